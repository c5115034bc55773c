# SPDX-License-Identifier: Apache-2.0
"""The startup barrier: the image source starts when every node has discovered its peers.

DDS discovery takes a second or two, and what is published before both ends have matched is lost: a
bag would begin in the middle, and could not be recomputed from its own images. Each process knows
only of the endpoints that it has discovered itself. So every node waits until it has discovered its
own publishers and subscribers, and then subscribes to `ready`; the image source compares the names
of the subscribers of `ready` with the nodes of its scene, for other participants may subscribe too.
"""

import os
import time
from collections.abc import Callable
from typing import Any

from eol_ros.ros.health_pipe import AGAIN
from eol_ros.ros.played import played
from eol_ros.streams.graph import TOPICS

WATCHED = tuple(topic.name for topic in TOPICS.values() if topic.barrier)
PICTURES = 'camera/image_raw', 'camera/camera_info'  # the recorder takes them where it is asked to
FELT = 'felt_slips', 'felt_triggers'  # a bag of a table without accelerometers has none
READY = 'ready'
SETTLE_S = 0.2  # after a restart of the source the others are still subscribed to `ready`
PATIENCE_S = 15.0  # then the source starts without the nodes that are missing
AGAIN_PATIENCE_S = 4.0  # where those run already: DDS has found them by then, or lost one
LOOK_S = 0.05


def endpoints_of(scene: Any, topic: str) -> tuple[set[str], set[str]]:
    """Return the nodes of `scene` that publish a topic and those that subscribe to it.

    Both are empty where either is. The panel subscribes as its viewers come and go, and is not
    waited for.
    """
    row = TOPICS[topic]
    publishers = set(row.sources) & set(scene.nodes)
    if 'replay' in publishers:
        topics = scene.nodes['replay'].topics or played(scene, True)
        if topic not in topics or topic in FELT:
            publishers.discard('replay')
    subscribers = set(row.subscribers) & set(scene.nodes) - {'panel', 'recorder'}
    recorder = scene.nodes.get('recorder')
    if recorder and (topic not in PICTURES or recorder.images in ('all', 'around_slips')):
        subscribers.add('recorder')
    return (publishers, subscribers) if publishers and subscribers else (set(), set())


class PeerDiscovery:
    """Whether a node has discovered the peers that it has by its scene."""

    def __init__(self, node: Any, clock: Callable[[], float] = time.monotonic):
        self._node, self._clock = node, clock
        self._subscribers, self._publishers = {}, {}
        for topic in WATCHED:
            publishers, subscribers = endpoints_of(node.scene, topic)
            if node.get_name() in publishers:
                self._subscribers[topic] = subscribers
            if node.get_name() in subscribers:
                self._publishers[topic] = publishers
        self._began_s = self._clock()
        self._patience_s = AGAIN_PATIENCE_S if os.environ.get(AGAIN) else PATIENCE_S

    def complete(self) -> bool:
        """Return whether all peers are discovered, or were waited for long enough."""
        return self._clock() - self._began_s > self._patience_s or not self.missing()

    def missing(self) -> list[str]:
        """Return the topics on which a peer has not been discovered yet."""
        return [
            topic
            for wanted, found in (
                (self._subscribers, self.subscribers),
                (self._publishers, self.publishers),
            )
            for topic, names in wanted.items()
            if names - found(topic)
        ]

    def subscribers(self, topic: str) -> set[str]:
        """Return the names of the nodes in this namespace that subscribe to `topic`."""
        return self._names(topic, self._node.get_subscriptions_info_by_topic)

    def publishers(self, topic: str) -> set[str]:
        """Return the names of the nodes in this namespace that publish `topic`."""
        return self._names(topic, self._node.get_publishers_info_by_topic)

    def _names(self, topic: str, ask: Any) -> set[str]:
        space = self._node.get_namespace()
        found = ask(self._node.resolve_topic_name(topic))
        return {end.node_name for end in found if end.node_namespace == space}


class StartupBarrier(PeerDiscovery):
    """What an image source waits for: that it and all other nodes have discovered their peers."""

    def __init__(self, node: Any, clock: Callable[[], float] = time.monotonic):
        super().__init__(node, clock)
        named = (names for topic in WATCHED for names in endpoints_of(node.scene, topic))
        self._others: set[str] = set().union(*named)
        self._others.discard(node.get_name())
        self._complete_s: float | None = None

    @property
    def expects(self) -> bool:
        """Return whether the scene has nodes to wait for."""
        return bool(self._others)

    def missing(self) -> list[str]:
        """Return the nodes that are not ready, and the topics on which this one is not."""
        return sorted(self._others - self.subscribers(READY)) + super().missing()

    def ready(self) -> bool:
        """Whether to begin."""
        now = self._clock()
        if now - self._began_s > self._patience_s:
            return True
        if self.missing():
            self._complete_s = None
            return False
        if self._complete_s is None:
            self._complete_s = now
        return not self._others or now - self._complete_s > SETTLE_S

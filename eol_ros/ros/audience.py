# SPDX-License-Identifier: Apache-2.0
"""Does everybody listen yet? A source that waits for its readers loses no first image.

DDS needs a second or two until writers and readers have found each other, and what is sent before
that is gone: a bag would begin in the middle, and could not be proved by its own images. Both ends
must know of the other, and each process knows only what it has found itself. So every node looks
whether it has met its own writers and readers, and says so by reading `ready`; the source looks who
does, and by what name, for others may look on.
"""

import time
from typing import Any

from eol_ros.ros.played import played
from eol_ros.ros.topics import TOPICS

WATCHED = ('camera/image_raw', 'blocks', 'slips', 'cascades', 'grain_triggers')
READY = 'ready'
SETTLE_S = 0.2  # a source that was started anew: the others were ready for the one before
PATIENCE_S = 15.0  # then the show begins without those who are missing
LOOK_S = 0.05


def parts(scene: Any, topic: str) -> tuple[set[str], set[str]]:
    """Return the nodes of `scene` that give a topic and those that take it, none if either is none.

    The panel comes and goes with its viewers: nobody waits for it.
    """
    row = TOPICS[topic]
    givers = {n for n in row.gives if n in scene.nodes and n != 'panel'}
    if 'replay' in givers and topic not in (scene.nodes['replay'].topics or played(scene, True)):
        givers.discard('replay')
    takers = {n for n in row.takes if n in scene.nodes and n not in ('panel', 'recorder')}
    recorder = scene.nodes.get('recorder')
    if recorder and (topic != WATCHED[0] or recorder.images in ('all', 'around_slips')):
        takers.add('recorder')
    return (givers, takers) if givers and takers else (set(), set())


class Meeting:
    """Whether a node has met those whom its scene has it write to and read from."""

    def __init__(self, node: Any):
        self._node = node
        self._readers, self._writers = {}, {}
        for topic in WATCHED:
            givers, takers = parts(node.scene, topic)
            if node.get_name() in givers:
                self._readers[topic] = takers
            if node.get_name() in takers:
                self._writers[topic] = givers
        self._began_s = time.monotonic()

    def over(self) -> bool:
        """Whether all were met, or whoever is missing was waited for long enough."""
        return time.monotonic() - self._began_s > PATIENCE_S or not self.missing()

    def missing(self) -> list[str]:
        """Return the topics on which somebody of the scene has not been met yet."""
        return [
            topic
            for wanted, found in ((self._readers, self.readers), (self._writers, self.writers))
            for topic, names in wanted.items()
            if names - found(topic)
        ]

    def readers(self, topic: str) -> set[str]:
        """Return the names of the nodes of the scene's namespace that read `topic`."""
        return self._names(topic, self._node.get_subscriptions_info_by_topic)

    def writers(self, topic: str) -> set[str]:
        """Return the same of those who write it."""
        return self._names(topic, self._node.get_publishers_info_by_topic)

    def _names(self, topic: str, ask: Any) -> set[str]:
        space = self._node.get_namespace()
        found = ask(self._node.resolve_topic_name(topic))
        return {end.node_name for end in found if end.node_namespace == space}


class Audience(Meeting):
    """What a source waits for: that it and all others have met whom they must."""

    def __init__(self, node: Any):
        super().__init__(node)
        named = (names for topic in WATCHED for names in parts(node.scene, topic))
        self._others: set[str] = set().union(*named)
        self._others.discard(node.get_name())
        self._complete_s: float | None = None

    @property
    def expects(self) -> bool:
        """Whether the scene names anybody to wait for."""
        return bool(self._others)

    def missing(self) -> list[str]:
        """Return the nodes that are not ready, and the topics on which this one is not."""
        return sorted(self._others - self.readers(READY)) + super().missing()

    def ready(self) -> bool:
        """Whether to begin."""
        now = time.monotonic()
        if now - self._began_s > PATIENCE_S:
            return True
        if self.missing():
            self._complete_s = None
            return False
        if self._complete_s is None:
            self._complete_s = now
        return not self._others or now - self._complete_s > SETTLE_S

# SPDX-License-Identifier: Apache-2.0
"""Does everybody listen yet? A source that waits for its readers loses no first image.

DDS needs a second or two until writers and readers have found each other, and what is sent before
that is gone: a bag would begin in the middle, and could not be proved by its own images.
"""

import time

from eol_ros.ros.topics import TOPICS

WATCHED = ('camera/image_raw', 'blocks', 'slips', 'cascades', 'grain_triggers')
SETTLE_S = 0.5  # when this process has found all readers, the others may still be about to
PATIENCE_S = 15.0  # then the show begins without those who are missing


class Audience:
    """The readers that a scene has, of the topics that its own nodes give."""

    def __init__(self, node):
        self._node = node
        scene = node.scene
        self._wanted = {}
        for topic in WATCHED:
            row = TOPICS[topic]
            takers = {t for t in row.takes if t in scene.nodes and t not in ('panel', 'recorder')}
            if 'recorder' in scene.nodes and (
                topic != 'camera/image_raw'
                or scene.nodes['recorder'].images in ('all', 'around_slips')
            ):
                takers.add('recorder')
            if takers and any(giver in scene.nodes for giver in row.gives):
                self._wanted[topic] = takers
        self._began_s = time.monotonic()
        self._complete_s: float | None = None

    def missing(self) -> list[str]:
        """Return the topics that not all nodes of the scene read yet, whoever else may look on."""
        return [topic for topic, takers in self._wanted.items() if takers - self._readers(topic)]

    def _readers(self, topic: str) -> set[str]:
        name, space = self._node.resolve_topic_name(topic), self._node.get_namespace()
        found = self._node.get_subscriptions_info_by_topic(name)
        return {reader.node_name for reader in found if reader.node_namespace == space}

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
        return not self._wanted or now - self._complete_s > SETTLE_S

# SPDX-License-Identifier: Apache-2.0
"""What of a bag a replay plays: what the nodes behind it need, and none of them makes itself."""

from collections.abc import Sequence
from typing import Any

from eol_ros.streams.graph import TOPICS

IMAGES, BLOCKS, TAPS, REQUESTS = 'camera/image_raw', 'blocks', 'block_taps', 'control'
INFO = 'camera/camera_info'
# Of that run's own processes, or made anew.
NEVER = ('ready', '/diagnostics', '/clock', 'sound_samples', 'rim_command')
KEPT = ('threshold', 'clutter')  # of what a tracker heeds: holds until the next such request
PEOPLE = ('sleep', 'wake', 'test')  # what is asked of the work, not of a machine or a room


def played(scene: Any, images: bool) -> list[str]:
    """Return the topics to play into `scene`; `images`: the bag has all of them.

    A topic is played when a node of the scene takes it and none gives it. The taps are played too:
    behind a replay the node leds gives none. A replay started by hand does not know the graph: it
    plays what a tracker takes, or where there are not all images, what comes behind the tracker.
    """
    nodes = set(scene.nodes) - {'replay', 'recorder'}
    if not nodes:
        return [INFO, IMAGES, TAPS, REQUESTS] if images else [BLOCKS, TAPS, REQUESTS]
    return [
        row.name
        for row in TOPICS.values()
        if row.name not in NEVER
        and nodes & set(row.subscribers)
        and (row.name in (TAPS, REQUESTS) or not nodes & set(row.publishers) - {'panel'})
    ]


def ahead(said: Sequence[tuple[int, Any, bytes]], start_ns: int) -> list[bytes]:
    """Return what a tracker said that it heeds, to be told before the first image.

    said: recording time in ns, Control and its bytes. Of what was asked before `start_ns` of the
    recording only what still held then is told, once a key.
    """
    mine = [(log, m, raw) for log, m, raw in said if m.source == m.target == 'tracker']
    before = {m.key: raw for log, m, raw in mine if log < start_ns and m.key in KEPT}
    return list(before.values()) + [raw for log, _, raw in mine if log >= start_ns]


def for_all(control: Any) -> bool:
    """Return whether a recorded request is one to be heeded again when its time comes.

    What the tracker heeds is told ahead, with the stamp from which it counts. What concerned files,
    lamps and the room of that day does not concern those of today.
    """
    return control.command in PEOPLE

# SPDX-License-Identifier: Apache-2.0
"""What of a bag a replay plays: what the nodes behind it need, and none of them makes itself."""

from typing import Any

from eol_ros.streams.graph import TOPICS

IMAGES, BLOCKS, TAPS, REQUESTS = 'camera/image_raw', 'blocks', 'block_taps', 'requests'
INFO = 'camera/camera_info'
# Of that run's own processes: of today's there are some, too. Not even `--only all` plays them.
OF_PROCESSES = (
    'ready',
    'node_states',
    'work_state',
    '/diagnostics',
    '/clock',
    '/rosout',
    '/parameter_events',
)
# Nor what is made again.
NEVER = (*OF_PROCESSES, 'sound_samples', 'markers', 'block_poses', 'rim_command', 'request_results')


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
        and (row.name in (TAPS, REQUESTS) or not nodes & set(row.sources))
    ]

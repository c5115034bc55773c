# SPDX-License-Identifier: Apache-2.0
"""The streams that pages can ask for: which topic, and how its messages become packets."""

import time
from typing import Any

import numpy as np

from eol_ros.streams import blocks, slips, triggers
from eol_ros.streams.record import seconds
from eol_ros.web import notices, wire
from eol_ros.web.hub import Hub

LINGER_S = 5.0  # a stream ends so late: a page that is loaded again finds it still there


def _blocks(message: blocks.Blocks) -> bytes:
    return wire.blocks(message.stamp_s, message.state, message.symmetry_ambiguous, message.rows)


# channel: topic, packet for the pages
STREAMS = {
    'blocks': ('blocks', _blocks),
    'truth': ('truth', lambda m: wire.truth(
        seconds(m.header.stamp), (m.rim_x, m.rim_y, m.rim_yaw), np.array([m.x, m.y, m.yaw]),
        m.moving)),
    'image': ('camera/image_raw/compressed', lambda m: wire.image(
        seconds(m.header.stamp), m.data)),
    'meter': ('sound_meter', lambda m: wire.meter(
        seconds(m.header.stamp), m.wave_min, m.wave_max, m.spectrum_db, notices.meter(m))),
    'sound': ('sound_samples', lambda m: wire.sound(
        seconds(m.header.stamp), m.sample_rate, m.channels, m.first, m.samples)),
    'leds': ('led_commands', lambda m: wire.leds(
        seconds(m.header.stamp), m.white, m.infrared)),
    'slips': ('slips', slips.to_json),
    'triggers': ('grain_triggers', triggers.to_json),
}  # fmt: skip


class Streams:
    """The subscriptions of a node to what somebody looks at, and to nothing else."""

    def __init__(self, node: Any, hub: Hub):
        self._node, self._hub = node, hub
        self._open: dict[str, Any] = {}
        self._wanted_s: dict[str, float] = {}
        hub.on_demand = self._ask

    def _ask(self) -> None:
        """Called in the server's thread: let the executor follow."""
        if self._node.executor is not None:
            self._node.executor.create_task(self.follow)

    def follow(self) -> None:
        """Open the streams that somebody looks at, close the others; the executor's thread."""
        demand, now_s = self._hub.demand, time.monotonic()
        for channel in demand - set(self._open):
            topic, packet = STREAMS[channel]
            self._open[channel] = self._node.subscribe(
                topic, lambda packed, c=channel: self._hub.put(c, packed), read=packet
            )
        self._wanted_s.update(dict.fromkeys(demand, now_s))
        for channel in [c for c in self._open if now_s - self._wanted_s[c] > LINGER_S]:
            self._node.destroy_subscription(self._open.pop(channel))

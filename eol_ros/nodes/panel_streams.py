# SPDX-License-Identifier: Apache-2.0
"""The streams that pages can ask for: which topic, and how its messages become packets."""

import numpy as np

from eol_ros.ros.blocks import blocks_from_cdr
from eol_ros.web import notices, wire


def _blocks(message) -> bytes:
    return wire.blocks(
        message.stamp_ns * 1e-9, message.state, message.symmetry_ambiguous, message.blocks
    )


# channel: topic, whether it is handed over as CDR bytes, packet for the pages
STREAMS = {
    'blocks': ('blocks', True, lambda raw: _blocks(blocks_from_cdr(raw))),
    'truth': ('truth', False, lambda m: wire.truth(
        notices.seconds(m.header.stamp), (m.rim_x, m.rim_y, m.rim_yaw), np.array([m.x, m.y, m.yaw]),
        m.moving)),
    'image': ('camera/image/compressed', False, lambda m: wire.image(
        notices.seconds(m.header.stamp), m.data)),
    'meter': ('sound_meter', False, lambda m: wire.meter(
        notices.seconds(m.header.stamp), m.wave_min, m.wave_max, m.spectrum_db, notices.meter(m))),
    'sound': ('sound_samples', False, lambda m: wire.sound(
        notices.seconds(m.header.stamp), m.sample_rate, m.channels, m.first, m.data)),
    'leds': ('led_commands', False, lambda m: wire.leds(
        notices.seconds(m.header.stamp), m.white, m.infrared)),
    'slips': ('slips', False, lambda m: wire.text(notices.slip(m))),
    'triggers': ('grain_triggers', False, lambda m: wire.text(notices.trigger(m))),
}  # fmt: skip

# SPDX-License-Identifier: Apache-2.0
"""Settings of grains and sound with one voice a trigger: no ambience, no size of a cascade."""

from eol_ros.settings import GrainsSettings, SoundSettings

GRAINS = GrainsSettings(radius=0.07, ambience_rate=0.0)
SOUND = SoundSettings(
    rate_scaling=0.0, corner_hz=0.0, low_corner_hz=0.0, gain_db=-4.0, dynamics_db=0.0,
    onset_duck_db=0.0, sub_db=-90.0, room_s=0.0, room_db=-6.0,
)  # fmt: skip

# SPDX-License-Identifier: Apache-2.0
"""Grains to be played: eol_msgs/GrainTrigger, from the selection to the mixer."""

from typing import Any

import numpy as np

from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.streams.record import Record, seconds

NO_BLOCK = 255  # `block` of a trigger that no block caused; core says -1
DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('sequence', 'u4'), ('grain', 'u4'), ('block', 'u1'), ('gain', 'f4'),
     ('rate', 'f4'), ('pan', 'f4'), ('attack', 'f4'), ('release', 'f4')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/GrainTrigger', DTYPE, 'table')
_GREATEST = int(np.iinfo(TRIGGER['grain']).max)


def of(stamp_ns: int, sequence: int, trigger: np.void) -> Any:
    """Return the row of one TRIGGER; the stamp is that of the image, unchanged."""
    _, grain, gain, rate, pan, attack, release, block = trigger.item()
    block = NO_BLOCK if block < 0 else block
    return RECORD.row(stamp_ns, sequence, grain, block, gain, rate, pan, attack, release)


def of_knock(stamp_ns: int, sequence: int, trigger: np.void) -> Any:
    """Return the row of one TRIGGER of a knock at `stamp_ns`; its stamp is when it may sound."""
    wait_ns = round((float(trigger['time_s']) - stamp_ns * 1e-9) * 1e9)
    return of(stamp_ns + wait_ns, sequence, trigger)


def of_person(stamp_ns: int, sequence: int, grain: int) -> Any:
    """Return the row of a grain that a person wants to hear; such have a sequence of their own."""
    return RECORD.row(stamp_ns, sequence, grain, NO_BLOCK, 1.0, 1.0, 0.0, 0.005, 0.02)


def to_core(row: Any, time_s: float) -> tuple[float | int, ...]:
    """Return the values of one TRIGGER at `time_s` on the mixer's axis, from a row or a message."""
    block = -1 if row.block == NO_BLOCK else row.block
    grain = min(row.grain, _GREATEST)  # so many are in no corpus
    return time_s, grain, row.gain, row.rate, row.pan, row.attack, row.release, block


def to_json(message: Any) -> dict[str, Any]:
    """Return a GrainTrigger message as pages read it."""
    return {
        't': 'trigger', 'grain': message.grain, 'block': message.block, 'gain': message.gain,
        'stamp': seconds(message.header.stamp),
    }  # fmt: skip

# SPDX-License-Identifier: Apache-2.0
import math

from eol_ros.core.sound.midi_notes import HELD_S, Notes


def test_slips_and_cascades_are_notes():
    notes = Notes(36, 0.5, 25)
    assert notes.starts(3, 0.25) == (0x90, 39, 64)
    assert notes.starts(0, 5.0) == (0x90, 36, 127)
    assert notes.starts(0, 0.0) == (0x90, 36, 1)  # 0 would be note off
    assert notes.stops(3) == (0x80, 39, 0)
    assert notes.cascade(24, 25, 1.0) == (0x91, 60, 127)
    assert notes.cascade(2, 5, 1.0 + HELD_S / 2) == (0x91, 38, 25)
    assert notes.over(1.0) == []
    assert notes.over(1.0 + HELD_S) == [(0x81, 60, 0)]
    assert notes.over(9.0) == [(0x81, 38, 0)] and notes.over(9.0) == []
    assert notes.silence() == [(0xB0, 123, 0), (0xB1, 123, 0)]


def test_stress_is_poly_pressure_where_it_changes():
    notes = Notes(36, 0.5, 25)
    assert notes.stress([0.0, 0.5, math.nan, 7.0]) == [
        (0xA0, 36, 0), (0xA0, 37, 64), (0xA0, 39, 127)
    ]  # fmt: skip
    assert notes.stress([0.003, 0.51, 0.0, math.nan]) == [(0xA0, 37, 65), (0xA0, 38, 0)]


def test_every_block_of_the_largest_table_has_a_note():
    for lowest in (0, 36, 127):
        notes = Notes(lowest, 0.5, 225)
        found = [notes.starts(block, 0.1)[1] for block in range(225)]
        assert set(found) == set(range(lowest, 128))
        assert found[: 128 - lowest] == list(range(lowest, 128))

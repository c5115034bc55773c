# SPDX-License-Identifier: Apache-2.0
"""Slips and cascades as MIDI notes: of each block one note, which sounds while the block slides.

Messages are those of MIDI 1.0 (MMA, 1996): note on (0x90), note off (0x80), all notes off (0xB0,
123), poly pressure (0xA0), clock (0xF8, 24 a beat), start (0xFA).
"""

from collections.abc import Iterable

SLIPS, CASCADES = 0, 1  # channels; people count them from 1
ON, OFF, PRESSURE, CONTROL, ALL_OFF = 0x90, 0x80, 0xA0, 0xB0, 123
CLOCK, START, CLOCKS = (0xF8,), (0xFA,), 24  # clocks a beat
LOUDEST = 127
HELD_S = 0.1  # for which the note of a cascade sounds (chosen)

Message = tuple[int, ...]


class Notes:
    """Feed it slips and cascades; it returns messages. `blocks` is the number on the table."""

    def __init__(self, lowest: int, fastest_mps: float, blocks: int):
        self._lowest, self._fastest_mps, self._blocks = lowest, fastest_mps, blocks
        self._held: dict[int, float] = {}  # notes of cascades, and until when
        self._pressed: dict[int, int] = {}  # blocks, and the pressure that was sent

    def starts(self, block: int, speed_mps: float) -> Message:
        """Return the note of a slip that starts."""
        return ON | SLIPS, self._note(block), self._velocity(speed_mps / self._fastest_mps)

    def stops(self, block: int) -> Message:
        """Return the end of a slip's note."""
        return OFF | SLIPS, self._note(block), 0

    def stress(self, stress: Iterable[float]) -> list[Message]:
        """Return the pressure of each block's note that changes; 127: friction at its limit."""
        found = {
            block: round(LOUDEST * min(share, 1.0))
            for block, share in enumerate(stress)
            if share == share  # not NaN: it is known
        }
        changed = found.items() - self._pressed.items()
        self._pressed |= found
        return [(PRESSURE | SLIPS, self._note(block), value) for block, value in sorted(changed)]

    def forget(self) -> None:
        """Send every pressure again: another instrument listens."""
        self._pressed.clear()

    def cascade(self, nucleus: int, area: int, now_s: float) -> Message:
        """Return the note of a cascade, by the block of its first slip and its area."""
        note = self._note(nucleus)
        self._held[note] = now_s + HELD_S
        return ON | CASCADES, note, self._velocity(area / self._blocks)

    def over(self, now_s: float) -> list[Message]:
        """Return the ends of the notes of cascades that have sounded long enough."""
        ended = [note for note, until_s in self._held.items() if now_s >= until_s]
        for note in ended:
            del self._held[note]
        return [(OFF | CASCADES, note, 0) for note in ended]

    @staticmethod
    def silence() -> list[Message]:
        """Return what ends all notes."""
        return [(CONTROL | channel, ALL_OFF, 0) for channel in (SLIPS, CASCADES)]

    def _note(self, block: int) -> int:
        return self._lowest + block % (LOUDEST + 1 - self._lowest)

    @staticmethod
    def _velocity(share: float) -> int:
        return max(1, round(LOUDEST * min(share, 1.0)))  # with velocity 0 it would be off

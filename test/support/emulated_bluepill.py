# SPDX-License-Identifier: Apache-2.0
"""The bridge of docs/build in emulation, with what only tests do to it."""

import ctypes
import subprocess
from functools import cache
from typing import NamedTuple

from eol_ros.devices.board import bluepill
from support.emulated import built

TO_BLOCKS = bytes.fromhex('C24C6F45B1')  # firmware/link.h
LOW, HIGH, NO_CE, NO_IRQ, POWER = 1, 2, 3, 4, -1  # faults of the radio


class Counts(NamedTuple):
    """As `counts` in firmware/emulator/bluepill.c."""

    cycles: int
    resets: int
    strange: int
    lost: int
    stack: int
    asleep: int


@cache
def symbol(name: str) -> int:
    """Return the address of a function or variable of the firmware."""
    lines = subprocess.run(
        ['arm-none-eabi-nm', str(built() / 'bluepill.elf')],
        check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    return int(next(line.split()[0] for line in lines if line.split()[-1] == name), 16)


class BluePill(bluepill.BluePill):
    """A bridge that has power since 0 us."""

    def __init__(self) -> None:
        built()
        super().__init__()

    def __enter__(self) -> 'BluePill':
        return self

    def __exit__(self, *_: object) -> None:
        self.free()

    @property
    def lit(self) -> bool:
        """Whether its LED shines."""
        return bool(self._lib.bluepill_lit(self._memory))

    def break_radio(self, fault: int) -> None:
        """LOW or HIGH: MISO stays so, as without a chip; NO_CE, NO_IRQ; 0: well; POWER: a dip."""
        self._lib.bluepill_radio_fault(self._memory, fault)

    def reset(self) -> None:
        """Push its button."""
        self._lib.bluepill_reset(self._memory)

    def hang(self) -> None:
        """Let the processor run in an endless loop."""
        self._lib.bluepill_jump(self._memory, symbol('on_fault'))

    @property
    def counts(self) -> Counts:
        """Return all counters."""
        room = (ctypes.c_uint64 * len(Counts._fields))()
        self._lib.bluepill_counts(self._memory, room)
        return Counts(*room)

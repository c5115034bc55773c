# SPDX-License-Identifier: Apache-2.0
"""One block in emulation: firmware/emulator/block.c, loaded with ctypes; times in cycles."""

import ctypes
import subprocess
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

FIRMWARE = Path(__file__).parents[2] / 'firmware'
HZ, RATE_HZ = 8_000_000, 1344.0
MS = HZ // 1000
FRAME, KNOCK = 18, 0x4B  # firmware/link.h
LEVEL, INFRARED, SENT = 1, 2, 3  # of an event
WORD, FEELS, LIT, STATUS, TESTED = 0x57, 0x46, 0x4C, 0x53, 0x54
RUNS, SLEEPS = 2, 3


class EmulatorEvent(ctypes.Structure):
    """As in firmware/emulator/block.c: when, in cycles, what, and its value or its frame."""

    _fields_ = [
        ('cycle', ctypes.c_uint64),
        ('what', ctypes.c_uint32),
        ('value', ctypes.c_uint32),
        ('frame', ctypes.c_uint8 * FRAME),
        ('pad', ctypes.c_uint8 * 6),
    ]


class Event(NamedTuple):
    """What was seen from outside: when, what, and its value or the frame that was sent."""

    cycle: int
    what: int
    value: int
    frame: bytes


class Counts(NamedTuple):
    """See emulator_counts."""

    asleep: int
    power_down: int
    read: int
    lost: int
    strange: int
    ram: int
    pc: int
    infrared: int
    level: int


@cache
def built() -> Path:
    """Build firmware and emulator, without a warning; return the folder."""
    subprocess.run(['make', '-s', 'all', 'emulator'], cwd=FIRMWARE, check=True, capture_output=True)
    return FIRMWARE / 'build'


@cache
def _library() -> ctypes.CDLL:
    lib = ctypes.CDLL(str(built() / 'emulator.so'))
    memory, u64 = ctypes.c_void_p, ctypes.c_uint64
    lib.emulator_new.restype = memory
    lib.emulator_new.argtypes = [ctypes.c_char_p, ctypes.c_uint32, ctypes.c_uint8]
    lib.emulator_free.argtypes = lib.emulator_reset.argtypes = lib.emulator_cycle.argtypes = [
        memory
    ]
    lib.emulator_cycle.restype = u64
    lib.emulator_samples.argtypes = [memory, memory, u64, ctypes.c_double, ctypes.c_double]
    lib.emulator_run.argtypes = [memory, u64]
    lib.emulator_radio.argtypes = [memory, ctypes.c_char_p]
    lib.emulator_answered.argtypes = [memory]
    lib.emulator_hears.argtypes = [memory, memory]
    lib.emulator_radio_fault.argtypes = [memory, ctypes.c_int]
    lib.emulator_set.argtypes = [memory, ctypes.c_int, ctypes.c_int]
    lib.emulator_break.argtypes = [memory, ctypes.c_int]
    lib.emulator_hang.argtypes = [memory, ctypes.c_int]
    lib.emulator_events.argtypes = [memory, memory, ctypes.c_int]
    lib.emulator_counts.argtypes = [memory, memory]
    lib.emulator_memory.argtypes = [memory, ctypes.c_uint32, memory, ctypes.c_uint32]
    return lib


def symbol(name: str) -> int:
    """Return the address in RAM of a variable of the firmware."""
    lines = subprocess.run(
        ['avr-nm', str(built() / 'block.elf')], check=True, capture_output=True, text=True
    ).stdout.splitlines()
    found = [line.split()[0] for line in lines if line.split()[-1].split('.')[0] == name]
    return int(found[0], 16) & 0xFFFF


class Block:
    """A block that has power since cycle 0."""

    def __init__(self, number: int = 7):
        code = (built() / 'block.bin').read_bytes()
        self._lib = _library()
        self._memory = self._lib.emulator_new(code, len(code), number)
        self._room = (EmulatorEvent * 4096)()
        self._samples = np.zeros((0, 2), np.int16)

    def __enter__(self) -> 'Block':
        return self

    def __exit__(self, *_: object) -> None:
        self._lib.emulator_free(self._memory)

    @property
    def cycle(self) -> int:
        """How many have passed."""
        return self._lib.emulator_cycle(self._memory)

    def feel(self, samples: np.ndarray, first: float | None = None) -> float:
        """Let the sensor take samples (n, 2), 1/16 mg, from cycle `first` on.

        Returns the cycle of the last one's end.
        """
        first = self.cycle + HZ / RATE_HZ if first is None else first
        self._samples = np.ascontiguousarray(samples, np.int16)
        self._lib.emulator_samples(
            self._memory, self._samples.ctypes.data, len(samples), first, HZ / RATE_HZ
        )
        return first + (len(samples) - 1) * HZ / RATE_HZ

    def run(self, cycles: float) -> list[Event]:
        """Go on for so many cycles; return what was seen."""
        found, until = [], self.cycle + round(cycles)
        while self.cycle < until:
            state = self._lib.emulator_run(self._memory, min(until, self.cycle + 20 * MS))
            assert state in (RUNS, SLEEPS), f'the core is in state {state} at {self.counts.pc:#x}'
            found += self.events()
        return found

    def events(self) -> list[Event]:
        """Return what was seen since the last call."""
        count = self._lib.emulator_events(self._memory, self._room, len(self._room))
        return [
            Event(e.cycle, e.what, e.value, bytes(e.frame) if e.what == SENT else b'')
            for e in self._room[:count]
        ]

    def hear(self, frame: bytes) -> bool:
        """The bridge sends; return whether the radio of the block took it."""
        assert len(frame) == FRAME
        return bool(self._lib.emulator_radio(self._memory, frame))

    def hears(self, packet: ctypes.Structure) -> bool:
        """A packet ends now, or has ended; return whether its radio took it."""
        return bool(self._lib.emulator_hears(self._memory, ctypes.byref(packet)))

    def break_radio(self, fault: int) -> None:
        """See support/emulated_bluepill.py."""
        self._lib.emulator_radio_fault(self._memory, fault)

    def acknowledged(self) -> None:
        """The acknowledgement of what it has sent is there."""
        self._lib.emulator_answered(self._memory)

    def surround(self, acknowledged: bool = True, dead_bus: bool = False) -> None:
        """Whether the bridge acknowledges, and whether the sensor is gone."""
        self._lib.emulator_set(self._memory, acknowledged, dead_bus)

    def break_parts(self, broken: int) -> None:
        """Let the sensor stick (1), LEDs be open (white 2, infrared 4), white stay dark (8)."""
        self._lib.emulator_break(self._memory, broken)

    def hang(self, interrupts: bool) -> None:
        """Let the processor run in an endless loop."""
        self._lib.emulator_hang(self._memory, interrupts)

    def reset(self) -> None:
        """Pull its reset line."""
        self._lib.emulator_reset(self._memory)

    @property
    def counts(self) -> Counts:
        """Return all counters."""
        room = (ctypes.c_uint64 * len(Counts._fields))()
        self._lib.emulator_counts(self._memory, room)
        return Counts(*room)

    def memory(self, at: int, count: int) -> bytes:
        """Return bytes of its RAM."""
        room = ctypes.create_string_buffer(count)
        self._lib.emulator_memory(self._memory, at, room, count)
        return room.raw

# SPDX-License-Identifier: Apache-2.0
"""The bridge of docs/build in emulation: its program on an STM32F103 with an nRF24L01+, by ctypes.

It advances in us of its own time (firmware/emulator/bluepill.c).
"""

import ctypes
import subprocess
from functools import cache
from typing import NamedTuple

from support.emulated import FRAME, built

TO_BRIDGE, TO_BLOCKS = map(bytes.fromhex, ('E74C6F45B1', 'C24C6F45B1'))  # firmware/link.h
LOW, HIGH, NO_CE, NO_IRQ, POWER = 1, 2, 3, 4, -1  # faults of the radio
CHANNEL, SETUP = 76, 0x0C  # 1 Mbit/s, checksum of 16 bits
AIR_US, ANSWER_US = 217, 203  # of a packet and of its acknowledgement


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


class Packet(ctypes.Structure):
    """As radio_packet in firmware/emulator/radio.h."""

    _fields_ = [
        ('begin_ns', ctypes.c_uint64),
        ('end_ns', ctypes.c_uint64),
        ('address', ctypes.c_uint8 * 5),
        ('channel', ctypes.c_uint8),
        ('setup', ctypes.c_uint8),
        ('size', ctypes.c_uint8),
        ('number', ctypes.c_uint8),
        ('unanswered', ctypes.c_uint8),
        ('bytes', ctypes.c_uint8 * 32),
    ]

    @property
    def frame(self) -> bytes:
        """The frame in the packet."""
        return bytes(self.bytes[: self.size])


def packet(frame: bytes, end_us: float, number: int = 0) -> Packet:
    """Return `frame` as a block's radio sends it, so that its end is at `end_us`."""
    end_ns = round(end_us * 1000)
    return Packet(
        end_ns - AIR_US * 1000, end_ns, (ctypes.c_uint8 * 5)(*TO_BRIDGE), CHANNEL, SETUP, FRAME,
        number, 0, (ctypes.c_uint8 * 32)(*frame),
    )  # fmt: skip


@cache
def library() -> ctypes.CDLL:
    """Return the built emulator."""
    lib = ctypes.CDLL(str(built() / 'bluepill.so'))
    memory, u32, u64 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
    lib.bluepill_new.restype = memory
    lib.bluepill_new.argtypes = [ctypes.c_char_p, u32]
    for name in ('free', 'reset', 'answered', 'lit'):
        getattr(lib, f'bluepill_{name}').argtypes = [memory]
    lib.bluepill_run.argtypes = [memory, u64]
    lib.bluepill_run.restype = None
    lib.bluepill_write.argtypes = lib.bluepill_read.argtypes = [memory, ctypes.c_char_p, u32]
    lib.bluepill_sent.argtypes = [memory, ctypes.POINTER(Packet), u32]
    lib.bluepill_hears.argtypes = [memory, ctypes.POINTER(Packet)]
    lib.bluepill_radio_fault.argtypes = [memory, ctypes.c_int]
    lib.bluepill_jump.argtypes = [memory, u32]
    lib.bluepill_counts.argtypes = [memory, memory]
    return lib


class BluePill:
    """A bridge that has power since 0 us."""

    def __init__(self) -> None:
        code = (built() / 'bluepill.bin').read_bytes()
        self._lib = library()
        self._memory = self._lib.bluepill_new(code, len(code))
        assert self._memory, 'Unicorn cannot be started'
        self._sent, self._room = (Packet * 4096)(), ctypes.create_string_buffer(65536)
        self.now_us = 0

    def free(self) -> None:
        """Cut its power."""
        self._lib.bluepill_free(self._memory)

    def run(self, us: float) -> list[Packet]:
        """Advance by `us`; return the packets that its radio has sent."""
        self.now_us += round(us)
        self._lib.bluepill_run(self._memory, self.now_us)
        count = self._lib.bluepill_sent(self._memory, self._sent, len(self._sent))
        return [Packet.from_buffer_copy(one) for one in self._sent[:count]]

    def write(self, data: bytes) -> int:
        """Send bytes of the host; return how many found room."""
        return self._lib.bluepill_write(self._memory, data, len(data))

    def read(self) -> bytes:
        """Return the bytes for the host since the last call."""
        count = self._lib.bluepill_read(self._memory, self._room, len(self._room))
        return self._room.raw[:count]

    def hears(self, one: Packet) -> bool:
        """A packet ends now, or has ended; return whether its radio took it."""
        return bool(self._lib.bluepill_hears(self._memory, one))

    @property
    def answered(self) -> bool:
        """Whether the acknowledgement of the last packet that it took has gone out."""
        return bool(self._lib.bluepill_answered(self._memory))

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

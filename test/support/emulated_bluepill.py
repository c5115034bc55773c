# SPDX-License-Identifier: Apache-2.0
"""The bridge of docs/build in emulation: firmware/emulator/bluepill.c, loaded with ctypes.

`BluePill` goes on when it is told to, in us of its own time. `LiveBluePill` follows the clock, with
a pty for its host line; it is used as support/emulated_bridge.py's Bridge is.
"""

import contextlib
import ctypes
import os
import random
import subprocess
import threading
import time
import tty
from collections import deque
from functools import cache
from typing import NamedTuple

from eol_ros.devices.board.firmware import FRAME
from support.emulated import built

TO_BRIDGE, TO_BLOCKS = bytes.fromhex('E74C6F45B1'), bytes.fromhex('C24C6F45B1')  # firmware/link.h
CHANNEL, SETUP = 76, 0x0C  # 1 Mbit/s, checksum of 16 bits
AIR_US, ANSWER_US = 217, 203
LOW, HIGH, NO_CE, NO_IRQ, POWER = 1, 2, 3, 4, -1  # faults of the radio
TURN_S = 5e-4
TRIES = 12


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
        """What it carries."""
        return bytes(self.bytes[: self.size])


def packet(frame: bytes, end_us: float, number: int = 0, address: bytes = TO_BRIDGE) -> Packet:
    """Return `frame` as a block's radio sends it, so that its end is at `end_us`."""
    end_ns = round(end_us * 1000)
    return Packet(
        end_ns - AIR_US * 1000, end_ns, (ctypes.c_uint8 * 5)(*address), CHANNEL, SETUP, FRAME,
        number, 0, (ctypes.c_uint8 * 32)(*frame),
    )  # fmt: skip


class Counts(NamedTuple):
    """As `counts` in firmware/emulator/bluepill.c."""

    cycles: int
    resets: int
    strange: int
    lost: int
    stack: int
    asleep: int


@cache
def library() -> ctypes.CDLL:
    """Load the emulator, built."""
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


@cache
def symbol(name: str) -> int:
    """Return the address of a function or variable of the firmware."""
    lines = subprocess.run(
        ['arm-none-eabi-nm', str(built() / 'bluepill.elf')],
        check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    return int(next(line.split()[0] for line in lines if line.split()[-1] == name), 16)


class BluePill:
    """A bridge that has power since 0 us."""

    def __init__(self) -> None:
        code = (built() / 'bluepill.bin').read_bytes()
        self._lib = library()
        self._memory = self._lib.bluepill_new(code, len(code))
        assert self._memory, 'Unicorn cannot be started'
        self._sent, self._room = (Packet * 4096)(), ctypes.create_string_buffer(65536)
        self.now_us = 0

    def __enter__(self) -> 'BluePill':
        return self

    def __exit__(self, *_: object) -> None:
        self.free()

    def free(self) -> None:
        """Cut its power."""
        self._lib.bluepill_free(self._memory)

    def run(self, us: float) -> list[Packet]:
        """Go on; return what its radio has sent."""
        self.now_us += round(us)
        self._lib.bluepill_run(self._memory, self.now_us)
        count = self._lib.bluepill_sent(self._memory, self._sent, len(self._sent))
        return [Packet.from_buffer_copy(one) for one in self._sent[:count]]

    def write(self, data: bytes) -> int:
        """The host sends; return how many bytes found room."""
        return self._lib.bluepill_write(self._memory, data, len(data))

    def read(self) -> bytes:
        """Return what the host has heard since the last call."""
        count = self._lib.bluepill_read(self._memory, self._room, len(self._room))
        return self._room.raw[:count]

    def hears(self, one: Packet) -> bool:
        """A packet ends now, or has ended; return whether its radio took it."""
        return bool(self._lib.bluepill_hears(self._memory, one))

    @property
    def answered(self) -> bool:
        """Whether the acknowledgement of the last packet that it took has gone out."""
        return bool(self._lib.bluepill_answered(self._memory))

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


class LiveBluePill:
    """A bridge that follows the clock. `port` is the pty of its host line."""

    def __init__(self) -> None:
        self._pill = BluePill()
        self._fd, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._fd, False)
        self.port = os.ttyname(self._slave)
        self._frames: deque[bytes] = deque(maxlen=10_000)
        self._said: deque[tuple[float, int, int, bytes]] = deque()  # due, tries, number
        self._number, self._random = 0, random.Random(4)
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name='bluepill', daemon=True)
        self._thread.start()

    def __enter__(self) -> 'LiveBluePill':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cut its power."""
        self._stop.set()
        self._thread.join()
        os.close(self._fd)
        os.close(self._slave)
        self._pill.free()

    def say(self, frame: bytes) -> None:
        """A block sends, and sends again as often as a block does until it is acknowledged."""
        with self._lock:
            self._number = (self._number + 1) & 3
            self._said.append((0.0, TRIES, self._number, frame.ljust(FRAME, b'\0')))

    def noise(self, data: bytes) -> None:
        """Packets with a good checksum and anything in them."""
        for at in range(0, len(data), FRAME):
            self.say(data[at : at + FRAME])

    def sent(self, seconds: float) -> list[bytes]:
        """Return the frames that it has sent since the last call, and within some time."""
        time.sleep(seconds)
        found = []
        while self._frames:
            found.append(self._frames.popleft())
        return found

    def monitor(self, command: str) -> None:
        """Push its button: `system_reset`."""
        assert command == 'system_reset'
        with self._lock:
            self._pill.reset()

    def hang(self) -> None:
        """Let the processor run in an endless loop."""
        with self._lock:
            self._pill.hang()

    def break_radio(self, fault: int) -> None:
        """As of BluePill."""
        with self._lock:
            self._pill.break_radio(fault)

    @property
    def counts(self) -> Counts:
        """As of BluePill."""
        with self._lock:
            return self._pill.counts

    def _run(self) -> None:
        ahead_s = time.monotonic()
        while not self._stop.wait(TURN_S):
            until_us = (time.monotonic() - ahead_s) * 1e6
            if until_us - self._pill.now_us > 2e5:  # the machine stood still
                ahead_s = time.monotonic() - self._pill.now_us * 1e-6
                continue
            while self._pill.now_us < until_us:
                with self._lock:
                    self._turn()

    def _turn(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._pill.write(os.read(self._fd, 4096))
        due_us, tries, number, frame = self._said[0] if self._said else (float('inf'), 0, 0, b'')
        if due_us <= self._pill.now_us:
            self._said.popleft()
            self._go(AIR_US)
            took = self._pill.hears(packet(frame, self._pill.now_us, number))
            self._go(ANSWER_US + 20)
            if not (took and self._pill.answered) and tries > 1:
                again_us = self._pill.now_us + self._random.randint(1, 4) * 1000
                self._said.appendleft((again_us, tries - 1, number, frame))
        else:
            self._go(TURN_S * 1e6)

    def _go(self, us: float) -> None:
        self._frames.extend(one.frame for one in self._pill.run(us))
        data = self._pill.read()
        with contextlib.suppress(BlockingIOError):
            while data:
                data = data[os.write(self._fd, data) :]

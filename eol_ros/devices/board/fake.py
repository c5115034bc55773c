# SPDX-License-Identifier: Apache-2.0
"""A board made of software: it speaks the protocol of docs/reference/serial.md.

It emulates the bridge, with blocks that flash by themselves. The twin's rehearsal runs on it.
It keeps its own clock, which neither agrees with the host's nor runs at quite its rate.
"""

import contextlib
import errno
import os
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.light.bridge import Bridge
from eol_ros.core.light.local import FIELD, FIELD_OF_VIEW, OFF
from eol_ros.core.table import Table
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.rounds import Rounds
from eol_ros.disk import check_file
from eol_ros.errors import writing
from eol_ros.said import said

TABLE = said('simulated_table')  # the port of a bridge that a twin plays
MILLIVOLTS, CELSIUS = 3900, 24  # of the battery of a block that has one
CLOCK_US, CLOCK_RATE = 4_200_000_000, 30e-6  # at the start; excess over the host's rate


class Arrival(NamedTuple):
    """One packet that came in: when (system time), what, its number, the stamp that it carried."""

    time_ns: int
    kind: str
    sequence: int
    stamp_us: int


def latency_s(arrival: Arrival) -> float:
    """Return the time from the image's stamp to the packet's arrival, up to 35 minutes."""
    late = arrival.time_ns // 1000 - arrival.stamp_us
    return ((late + 2**31) % 2**32 - 2**31) * 1e-6


def obey(bridge: Bridge, now_s: float, message: protocol.Message) -> None:
    """Let `bridge` do what the host says."""
    if isinstance(message, protocol.Lighting):
        flags = message.flags
        limit = FIELD_OF_VIEW if flags & protocol.EACH_FIELD else FIELD
        limit = limit if flags & protocol.LIMITED else OFF
        by_itself = bool(flags & protocol.BY_ITSELF)
        bridge.configure(now_s, by_itself, limit, message.peak / 255, message.decay_ms * 1e-3)
    elif isinstance(message, protocol.Light):
        bridge.light(now_s, message.mask)
    elif isinstance(message, protocol.DimLight):
        bridge.light(now_s, message.mask, message.share / protocol.SHARES)


class FakeBoard:
    """A board on a line within this process, which `open_line` opens: faster than a pty.

    `on_message` is called in the board's thread with each received message and its arrival.
    `log_file`: CSV file of all arrivals.
    """

    def __init__(
        self,
        name: str = 'fake',
        on_message: Callable[[protocol.Message, Arrival], None] | None = None,
        log_file: str = '',
        table: Table = Table(),
    ):
        self._file = None
        if log_file:
            check_file(log_file)
            with writing(log_file):
                self._file = open(log_file, 'w', buffering=1)  # noqa: SIM115
            print(*Arrival._fields, sep=',', file=self._file)
        self.name = name
        self.log: deque[Arrival] = deque(maxlen=8192)
        self.table, self.count = table, table.cells  # of numbers of blocks, as it says
        self.infrared_mask = (1 << self.count) - 1
        self.firmware = protocol.FIRMWARE
        self.port = TABLE
        self.bridge = Bridge(table)  # with the blocks
        self._on_message = on_message
        self._clock_us, self._boot = CLOCK_US, time.monotonic()
        self._sequence = 0
        self._lock, self._field = threading.Lock(), threading.Lock()
        self._fds: tuple[int, int] | None = None
        self._decoder = protocol.Decoder()
        self._wake_read, self._wake_write = os.pipe()
        self._stop = threading.Event()
        self.rounds = Rounds()
        self._thread = carrier_thread('fake', self._run)

    def start(self) -> 'FakeBoard':
        """Plug the board in and power it."""
        self.plug()
        self._thread.start()
        return self

    def open_line(self) -> int:
        """Return a descriptor of the host's end, the caller's to close; OSError when unplugged."""
        with self._lock:
            if self._fds is None:
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            return os.dup(self._fds[1])

    def close(self) -> None:
        """Unplug it for good."""
        self._stop.set()
        os.write(self._wake_write, b'x')
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)
        self.unplug()
        os.close(self._wake_read)
        os.close(self._wake_write)
        if self._file:
            self._file.close()

    def __enter__(self) -> 'FakeBoard':
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def knock(
        self,
        block: int,
        strength: float,
        ago_s: float = 0.0,
        lit_s: float = 0.0,
        woke: bool = False,
    ) -> None:
        """Report a tap of `block` with `strength` in m/s^2, `ago_s` ago.

        If the bridge allows it, the tap lit the block `lit_s` later. woke: the tap woke the block.
        """
        felt_us = (self.clock_us() - round(ago_s * 1e6)) & 0xFFFFFFFF
        counts = min(round(strength / protocol.STRENGTH_UNIT), 0xFFFF)
        lit_us = protocol.NOT_LIT
        with self._field:
            if self.bridge.felt(time.monotonic(), block):
                lit_us = min(round(lit_s * 1e6), protocol.NOT_LIT - 1)
        self._send(protocol.Knock(felt_us, block, counts, lit_us, protocol.WOKE * woke))

    def report(
        self, block: int, millivolts: int = MILLIVOLTS, flags: int = protocol.LINKED
    ) -> None:
        """Say how `block` is, or the bridge itself."""
        if block != protocol.BRIDGE:
            with self._field:
                heard = bool(flags & protocol.LINKED)
                self.bridge.hear(time.monotonic(), block, heard)
        self._send(protocol.BlockStatus(block, millivolts, CELSIUS, *self.firmware, flags))

    @property
    def plugged(self) -> bool:
        """Whether its cable is in."""
        return self._fds is not None

    def clock_us(self) -> int:
        """Return what the board's 32-bit microsecond clock shows."""
        run = (time.monotonic() - self._boot) * (1 + CLOCK_RATE)
        return (self._clock_us + int(run * 1e6)) & 0xFFFFFFFF

    def levels(self) -> list[int]:
        """Return the level 0..255 of each white LED now, by place."""
        with self._field:
            return list(self.bridge.field.level_bytes(time.monotonic()))

    def plug(self) -> None:
        """Plug its cable in."""
        with self._lock:
            if self._fds is not None:
                return
            board_end, host_end = self._line()
            os.set_blocking(board_end, False)
            self._link(True)
            self._fds = (board_end, host_end)  # the second keeps the line up between users
            self._decoder = protocol.Decoder()
        os.write(self._wake_write, b'x')

    def unplug(self) -> None:
        """Pull its cable."""
        with self._lock:
            if self._fds is None:
                return
            fds, self._fds = self._fds, None
            self._link(False)
            os.write(self._wake_write, b'x')  # a thread that waits on the line would hold it open
            for fd in fds:
                os.close(fd)

    def _line(self) -> tuple[int, int]:
        """Return the board's and the host's end of a new line."""
        board_end, host_end = (end.detach() for end in socket.socketpair())
        os.set_blocking(host_end, False)
        return board_end, host_end

    def _link(self, linked: bool) -> None:
        """The plug feeds the bridge, too."""
        with self._field:
            self.bridge.link(time.monotonic(), linked)

    def _run(self) -> None:
        while not self._stop.is_set():
            self.rounds.done()
            fds = self._fds
            watched = [self._wake_read] + ([fds[0]] if fds else [])
            try:
                ready, _, _ = select.select(watched, [], [], 0.5)
                if self._wake_read in ready:
                    os.read(self._wake_read, 64)
                if fds is None or fds[0] not in ready:
                    continue
                data = os.read(fds[0], 4096)
            except OSError:  # unplugged while we looked
                continue
            now_ns = time.time_ns()
            for received in self._decoder.feed(data):
                self._take(received, now_ns)
        self.rounds.rest()

    def _take(self, received: protocol.Received, now_ns: int) -> None:
        message = received.message
        arrival = Arrival(
            now_ns, type(message).__name__, received.sequence, getattr(message, 'stamp_us', 0)
        )
        self.log.append(arrival)
        if self._file:
            print(*arrival, sep=',', file=self._file)
        if self._on_message:
            self._on_message(message, arrival)
        if isinstance(message, protocol.Hello):
            name = self.name.encode('ascii')[:16]
            self._send(protocol.Welcome(protocol.VERSION, self.count, name))
        elif isinstance(message, protocol.Infrared):
            self.infrared_mask = message.mask
        elif isinstance(message, protocol.Ping):
            counters = (self._decoder.good & 0xFFFFFFFF, min(self._decoder.bad, 0xFFFF))
            self._send(protocol.Pong(message.host_us, self.clock_us(), *counters))
        else:
            with self._field:
                obey(self.bridge, time.monotonic(), message)
            if isinstance(message, protocol.Lighting):
                self.report(protocol.BRIDGE, 0)
                for block in self.table.ids.tolist():
                    self.report(block)

    def _send(self, message: protocol.Message) -> None:
        with self._lock:
            if self._fds is None:
                return
            packet = protocol.encode(message, self._sequence)
            self._sequence = (self._sequence + 1) & 0xFF
            self._write(self._fds[0], packet)

    def _write(self, end: int, packet: bytes) -> None:
        # the board does not wait for a host that does not read or is unplugged
        with contextlib.suppress(OSError):
            os.write(end, packet)

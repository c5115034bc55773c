# SPDX-License-Identifier: Apache-2.0
"""A board made of software: it speaks the protocol of docs/reference/serial.md, usually over a pty.

It emulates the bridge, with blocks that flash by themselves.
The twin's rehearsal runs on it, and the tests. It keeps its own clock, which neither agrees with
the host's nor runs at quite its rate, and it can be told to misbehave.

    python -m eol_ros.devices.board.fake --link /tmp/board --taps 2
"""

import argparse
import contextlib
import errno
import itertools
import os
import select
import signal
import socket
import sys
import threading
import time
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.light.bridge import Bridge
from eol_ros.core.light.local import FIELD, FIELD_OF_VIEW, OFF
from eol_ros.core.table import Table
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.rounds import Rounds
from eol_ros.disk import check_file
from eol_ros.errors import UsageError, writing
from eol_ros.said import said

TABLE = said('simulated_table')  # the port of a bridge that a twin plays
MILLIVOLTS, CELSIUS = 3900, 24  # of the battery of a block that has one
WHOLE = (protocol.ANSWERS, 400, 400, 400, 1700, 100, 1350)  # of a self-test
FAULTS = ('noise', 'truncate', 'oversize', 'mute', 'unmute', 'unplug', 'plug', 'reboot')
CLOCK_US, CLOCK_RATE = 4_200_000_000, 30e-6  # at the start; excess over the host's rate
NOISE = bytes(range(1, 200, 7)) + b'\0\xff\xff\0'


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
    """A board on a pty at `port`; with `link` there is a symbolic link to it, a stable name.

    Or, with `socket_pair`, on a line within this process, which `open_line` opens: what goes
    through a pty is carried by a worker of the kernel that has no real-time priority, and waits
    for some milliseconds where both processors are taken.

    `on_message` is called in the board's thread with each received message and its arrival.
    `log_file`: CSV file of all arrivals.
    """

    def __init__(
        self,
        link: str | None = None,
        version: int = protocol.VERSION,
        name: str = 'fake',
        on_message: Callable[[protocol.Message, Arrival], None] | None = None,
        socket_pair: bool = False,
        log_file: str = '',
        table: Table = Table(),
    ):
        self._file = None
        if log_file:
            check_file(log_file)
            with writing(log_file):
                self._file = open(log_file, 'w', buffering=1)  # noqa: SIM115
            print(*Arrival._fields, sep=',', file=self._file)
        self.link, self.version, self.name = link, version, name
        self.log: deque[Arrival] = deque(maxlen=8192)
        self.table, self.count = table, table.cells  # of numbers of blocks, as it says
        self.infrared_mask = (1 << self.count) - 1
        self.detector = protocol.Detector()  # as the host has set it
        self.lattice: protocol.Lattice | None = None  # the same; its bridge knows the table
        self.firmware = protocol.FIRMWARE
        self.self_tests: dict[int, tuple[int, ...] | None] = {}  # but for WHOLE; None: no answer
        self._socket_pair, self.port = socket_pair, TABLE if socket_pair else ''
        self.bridge = Bridge(table)  # with the blocks
        self._on_message = on_message
        self._clock_us, self._boot = CLOCK_US, time.monotonic()
        self._muted, self._spoil = False, ''
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
        self.fault('plug')
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
        self.fault('unplug')
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

    def fault(self, what: str) -> None:
        """Misbehave, see FAULTS: spoil the next packet, fall silent, lose the plug, start again."""
        if what in ('noise', 'truncate', 'oversize'):
            self._spoil = what
        elif what in ('mute', 'unmute'):
            self._muted = what == 'mute'
        elif what == 'plug':
            self._plug()
        elif what == 'unplug':
            self._unplug()
        elif what == 'reboot':
            self._boot, self._clock_us, self._sequence = time.monotonic(), 0, 0
            self._decoder, self.infrared_mask = protocol.Decoder(), (1 << self.count) - 1
        else:
            raise UsageError(f'fault {what!r} is not known; there are {", ".join(FAULTS)}')

    def _plug(self) -> None:
        host_end, board_end = None, None
        with self._lock:
            if self._fds is not None:
                return
            if self._socket_pair:
                board_end, host_end = (end.detach() for end in socket.socketpair())
                os.set_blocking(host_end, False)
            else:
                board_end, host_end = os.openpty()
                tty.setraw(host_end)
                self.port = os.ttyname(host_end)
            os.set_blocking(board_end, False)
            self._link(True)
            self._fds = (board_end, host_end)  # the second keeps the line up between users
            self._decoder = protocol.Decoder()
            if self.link:
                fresh = Path(f'{self.link}.new')
                fresh.unlink(missing_ok=True)
                fresh.symlink_to(self.port)
                fresh.replace(self.link)
        os.write(self._wake_write, b'x')

    def _unplug(self) -> None:
        with self._lock:
            if self._fds is None:
                return
            fds, self._fds = self._fds, None
            self._link(False)
            os.write(self._wake_write, b'x')  # a thread that waits on the line would hold it open
            if self.link:
                Path(self.link).unlink(missing_ok=True)
            for fd in fds:
                os.close(fd)

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
            if message.version == self.version:
                name = self.name.encode('ascii')[:16]
                self._send(protocol.Welcome(self.version, self.count, name))
            else:
                self._send(protocol.Refused(self.version, message.version))
        elif isinstance(message, protocol.Infrared):
            self.infrared_mask = message.mask
        elif isinstance(message, protocol.SelfTest) and message.block in self.table.ids:
            found = self.self_tests.get(message.block, WHOLE)
            if found is not None:
                self._send(protocol.SelfTested(message.block, *found))
        elif isinstance(message, protocol.Ping):
            counters = (self._decoder.good & 0xFFFFFFFF, min(self._decoder.bad, 0xFFFF))
            self._send(protocol.Pong(message.host_us, self.clock_us(), *counters))
        else:
            with self._field:
                obey(self.bridge, time.monotonic(), message)
            if isinstance(message, protocol.Detector):
                self.detector = message
            elif isinstance(message, protocol.Lattice):
                self.lattice = message
            elif isinstance(message, protocol.Lighting):
                self.report(protocol.BRIDGE, 0)
                for block in self.table.ids.tolist():
                    self.report(block)

    def _send(self, message: protocol.Message) -> None:
        with self._lock:
            if self._fds is None or self._muted:
                return
            packet = protocol.encode(message, self._sequence)
            self._sequence = (self._sequence + 1) & 0xFF
            spoil, self._spoil = self._spoil, ''
            if spoil == 'noise':
                packet = NOISE + packet
            elif spoil == 'truncate':
                packet = packet[: len(packet) // 2]
            elif spoil == 'oversize':
                packet = b'\x01' * 1000 + packet
            try:
                os.write(self._fds[0], packet)
            except OSError:  # nobody reads, or the plug was pulled: a board does not wait
                pass


def main(argv: list[str] | None = None) -> int:
    """Run a board until Ctrl-C or SIGTERM; its port is the one line on stdout."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--link', metavar='PATH', help='stable name for the port')
    parser.add_argument('--taps', type=float, default=0.0, metavar='HZ', help='rate of taps')
    parser.add_argument('--log', default='', metavar='FILE', help='CSV file of all arrivals')
    args = parser.parse_args(argv)
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has it ignore the first
        signal.signal(number, signal.default_int_handler)
    with FakeBoard(args.link, log_file=args.log) as board, contextlib.suppress(KeyboardInterrupt):
        print(args.link or board.port, flush=True)
        for count in itertools.count():
            time.sleep(1 / args.taps if args.taps > 0 else 1.0)
            if args.taps > 0:
                board.knock(count * 7 % board.count, 5.0)
    return 0


if __name__ == '__main__':
    sys.exit(main())

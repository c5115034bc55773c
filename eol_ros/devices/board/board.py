# SPDX-License-Identifier: Apache-2.0
"""The board that drives the blocks' LEDs and reads their accelerometers, seen from the host.

One thread reads; any thread writes, straight into the port. The line may break at any time: it is
opened again after 1, 2, 4 ... 30 s, and the board is then told once more what it should show.
"""

import contextlib
import errno
import math
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.clock_sync import ClockSync, HostTime
from eol_ros.devices.backoff import Backoff
from eol_ros.devices.board.ports import find_port
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.rounds import Rounds
from eol_ros.errors import DeviceMissing
from eol_ros.said import clauses, said
from eol_ros.streams.checks import strange

BAUD = 1_000_000
HELLO_EVERY_S = 0.25
HELLO_FOR_S = 5.0  # a board that resets when its port opens takes up to 2 s
PING_EVERY_S = 0.5
SILENT_AFTER_S = 2.0
READ_BYTES = 4096
WOKE_SIGMA_S = 3e-3  # of a knock that woke its block: `eol bench taps`
KNOCK_SPAN_S = 5.0  # from the host's clock to the time of a knock, at most
UNSYNCED_SIGMA_S = 0.02  # of a tap that comes before the clocks have met: its arrival time is taken


@dataclass(frozen=True)
class State:
    """How the line is: `looking`, `ready`, `lost` or `refused`, and a sentence for people."""

    kind: str
    text: str


@dataclass(frozen=True)
class TapReport:
    """A knock on a block: when, on this host's monotonic clock, and how hard, m/s^2.

    The block lit itself `lit_s` later, or not: None.
    """

    block: int
    strength: float
    time: HostTime
    board_us: int
    lit_s: float | None = None


class LineLost(OSError):
    """The port is gone or the board fell silent."""


class Board:
    """The line to one board, kept open from `start` to `close`.

    `on_tap` and `on_state` are called from the reader thread. `port` as for `find_port`, looked up
    again at each try; or `line` opens what is no serial port, whose descriptor it returns, and
    raises OSError where it cannot.
    """

    def __init__(
        self,
        port: str,
        on_tap: Callable[[TapReport], None] = lambda tap: None,
        on_state: Callable[[State], None] = lambda state: None,
        backoff: Backoff | None = None,
        line: Callable[[], int] | None = None,
    ):
        self.state = State('looking', said('looking', path=port))
        self.sync = ClockSync()
        self.decoder = protocol.Decoder()
        self.sent = self.dropped = self.connections = self.taps = 0
        self.version = 0  # of the protocol that the board speaks; 0 while that is not known
        self.count = 0  # of the blocks that it drives, as it says
        self.blocks: dict[int, protocol.BlockStatus] = {}  # as they were last reported
        self.tests: dict[int, protocol.SelfTested] = {}  # the last of each block
        self.reported_bad = 0  # damaged packets that the board itself counted
        self._good = 0  # packets that it counted since it started
        self.rejected = 0  # reports of blocks that it does not drive, or of knocks at another time
        self.round_trip_ms: deque[float] = deque(maxlen=64)
        self._port, self._line = port, line
        self._on_tap, self._on_state = on_tap, on_state
        self._backoff = backoff or Backoff()
        self._lock = threading.Lock()
        self._fd: int | None = None
        self._sequence = 0
        self._infrared = protocol.ALL_BLOCKS
        self._configuration: list[protocol.Message] = []
        self._asked: dict[int, float] = {}
        self._stop = threading.Event()
        self.rounds = Rounds()
        self._thread = carrier_thread('board', self._run)

    def start(self) -> None:
        """Begin to look for the board; returns at once."""
        self._thread.start()

    def close(self) -> None:
        """Close the port; blocks continue to light themselves."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    @property
    def ready(self) -> bool:
        """True while the board answers."""
        return self.state.kind == 'ready'

    def light(self, mask: int, stamp_us: int, share: float = 1.0) -> int | None:
        """Make the blocks of `mask` flash, for an image with this stamp in us (low 32 bits).

        To `share` of the peak, a multiple of 1 / SHARES; below 1 the firmware must know it.

        Returns the number of the packet, or None when it could not be sent now.
        """
        told = stamp_us & 0xFFFFFFFF, self._driven(mask)
        light: protocol.Message = protocol.Light(*told)
        if share < 1:
            light = protocol.DimLight(round(share * protocol.SHARES), *told)
        return self._send(light) if self.ready else None

    def configure(self, *messages: protocol.Message) -> None:
        """Say how blocks flash and what they feel; a board that comes back is told again."""
        self._configuration = list(messages)
        if self.ready:
            for message in self._configuration:
                self._send(message)

    def self_test(self, block: int) -> int | None:
        """Make a block test itself; `tests` then has the result. Returns like `light`."""
        self.tests.pop(block, None)
        return self._send(protocol.SelfTest(block)) if self.ready else None

    def infrared(self, on: bool | int) -> int | None:
        """Switch the infrared LEDs: all, none, or a bit per block. Returns like `light`."""
        self._infrared = protocol.ALL_BLOCKS * int(on) if isinstance(on, bool) else on
        return self._send(protocol.Infrared(self._driven(self._infrared))) if self.ready else None

    @property
    def infrared_on(self) -> bool:
        """True unless all infrared LEDs are off."""
        return self._infrared != 0

    def _driven(self, mask: int) -> int:
        return mask & (1 << self.count) - 1

    def _send(self, message: protocol.Message) -> int | None:
        with self._lock:
            if self._fd is None:
                return None
            sequence = self._sequence
            packet = protocol.encode(message, sequence)
            try:
                written = os.write(self._fd, packet)
            except BlockingIOError:
                written = 0
            except OSError:  # the reader thread meets the same error and opens the port again
                return None
            if written < len(packet):  # the line is full: newer levels follow, do not wait for it
                self.dropped += 1
                return None
            self._sequence = (sequence + 1) & 0xFF
            self.sent += 1
            return sequence

    def _set_state(self, kind: str, text: str) -> None:
        state = State(kind, text)
        if state != self.state:
            self.state = state
            self._on_state(state)

    def _run(self) -> None:
        while not self._stop.is_set():
            kind = 'lost'
            try:
                self._talk()
                return self.rounds.rest()
            except DeviceMissing as error:
                kind, text = 'looking', str(error)
            except VersionRefused as error:
                kind, text = 'refused', str(error)
            except OSError as error:
                text = _why(self._port, error)
            if self._stop.is_set():
                break
            pause_s = self._backoff.failed()
            self._set_state(kind, clauses([text, said('again', seconds=f'{pause_s:.0f}')]))
            with self.rounds.waiting():
                self._stop.wait(pause_s)
        self.rounds.rest()

    def _talk(self) -> None:
        """Open the port and serve it until it fails (OSError) or `close` is called (returns)."""
        with contextlib.ExitStack() as opened:
            if self._line:
                path, fd = self._port, self._line()
                opened.callback(os.close, fd)
            else:
                path = find_port(self._port)
                fd = opened.enter_context(_serial_port(path)).fileno()
            with self._lock:
                self._fd = fd
            opened.callback(self._put_down)
            self.sync, self.decoder = ClockSync(), protocol.Decoder()
            self._asked.clear()
            self._good = 0
            welcome = self._shake_hands(path)
            self.version, self.count, self.blocks = welcome.version, welcome.blocks, {}
            name = welcome.name.rstrip(b'\0').decode('ascii', 'replace')
            self._backoff.succeeded()
            self.connections += 1
            board = said('board', name=name, path=path, count=welcome.blocks)
            self._set_state('ready', board)
            self._tell()
            self._serve()

    def _tell(self) -> None:
        """Say what the board should show, and how."""
        self.infrared(self._infrared)
        for message in self._configuration:
            self._send(message)

    def _put_down(self) -> None:
        with self._lock:
            self._fd = None

    def _shake_hands(self, path: str) -> protocol.Welcome:
        give_up = time.monotonic() + HELLO_FOR_S
        while not self._stop.is_set():
            self._send(protocol.Hello())
            for message in self._read(HELLO_EVERY_S):
                if isinstance(message, protocol.Refused | protocol.Welcome):
                    if message.version != protocol.VERSION:
                        raise VersionRefused(path, message.version)
                    if isinstance(message, protocol.Welcome):
                        return message
            if time.monotonic() > give_up:
                raise LineLost(errno.ETIMEDOUT, said('no_board_answers', path=path))
        raise LineLost(errno.ECANCELED, 'stopped')

    def _serve(self) -> None:
        next_ping = heard = time.monotonic()
        while not self._stop.is_set():
            now = time.monotonic()
            if now >= next_ping:
                asked_us = int(now * 1e6) & 0xFFFFFFFF
                self._asked[asked_us] = now
                self._send(protocol.Ping(asked_us))
                next_ping = now + (PING_EVERY_S if len(self.round_trip_ms) > 8 else 0.1)
            for message in self._read(max(0.0, next_ping - time.monotonic())):
                heard = time.monotonic()
                self._hear(message, heard)
            if time.monotonic() - heard > SILENT_AFTER_S:
                raise LineLost(
                    errno.ETIMEDOUT, said('board_silent', seconds=f'{SILENT_AFTER_S:.0f}')
                )

    def _hear(self, message: protocol.Message, now: float) -> None:
        blocks = {'block': range(self.count)}
        rules: dict[type, dict[str, Any]] = {
            protocol.Knock: blocks,
            protocol.BlockStatus: {'block': {*range(self.count), protocol.BRIDGE}},
            protocol.SelfTested: blocks,
        }
        if strange(message, rules.get(type(message), {})):
            self.rejected += 1
        elif isinstance(message, protocol.Pong):
            asked = self._asked.pop(message.host_us, None)
            if asked is not None:
                self.sync.add(asked, message.board_us, now)
                self.round_trip_ms.append((now - asked) * 1e3)
                self._asked = {k: t for k, t in self._asked.items() if now - t < 10}
            if message.good < self._good:  # it has started again by itself, and knows nothing
                self._tell()
            self._good, self.reported_bad = message.good, message.bad
        elif isinstance(message, protocol.BlockStatus):
            self.blocks[message.block] = message
        elif isinstance(message, protocol.SelfTested):
            self.tests[message.block] = message
        elif isinstance(message, protocol.Knock):
            time_ = HostTime(now, UNSYNCED_SIGMA_S)
            if self.sync.ready:
                time_ = self.sync.to_host(message.board_us)
            if abs(time_.time_s - now) > KNOCK_SPAN_S:  # the board was started again, or is wrong
                self.rejected += 1
                return
            self.taps += 1
            strength, lit_s = message.strength * protocol.STRENGTH_UNIT, None
            if message.lit_us != protocol.NOT_LIT:
                lit_s = message.lit_us * 1e-6
            if message.flags & protocol.WOKE:
                time_ = HostTime(time_.time_s, math.hypot(time_.sigma_s, WOKE_SIGMA_S))
            self._on_tap(TapReport(message.block, strength, time_, message.board_us, lit_s))

    def _read(self, timeout_s: float) -> list[protocol.Message]:
        """Return the messages that come within `timeout_s`; as soon as there is any."""
        assert self._fd is not None
        until = time.monotonic() + timeout_s
        while not self._stop.is_set():
            left = until - time.monotonic()
            ready, _, _ = select.select([self._fd], [], [], max(0.0, min(left, 0.2)))
            self.rounds.done()
            if ready:
                data = os.read(self._fd, READ_BYTES)
                if not data:
                    raise LineLost(errno.ENODEV, said('board_gone', path=self._port))
                found = [r.message for r in self.decoder.feed(data)]
                if found:
                    return found
            if left <= 0:
                break
        return []


class VersionRefused(Exception):
    """The board speaks another version of the protocol."""

    def __init__(self, path: str, version: int):
        older, way = version < protocol.VERSION, 'update the firmware of the board'
        super().__init__(
            f'the board on {path} speaks protocol version {version}, this program '
            f'{protocol.VERSION}: {way if older else "update eol_ros"}'
        )


def _serial_port(path: str) -> Any:
    """Return it open and ours alone; raise OSError where it cannot be."""
    import serial

    try:
        port = serial.Serial(path, BAUD, timeout=0, exclusive=True)
    except serial.SerialException as error:
        raise OSError(error.errno, str(error)) from error
    with contextlib.suppress(ValueError, OSError):  # not every driver knows it
        port.set_low_latency_mode(True)  # one of FTDI keeps bytes back for 16 ms
    return port


def _why(port: str, error: OSError) -> str:
    if error.errno == errno.EACCES:
        return f'no permission to open {port}: add the user to group dialout'
    if error.errno in (errno.EBUSY, errno.EAGAIN):
        return f'{port} is in use by another program'
    if isinstance(error, LineLost):
        return str(error.strerror)
    return f'serial line on {port} lost ({error.strerror or error})'

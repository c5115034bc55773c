# SPDX-License-Identifier: Apache-2.0
"""The twin's board: a fake one. The twin's blocks tell it by radio what they feel.

And it tells them what the host wants of them. The radio is a pair of Unix datagram sockets, for
the board runs with `leds`, in another process than the twin, and what blocks and their board say to
each other is on no topic. It reaches as far as one machine.
"""

import contextlib
import heapq
import math
import os
import select
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.light.bridge import Bridge
from eol_ros.core.table import Table
from eol_ros.devices.board.fake import Arrival, FakeBoard, latency_s, obey
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.rounds import Rounds
from eol_ros.streams.graph import NAMESPACE

KNOCK = struct.Struct('<qBff?f')  # of Felt
LINK_NS = 1_000_000  # from block to board: a guess
AHEAD_S = 0.2  # the twin is ahead by less; else the system clock was set back
BEACON_S = 0.05
SILENT_S = 0.25  # blocks that have not heard their board for so long are alone
SIGMA_S = 5e-4  # of the time of a knock: `eol bench taps`


class Felt(NamedTuple):
    """A tap of a block of the twin, with its time by the clock of the table or of the system.

    The block lit itself `lit_s` later, and its firmware had measured and reports the tap `told_s`
    later. The twin knows it earlier: it has simulated the table up to its next image. `woke`: the
    tap woke the block.
    """

    time_ns: int
    block: int
    strength_mps2: float
    lit_s: float = 0.0
    woke: bool = False
    told_s: float = 0.0

    @property
    def time_s(self) -> float:
        """Time in s."""
        return self.time_ns * 1e-9

    @property
    def report_ns(self) -> int:
        """When its board has it."""
        return self.time_ns + round(self.told_s * 1e9) + LINK_NS


class Radio:
    """The twin's end: what its blocks say, and hear. Nobody need listen."""

    def __init__(self, namespace: str = NAMESPACE) -> None:
        self._board = board_address(namespace)
        self._socket = unix_socket(board_address(namespace, 'blocks'))
        self._decoder = protocol.Decoder()
        self._heard_s = -math.inf

    def send(self, knocks: Iterable[Felt]) -> None:
        """Say what was felt; where no board listens it is lost."""
        for knock in knocks:
            send(self._socket, KNOCK.pack(*knock), self._board)

    def hear(self) -> list[protocol.Message]:
        """Return what the board has said to the blocks."""
        found = []
        while packet := _received(self._socket):
            self._heard_s = time.monotonic()
            found += [received.message for received in self._decoder.feed(packet)]
        return found

    @property
    def linked(self) -> bool:
        """Whether the board is there."""
        return time.monotonic() - self._heard_s < SILENT_S

    def close(self) -> None:
        """Say no more."""
        self._socket.close()


class Lamps:
    """The white LEDs of the twin's blocks; time is that of the table, in s."""

    def __init__(self, radio: Radio, table: Table = Table()):
        self._radio, self._bridge = radio, Bridge(table)
        self._bridge.link(0.0, False)

    def advance(
        self, begin_s: float, end_s: float, felt: Iterable[tuple[float, int]]
    ) -> tuple[np.ndarray, protocol.Detector | None]:
        """Return the light at `end_s`, (cells,) in 0..1, and what the detectors are to be like.

        felt: when blocks felt a knock since `begin_s`, and which.
        """
        detector = None
        messages = self._radio.hear()
        self._bridge.link(begin_s, self._radio.linked)
        for message in messages:
            obey(self._bridge, begin_s, message)
            if isinstance(message, protocol.Detector):
                detector = message
        for time_s, block in felt:
            self._bridge.felt(time_s, block)
        return self._bridge.levels(end_s), detector


def board_address(namespace: str, end: str = 'board') -> str:
    """Return the abstract address of one end in a graph on this ROS domain."""
    return f'\0eol_ros/twin/{os.environ.get("ROS_DOMAIN_ID", "0")}/{namespace}/{end}'


def unix_socket(address: str) -> socket.socket:
    """Return a datagram socket that never waits, at an abstract address."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    try:
        made.bind(address)
    except OSError:  # another one of this graph has it: this one hears nothing
        pass
    return made


def send(radio: socket.socket, packet: bytes, to: str) -> None:
    """Send a datagram, which is lost where nobody is or keeps up."""
    with contextlib.suppress(OSError):
        radio.sendto(packet, to)


def _received(radio: socket.socket) -> bytes:
    try:
        return radio.recv(128)
    except OSError:  # no more
        return b''


class TwinBoard:
    """A FakeBoard with the twin's blocks; it also measures how late light arrives.

    `log` names a CSV of all that arrives on the wire.
    """

    def __init__(self, log: str = '', namespace: str = NAMESPACE, table: Table = Table()):
        self._late_s: deque[float] = deque(maxlen=1000)
        self._guard = threading.Lock()
        self._radio, self._blocks = (
            unix_socket(board_address(namespace)),
            board_address(namespace, 'blocks'),
        )
        self._told: dict[type, protocol.Message] = {}
        self.fake = FakeBoard(
            name='twin',
            on_message=self._on_message,
            log_file=log,
            table=table,
        ).start()
        self._stop = threading.Event()
        self.rounds = Rounds()
        self._thread = carrier_thread('radio', self._listen)
        self._thread.start()

    @property
    def port(self) -> str:
        """Return what its line is called."""
        return self.fake.port

    def _listen(self) -> None:
        """Report what the blocks feel, when they report it, and tell them again and again that
        the board is there."""
        waiting: list[tuple[float, Felt]] = []  # steady time: the system clock may be set
        beacon_s = 0.0
        while not self._stop.is_set():
            left_s = waiting[0][0] - time.monotonic() if waiting else BEACON_S
            ready, _, _ = select.select([self._radio], [], [], min(max(left_s, 0.0), BEACON_S))
            self.rounds.done()
            while ready and (packet := _received(self._radio)):
                if len(packet) == KNOCK.size:
                    knock = Felt(*KNOCK.unpack(packet))
                    wait_s = (knock.report_ns - time.time_ns()) * 1e-9
                    wait_s = wait_s if wait_s < AHEAD_S else 0.0
                    heapq.heappush(waiting, (time.monotonic() + wait_s, knock))
            while waiting and waiting[0][0] <= time.monotonic():
                knock = heapq.heappop(waiting)[1]
                ago_s = max(0.0, (time.time_ns() - knock.time_ns) * 1e-9)
                self.fake.knock(knock.block, knock.strength_mps2, ago_s, knock.lit_s, knock.woke)
            if self.fake.plugged and time.monotonic() - beacon_s >= BEACON_S:
                beacon_s = time.monotonic()
                for message in list(self._told.values()):
                    send(self._radio, protocol.encode(message, 0), self._blocks)
        self.rounds.rest()

    def _on_message(self, message: protocol.Message, arrival: Arrival) -> None:
        if isinstance(message, protocol.Lighting | protocol.Detector):
            self._told[type(message)] = message
        elif isinstance(message, protocol.Light | protocol.DimLight):
            send(self._radio, protocol.encode(message, 0), self._blocks)
            if message.stamp_us:
                with self._guard:
                    self._late_s.append(latency_s(arrival))

    def late_ms(self) -> dict[str, float]:
        """Return image stamp -> bytes on the wire of the last 1000 first packets, ms."""
        with self._guard:
            late = sorted(self._late_s)
        if not late:
            return {}
        return {
            'wire_p50_ms': round(late[len(late) // 2] * 1e3, 2),
            'wire_p99_ms': round(late[int(0.99 * (len(late) - 1))] * 1e3, 2),
            'wire_packets': len(late),
        }

    def close(self) -> None:
        """Unplug it."""
        self._stop.set()
        self._thread.join(2.0)
        self._radio.close()
        self.fake.close()

# SPDX-License-Identifier: Apache-2.0
"""The twin's board: a fake one on a pty. The twin's blocks tell it by radio what they feel.

The radio is a Unix datagram socket, for the board runs with `leds`, in another process than the
twin, and what blocks say to their board is on no topic. It reaches as far as one machine.
"""

import os
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from eol_ros.devices.board.fake import Arrival, FakeBoard, latency_s
from eol_ros.streams.graph import NAMESPACE

KNOCK = struct.Struct('<qBf')  # time, ns of the system clock; block; strength, m/s^2
SIGMA_S = 5e-4  # of the time of a knock: `eol bench taps`


class Felt(NamedTuple):
    """A knock that a block of the twin felt, on the system's clock."""

    time_ns: int
    block: int
    strength_mps2: float


class Radio:
    """The twin's end: what its blocks say. Nobody need listen."""

    def __init__(self, namespace: str = NAMESPACE) -> None:
        self._board = _address(namespace)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)

    def send(self, knocks: Iterable[Felt]) -> None:
        """Say what was felt; where no board listens it is lost."""
        for knock in knocks:
            try:
                self._socket.sendto(KNOCK.pack(*knock), self._board)
            except OSError:
                return

    def close(self) -> None:
        """Say no more."""
        self._socket.close()


def _address(namespace: str) -> str:
    """Return the abstract address of the board of a graph on this ROS domain."""
    return f'\0eol_ros/twin/{os.environ.get("ROS_DOMAIN_ID", "0")}/{namespace}'


class TwinBoard:
    """A FakeBoard with the twin's blocks; it also measures how late light arrives.

    `log` names a CSV of all that arrives on the wire.
    """

    def __init__(self, log: str = '', namespace: str = NAMESPACE):
        self._log = open(log, 'w', buffering=1) if log else None  # noqa: SIM115
        if self._log:
            self._log.write('time_ns,kind,sequence,stamp_us\n')
        self._late_s: deque[float] = deque(maxlen=1000)
        self._guard = threading.Lock()
        self._radio = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            self._radio.bind(_address(namespace))
        except OSError:  # another board of this graph has it: this one hears nothing
            pass
        self.fake = FakeBoard(name='twin', on_arrival=self._on_arrival).start()

    @property
    def port(self) -> str:
        """Return the path of the pty."""
        return self.fake.port

    def listen(self) -> float:
        """Report what the blocks have felt; return the standard error of its times, s."""
        while True:
            try:
                packet = self._radio.recv(64)
            except OSError:  # no more
                return SIGMA_S
            if len(packet) == KNOCK.size:
                knock = Felt(*KNOCK.unpack(packet))
                ago_s = max(0.0, (time.time_ns() - knock.time_ns) * 1e-9)
                self.fake.tap(knock.block, knock.strength_mps2, ago_s)

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
        self._radio.close()
        self.fake.close()
        if self._log:
            self._log.close()

    def _on_arrival(self, arrival: Arrival) -> None:
        if self._log:
            print(*arrival, sep=',', file=self._log)
        if arrival.kind == 'Levels' and arrival.stamp_us:
            with self._guard:
                self._late_s.append(latency_s(arrival))

# SPDX-License-Identifier: Apache-2.0
"""The twin's board: a fake one on a pty, whose blocks feel what the twin's blocks do."""

import threading
import time
from collections import deque
from collections.abc import Sequence

from eol_ros.devices.board.fake import Arrival, FakeBoard, latency_s

BREAKAWAY = 2.45  # m/s^2, (mu_s - mu_k) g of the twin's blocks: what an accelerometer feels first


class TwinBoard:
    """A FakeBoard fed with the twin's `moving` flags; it also measures how late light arrives.

    `log` names a CSV of all that arrives on the wire.
    """

    def __init__(self, log: str = ''):
        self._log = open(log, 'w', buffering=1) if log else None  # noqa: SIM115
        if self._log:
            self._log.write('time_ns,kind,sequence,stamp_us\n')
        self._late_s: deque[float] = deque(maxlen=1000)
        self._guard = threading.Lock()
        self._moving: Sequence[bool] = ()
        self._stamp_ns = 0
        self.fake = FakeBoard(name='twin', on_arrival=self._on_arrival).start()

    @property
    def port(self) -> str:
        """Return the path of the pty."""
        return self.fake.port

    def feel(self, stamp_ns: int, moving: Sequence[bool]) -> float:
        """Tap each block that has begun to move; return the standard error of the taps' times, s.

        The flags come once per image, stamped `stamp_ns` of system time, so all that is known is
        that the block broke away since the image before: the middle of that time is reported.
        """
        period_s = (stamp_ns - self._stamp_ns) * 1e-9
        if self._moving and 0 < period_s < 1:
            ago_s = max(0.0, (time.time_ns() - stamp_ns) * 1e-9) + period_s / 2
            for block, (before, now) in enumerate(zip(self._moving, moving)):
                if now and not before:
                    self.fake.tap(block, BREAKAWAY, ago_s)
        self._moving, self._stamp_ns = tuple(moving), stamp_ns
        return period_s / 12**0.5

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
        self.fake.close()
        if self._log:
            self._log.close()

    def _on_arrival(self, arrival: Arrival) -> None:
        if self._log:
            print(*arrival, sep=',', file=self._log)
        if arrival.kind == 'Levels' and arrival.stamp_us:
            with self._guard:
                self._late_s.append(latency_s(arrival))

# SPDX-License-Identifier: Apache-2.0
"""An observer of a soak that imports nothing of the project and reads only the wire and the disk.

Blocks on the wire, or the bags on the disk, stand still for longer than a fault may go unreported:
was it reported? A status on /diagnostics that is not OK, or one that stops coming, reports it. For
each such silence it prints {"source", "seconds", "reported"} as a line of JSON, at its end
{"hours"}. `observe` starts it as a process of its own.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

SILENT_S = 5.0  # an error is reported after 3 s, by a status that comes once a second
STALE_S = 2.5  # two statuses of a node are missing
LOOK_S = 0.1


class Silences:
    """Finds silences of sources, and whether any status reported them meanwhile."""

    def __init__(self, now_s: float) -> None:
        self._since_s: dict[str, float] = {}
        self._last: dict[str, int] = {}
        self._reported: dict[str, bool] = {}
        self._status: dict[str, tuple[bool, float]] = {}
        self.begun_s = now_s

    def status(self, name: str, ok: bool, now_s: float) -> None:
        """Take the status of a node."""
        self._status[name] = ok, now_s

    def look(self, counts: dict[str, int], now_s: float) -> list[dict[str, Any]]:
        """Take a count of each source that rises while it lives; return the silences that ended."""
        told = any(not ok or now_s - at > STALE_S for ok, at in self._status.values())
        told = told or not self._status
        ended = []
        for source, count in counts.items():
            since_s = self._since_s.setdefault(source, now_s)
            self._reported[source] = self._reported.get(source, False) or told
            if count != self._last.setdefault(source, count):
                ended += self._end(source, now_s - since_s)
                self._since_s[source], self._reported[source] = now_s, told
                self._last[source] = count
        return ended

    def close(self, now_s: float) -> list[dict[str, Any]]:
        """Return the silences that last."""
        return [one for s, at in self._since_s.items() for one in self._end(s, now_s - at)]

    def _end(self, source: str, seconds: float) -> list[dict[str, Any]]:
        if seconds <= SILENT_S:
            return []
        return [
            {'source': source, 'seconds': round(seconds, 1), 'reported': self._reported[source]}
        ]


class Observer:
    """The observer as a child; `stop` returns what it has seen."""

    def __init__(self, file: Path, bags: Path, domain: int) -> None:
        from eol_ros import parent_death  # of the bench, not of the child

        self._file = file
        with file.open('w') as out:
            self._child = subprocess.Popen(
                [sys.executable, '-P', __file__, str(bags)],
                stdout=out, env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
                preexec_fn=parent_death.following(),
            )  # fmt: skip

    def stop(self) -> dict[str, Any]:
        """End it; return hours, the number of silences, and those that nothing reported."""
        self._child.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(10)
        self._child.kill()
        lines = [json.loads(line) for line in self._file.read_text().splitlines()]
        silences = [line for line in lines if 'source' in line]
        return {
            'hours': next((line['hours'] for line in lines if 'hours' in line), None),
            'silences': len(silences),
            'unreported': [one for one in silences if not one['reported']],
        }


def main(bags: Path) -> None:
    """Observe until SIGTERM."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from eol_msgs.msg import Blocks
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data

    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    node = Node('soak_observer')
    found, blocks = Silences(time.monotonic()), 0

    def count(_message: bytes) -> None:
        nonlocal blocks
        blocks += 1

    def hear(message: Any) -> None:
        for status in message.status:
            found.status(status.name, status.level == b'\0', time.monotonic())

    node.create_subscription(Blocks, '/eol/blocks', count, qos_profile_sensor_data, raw=True)
    node.create_subscription(DiagnosticArray, '/diagnostics', hear, 50)
    try:
        looked_s = 0.0
        while True:
            rclpy.spin_once(node, timeout_sec=LOOK_S)
            if (now_s := time.monotonic()) - looked_s >= LOOK_S:
                looked_s = now_s
                for one in found.look({'blocks': blocks, 'bags': _size(bags)}, now_s):
                    print(json.dumps(one), flush=True)
    finally:
        now_s = time.monotonic()
        for one in found.close(now_s):
            print(json.dumps(one))
        print(json.dumps({'hours': round((now_s - found.begun_s) / 3600, 4)}), flush=True)


def _size(bags: Path) -> int:
    """Return a number that changes when the bags do."""
    total = 0
    for file in bags.rglob('*.mcap'):
        with contextlib.suppress(OSError):  # just removed
            total += file.stat().st_size
    return total


if __name__ == '__main__':
    main(Path(sys.argv[1]))

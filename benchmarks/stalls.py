# SPDX-License-Identifier: Apache-2.0
"""When the machine itself stood still: a virtual one is now and then taken off its processor.

On each processor a thread above all others does nothing but wake up every millisecond. Where even
that one is late, nobody else could have been in time.
"""

import json
import os
import select
import subprocess
import sys
import time

from eol_ros import parent_death

EVERY_S = 0.001
LATE_S = 0.0025  # half a block of 256 samples
REAL_TIME = 90  # above JACK, which has 70


def overlap(moments: list[list[float]], stalls: list[tuple[float, float]]) -> int:
    """Return how many of the `moments` (from, to) share time with a standstill."""
    return sum(any(b <= until and a >= since for b, a in stalls) for since, until in moments)


class Stalls:
    """Watches from `start` to `stop`, in a process of its own on each processor."""

    def __init__(self) -> None:
        self._children: list[subprocess.Popen[str]] = []

    def start(self) -> None:
        """Begin to watch."""
        self._children = [
            subprocess.Popen(
                [sys.executable, '-m', __name__, str(processor)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                preexec_fn=parent_death.following(),
            )
            for processor in sorted(os.sched_getaffinity(0))
        ]  # fmt: skip

    def stop(self) -> list[tuple[float, float]] | None:
        """Return (begin, end) of each standstill, monotonic; None where we may not be first."""
        answers = [json.loads(child.communicate()[0]) for child in self._children]
        self._children = []
        if any(answer is None for answer in answers):
            return None
        return sorted((begin_s, end_s) for answer in answers for begin_s, end_s in answer)


def _watch(processor: int) -> list[tuple[float, float]] | None:
    os.sched_setaffinity(0, {processor})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME))
    except PermissionError:
        return None
    found = []
    due_s = time.monotonic()
    while not select.select([sys.stdin], [], [], 0)[0]:
        due_s += EVERY_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        now_s = time.monotonic()
        if now_s - due_s > LATE_S:
            found.append((due_s, now_s))
            due_s = now_s
    return found


if __name__ == '__main__':
    print(json.dumps(_watch(int(sys.argv[1]))))

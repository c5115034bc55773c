# SPDX-License-Identifier: Apache-2.0
"""What the kernel says of a process: how long it ran and how long it waited, thread by thread.

The one place that reads `/proc/PID/task/*/schedstat` (the kernel's sched-stats.rst: ns on a
processor, ns on a run queue, turns given) and `/proc/pressure/io` (psi.rst). A kernel without the
first (no CONFIG_SCHED_INFO, some sandboxes) leaves `waited_ns` None: then the state at each look
and the times of `stat`, in steps of 10 ms, must do.
"""

import contextlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

_TICK_NS = 1_000_000_000 // os.sysconf('SC_CLK_TCK')


@dataclass(frozen=True)
class Thread:
    """One thread at one moment: its state (R, S, D, T ... of proc(5)) and counts since it began."""

    state: str
    ran_ns: int
    waited_ns: int | None = None  # for a processor; a wait that still lasts is not in it yet
    turns: int = 0  # how often it was given a processor


def threads(pid: int) -> dict[int, Thread]:
    """Return the threads of process `pid` by their id; none if it has ended."""
    found = {}
    with contextlib.suppress(OSError):
        for name in os.listdir(f'/proc/{pid}/task'):
            with contextlib.suppress(OSError, ValueError, IndexError):  # it has just ended
                found[int(name)] = _thread(f'/proc/{pid}/task/{name}/')
    return found


def _thread(task: str) -> Thread:
    stat = _read(task + 'stat').rpartition(b')')[2].split()
    state, ticks = stat[0].decode(), int(stat[11]) + int(stat[12])
    try:
        ran, waited, turns = map(int, _read(task + 'schedstat').split())
    except (OSError, ValueError):
        turns = 0
    if not turns:  # also where the kernel could count and does not: it says 0 0 0
        return Thread(state, ticks * _TICK_NS)
    return Thread(state, ran, waited, turns)


def _read(path: str) -> bytes:
    fd = os.open(path, os.O_RDONLY)
    try:
        return os.read(fd, 4096)
    finally:
        os.close(fd)


def disk_wait_s() -> float | None:
    """Return for how long, since boot, somebody has waited for a disk; None if nobody counts."""
    with contextlib.suppress(OSError):
        text = Path('/proc/pressure/io').read_text()
        if some := re.search(r'^some .*total=(\d+)', text, re.M):
            return int(some[1]) * 1e-6
    return None

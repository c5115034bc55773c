# SPDX-License-Identifier: Apache-2.0
"""Kernel priorities of processes that need the two cores in the same millisecond.

An image wakes six processes together. In a scene with `real_time: true` the processes from camera
to light and sound get real-time priority (SCHED_RR, 1 or 2 of 99, below every sound server), so
that they run when their message arrives. Processes that nobody waits for get a lower priority.
Bringup sets both when all nodes are up. A thread does not preempt another of its own level:
threads that work for milliseconds on each image have the lower level, so that no tap waits.
"""

import contextlib
import os
import resource
from pathlib import Path

from eol_ros.bringup.policy import SILENT_S
from eol_ros.devices.carrier_thread import PREFIX

CARRIERS = ('dds.', PREFIX)  # what Fast DDS calls its threads, and we those that carry


def step_back(pid: int, nice: int) -> None:
    """Let others go before process `pid` by `nice`.

    Its threads alone would not do: where the kernel groups by session (autogroup, as Debian and
    Ubuntu ship it) a nice value counts only within a session, and each child has its own.
    """
    nice = min(os.getpriority(os.PRIO_PROCESS, 0) + nice, 19)
    proc = Path('/proc', str(pid))
    with contextlib.suppress(OSError):  # it has just ended, or there is no autogroup
        for thread in (proc / 'task').iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), nice)
        (proc / 'autogroup').write_text(str(nice))


def step_ahead(pid: int, level: int, main: bool = True) -> bool:
    """Give real-time priority to the message threads of `pid`; return whether the system allows it.

    The priority is `level`, or the highest permitted below it. Message threads are the `main`
    thread, where every callback runs, the threads of DDS, and those that carry images and taps.
    Threads that load files, compile or record keep the normal priority, and so do their children.

    The kernel ends the process (SIGXCPU, RLIMIT_RTTIME) when one of these threads has run for
    SILENT_S without a pause. A node that is silent for so long counts as hung anyway.
    """
    most_us = round(SILENT_S * 1e6)
    with contextlib.suppress(ProcessLookupError):
        resource.prlimit(pid, resource.RLIMIT_RTTIME, (most_us, most_us + 1_000_000))
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it, or a thread, has ended
        for task in Path('/proc', str(pid), 'task').iterdir():
            name = (task / 'comm').read_text()
            carries = name.startswith(CARRIERS) or (main and int(task.name) == pid)
            if carries and not _step_ahead(int(task.name), level):
                return False
    return True


def _step_ahead(thread: int, level: int) -> bool:
    for given in range(level, 0, -1):
        with contextlib.suppress(PermissionError):
            policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(thread, policy, os.sched_param(given))
            return True
    return False

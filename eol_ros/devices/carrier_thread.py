# SPDX-License-Identifier: Apache-2.0
"""Threads that carry images or knocks: they run when the callbacks of their process would."""

import contextlib
import os
import threading
from collections.abc import Callable
from pathlib import Path

PREFIX = 'eol.'
"""What the kernel calls them begins with; bringup gives these its real-time priority, too."""


def aside(work: Callable[[], None]) -> None:
    """Do `work` that takes long in a thread without priority, and wait for its end."""

    def body() -> None:
        with contextlib.suppress(OSError):  # it begins with the name of who asks
            Path(f'/proc/self/task/{threading.get_native_id()}/comm').write_text('aside')
        work()

    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    thread.join()


def carrier_thread(name: str, run: Callable[[], None]) -> threading.Thread:
    """Return a daemon thread of `run`, not yet started.

    One that begins later than bringup gave its process a priority takes that of the main thread.
    """

    def body() -> None:
        own = threading.get_native_id()
        with contextlib.suppress(OSError):  # not Linux, or not allowed here: as all the others
            Path(f'/proc/self/task/{own}/comm').write_text(PREFIX + name)
            policy = os.sched_getscheduler(os.getpid())
            if policy & ~os.SCHED_RESET_ON_FORK in (os.SCHED_RR, os.SCHED_FIFO):
                os.sched_setscheduler(own, policy, os.sched_getparam(os.getpid()))
        run()

    return threading.Thread(target=body, name=name, daemon=True)

# SPDX-License-Identifier: Apache-2.0
"""Child processes that end when their parent ends in any way (prctl(2), PR_SET_PDEATHSIG).

For the kernel the parent is the thread that started the child. It must outlive the child.
"""

import ctypes
import os
import signal
from collections.abc import Callable

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def follow(parent: int, number: int = signal.SIGKILL) -> None:
    """Make the kernel send this process signal `number` when process `parent` ends."""
    _libc.prctl(_PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:  # the parent ended before the call above
        os._exit(1)


def following(number: int = signal.SIGKILL) -> Callable[[], None]:
    """Return a `preexec_fn` for `subprocess`: the child gets signal `number` when we end."""
    parent = os.getpid()
    return lambda: follow(parent, number)

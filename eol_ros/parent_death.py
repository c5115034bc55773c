# SPDX-License-Identifier: Apache-2.0
"""Child processes that end with their parent, however that ended (prctl(2), PR_SET_PDEATHSIG).

To the kernel the parent is the thread that started the child: it must last as long as that.
"""

import ctypes
import os
import signal
from collections.abc import Callable

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def follow(parent: int, number: int = signal.SIGKILL) -> None:
    """Have the kernel send this process signal `number` when process `parent` has ended."""
    _libc.prctl(_PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:  # it ended before the call above
        os._exit(1)


def following(number: int = signal.SIGKILL) -> Callable[[], None]:
    """Return a `preexec_fn` for `subprocess`: the child gets signal `number` when we have ended."""
    parent = os.getpid()
    return lambda: follow(parent, number)

# SPDX-License-Identifier: Apache-2.0
"""The way out of DDS ends in time, even where DDS itself hangs.

Fast DDS 2.14 can wait for ever in `DomainParticipant::set_listener` when a participant is taken
down in the instant in which another one leaves. The main thread then spins inside C++ and no
Python signal handler runs any more; what the kernel does by itself still works.
"""

import signal

LEAVE_S = 4


def arm(seconds: int = LEAVE_S) -> None:
    """Let the kernel end this process (SIGALRM) if it still lives in `seconds`."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(seconds)


def disarm() -> None:
    """DDS is down: the process may live on."""
    signal.alarm(0)

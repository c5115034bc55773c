# SPDX-License-Identifier: Apache-2.0
"""ROS time stamps to whole nanoseconds and back."""

import time

from builtin_interfaces.msg import Time

NS = 1_000_000_000


def to_ns(stamp: Time) -> int:
    """Return the stamp in nanoseconds since the epoch."""
    ns: int = stamp.sec * NS + stamp.nanosec
    return ns


def to_msg(ns: int) -> Time:
    """Return the stamp message of `ns` nanoseconds since the epoch."""
    return Time(sec=ns // NS, nanosec=ns % NS)


def now_ns() -> int:
    """Return system time in nanoseconds."""
    return time.time_ns()


def system_ns(steady_s: float) -> int:
    """Return the system time, in nanoseconds, of the instant `steady_s` of `time.monotonic`.

    The two clocks are read one after the other; a pair of readings between which the process was
    held up by more than 50 us is taken again, at most ten times.
    """
    for _ in range(10):
        before = time.monotonic_ns()
        system = time.time_ns()
        gap = time.monotonic_ns() - before
        if gap < 50_000:
            break
    return system + round(steady_s * NS) - before - gap // 2

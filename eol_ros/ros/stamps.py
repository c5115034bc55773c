# SPDX-License-Identifier: Apache-2.0
"""ROS time stamps to whole nanoseconds and back."""

import time

from builtin_interfaces.msg import Time

NS = 1_000_000_000


def to_ns(stamp: Time) -> int:
    """Return the stamp in nanoseconds since the epoch."""
    return stamp.sec * NS + stamp.nanosec


def to_msg(ns: int) -> Time:
    """Return the stamp message of `ns` nanoseconds since the epoch."""
    return Time(sec=ns // NS, nanosec=ns % NS)


def now_ns() -> int:
    """Return system time in nanoseconds."""
    return time.time_ns()

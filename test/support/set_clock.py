# SPDX-License-Identifier: Apache-2.0
"""A clock that a test sets."""


class SetClock:
    """Takes the place of module `time` in the lights: steady time, and a clock that can be set."""

    def __init__(self, now_s: float):
        self.steady_ns, self.offset_ns = 10**9, round(now_s * 1e9)

    def monotonic_ns(self):
        return self.steady_ns

    def time_ns(self):
        return self.steady_ns + self.offset_ns

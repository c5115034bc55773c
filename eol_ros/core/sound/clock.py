# SPDX-License-Identifier: Apache-2.0
"""Which frame of the stream sounds at which time: a delay-locked loop on the callback's times.

F. Adriaensen, "Using a DLL to filter time", Linux Audio Conference 2005. A callback comes late by
a random bit; the loop follows the sample clock and smooths that out. It is of second order, so a
sound card that runs 100 ppm fast leaves no error behind.
"""

import math

from eol_ros.core.compiled import njit

BANDWIDTH_HZ = 0.5  # when settled
WIDE_HZ = 8.0  # just after locking, so that the first guess is soon forgotten
RELOCK_S = 0.02  # an error beyond any jitter: the system clock was set, or the device stood still
# Added before a frame number is cut to a whole one. A stamp counts nanoseconds, 4.8e-5 frames at
# 48 kHz: half of that on top lets no rounding error decide between two frames.
NEAREST = 0.5 + 2.4e-5


@njit(cache=True)
def start_clock(s, now_s):
    """Lock the clock in `s` (STATE) once more: the next frame sounds at `now_s`."""
    s.clock_time = now_s
    s.clock_frame = s.frame
    s.clock_period = 1.0 / s.sample_rate
    s.clock_since = 0.0
    s.clock_locks += 1


@njit(cache=True)
def step_clock(s, now_s):
    """A callback that makes frame `s.frame` and those after it came at `now_s` (seconds)."""
    if s.clock_steady:
        return
    if s.clock_locks == 0:
        start_clock(s, now_s)
        return
    frames = s.frame - s.clock_frame
    if frames <= 0:
        return
    expected = s.clock_time + frames * s.clock_period
    error = now_s - expected
    if not abs(error) < RELOCK_S + frames / s.sample_rate:
        start_clock(s, now_s)
        return
    span = frames / s.sample_rate
    s.clock_since += span
    band = max(BANDWIDTH_HZ, min(WIDE_HZ, 1.0 / s.clock_since))
    w = 2 * math.pi * band * span
    w = min(w, 0.7)  # long blocks: stay where the loop is stable
    s.clock_time = expected + math.sqrt(2.0) * w * error
    s.clock_period += w * w * error / frames
    s.clock_frame = s.frame


@njit(cache=True)
def set_clock(state, time_s):
    """From now on the frames of `state` (1,) STATE come at exact times, the next at `time_s`."""
    s = state[0]
    start_clock(s, time_s)
    s.clock_steady = 1


@njit(cache=True)
def frame_at(s, time_s):
    """Return the frame number that sounds at `time_s`, rounded to a whole one."""
    return int(math.floor(s.clock_frame + (time_s - s.clock_time) / s.clock_period + NEAREST))

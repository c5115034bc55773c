# SPDX-License-Identifier: Apache-2.0
"""What the sum of the voices goes through: gain, loudness governor, DC block, fades, limiter.

All of it works sample by sample with state in double precision, so the result does not depend on
the block size, and it comes to exact zeros when the voices are silent.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, exp, exp10, log10

ONE = 1 << 40  # the gain 1 in the smoothing box: integers add without rounding, so it never drifts
INAUDIBLE = 1e-7  # a gain so near to its aim is there
TAIL = 1e-8  # -160 dBFS: below it the tail of the DC block is cut to zero
GAIN_S = 0.05  # a change of the master gain is spread over about this long


@njit(cache=True)
def govern(m):
    """At the end of each 100 ms: set the governor's gain for the next 100 ms.

    Loudness of the last 30 s, not gated, over all channels; the governor takes away what exceeds
    `loudness`, at most `governor_range` dB.
    """
    s = m.state[0]
    energy = 0.0
    for c in range(m.filters.shape[0]):
        energy += m.filters[c, 6]
        m.filters[c, 6] = 0.0
        for k in range(2, 6):  # tails would end as denormal numbers, which are slow
            if abs(m.filters[c, k]) < 1e-20:
                m.filters[c, k] = 0.0
    m.windows[s.window_next] = energy / s.window_fill
    s.window_next = (s.window_next + 1) % m.windows.size
    length = s.window_fill
    s.window_fill = 0
    mean = m.windows.mean()
    s.lufs = -0.691 + 10 * log10(mean) if mean > 1e-12 else -120.0
    s.governor_db = min(0.0, max(-s.governor_range, s.loudness - s.lufs))
    target = exp10(s.governor_db / 20)
    if abs(target - s.governor) < INAUDIBLE:
        s.governor, s.governor_step = target, 0.0
    else:
        s.governor_step = (target - s.governor) / length


@njit(cache=True)
def _glide(m, at, n):
    """Multiply `n` frames by gain and fade where these move; return the gain that is left to do."""
    s = m.state[0]
    if s.gain == s.gain_target and s.fade == s.fade_target and s.fade == 1.0:
        return s.gain
    ease = 1.0 - exp(-1.0 / (GAIN_S * s.sample_rate))
    for k in range(at, at + n):
        if s.gain != s.gain_target:
            s.gain += ease * (s.gain_target - s.gain)
            if abs(s.gain - s.gain_target) < INAUDIBLE:
                s.gain = s.gain_target
        if s.fade < s.fade_target:
            s.fade = min(s.fade_target, s.fade + s.fade_step)
        elif s.fade > s.fade_target:
            s.fade = max(s.fade_target, s.fade - s.fade_step)
        gain = s.gain * (0.5 - 0.5 * cos(math.pi * s.fade) if s.fade < 1.0 else 1.0)
        for c in range(m.filters.shape[0]):
            m.mix[c, k] = np.float32(gain * m.mix[c, k])
    return 1.0


@njit(cache=True)
def _filter(row, f, w, gain, governor, step, pole):
    """Weigh and measure one channel `row` (n,) f4, then governor and DC block in place."""
    x1, y1, a1, a2, b1, b2, energy = f[0], f[1], f[2], f[3], f[4], f[5], f[6]
    w0, w1, w2, w3, w4 = w[0], w[1], w[2], w[3], w[4]
    u0, u1, u2, u3, u4 = w[5], w[6], w[7], w[8], w[9]
    for k in range(row.size):
        raw = np.float64(np.float32(gain * row[k]))  # rounded here as where the gain moves
        v = w0 * raw + a1
        a1 = w1 * raw - w3 * v + a2
        a2 = w2 * raw - w4 * v
        z = u0 * v + b1
        b1 = u1 * v - u3 * z + b2
        b2 = u2 * v - u4 * z
        energy += z * z
        governor += step
        x = governor * raw
        y = x - x1 + pole * y1
        if x == 0.0 and abs(y) < TAIL:
            y = 0.0
        x1, y1 = x, y
        row[k] = y
    f[0], f[1], f[2], f[3], f[4], f[5], f[6] = x1, y1, a1, a2, b1, b2, energy
    return governor


@njit(cache=True)
def condition(m, n):
    """Gain and fade, governor, DC block, in place on the first `n` frames of `m.mix`."""
    s = m.state[0]
    window = int(round(0.1 * s.sample_rate))
    at = 0
    while at < n:
        span = min(n - at, window - s.window_fill)
        gain = _glide(m, at, span)
        governor = s.governor
        for c in range(m.filters.shape[0]):
            governor = _filter(
                m.mix[c, at : at + span],
                m.filters[c],
                m.weights,
                gain,
                s.governor,
                s.governor_step,
                s.dc_pole,
            )
        s.governor = governor
        s.window_fill += span
        at += span
        if s.window_fill == window:
            govern(m)


@njit(cache=True, fastmath={'nnan', 'nsz'})  # a maximum has no order: vector code is as exact
def _peak(row):
    peak = np.float32(0.0)
    for k in range(row.size):
        peak = max(peak, abs(row[k]))
    return peak


@njit(cache=True)
def _least(m, frame, gain):
    """Push `gain` of `frame`; return the least of the last look_ahead + 1 gains.

    A queue of rising gains (Lemire 2006): each frame enters and leaves once.
    """
    s = m.state[0]
    size = m.queue_gain.size
    while s.queue_count and m.queue_gain[(s.queue_first + s.queue_count - 1) % size] >= gain:
        s.queue_count -= 1
    end = (s.queue_first + s.queue_count) % size
    m.queue_gain[end], m.queue_frame[end] = gain, frame
    s.queue_count += 1
    if m.queue_frame[s.queue_first] < frame - s.look_ahead:
        s.queue_first = (s.queue_first + 1) % size
        s.queue_count -= 1
    return m.queue_gain[s.queue_first]


@njit(cache=True)
def limit(m, out, at, n):
    """Write the first `n` frames of `m.mix` to `out` (frames, channels) f4 from row `at` on.

    Delayed by `look_ahead` frames and never above `ceiling`: the gain that each frame needs is held
    back to the least of the window ahead, let go exponentially, and averaged over the window. Each
    of the averaged gains is at most what the frame that leaves needs, and so is their mean.
    """
    s = m.state[0]
    channels, ahead = m.delay.shape[0], s.look_ahead
    peak = np.float32(0.0)
    for c in range(channels):
        m.delay[c, ahead : ahead + n] = m.mix[c, :n]
        peak = max(peak, _peak(m.mix[c, :n]))
    if peak <= s.ceiling and s.settled > 2 * ahead + 2:
        for k in range(n):
            for c in range(channels):
                out[at + k, c] = m.delay[c, k]
        s.settled += n
        s.queue_count = 0  # all it could hold are ones
    else:
        for k in range(n):
            frame = s.frame + k
            x = np.float32(0.0)
            for c in range(channels):
                x = max(x, abs(m.delay[c, ahead + k]))
            need = 1.0 if x <= s.ceiling else s.ceiling / x
            least = _least(m, frame, need)
            s.held = min(least, s.held + s.release * (1.0 - s.held))
            if s.held > 1.0 - INAUDIBLE and least == 1.0:
                s.held = 1.0
            s.settled = s.settled + 1 if s.held == 1.0 else 0
            i = frame % m.box.size
            s.box_sum -= m.box[i]
            m.box[i] = int(s.held * ONE)
            s.box_sum += m.box[i]
            s.limiter = s.box_sum / (ONE * m.box.size)
            s.limiter_least = min(s.limiter_least, s.limiter)
            for c in range(channels):
                out[at + k, c] = np.float32(m.delay[c, k] * s.limiter)
    for c in range(channels):
        row = m.delay[c]
        for k in range(ahead):
            row[k] = row[k + n]

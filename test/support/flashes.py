# SPDX-License-Identifier: Apache-2.0
"""Flashes as WCAG 2.2 counts them (success criterion 2.3.1)."""

import numpy as np


def render(field, slips, seconds, rate_hz=250.0):
    """Levels on a time grid, shape (n, 25); slips take effect at their own times."""
    pending, out = sorted(slips)[::-1], []
    for t in np.arange(int(seconds * rate_hz)) / rate_hz:
        while pending and pending[-1][0] <= t:
            field.slip(*pending.pop())
        out.append(field.levels(t))
    return np.array(out)


def count_flashes(luminance):
    """Pairs of opposing changes of 10 % or more, from the samples alone (WCAG 2.2, 2.3.1)."""
    transitions, direction, extreme = 0, 0, luminance[0]
    low = high = luminance[0]
    for value in luminance:
        if direction == 0:
            low, high = min(low, value), max(high, value)
            if high - low >= 0.1:
                direction, extreme, transitions = (1 if value == high else -1), value, 1
        elif (value - extreme) * direction > 0:
            extreme = value
        elif abs(value - extreme) >= 0.1:
            direction, extreme, transitions = -direction, value, transitions + 1
    return transitions // 2


def most_flashes_in_a_second(luminance, rate_hz):
    window = int(rate_hz) + 1  # both ends of a closed second
    step = max(1, window // 50)
    return max(
        count_flashes(luminance[at : at + window])
        for at in range(0, max(1, len(luminance) - window), step)
    )


def changes(times_s, luminance):
    """When light that is sampled at any times has turned round by 10 % or more, (n,) s."""
    found, direction, extreme = [], 0, luminance[0]
    for t, value in zip(times_s, luminance, strict=True):
        if (value - extreme) * direction > 0:
            extreme = value
        elif abs(value - extreme) >= 0.1:
            direction, extreme = (1 if value > extreme else -1), value
            found.append(t)
    return np.array(found)

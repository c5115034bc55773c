# SPDX-License-Identifier: Apache-2.0
"""What the map to sound makes of slips: which of them sound, and the power of their grains.

A model of `sound.select` and the mixer for tables of any size: each slip asks for one grain, its
block's own, which does not sound again within `refractory_s`; no block sounds more than `block_cap`
times in a second and all no more than `total_cap`; a grain has an envelope and no pitch. Gains,
which follow speed, are left out. docs/explanation/science.md holds it against the real chain.
"""

from collections import deque

import numpy as np

from eol_ros.settings import GrainsSettings

STEP_S = 0.0025  # of the envelope, finer than its rise


def heard(times_s: np.ndarray, block: np.ndarray, rule: GrainsSettings) -> np.ndarray:
    """Return which slips sound, (n,) bool, of slips at `times_s` (n,), rising, of `block` (n,).

    Of `rule` refractory_s, block_cap and total_cap count.
    """
    last: dict[int, float] = {}
    second: deque[tuple[float, int]] = deque()
    of_block: dict[int, int] = {}
    sounds = np.zeros(len(times_s), bool)
    for k, (time_s, one) in enumerate(zip(times_s.tolist(), block.tolist(), strict=True)):
        while second and time_s - second[0][0] >= 1.0:
            of_block[second.popleft()[1]] -= 1
        if time_s - last.get(one, -np.inf) < rule.refractory_s:
            continue
        if len(second) >= rule.total_cap or of_block.get(one, 0) >= rule.block_cap:
            continue
        last[one] = time_s
        of_block[one] = of_block.get(one, 0) + 1
        second.append((time_s, one))
        sounds[k] = True
    return sounds


def power(
    times_s: np.ndarray, duration_s: float, rate_hz: float, rule: GrainsSettings
) -> np.ndarray:
    """Return the mean power of the sound in each 1 / `rate_hz`, (n,): 1 is one grain at its height.

    times_s : (m,) of the slips that sound, as `heard` says.
    """
    fine = max(1, round(1 / (rate_hz * STEP_S)))
    step_hz, count = rate_hz * fine, round(duration_s * rate_hz) * fine
    at_s = (np.arange(max(1, round(rule.grain_s * step_hz))) + 0.5) / step_hz
    fall_s = min(rule.release_s, rule.grain_s)
    level = np.clip(np.minimum(at_s / rule.attack_s, (rule.grain_s - at_s) / fall_s), 0.0, 1.0)
    made = np.zeros(count + len(level))
    first = np.minimum((np.asarray(times_s) * step_hz).astype(np.int64), count)
    for k, one in enumerate(level**2):  # grains of noise: their powers add
        np.add.at(made, first + k, one)
    return made[:count].reshape(-1, fine).mean(axis=1)

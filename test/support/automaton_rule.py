# SPDX-License-Identifier: Apache-2.0
"""The rule of the automaton in exact arithmetic: whole numbers over one common denominator."""

from fractions import Fraction

import numpy as np

GROW = 16  # powers of alpha's denominator that the common denominator grows by at a time


def by_the_rule(start: np.ndarray, denominator: int, alpha: Fraction, count: int) -> np.ndarray:
    """Return size, area, duration and first site of `count` events, (count, 4).

    start: (L, L) whole numbers below `denominator`.
    """
    side, one, drive = len(start), denominator, 0  # `drive` is to be added to all sites
    value = dict(zip(np.ndindex(side, side), map(int, start.flat), strict=True))
    rows = []
    for _ in range(count):
        drive = one - max(value.values())
        layers: list[list[tuple[int, ...]]] = []
        layer = sorted(site for site, v in value.items() if v + drive == one)
        while layer:
            layers.append(layer)
            old = [value[site] + drive for site in layer]
            if any(v % alpha.denominator for v in old):
                scale = alpha.denominator**GROW
                value = {site: v * scale for site, v in value.items()}
                old = [v * scale for v in old]
                one, drive = one * scale, drive * scale
            for site in layer:
                value[site] = -drive
            near = set(layer)
            for (i, j), v in zip(layer, old, strict=True):
                for to in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                    if to in value:
                        value[to] += v // alpha.denominator * alpha.numerator
                        near.add(to)
            layer = sorted(site for site in near if value[site] + drive >= one)
        area = len(set().union(*layers))
        first = int(np.ravel_multi_index(layers[0][0], (side, side)))
        rows.append((sum(map(len, layers)), area, len(layers), first))
    return np.array(rows)

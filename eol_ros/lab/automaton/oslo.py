# SPDX-License-Identifier: Apache-2.0
"""The rice pile: the Oslo model, Christensen and others, Phys. Rev. Lett. 77 (1996) 107.

One grain after another is put on the wall end of a row of L heaps. A heap whose slope to the next
is greater than its own limit, 1 or 2 by the toss of a coin, loses a grain downhill and tosses
again. The grain that leaves the last heap is gone. Rice itself was measured by Frette et al.,
Nature 379 (1996) 49. Here z_i is the slope; a topple takes 2 from it and gives 1 to either side, at
the end 1 and 1 uphill.
"""

import numpy as np
from numba import uint64

from eol_ros.core.compiled import njit
from eol_ros.errors import ConfigError
from eol_ros.lab.automaton.ofc import LARGEST_SIDE, Events


@njit(cache=True)
def _coin(seed, site, use):
    """Return 1 or 2: coin number `use` of `site`; SplitMix64 (Steele et al. 2014) of the three.

    A pure function, so that the pile does not depend on the order in which heaps topple.
    """
    z = uint64(seed) * uint64(0x9E3779B97F4A7C15) + uint64(site) * uint64(0xD1B54A32D192ED03)
    z += uint64(use) * uint64(0x8CB92BA72F3D8DD7) + uint64(0x632BE59BD9B4E019)
    z = (z ^ (z >> uint64(30))) * uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> uint64(27))) * uint64(0x94D049BB133111EB)
    z ^= z >> uint64(31)
    return 1 + int(z >> uint64(63))


@njit(cache=True)
def _run(slope, limit, uses, seed, sizes, areas, durations):
    side = slope.size
    layer, following = np.empty(2 * side + 2, np.int64), np.empty(2 * side + 2, np.int64)
    seen = np.full(side, -1, np.int64)
    for event in range(sizes.size):
        slope[0] += 1
        count, size, area, duration = 1, 0, 0, 0
        layer[0] = 0
        while True:
            found = 0
            for k in range(count):  # who topples is settled before anybody does
                i = layer[k]
                if slope[i] > limit[i]:
                    limit[i] = 1 << 40  # marks it: a repeat in the list passes by
                    following[found] = i
                    found += 1
            if found == 0:
                break
            duration += 1
            size += found
            count = 0
            for k in range(found):
                i = following[k]
                area += seen[i] != event
                seen[i] = event
                uses[i] += 1
                limit[i] = _coin(seed, i, uses[i])
                slope[i] -= 2 if i < side - 1 else 1
            for k in range(found):
                i = following[k]
                layer[count] = i
                count += 1
                if i > 0:
                    slope[i - 1] += 1
                    layer[count] = i - 1
                    count += 1
                if i < side - 1:
                    slope[i + 1] += 1
                    layer[count] = i + 1
                    count += 1
        sizes[event], areas[event], durations[event] = size, area, duration


class OsloPile:
    """A pile of `side` heaps, empty at first; `run` puts on grains. Every grain is an event."""

    arithmetic = 'whole numbers'

    def __init__(self, side: int, seed: int):
        if not 1 <= side <= LARGEST_SIDE:
            raise ConfigError(f'pile size {side} is not between 1 and {LARGEST_SIDE}')
        self.side, self.seed = side, seed
        self.slope = np.zeros(side, np.int64)
        self._uses = np.zeros(side, np.int64)
        self._limit = np.array([self.limit_of(seed, i, 0) for i in range(side)], np.int64)

    @staticmethod
    def limit_of(seed: int, site: int, use: int) -> int:
        """Return the limit of `site` after it has toppled `use` times."""
        return _coin(seed, site, use)

    def run(self, count: int, full: bool = True) -> Events:
        """Return the next `count` grains; a grain that moves nothing has size 0."""
        events = Events.empty(count)
        _run(
            self.slope,
            self._limit,
            self._uses,
            self.seed,
            events.size,
            events.area,
            events.duration,
        )
        return events

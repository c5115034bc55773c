# SPDX-License-Identifier: Apache-2.0
"""The inner loop of the automaton, in integers.

Stress is held as integers relative to a drive `g` that all sites share, so that raising all of them
is one addition. Integer sums do not depend on their order: a layer may be worked off in any order,
on any machine, with the same result to the last bit.

The next event starts at the greatest stress. Finding it is the work of a queue of two parts
(Grassberger 1994 held all sites in boxes; here there is one box): a bucket of all sites at or above
`floor`, kept as a maximum tree (binary heap). Whoever rises into the bucket is pushed; an entry
whose site has changed since is dropped when it comes up. When the bucket is empty a sweep of the
lattice fills it again, with a floor so much lower that sweeps and pushes cost about the same.

Lattice: rows of L sites with one sink before each and a row of sinks above and below, flat; a sink
lies so deep that it never topples, which makes the open boundary free of tests.
"""

import numpy as np
from numba import int64, uintp

from eol_ros.core.compiled import njit

SINK = -(1 << 62)
REBASE = 1 << 60  # the drive is folded into the sites before it nears the depth of the sinks
SINK_EVERY = 256  # events after which the sinks are emptied
SHARE_BITS = 32  # of the multiplier of the fixed-point path
LOW = (1 << SHARE_BITS) - 1


@njit(inline='always')
def _push(keys, sites, count, key, site):
    k = count
    while k > 0:
        up = (k - 1) >> 1
        if keys[uintp(up)] >= key:
            break
        keys[uintp(k)] = keys[uintp(up)]
        sites[uintp(k)] = sites[uintp(up)]
        k = up
    keys[uintp(k)] = key
    sites[uintp(k)] = site


@njit(inline='always')
def _pop(keys, sites, count):
    """Remove the root of a heap that has `count` entries afterwards.

    The hole goes down to the bottom without asking whether the last entry fits: it nearly never
    does, and the question would be a branch that is guessed wrong half of the time.
    """
    key, site, k = keys[uintp(count)], sites[uintp(count)], 0
    keys[uintp(count)] = SINK
    down = 1
    while down < count:
        down += keys[uintp(down + 1)] > keys[uintp(down)]
        keys[uintp(k)] = keys[uintp(down)]
        sites[uintp(k)] = sites[uintp(down)]
        k = down
        down = 2 * k + 1
    _push(keys, sites, k, key, site)


@njit(cache=True)
def _maximum(stress):
    top = stress[0]
    for k in range(stress.size):
        top = max(top, stress[k])
    return top


@njit(cache=True)
def _empty_sinks(stress, side):
    stride = side + 1
    for k in range(stride):
        stress[k] = SINK
        stress[stress.size - 1 - k] = SINK
    for row in range(side + 2):
        stress[row * stride] = SINK


@njit(inline='always')
def _give(stress, site, gift, floor, near, candidates):
    """Raise a site; return how many candidates there are, itself among them from `floor` on."""
    value = stress[site] + gift
    stress[site] = value
    near[uintp(candidates)] = site
    return candidates + (value >= floor)


@njit(cache=True)
def topple(stress, side, one, share, events):
    """Run the events of `events` (Events) on `stress` in place.

    stress: (n,) int64, padded as the module says, in units in which the threshold is `one`.
    A toppling site gives each neighbour floor(stress * share / 2^32).
    """
    sizes, areas, durations, firsts = events
    n, stride = stress.size, side + 1
    near = np.empty(4 * n + 8, np.int32)  # sites that may topple in the next layer, with repeats
    now = np.empty(n, np.int32)
    gifts = np.empty(n, np.int64)
    capacity = n // 4 + 64
    keys, sites = np.empty(capacity + 2, np.int64), np.empty(capacity + 2, np.int32)
    seen = np.full(n if areas.size else 1, -1, np.int64)
    count, refill, floor = 0, True, int64(0)
    depth = max(int64(1), int64(one) // 64)
    drive = int64(0)
    filled_at, toppled_since = 0, 0
    for event in range(sizes.size):
        if event % SINK_EVERY == 0:
            _empty_sinks(stress, side)
        candidates = 0
        while True:
            if refill or count == 0:
                mean = (toppled_since + 1.0) / (event - filled_at + 1.0)
                wanted = min(max(8, int(0.045 * n / np.sqrt(mean))), capacity // 2)
                filled_at, toppled_since, refill = event, 0, False
                top = _maximum(stress)
                while True:
                    floor = top - depth
                    found = 0
                    for k in range(n):
                        now[uintp(found)] = k
                        found += stress[k] >= floor
                    if found <= capacity // 2 or depth <= 1:
                        break
                    depth //= 2
                if 2 * found > capacity:  # more equals than the bucket holds: take them all, now
                    floor, refill = top, True
                    while stress[now[0]] != top:
                        now[0] += 1
                    found = 1
                if 2 * found < wanted and depth < one:
                    depth = depth * 3 // 2 + 1
                elif found > 2 * wanted:
                    depth = max(int64(1), depth * 2 // 3)
                count = 0
                for k in range(found):
                    _push(keys, sites, count, stress[now[k]], now[k])
                    count += 1
            theta, site = keys[0], sites[0]
            count -= 1
            _pop(keys, sites, count)
            if stress[uintp(site)] == theta:
                break
        first = site
        near[0] = site
        candidates = 1
        if refill:
            candidates, count = 0, 0
            for k in range(n):
                near[uintp(candidates)] = k
                candidates += stress[k] == theta
            first = near[0]
        while count > 0 and keys[0] == theta:
            near[uintp(candidates)] = sites[0]
            first = min(first, sites[0]) if stress[uintp(sites[0])] == theta else first
            candidates += 1
            count -= 1
            _pop(keys, sites, count)
        drive = one - theta
        size = area = duration = 0
        while True:
            toppling = 0
            for k in range(candidates):
                j = uintp(near[uintp(k)])
                value = stress[j]
                if value >= theta:
                    now[uintp(toppling)] = j
                    full = value + drive
                    gifts[uintp(toppling)] = (full >> SHARE_BITS) * share + (
                        ((full & LOW) * share) >> SHARE_BITS
                    )
                    stress[j] = -drive
                    toppling += 1
                elif value >= floor:
                    if count == capacity:
                        count, refill = 0, True
                    _push(keys, sites, count, value, int64(j))
                    count += 1
            if toppling == 0:
                break
            duration += 1
            size += toppling
            if areas.size:
                for k in range(toppling):
                    area += seen[now[k]] != event
                    seen[now[k]] = event
            candidates = 0
            for k in range(toppling):
                gift = gifts[uintp(k)]
                j = uintp(now[uintp(k)])
                candidates = _give(stress, j - uintp(1), gift, floor, near, candidates)
                candidates = _give(stress, j + uintp(1), gift, floor, near, candidates)
                candidates = _give(stress, j - uintp(stride), gift, floor, near, candidates)
                candidates = _give(stress, j + uintp(stride), gift, floor, near, candidates)
        toppled_since += size
        sizes[event] = size
        if areas.size:
            areas[event] = area
            durations[event] = duration
            row, column = divmod(int64(first), int64(stride))
            firsts[event] = (row - 1) * side + column - 1
        if drive > REBASE:
            for k in range(n):
                stress[k] += drive
            drive = int64(0)
            refill = True
    for k in range(n):
        stress[k] += drive
    _empty_sinks(stress, side)

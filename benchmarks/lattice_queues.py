# SPDX-License-Identifier: Apache-2.0
"""Two other queues for the automaton, to measure ours by: a maximum tree, and circular boxes.

Both follow the rule of `core.physics.automaton` in the same integers, and give the same sizes.
"""

import numpy as np
from numba import njit

from eol_ros.core.physics.automaton.ofc_kernel import LOW, REBASE, SHARE_BITS, SINK

WAYS = 6  # a node of the tree has 2^6 below it


@njit(cache=True)
def _gift(full, share):
    return (full >> SHARE_BITS) * share + (((full & LOW) * share) >> SHARE_BITS)


@njit(cache=True)
def _clear(stress, side):
    stride = side + 1
    for k in range(stride):
        stress[k] = stress[stress.size - 1 - k] = SINK
    for row in range(side + 2):
        stress[row * stride] = SINK


@njit(cache=True)
def tree(stress, side, one, share, sizes):
    """Write the sizes of the next events, return how many: upper bounds of groups of 64 sites."""
    n, stride = stress.size, side + 1
    groups = (n + 63) >> WAYS
    tops = (groups + 63) >> WAYS
    bound, top = np.full(tops << WAYS, SINK), np.full(tops, SINK)
    for k in range(n):
        bound[k >> WAYS] = max(bound[k >> WAYS], stress[k])
    for g in range(groups):
        top[g >> WAYS] = max(top[g >> WAYS], bound[g])
    near, now = np.empty(4 * n + 8, np.int32), np.empty(n, np.int32)
    gifts = np.empty(n, np.int64)
    drive = done = 0
    for event in range(sizes.size):
        if event % 256 == 0:
            _clear(stress, side)
        while True:  # down along the greatest bounds, until they are true
            a = 0
            for k in range(1, tops):
                if top[k] > top[a]:
                    a = k
            g = a << WAYS
            for k in range(g + 1, (a + 1) << WAYS):
                if bound[k] > bound[g]:
                    g = k
            if bound[g] < top[a]:
                top[a] = bound[g]
                continue
            most = SINK
            for k in range(g << WAYS, min((g + 1) << WAYS, n)):
                most = max(most, stress[k])
            if most == bound[g]:
                break
            bound[g] = most
        theta, count = bound[g], 0
        for a in range(tops):
            if top[a] < theta:
                continue
            for g in range(a << WAYS, min((a + 1) << WAYS, groups)):
                if bound[g] < theta:
                    continue
                for k in range(g << WAYS, min((g + 1) << WAYS, n)):
                    if stress[k] == theta:
                        near[count] = k
                        count += 1
        drive, size = one - theta, 0
        while count:
            toppling = 0
            for k in range(count):
                j = near[k]
                if stress[j] >= theta:
                    gifts[toppling] = _gift(stress[j] + drive, share)
                    now[toppling] = j
                    stress[j] = -drive
                    toppling += 1
            size += toppling
            count = 0
            for k in range(toppling):
                for way in range(4):
                    j = now[k] + (way * 2 - 1 if way < 2 else (way * 2 - 5) * stride)
                    value = stress[j] + gifts[k]
                    stress[j] = value
                    if value >= theta:
                        near[count] = j
                        count += 1
                    elif value > bound[j >> WAYS]:
                        bound[j >> WAYS] = value
                        if value > top[j >> (2 * WAYS)]:
                            top[j >> (2 * WAYS)] = value
        sizes[event] = size
        done = event + 1
        if drive > REBASE:
            break
    for k in range(n):
        stress[k] += drive
    return done


@njit(cache=True)
def boxes(stress, side, one, share, sizes):
    """Write the sizes of the next events, return how many: boxes by stress (Grassberger 1994)."""
    n, stride = stress.size, side + 1
    bits = 1
    while (1 << bits) < n // 2 and bits < 20:
        bits += 1
    shift, mask = 50 - bits, (2 << bits) - 1  # `one` is 2^50, and the circle twice as long
    head = np.full(mask + 1, -1, np.int32)
    after, before = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    at = np.full(n, -1, np.int32)  # the box of a site
    near, now = np.empty(4 * n + 8, np.int32), np.empty(n, np.int32)
    gifts = np.empty(n, np.int64)
    for k in range(n):
        if stress[k] > SINK >> 1:
            _into(k, (stress[k] >> shift) & mask, head, after, before, at)
    high, drive, done = one >> shift, 0, 0
    for event in range(sizes.size):
        if event % 256 == 0:
            _clear(stress, side)
        while head[high & mask] < 0:
            high -= 1
        theta, count, j = SINK, 0, head[high & mask]
        while j >= 0:
            if stress[j] > theta:
                theta, count = stress[j], 0
            if stress[j] == theta:
                near[count] = j
                count += 1
            j = after[j]
        drive, size = one - theta, 0
        while count:
            toppling = 0
            for k in range(count):
                j = near[k]
                if stress[j] >= theta:
                    gifts[toppling] = _gift(stress[j] + drive, share)
                    now[toppling] = j
                    stress[j] = -drive
                    toppling += 1
            size += toppling
            count = 0
            for k in range(toppling):
                for way in range(4):
                    j = now[k] + (way * 2 - 1 if way < 2 else (way * 2 - 5) * stride)
                    value = stress[j] + gifts[k]
                    stress[j] = value
                    if value >= theta:
                        near[count] = j
                        count += 1
                    elif at[j] >= 0:
                        _move(j, (value >> shift) & mask, head, after, before, at)
            for k in range(toppling):
                j = now[k]
                if stress[j] < theta:
                    _move(j, (stress[j] >> shift) & mask, head, after, before, at)
        sizes[event] = size
        done = event + 1
        if drive > REBASE:
            break
    for k in range(n):
        stress[k] += drive
    return done


@njit(cache=True)
def _into(j, box, head, after, before, at):
    first = head[box]
    after[j], before[j], at[j] = first, -1, box
    if first >= 0:
        before[first] = j
    head[box] = j


@njit(cache=True)
def _move(j, box, head, after, before, at):
    if at[j] == box:
        return
    if before[j] >= 0:
        after[before[j]] = after[j]
    else:
        head[at[j]] = after[j]
    if after[j] >= 0:
        before[after[j]] = before[j]
    _into(j, box, head, after, before, at)

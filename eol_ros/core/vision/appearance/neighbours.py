# SPDX-License-Identifier: Apache-2.0
"""Where its neighbours put a block: springs keep the order of the lattice."""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, exp


@njit(cache=True)
def weigh(rest, width_m):
    """Return the weights (n, n) of others: Gaussian, of standard deviation `width_m`."""
    n = rest.shape[0]
    weights = np.zeros((n, n))
    for k in range(n):
        for j in range(n):
            if j != k:
                dx, dy = rest[j, 0] - rest[k, 0], rest[j, 1] - rest[k, 1]
                weights[k, j] = exp(-(dx * dx + dy * dy) / (2 * width_m**2)) + 1e-4
    return weights


@njit(cache=True)
def predict(rest, weights, xy, seen, out):
    """Fill out (n, 4): x, y, turn of the lattice there, and how many others are in sight.

    An affine map of the rest lattice (n, 2) to the places xy (n, 2) of the others in sight, with
    `weights` (n, n), drawn to a similarity by a twentieth of its weight, so that blocks in one line
    suffice. With fewer than three in sight nothing but the count is set.
    """
    n = rest.shape[0]
    for k in range(n):
        sw = mx = my = mu = mv = 0.0
        out[k, 3] = 0.0
        for j in range(n):
            if j != k and seen[j]:
                dx, dy = rest[j, 0] - rest[k, 0], rest[j, 1] - rest[k, 1]
                w = weights[k, j]
                sw += w
                mx += w * dx
                my += w * dy
                mu += w * xy[j, 0]
                mv += w * xy[j, 1]
                out[k, 3] += 1.0
        if out[k, 3] < 3.0:
            continue
        mx, my, mu, mv = mx / sw, my / sw, mu / sw, mv / sw
        sxx = syy = sxy = sxu = sxv = syu = syv = 0.0
        for j in range(n):
            if j == k or not seen[j]:
                continue
            w = weights[k, j]
            dx, dy = rest[j, 0] - rest[k, 0] - mx, rest[j, 1] - rest[k, 1] - my
            u, v = xy[j, 0] - mu, xy[j, 1] - mv
            sxx += w * dx * dx
            syy += w * dy * dy
            sxy += w * dx * dy
            sxu += w * dx * u
            sxv += w * dx * v
            syu += w * dy * u
            syv += w * dy * v
        both = sxx + syy
        a, b, r = (sxu + syv) / both, (sxv - syu) / both, 0.05 * both
        det = (sxx + r) * (syy + r) - sxy * sxy
        ux, uy = sxu + r * a, syu - r * b
        vx, vy = sxv + r * b, syv + r * a
        out[k, 0] = mu - ((ux * (syy + r) - uy * sxy) * mx + (uy * (sxx + r) - ux * sxy) * my) / det
        out[k, 1] = mv - ((vx * (syy + r) - vy * sxy) * mx + (vy * (sxx + r) - vx * sxy) * my) / det
        out[k, 2] = arctan2(b, a)

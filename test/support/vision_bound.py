# SPDX-License-Identifier: Apache-2.0
"""The Cramer-Rao bound of a square's place: no unbiased method on one image can do better."""

import math

import numpy as np

_HALF_PX = 0.084 * 545 / 2


def position_bound_px(
    read: float,
    gain: float,
    psf_px: float = 1.2,
    amplitude: float = 170.0,
    background: float = 14.0,
) -> float:
    """Return the bound on one coordinate of a 45.8 px square, px, RMS over three angles.

    Flat square through a Gaussian and the pixel's box, variance read^2 + gain * signal + 1/12 for
    rounding; place, angle, amplitude and background unknown. Numerical Fisher information of
    independent Gaussian pixels whose variance is known (Kay 1993, eq. 3.31, first term).
    """
    blur = math.sqrt(psf_px**2 + 1 / 12)
    erf = np.vectorize(math.erf)
    v, u = np.mgrid[-44:45, -44:45].astype(float)

    def picture(p):
        c, s = math.cos(p[2]), math.sin(p[2])
        x, y = (u - p[0]) * c - (v - p[1]) * s, -(u - p[0]) * s - (v - p[1]) * c
        sides = [
            0.5 * (1 + erf((_HALF_PX + sign * axis) / (blur * math.sqrt(2))))
            for axis in (x, y)
            for sign in (1, -1)
        ]
        return p[4] + p[3] * (sides[0] + sides[1] - 1) * (sides[2] + sides[3] - 1)

    found = []
    for angle in (0.05, 0.35, 0.7):
        at = np.array([0.2, -0.3, angle, amplitude, background])
        steps = np.array([1e-3, 1e-3, 1e-4, 1e-2, 1e-2])
        slopes = [
            (picture(at + d) - picture(at - d)) / (2 * steps[k])
            for k, d in enumerate(np.diag(steps))
        ]
        variance = read**2 + gain * picture(at) + 1 / 12
        fisher = np.array([[(a * b / variance).sum() for a in slopes] for b in slopes])
        found.append(np.linalg.inv(fisher)[0, 0])
    return math.sqrt(float(np.mean(found)))

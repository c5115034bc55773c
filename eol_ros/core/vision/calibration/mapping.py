# SPDX-License-Identifier: Apache-2.0
"""Between pixels and table for the blocks of a live image: Calibration's formulas, compiled.

25 points cost numpy a hundred small calls an image. `calibration` is here Calibration.packed(): the
homography, its inverse, fx, skew, cx, fy, cy and k1, k2, p1, p2, k3, in one row, -1 for a camera
that sees the table in a mirror, else 1, and what a metre of height adds to a point's image.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit

_INVERSE = 9
_FX, _SKEW, _CX, _FY, _CY, _K1, _K2, _P1, _P2, _K3, SENSE, UP = range(18, 30)
_ROUNDS = 40
_SETTLED = 1e-13  # of the image plane at distance 1


@njit(inline='always')
def _project(c, at, x, y):
    w = c[at + 6] * x + c[at + 7] * y + c[at + 8]
    return (
        (c[at] * x + c[at + 1] * y + c[at + 2]) / w,
        (c[at + 3] * x + c[at + 4] * y + c[at + 5]) / w,
    )


@njit(cache=True)
def _bent(c):
    return c[_K1] != 0.0 or c[_K2] != 0.0 or c[_P1] != 0.0 or c[_P2] != 0.0 or c[_K3] != 0.0


@njit(cache=True)
def distorted(c, u, v):
    """Return the pixel of an undistorted pixel; see Calibration.distort."""
    if not _bent(c):
        return u, v
    y = (v - c[_CY]) / c[_FY]
    x = (u - c[_CX] - c[_SKEW] * y) / c[_FX]
    r2 = x * x + y * y
    radial = 1 + r2 * (c[_K1] + r2 * (c[_K2] + r2 * c[_K3]))
    xd = x * radial + 2 * c[_P1] * x * y + c[_P2] * (r2 + 2 * x * x)
    yd = y * radial + c[_P1] * (r2 + 2 * y * y) + 2 * c[_P2] * x * y
    return c[_FX] * xd + c[_SKEW] * yd + c[_CX], c[_FY] * yd + c[_CY]


@njit(cache=True)
def to_pixel(c, x, y):
    """Return the pixel of a point of the plane, m; see Calibration.to_pixels."""
    u, v = _project(c, 0, x, y)
    return distorted(c, u, v)


@njit(cache=True)
def lifted(c, u, v, height_m):
    """Return the undistorted pixel of what stands `height_m` over the plane's point at `u`, `v`."""
    # of the homogeneous image (u w, v w, w) of a point the table's coordinates give w
    per_w = c[_INVERSE + 6] * u + c[_INVERSE + 7] * v + c[_INVERSE + 8]
    s = height_m * per_w
    w = 1.0 + s * c[UP + 2]
    return (u + s * c[UP]) / w, (v + s * c[UP + 1]) / w


@njit(cache=True)
def undistorted(c, u, v):
    """Return the undistorted pixel of a pixel; see Calibration.undistort."""
    if _bent(c):  # fixed point, as in OpenCV
        yd = (v - c[_CY]) / c[_FY]
        xd = (u - c[_CX] - c[_SKEW] * yd) / c[_FX]
        x, y = xd, yd
        for _ in range(_ROUNDS):
            r2 = x * x + y * y
            radial = 1 + r2 * (c[_K1] + r2 * (c[_K2] + r2 * c[_K3]))
            nx = (xd - 2 * c[_P1] * x * y - c[_P2] * (r2 + 2 * x * x)) / radial
            ny = (yd - c[_P1] * (r2 + 2 * y * y) - 2 * c[_P2] * x * y) / radial
            change = abs(nx - x) + abs(ny - y)
            x, y = nx, ny
            if change < _SETTLED:
                break
        u, v = c[_FX] * x + c[_SKEW] * y + c[_CX], c[_FY] * y + c[_CY]
    return u, v


@njit(cache=True)
def rounded(yaw, sigma, step, parts, turned, coarse):
    """Fill turned (n,) with yaw on a grid of `step`, coarse (n,) with sigma to `parts` parts."""
    for i in range(len(yaw)):
        turned[i] = np.rint(yaw[i] / step) * step
        mantissa, exponent = math.frexp(sigma[i])
        coarse[i] = math.ldexp(np.rint(mantissa * parts) / parts, exponent)


@njit(cache=True)
def glance(image, step, small):
    """Copy every `step`-th pixel of every `step`-th row to `small`; return (least, most, same)."""
    low, high, changed = np.uint8(255), np.uint8(0), np.uint8(0)
    for r in range(small.shape[0]):
        for c in range(small.shape[1]):
            value = image[r * step + 1, c * step + 1]
            low, high = min(low, value), max(high, value)
            changed |= value ^ small[r, c]
            small[r, c] = value
    return low, high, changed == 0

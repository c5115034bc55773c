# SPDX-License-Identifier: Apache-2.0
"""Between pixels and table for the 25 blocks of a live image: Calibration's formulas, compiled.

25 points cost numpy a hundred small calls an image. `calibration` is here Calibration.packed(): the
homography, its inverse, fx, skew, cx, fy, cy and k1, k2, p1, p2, k3, in one row, -1 for a camera
that sees the table in a mirror, else 1, and what a metre of height adds to a point's image.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, cos, sin
from eol_ros.core.geometry import BLOCK_SIDE_M

_INVERSE = 9
_FX, _SKEW, _CX, _FY, _CY, _K1, _K2, _P1, _P2, _K3, SENSE, UP = range(18, 30)
NUMBERS = UP + 3
_ROUNDS = 40
_SETTLED = 1e-13  # of the image plane at distance 1
_STEP_M = 0.02
BEND = (BLOCK_SIDE_M / 2 / _STEP_M) ** 2


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
def _to_table(c, u, v):
    u, v = undistorted(c, u, v)
    return _project(c, _INVERSE, u, v)


@njit(cache=True)
def _square(c, x, y, yaw, bend):
    """Return middle u, v and image angle of a square with `yaw` at `x`, `y`, and its quarter turns.

    The middle of its sides, which a fit finds, lies beside the image of its own middle where lens
    or tilt bend the image: by BEND, here `bend`, times what the mean of four points about it does.
    The angle (see Calibration.yaw_to_image) is in [-pi/4, pi/4], as edges takes it: there sides 0
    and 2 are crossed by rows; the right angles lead from there to the block's own x axis.
    """
    u, v = to_pixel(c, x, y)
    u0, v0 = to_pixel(c, x - _STEP_M, y)
    u1, v1 = to_pixel(c, x + _STEP_M, y)
    u2, v2 = to_pixel(c, x, y - _STEP_M)
    u3, v3 = to_pixel(c, x, y + _STEP_M)
    s = c[SENSE]
    theta = arctan2(-(v1 - v0) - s * (u3 - u2), u1 - u0 - s * (v3 - v2)) + s * yaw
    quarter = round(theta / (math.pi / 2))
    u += bend * ((u0 + u1 + u2 + u3) / 4 - u)
    v += bend * ((v0 + v1 + v2 + v3) / 4 - v)
    return u, v, theta - quarter * (math.pi / 2), quarter


@njit(cache=True)
def expected(calibration, xy, velocity, yaw, contrast, ahead_s, out, bend=0.0):
    """Fill out (25, 5): u, v, theta and contrast of blocks `ahead_s` after xy, velocity (25, 2).

    And the right angles, 0 to 3, from theta to the block's own x axis. bend: BEND for the middle of
    a square's sides in the image, else that of the block; under a camera tilted by 10 degrees they
    lie 0.09 px apart, so that fits of covers would sometimes take one step and sometimes two.
    """
    for i in range(xy.shape[0]):
        x, y = xy[i, 0] + velocity[i, 0] * ahead_s, xy[i, 1] + velocity[i, 1] * ahead_s
        out[i, 0], out[i, 1], out[i, 2], quarter = _square(calibration, x, y, yaw[i], bend)
        out[i, 3], out[i, 4] = contrast[i], quarter % 4


@njit(cache=True)
def poses(calibration, blobs, side_m):
    """Return xy (n, 2), yaw (n,), sigma (n,) in m and rad of a BLOB array; see poses_to_table."""
    n = blobs.shape[0]
    xy, yaw, sigma = np.empty((n, 2)), np.empty(n), np.empty(n)
    for i in range(n):
        u, v, theta = blobs[i].u, blobs[i].v, blobs[i].theta
        c, s = (
            cos(theta) * blobs[i].side_px / 2,
            sin(theta) * blobs[i].side_px / 2,
        )
        ex, ey = _to_table(calibration, u + c, v - s)
        nx, ny = _to_table(calibration, u - s, v - c)
        wx, wy = _to_table(calibration, u - c, v + s)
        sx, sy = _to_table(calibration, u + s, v + c)
        xy[i, 0], xy[i, 1] = (ex + nx + wx + sx) / 4, (ey + ny + wy + sy) / 4
        s = calibration[SENSE]
        yaw[i] = arctan2(ey - wy - s * (nx - sx), ex - wx + s * (ny - sy))
        sigma[i] = blobs[i].sigma_px * side_m / max(blobs[i].side_px, 1.0)
    return xy, yaw, sigma


@njit(cache=True)
def answer(calibration, xy, seen, index, blobs, steps, px, world):
    """Fill px, world (25, 2): rounded to grids of `steps` (m, px).

    A seen block stands in the image where its square was found, a hidden one where it is carried.
    """
    for i in range(xy.shape[0]):
        u, v = to_pixel(calibration, xy[i, 0], xy[i, 1])
        if seen[i]:
            u, v = blobs[index[i]].u, blobs[index[i]].v
        px[i, 0], px[i, 1] = np.rint(u / steps[1]) * steps[1], np.rint(v / steps[1]) * steps[1]
        for k in range(2):
            world[i, k] = np.rint(xy[i, k] / steps[0]) * steps[0]


@njit(cache=True)
def rounded(yaw, sigma, step, parts, turned, coarse):
    """Fill turned (25,) with yaw on a grid of `step`, coarse (25,) with sigma to `parts` parts."""
    for i in range(len(yaw)):
        turned[i] = np.rint(yaw[i] / step) * step
        mantissa, exponent = math.frexp(sigma[i])
        coarse[i] = math.ldexp(np.rint(mantissa * parts) / parts, exponent)


@njit(cache=True)
def glance(image, step, small):
    """Copy every `step`-th pixel of every `step`-th row to `small`; return (least, most, same).

    They are among those that `detect.scan.sample` reads, so that these rows are fetched once.
    """
    low, high, changed = np.uint8(255), np.uint8(0), np.uint8(0)
    for r in range(small.shape[0]):
        for c in range(small.shape[1]):
            value = image[r * step + 1, c * step + 1]
            low, high = min(low, value), max(high, value)
            changed |= value ^ small[r, c]
            small[r, c] = value
    return low, high, changed == 0

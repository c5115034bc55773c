# SPDX-License-Identifier: Apache-2.0
"""How light is spread over a cover: what tells one from another, whatever its brightness.

The inner 80 % of a square are cut into CELLS x CELLS cells, in the block's own axes, so that the
result is the same however the block is turned. Less its mean, over its mean, so that neither gain
nor battery counts; and less the plane that fits it best, which lens and lamps lay over any cover.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.geometry import BLOCK_SIDE_M
from eol_ros.core.vision.calibration.mapping import to_pixel

CELLS = 8
SIZE = CELLS * CELLS
REACH_M = 0.4 * BLOCK_SIDE_M  # from the middle: nearer to the edge its blur counts
SUB = 4  # pixels that are read across a cell
DARK, BRIGHT = 16.0, 250  # grey levels: a mean below says little, a pixel above nothing
MOST_BRIGHT = 0.3  # of the pixels
WHOLE = 0.9  # share of an outline in sight


@njit(cache=True, fastmath=True, error_model='numpy')
def sample(calibration, image, x, y, yaw, pattern):
    """Fill pattern (SIZE,) with the spread of light over the block at x, y in m, yaw in rad.

    Returns whether it says anything: no if the block is dark, saturated, or not all in the image.

    calibration: Calibration.packed(); image (h, w) uint8. Row by row of the block's own y.
    """
    height, width = image.shape
    c, s = cos(yaw) * REACH_M, sin(yaw) * REACH_M
    # the image of a cover is so small that it is a parallelogram
    u, v = to_pixel(calibration, x, y)
    ue, ve = to_pixel(calibration, x + c, y + s)
    uw, vw = to_pixel(calibration, x - c, y - s)
    un, vn = to_pixel(calibration, x - s, y + c)
    us, vs = to_pixel(calibration, x + s, y - c)
    au, av, bu, bv = (ue - uw) / 2, (ve - vw) / 2, (un - us) / 2, (vn - vs) / 2
    reach_u, reach_v = abs(au) + abs(bu), abs(av) + abs(bv)
    if not (reach_u < u < width - 1 - reach_u and reach_v < v < height - 1 - reach_v):
        return False
    flat = image.ravel()
    fine = CELLS * SUB
    pattern[:] = 0.0
    bright = 0
    for j in range(fine):
        b = (2 * j + 1) / fine - 1.0
        for i in range(fine):
            a = (2 * i + 1) / fine - 1.0
            row, column = int(v + a * av + b * bv + 0.5), int(u + a * au + b * bu + 0.5)
            light = int(flat[np.uint64(row * width + column)])
            pattern[j // SUB * CELLS + i // SUB] += light
            bright += light >= BRIGHT
    mean = slope_a = slope_b = 0.0
    middle = (CELLS - 1) / 2
    for k in range(SIZE):
        mean += pattern[k] / SIZE
        slope_a += pattern[k] * (k % CELLS - middle)
        slope_b += pattern[k] * (k // CELLS - middle)
    if mean < DARK * SUB * SUB or bright > MOST_BRIGHT * fine * fine:
        return False
    across = SIZE * (CELLS**2 - 1) / 12.0  # sum of squares of a slope of one a cell
    slope_a /= across
    slope_b /= across
    for k in range(SIZE):
        plane = mean + slope_a * (k % CELLS - middle) + slope_b * (k // CELLS - middle)
        pattern[k] = (pattern[k] - plane) / mean
    return True


@njit(cache=True)
def glance(calibration, image, xy, blobs, which, yaw, patterns, good):
    """Fill patterns (k, SIZE) of squares `which` (k,) at xy (n, 2) m, turned by yaw (k,).

    blobs (n,): the squares, a BLOB array; one that is not whole has no pattern. good (k,): of which
    there is a pattern.
    """
    for k in range(which.shape[0]):
        i = which[k]
        good[k] = blobs[i].visibility > WHOLE and sample(
            calibration, image, xy[i, 0], xy[i, 1], yaw[k], patterns[k]
        )

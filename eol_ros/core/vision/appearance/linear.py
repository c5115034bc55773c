# SPDX-License-Identifier: Apache-2.0
"""The pose of a block that rests, by one linear estimate from each image.

A fit keeps its residuals' influence on the pose. While the block stands where it stood then, their
weighted sum is its next Gauss-Newton step: an inverse compositional step (Baker and Matthews,
International Journal of Computer Vision 56, 2004), with the block's other numbers eliminated and
Tukey's weights. One pass over the pixels gives it, and whether the block still looks the same.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.lanes import above, added, fma, least, look, put, take
from eol_ros.core.vision.appearance import fit
from eol_ros.core.vision.appearance.fit import COLUMNS
from eol_ros.core.vision.appearance.model import AGREE, FULL, LANES
from eol_ros.core.vision.appearance.pixels import AREA, GREY, REST_ROWS, constant

# Numbers of a pixel: grey level of the model, reciprocal variance, influence on the pose per grey
# level, and the pixels that it stands for inside the block
LEVEL, PER, BY_A, BY_B, BY_TURN, INSIDE = range(0, REST_ROWS * LANES, LANES)


@njit(cache=True, inner=True)
def keep(px, lens, room, sigma2_px, widen, patch, rows):
    """Keep in patch and rows (groups, REST_ROWS * LANES) what `estimate` needs of a fit.

    It has converged. lens: half a side, blur and noise. room: of register, after fit.solve with
    that sigma2_px. widen (2,): what variances are multiplied by, in the fit and where it is judged.
    """
    half, blur, noise = lens
    by, side_fit = np.empty((3, COLUMNS)), np.empty(COLUMNS)
    zero, one, per_widen = constant(0.0), constant(1.0), constant(1.0 / widen[0])
    at_a = at_b = at_turn = area = zero
    for side in range(5):
        fit.influences(room.kept[side], room.work, side, by)
        fit.of_side(room.z, room.own[side], side_fit)
        n = fit.numbers(half, blur, noise, side_fit, sigma2_px)
        count = zero
        for group in range(patch.starts[side], patch.starts[side + 1]):
            _w, values, _q, e, per = fit.derivatives(px, group, n, per_widen)
            grey, r = take(px, group, GREY), values[COLUMNS]
            per = above(take(px, group, AREA), zero, per, zero)
            per = above(grey, constant(FULL), zero, per)  # saturated pixels say nothing
            a = b = turn = zero
            for i in range(COLUMNS):
                a = fma(constant(by[0, i]), values[i], a)
                b = fma(constant(by[1, i]), values[i], b)
                turn = fma(constant(by[2, i]), values[i], turn)
            a, b, turn = per_widen * per * a, per_widen * per * b, per_widen * per * turn
            z = fit.tukey(r * r * per * per_widen)
            r = z * z * r
            at_a, at_b, at_turn = fma(a, r, at_a), fma(b, r, at_b), fma(turn, r, at_turn)
            inside = above(e, constant(0.5), take(px, group, AREA), zero)
            inside = above(per, zero, inside, zero)
            area, count = area + inside, count + above(per, zero, one, zero)
            put(rows, group, LEVEL, grey - values[COLUMNS])
            put(rows, group, PER, per)
            put(rows, group, BY_A, a)
            put(rows, group, BY_B, b)
            put(rows, group, BY_TURN, turn)
            put(rows, group, INSIDE, inside)
        if side < 4:
            patch.counts[side] = max(added(count), np.float32(1.0))
    patch.area = max(added(area), np.float32(1.0))
    patch.pulled[0], patch.pulled[1], patch.pulled[2] = added(at_a), added(at_b), added(at_turn)
    patch.stands[:] = room.z[:3]
    patch.widened[0], patch.widened[1] = widen
    patch.rests = True


@njit(cache=True, inner=True)
def estimate(image, at, patch, rows, step, misfit):
    """Set the step (3,) from where a block stood to where it stands in an image, px and rad.

    misfit (4,): set to the mean squared residual of each side. Returns the share of the cover that
    looks as it should, and the misfit of what agrees; see FOUND.
    """
    pixels, by = image.reshape(-1), patch.shift[1] * image.shape[1] + patch.shift[0]
    zero, one, agree = constant(0.0), constant(1.0), constant(AGREE)
    per_widen, per_judged = constant(1.0 / patch.widened[0]), constant(1.0 / patch.widened[1])
    a = b = turn = chi = n = alike = zero
    for side in range(5):
        total = zero
        for group in range(patch.starts[side], patch.starts[side + 1]):
            r = look(pixels, at, group * LANES, by) - take(rows, group, LEVEL)
            per = take(rows, group, PER)
            q = r * r * per
            z = fit.tukey(q * per_widen)
            r = z * z * r
            a, b = fma(take(rows, group, BY_A), r, a), fma(take(rows, group, BY_B), r, b)
            turn = fma(take(rows, group, BY_TURN), r, turn)
            total = total + least(q, agree)
            q = least(q * per_judged, agree)
            good = above(agree, q, one, zero)
            chi, alike = fma(good, q, chi), fma(take(rows, group, INSIDE), good, alike)
            n = n + above(per, zero, good, zero)
        if side < 4:
            misfit[side] = added(total) / patch.counts[side]
    step[0], step[1] = added(a) - patch.pulled[0], added(b) - patch.pulled[1]
    step[2] = added(turn) - patch.pulled[2]
    misfit_of_all = added(chi) / max(added(n), np.float32(1.0)) * patch.widened[1]
    return added(alike) / patch.area, misfit_of_all

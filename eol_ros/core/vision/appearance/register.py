# SPDX-License-Identifier: Apache-2.0
"""Register the faces of blocks in an image, and judge what was found."""

import math
from collections import namedtuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, cos, sin
from eol_ros.core.lanes import above, added, fma, least, most, take
from eol_ros.core.vision import outline
from eol_ros.core.vision.appearance import faces, fit, linear, pixels
from eol_ros.core.vision.appearance import model as m
from eol_ros.core.vision.appearance.model import LANES
from eol_ros.core.vision.appearance.pixels import AREA, EDGE, GREY, SPREAD, Q, constant
from eol_ros.core.vision.calibration import mapping

MADE, MOVED, SAME = range(3)  # what became of a patch
_1 = np.float32(1.0)

FOUND = np.dtype(
    [
        ('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'),  # m and rad; the start, then what was found
        ('start_px', 'f8'),  # standard deviation of the start
        ('edge_px', 'f8'),  # what the edge function leaves of an edge that moves so fast
        ('gain', 'f8'), ('ground', 'f8', 3),  # grey levels
        ('expected', 'f8'),  # gain, or 0
        # numbers of its sides, gains: as usual, their variances, in this image, and squared
        # deviations from what is usual, as expected of it
        ('usual', 'f8', (4, fit.OWN)), ('own', 'f8', fit.OWN),
        ('sides', 'f8', (4, fit.OWN)), ('off', 'f8', fit.OWN),
        ('free', 'f8', (4, fit.OWN)),  # as if nothing were known of this side alone: see _free
        ('sigma_m', 'f8'), ('sigma_rad', 'f8'),
        # influence of clusters of residuals on the pose, as usual and in this image
        ('lasting', 'f8', (fit.INFLUENCES, 3)), ('influence', 'f8', (fit.INFLUENCES, 3)),
        ('more', 'f8', 2),  # variance of place and turn, in that of the noise alone
        ('visible', 'f8'),  # share of the cover that looks as it should
        ('ring', 'f8'),  # and of the ground beside its edges
        ('ratio', 'f8'),  # log likelihood ratio of the cover to flat ground, nats a pixel
        ('nats', 'f8'),  # of all sides, that light falls there as at an edge
        ('weakest', 'f8'),  # side
        ('evidence', 'f8'),  # and with what was said before
        # the last step; infinite if the fit ended away from where it took the face
        ('step_px', 'f8'),
        ('misfit', 'f8'),  # mean squared residual in variances, of the pixels that agree
        ('side_misfit', 'f8', 4), ('side_usual', 'f8', 4),  # of each side, of all; and usually
        ('side_px', 'f8'),
        ('close', '?'),  # whether sides and brightness are of this image
        ('wider', 'f8'), ('wider_weight', 'f8'),  # of edges, see fit.widening
    ]
)  # fmt: skip
"""One block in one image; see register."""


@njit(cache=True)
def register(
    image, c, heights, half_m, blur_px, noise, light, spread, fresh, rounds, close, which, found,
    own, own_px, patches, kept, rests, places, picks, picked,
):  # fmt: skip
    """Fit the blocks `which` (k,) to an image, from the start that `found` (n,) holds.

    c: Calibration.packed(). heights (n, 4, 1 + POINTS): CoverOutlines.over the plane of c, or none
    of flat covers. blur_px: standard deviation of an edge. noise (2,): see fit.residuals.
    light, spread (n, CELLS, CELLS): their faces. fresh (n,): whether to take the face from this
    image. rounds: iterations at most. close (n,): whether to find sides and brightness, too;
    else they keep their last values. own, own_px: see Faces.
    patches, kept, rests, places, picks, picked: of pixels.empty_patches(n), from image to image.
    """
    room, table = _room(), np.zeros(outline.SIZE, np.float32)
    flat = heights.shape[0] == 0
    for k in range(which.shape[0]):
        n = which[k]
        f, patch, px = found[n], patches[n], kept[n]
        x, y = f.x, f.y
        camera = image, c, heights, n, half_m, blur_px, noise, table, flat
        looks = light[n], spread[n], fresh[n], rounds, own[n], own_px[n]
        at = places[n], picks, picked
        if not close[n] and _stands(image, half_m, places[n], rests[n], f, patch, room):
            f.close = False
            continue
        settled, judged, fitted, without, rested = _fit(camera, looks, f, patch, at, px, room)
        f.visible = f.ring = f.ratio = 0.0
        if not settled:
            f.nats = f.wider_weight = 0.0
            patch.starts[:] = 0
            continue
        half = half_m * patch.scale
        if not judged:
            fit.all_residuals(
                px, patch.starts, 1, half, blur_px, noise, room.z, room.own, f.edge_px**2
            )
        widen = fit.widen_of(px, patch.starts, 1, m.WIDEN_JUDGED, room.few)
        _judge(px, patch.starts, noise, room.z, widen, f)
        f.close = close[n] or _unlike(f)
        _tell(f, patch, half, room)
        moved_px = _far_px(f, (x, y), patch)
        _tell_sigma(f, patch, moved_px, without, (half, blur_px, noise), fitted, px, room)
        if f.close:
            patch.rests = False  # what was kept is replaced, or does not hold any more
            if rested and flat and without < 0 and not _unlike(f):
                lens = half, blur_px, noise
                linear.keep(px, lens, room, m.JUDGED_PX**2, (fitted, widen), patch, rests[n])
            near = min(3.5 * blur_px + 1.0, half / 2)
            fit.side_nats(
                px, patch.starts, half, blur_px, noise, room.z, room.own, near, widen, room.sides
            )  # fmt: skip
            f.weakest, f.nats = room.sides.min(), 0.0
            for i in range(4):
                f.nats += min(max(room.sides[i], m.SIDE_NATS[0]), m.SIDE_NATS[1])
            f.wider, f.wider_weight = fit.widening(
                px, patch.starts[5], half, blur_px, noise, room.z, 2 * widen * m.AGREE
            )
            faces.brightness(px, patch.starts[5], half, blur_px, room.z, own[n], own_px[n])
            if f.visible > m.WHOLE or f.nats > m.THREE_NATS:
                _free(px, patch.starts, half, blur_px, noise, widen, without, flat, f, room)
        if fresh[n]:
            patch.starts[:] = 0  # of a face that is not kept


Room = namedtuple(
    'Room',
    'z own equations kept work prior towards own_prior sums matrix bins few sides usual at its_own'
    ' map cells',
)


@njit(cache=True)
def _room():
    """Return scratch for one block; _fit leaves what it found in z, own, kept and work."""
    n, own = fit.NUMBERS, fit.OWN
    return Room(
        np.zeros(n), np.zeros((5, own)), np.empty((5, n, n + 1)), np.zeros((5, own, 11)),
        np.empty((n, 11)), np.zeros(n), np.zeros(n), np.empty(own),
        np.empty((fit.SUMS + fit.COLUMNS, LANES), np.float32),
        np.empty((fit.COLUMNS, fit.COLUMNS + 1)),
        np.empty((4, m.PARTS, 2)), np.empty(m.MOST_PX, np.float32), np.empty(4), np.empty(4),
        np.empty(n), np.empty((5, own)), np.empty(12),
        np.empty(((m.CELLS - 1) ** 2, 4), np.float32),
    )  # fmt: skip


@njit(inline='always')
def _unlike(f):
    """Return whether something hides part of a block, or shines on it."""
    return _looks_odd(f.visible, f.misfit, f)


@njit(inline='always')
def _looks_odd(visible, misfit, f):
    return visible < m.ALIKE or misfit > m.MISFIT * max(f.side_usual.mean(), 1.0)


@njit(cache=True, inner=True)
def _fit(camera, looks, f, patch, at, px, room):
    """Fit one block from the pose of f.

    Returns whether that can be done, whether it converged, by how much residuals exceed their
    variance, the side that was left out, or -1, and whether the block rested. One that rested is
    first taken to be where it was, which needs one step.
    """
    image, c, heights, n, half_m, blur_px, noise, table, flat = camera
    face, spread, fresh, rounds, own_face, own_px = looks
    z, own, work, starts = room.z, room.own, room.work, patch.starts
    half, judged, widen, odd, without = 1.0, False, 1.0, False, -1
    began = 0.0, 0.0, 0.0  # the pose from which pixels were gathered
    whole = False  # whether the last step was of every one of these pixels, as judging needs
    dense = m.DENSE[0 if flat or fresh else 1]
    doubtful = not fresh and _unlike(f)
    rests, begins = not (fresh or doubtful) and f.start_px < m.RESTS_PX, True
    sigma_px = m.JUDGED_PX if rests else f.start_px
    again, taken = False, (0.0, 0.0)  # whether to take its face once more; where it was taken
    for it in range(rounds):
        renew = fresh and (it == 2 or it == 4 or again)
        moved = math.sqrt((z[0] - began[0]) ** 2 + (z[1] - began[1]) ** 2)
        moved += abs(z[2] - began[2]) * half
        if it == 0 or renew or moved > max(0.5 * sigma_px, 1.0):
            whole = False
            near = dense * blur_px + m.MARGIN_PX + 0.5 * min(max(sigma_px, 0.7), 5.0)
            kept = MADE
            if not fresh and it == 0:
                kept = _lies_in(patch, c, f, half_m, near, image.shape, flat, px, room)
            if kept == MADE:
                _gather(image, c, heights, n, half_m, near, table, f, patch, px, at, room)
            if starts[5] < 8:
                return False, False, widen, without, False
            half = half_m * patch.scale
            if kept != SAME:
                pixels.shade(px, starts[5], half, face, spread, flat, room.cells)
            pixels.read(image, at[0], patch.shift, starts[5], px)
            _from_patch(patch, f, z)
            began = z[0], z[1], z[2]
            if it == 0:
                _levels(px, starts[5], half, blur_px, f, room)
            if renew:
                faces.brightness(px, starts[5], half, blur_px, z, own_face, own_px)
                face = own_face[0]
                faces.fill(face, own_px, 1.0)
                taken = f.x, f.y
                pixels.shade(px, starts[5], half, face, spread, flat, room.cells)
        if begins:
            fit.all_residuals(px, starts, 4, half, blur_px, noise, z, own, sigma_px**2)
            widen = fit.widen_of(px, starts, 4, m.WIDEN, room.few)
        elif doubtful and sigma_px < 1.0 and not (odd and without < 0):
            fit.all_residuals(px, starts, 1, half, blur_px, noise, z, own, sigma_px**2)
            fit.trust(px, starts, _usual(f, widen, room), room.bins)
            if it > 3 and whole:
                _judge(px, starts, noise, z, widen, f)
                if f.visible < m.HOPELESS:
                    break
        _priors(f, half, sigma_px, room)
        whole = not begins or rests or it == rounds - 1
        fit.all_equations(
            px, starts, 1 if whole else 2, half, blur_px, noise, z, own, f.usual,
            room.own_prior, sigma_px**2, widen, (room.sums, room.matrix), room.kept,
            room.equations,
        )  # fmt: skip
        if odd and without < 0:
            without = _odd_one(px, starts, half, blur_px, noise, room)
        if not fit.solve(room.equations, without, room.prior, room.towards, work):
            return False, False, widen, without, False
        f.step_px = _step(work, half, z)
        _to_table(z, patch, f)
        for side in range(4):
            fit.restore(room.kept[side], work[:, 7], z[3], own[side])
        sure_px = math.sqrt(max(work[0, 8], 0.0))
        least_px = m.SETTLED * sure_px
        if rests:  # the light of covers in relief does not move with their sides: steps fall short
            least_px = m.RESTED_PX if flat else m.JUDGED_PX
        close = sigma_px <= max(m.JUDGED_PX, 2 * sure_px, 2.5 * f.edge_px)
        judged = whole and close and f.step_px < least_px
        again = fresh and judged and it > 4 and _far_px(f, taken, patch) > m.LAST_STEP_PX
        judged = judged and not again
        begins = rests and not (judged and abs(work[3, 7]) < m.STEADY * z[3])
        if judged and not begins and (not fresh or it > 4):
            if odd:
                break
            _judge(px, starts, noise, z, widen, f)
            begins = rests and _unlike(f)
            if not begins:
                odd = (f.side_misfit > m.SIDE_MISFIT * _usual(f, widen, room)).any()
                if not odd and (doubtful or not _unlike(f)):
                    break
                doubtful = True  # an arm came in
                if odd:
                    sigma_px = m.JUDGED_PX
                    continue
        if begins:  # it does not rest
            rests, sigma_px = False, f.start_px
        else:
            sigma_px = min(0.4 * sigma_px, 0.5 * f.step_px + f.edge_px)
    if fresh and _far_px(f, taken, patch) > m.LAST_STEP_PX:
        f.step_px = math.inf
    return True, judged, widen, without, rests and judged


@njit(cache=True, inner=True)
def _stands(image, half_m, at, rows, f, patch, room):
    """Return whether a block rests where it was fitted in full, and looks as it did; then set f.

    Farther off than noise explains it is fitted in full again. Gain, ground, ring, ratio and sigma
    stay as they were found last.
    """
    if not (patch.rests and patch.starts[5] > 0 and f.start_px < m.RESTS_PX) or _unlike(f):
        return False
    z, step, half = room.z, room.work[:3, 7], half_m * patch.scale
    most_px = min(m.STANDS * f.sigma_m * patch.scale, m.RESTED_PX)
    _from_patch(patch, f, z)
    z[:3] -= patch.stands
    if math.sqrt(z[0] * z[0] + z[1] * z[1]) + abs(z[2]) * half > m.KEPT_PX:
        return False
    visible, misfit = linear.estimate(image, at, patch, rows, step, room.sides)
    f.step_px = max(math.sqrt(step[0] ** 2 + step[1] ** 2), abs(step[2]) * half)
    unlike = _looks_odd(visible, misfit, f)
    for side in range(4):
        usual = max(f.side_usual[side], patch.widened[0])
        unlike = unlike or room.sides[side] > m.SIDE_MISFIT * usual
    if unlike or not f.step_px <= most_px:
        return False
    f.visible, f.misfit, f.side_misfit[:] = visible, misfit, room.sides
    z[:3], room.work[3:, 7] = patch.stands, 0.0
    _step(room.work, half, z)
    _to_table(z, patch, f)
    return True


@njit(cache=True)
def _levels(px, groups, half, blur_px, f, room):
    """Start gain, ground and the numbers of sides."""
    z = room.z
    inner, outer = fit.levels(px, groups, half, blur_px, room.few)
    z[3] = f.expected if f.expected > 0.0 else max(inner - outer, 2.0)
    z[4], z[5], z[6] = outer, 0.0, 0.0
    room.own[:4] = z[3] * f.usual


@njit(cache=True)
def _priors(f, half, sigma_px, room):
    """Set the reciprocal variances of a block's numbers, and of each side's own."""
    gain, prior = room.z[3], room.prior
    prior[0] = prior[1] = 1.0 / f.start_px**2
    prior[2] = (half / (1.5 * f.start_px)) ** 2
    prior[5] = prior[6] = 1.0 / (m.PLANE_SIGMA * gain) ** 2
    prior[3] = 0.0
    if f.expected > 0.0:
        prior[3] = 1.0 / (m.GAIN_SIGMA * f.expected) ** 2
        room.towards[3] = f.expected - gain
    for i in range(fit.OWN):
        # far from its place they would explain a side that is not there
        variance = f.own[i] if sigma_px < m.COARSE_PX else m.LEAST_OWN[i]
        room.own_prior[i] = 1.0 / (variance * gain**2)


@njit(cache=True)
def _tell(f, patch, half, room):
    """Set gain, ground and numbers of sides of f."""
    gain = f.gain = room.z[3]
    f.side_px = 2 * half
    for i in range(3):
        f.ground[i] = room.z[4 + i]
    f.off[:] = 0.0
    for side in range(4):
        for i in range(fit.OWN):
            f.sides[side, i] = room.own[side, i] / gain
            f.off[i] += (f.sides[side, i] - f.usual[side, i]) ** 2 / 4
            f.off[i] += room.kept[side, i, 8 + i] / (4 * gain**2)


@njit(cache=True, inner=True)
def _free(px, starts, half, blur_px, noise, widen, without, flat, f, room):
    """Set the numbers of sides that an image alone says, about what all four sides have in common.

    Their mean over images is what is usual. An estimate about what is usual of its own side would
    draw that mean along, image by image, to where no prior holds it, and the block with it.
    """
    gain, own, most = room.z[3], room.own, m.MOST_OWN[0 if flat else 1]
    common = np.zeros((4, fit.OWN))
    for i in range(fit.OWN):
        common[:, i] = f.usual[:, i].mean()
        room.own_prior[i] = 1.0 / (most[i] * gain**2)
    fit.all_equations(
        px, starts, 1, half, blur_px, noise, room.z, own, common, room.own_prior, f.edge_px**2,
        widen, (room.sums, room.matrix), room.kept, room.equations,
    )  # fmt: skip
    if not fit.solve(room.equations, without, room.prior, room.towards, room.work):
        return
    for side in range(4):
        fit.restore(room.kept[side], room.work[:, 7], gain, own[side])
        for i in range(fit.OWN):
            f.free[side, i] = own[side, i] / gain


@njit(cache=True, inner=True)
def _tell_sigma(f, patch, moved_px, without, lens, widen, px, room):
    """Set the standard deviations of f.

    Those of the noise alone, times what residuals say, which is looked at closely where the block
    seems to have moved.
    """
    place, turn = (room.work[0, 8] + room.work[1, 9]) / 2, room.work[2, 10]
    if f.close or moved_px**2 > 4 * place * f.more[0]:
        half, blur_px, noise = lens
        by = fit.covariance(
            px, patch.starts, without, half, blur_px, noise, room.z, room.own, f.edge_px**2, widen,
            room.kept, room.work, f.lasting, room.sums, f.influence,
        )  # fmt: skip
        f.more[0], f.more[1] = max(by[0] / (2 * place), 1.0), max(by[1] / turn, 1.0)
    beside = m.BESIDE if without >= 0 or _unlike(f) or f.more[0] > m.UNEVEN else 1.0
    f.sigma_m = beside * math.sqrt(place * f.more[0]) / patch.scale
    f.sigma_rad = beside * math.sqrt(turn * f.more[1])


@njit(inline='always')
def _far_px(f, place, patch):
    """Return how far a block lies from a place, px."""
    return math.sqrt((f.x - place[0]) ** 2 + (f.y - place[1]) ** 2) * patch.scale


@njit(cache=True, inner=True)
def _lies_in(patch, c, f, half_m, near, shape, flat, px, room):
    """Return whether the stored patch is that of a block at the start of f, or move it there.

    MADE: it must be made again. So it is for covers in relief, which change from place to place.
    """
    half = half_m * patch.scale
    if patch.starts[5] == 0 or not -0.1 < patch.near_px - near < m.STALE_PX:
        return MADE
    if abs(f.yaw - patch.made_yaw) * half > m.STALE_PX:
        return MADE
    far_px = _far_px(f, (patch.x, patch.y), patch)
    if far_px < m.KEPT_PX and abs(f.yaw - patch.yaw) * half < m.KEPT_PX:
        return SAME
    if not flat:
        return SAME if far_px < 0.7 else MADE
    pixels.taylor(c, f.x, f.y, f.yaw, room.map)
    if not pixels.move(patch, room.map, half, shape[0], shape[1], px):
        return MADE
    patch.x, patch.y, patch.yaw, patch.scale = f.x, f.y, f.yaw, pixels.scale_of(room.map)
    return MOVED


@njit(cache=True, inner=True)
def _gather(image, c, heights, n, half_m, near, table, f, patch, px, at, room):
    """Make a patch for the block n at f."""
    d = room.map
    pixels.taylor(c, f.x, f.y, f.yaw, d)
    patch.x, patch.y, patch.yaw, patch.scale = f.x, f.y, f.yaw, pixels.scale_of(d)
    patch.near_px, patch.made_yaw = near, f.yaw
    table[0] = 0.0
    if heights.shape[0]:
        theta = arctan2(-d[7], d[1])
        outline.tabulate(c, heights[n], d[0], d[6], theta, half_m * patch.scale, table)
    pixels.gather(
        image.shape[0], image.shape[1], d, half_m, near, near + m.OUTSIDE_PX, table,
        c[mapping.SENSE], patch, px, at[0], at[1], at[2],
    )  # fmt: skip


@njit(cache=True)
def _from_patch(patch, f, z):
    """Set the pose of z from that of f."""
    cs, sn = cos(patch.yaw), sin(patch.yaw)
    dx, dy = (f.x - patch.x) * patch.scale, (f.y - patch.y) * patch.scale
    z[0], z[1] = cs * dx + sn * dy, cs * dy - sn * dx
    z[2] = f.yaw - patch.yaw


@njit(cache=True)
def _step(work, half, z):
    """Take the step in column 7 of work; return how long it is, in px."""
    da, db, turn = work[0, 7], work[1, 7], work[2, 7]
    step = math.sqrt(da * da + db * db)
    if step > m.STEP_PX:
        da, db, step = da * m.STEP_PX / step, db * m.STEP_PX / step, m.STEP_PX
    turn = min(max(turn, -m.STEP_RAD), m.STEP_RAD)
    cs, sn = cos(z[2]), sin(z[2])
    z[0] += cs * da - sn * db
    z[1] += sn * da + cs * db
    z[2] += turn
    z[3] = max(z[3] + work[3, 7], 1.0)
    for i in range(4, 7):
        z[i] += work[i, 7]
    return max(step, abs(turn) * half)


@njit(cache=True)
def _to_table(z, patch, f):
    """Set the pose of f from that of z."""
    cs, sn = cos(patch.yaw), sin(patch.yaw)
    f.x = patch.x + (cs * z[0] - sn * z[1]) / patch.scale
    f.y = patch.y + (sn * z[0] + cs * z[1]) / patch.scale
    f.yaw = patch.yaw + z[2]


@njit(cache=True, inner=True)
def _odd_one(px, starts, half, blur_px, noise, room):
    """Return the side without which the other three look as usual and agree best, or 5.

    An arm that touches one side draws the block along, and then the side across from it looks odd.
    """
    best, least = 5, math.inf
    for without in range(4):
        if not fit.solve(room.equations, without, room.prior, room.towards, room.work):
            continue
        room.at[:], room.its_own[:] = room.z, room.own
        _step(room.work, half, room.at)
        for side in range(4):
            fit.restore(room.kept[side], room.work[:, 7], room.at[3], room.its_own[side])
        fit.all_residuals(px, starts, 2, half, blur_px, noise, room.at, room.its_own, m.MODEL_PX**2)
        total = most = 0.0
        for side in range(4):
            if side != without:
                misfit = _mean(px, starts[side], starts[side + 1], 2, room.usual[side])
                total, most = total + misfit, max(most, misfit)
        if total < least and most < m.SIDE_MISFIT:
            best, least = without, total
    return best


@njit(cache=True)
def _mean(px, start, stop, every, expected):
    """Return the mean squared residual of every `every`-th group, in that which is expected."""
    total = n = 0.0
    for group in range(start, stop, every):
        for i in range(LANES):
            if px[group, AREA + i] > 0.0:
                total += min(px[group, Q + i] / expected, m.AGREE)
                n += 1.0
    return total / max(n, 1.0)


@njit(cache=True)
def _usual(f, widen, room):
    """Set and return room.usual (4,): mean squared residual to expect of each side.

    What it usually is, more where there is more light, in this image; and what most sides exceed,
    where no face is known.
    """
    room.sides[:] = f.side_misfit
    room.sides.sort()
    more = (room.z[3] / f.expected) ** 2 if f.expected > 0.0 else 1.0
    for side in range(4):
        room.usual[side] = max(f.side_usual[side] * max(more, 1.0), widen, room.sides[1])
    return room.usual


@njit(cache=True, inner=True)
def _judge(px, starts, noise, z, widen, f):
    """Set visible, ring, ratio, misfit and side_misfit of f, from all pixels."""
    zero, one, half, agree = constant(0.0), constant(1.0), constant(0.5), constant(m.AGREE)
    per_widen, ground = constant(1.0 / widen), constant(z[4])
    gain2, n0 = constant(z[3] ** 2), constant(noise[0])
    n1, dark = constant(noise[1]), constant(m.LEAST_VARIANCE)
    alike = area = ratio = chi = n = ring = ringed = zero
    for side in range(5):
        total = count = zero
        for group in range(starts[side], starts[side + 1]):
            part, grey = take(px, group, AREA), take(px, group, GREY)
            here = above(part, zero, one, zero)
            q = take(px, group, Q)
            total = fma(here, least(q, agree), total)
            count = count + here
            q = least(q * per_widen, agree)
            good = above(agree, q, here, zero)
            chi = fma(good, q, chi)
            n = n + good
            edge = take(px, group, EDGE)
            inside = above(edge, half, part, zero)
            area = area + inside
            alike = fma(inside, good, alike)
            d = grey - ground
            s2 = fma(gain2, take(px, group, SPREAD), most(fma(n1, grey, n0), dark))
            ratio = fma(inside, least(d * d / s2 * per_widen, agree) - q, ratio)
            beside = above(edge, half, zero, above(part, one, zero, here))
            ring = ring + beside
            ringed = fma(beside, good, ringed)
        if side < 4:
            f.side_misfit[side] = added(total) / max(added(count), _1)
    whole = max(added(area), _1)
    f.visible, f.ring = added(alike) / whole, added(ringed) / max(added(ring), _1)
    f.ratio = added(ratio) / 2 / whole
    f.misfit = added(chi) / max(added(n), _1) * widen

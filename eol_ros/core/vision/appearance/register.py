# SPDX-License-Identifier: Apache-2.0
"""Register the faces of blocks in an image, and judge what was found."""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, cos, sin
from eol_ros.core.vision.appearance import faces, fit, pixels
from eol_ros.core.vision.appearance import model as m
from eol_ros.core.vision.appearance.model import LANES
from eol_ros.core.vision.appearance.pixels import AREA, EDGE, GREY, SPREAD, Q
from eol_ros.core.vision.calibration.mapping import SENSE
from eol_ros.core.vision.detect import outline

FOUND = np.dtype(
    [
        ('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'),  # m and rad; the start, then what was found
        ('start_px', 'f8'),  # standard deviation of the start
        ('gain', 'f8'), ('ground', 'f8', 3),  # grey levels
        ('expected', 'f8'),  # gain, or 0
        # numbers of its sides, gains: as usual, their variances, in this image, and squared
        # deviations from what is usual, as expected of it
        ('usual', 'f8', (4, fit.OWN)), ('own', 'f8', fit.OWN),
        ('sides', 'f8', (4, fit.OWN)), ('off', 'f8', fit.OWN),
        ('sigma_m', 'f8'), ('sigma_rad', 'f8'),
        ('visible', 'f8'),  # share of the cover that looks as it should
        ('ring', 'f8'),  # and of the ground beside its edges
        ('ratio', 'f8'),  # log likelihood ratio of the cover to flat ground, nats a pixel
        ('nats', 'f8'),  # of all sides, that light falls there as at an edge
        ('weakest', 'f8'),  # side
        ('evidence', 'f8'),  # and with what was said before
        ('step_px', 'f8'),  # the last step
        ('misfit', 'f8'),  # mean squared residual in variances, of the pixels that agree
        ('side_px', 'f8'),
        ('close', '?'),  # whether sides and brightness are of this image
        ('wider', 'f8'), ('wider_weight', 'f8'),  # of edges, see fit.widening
    ]
)  # fmt: skip
"""One block in one image; see register."""


@njit(cache=True)
def register(
    image, c, heights, half_m, blur_px, noise, light, spread, fresh, close, which, found, own,
    own_px, patches, kept, places,
):  # fmt: skip
    """Fit the blocks `which` (k,) to an image, from the start that `found` (n,) holds.

    c: Calibration.packed(). heights (n, 4, 1 + POINTS): CoverOutlines.over the plane of c, or none
    of flat covers. blur_px: standard deviation of an edge. noise (2,): see fit.residuals.
    light, spread (n, CELLS, CELLS): their faces. fresh (n,): whether to take the face from this
    image. close (n,): whether to look closely, at sides and brightness; else these stay as they
    were found last. own, own_px (n, CELLS, CELLS): brightness of each cover, and its pixels.
    patches, kept, places: of pixels.empty_patches(n), from image to image.
    """
    z, prior, own_level = np.zeros(fit.NUMBERS), np.zeros(fit.NUMBERS), np.zeros((5, fit.OWN))
    equations, kept_sides = np.empty((fit.NUMBERS, fit.NUMBERS + 1)), np.zeros((5, fit.OWN, 11))
    own_prior = np.empty(fit.OWN)
    work, px = np.empty((fit.NUMBERS, 11)), pixels.empty()
    room = (
        np.empty((fit.COLUMNS + 3, pixels.GROUPS * LANES), np.float32),
        np.empty(fit.SUMS + fit.COLUMNS),
        np.empty((fit.COLUMNS, fit.COLUMNS + 1)),
    )
    bins, few = np.empty((4, m.PARTS, 2)), np.empty(m.MOST_PX, np.float32)
    side_room, sides = np.empty((4, 11)), np.empty(4)
    table, flat = np.zeros(outline.SIZE, np.float32), heights.shape[0] == 0
    for k in range(which.shape[0]):
        n = which[k]
        f, patch, at = found[n], patches[n], places[n]
        starts = patch.starts
        sigma_px, settled, judged, widen = f.start_px, False, False, 1.0
        half, face = 1.0, light[n]
        doubtful = not fresh[n] and (f.visible < m.ALIKE or f.misfit > m.MISFIT)
        for it in range(m.ROUNDS):
            own_face = fresh[n] and (it == 2 or it == 4)
            moved = math.sqrt(z[0] ** 2 + z[1] ** 2) + abs(z[2]) * half
            if it == 0 or own_face or moved > max(0.5 * sigma_px, 1.0):
                near = m.DENSE * blur_px + m.MARGIN_PX + 0.5 * min(max(sigma_px, 0.7), 5.0)
                keep = not fresh[n] and it == 0 and _lies_in(patch, f, half_m, near)
                if keep:
                    pixels.copy(kept[n], starts[5], px)
                else:
                    _gather(image, c, heights, n, half_m, near, table, f, patch, px, at)
                if starts[5] < 8:
                    settled = False
                    break
                half = half_m * patch.scale
                if not keep:
                    pixels.shade(px, starts[5], half, face, spread[n], flat)
                pixels.read(image, at, starts[5], px)
                _from_patch(patch, f, z)
                if it == 0:
                    inner, outer = fit.levels(px, starts[5], half, blur_px, few)
                    z[3] = f.expected if f.expected > 0.0 else max(inner - outer, 2.0)
                    z[4], z[5], z[6] = outer, 0.0, 0.0
                    own_level[:4] = z[3] * f.usual
                if own_face:
                    face = own[n]
                    faces.brightness(px, starts[5], half, blur_px, z, face, own_px[n])
                    faces.fill(face, own_px[n], 1.0)
                    pixels.shade(px, starts[5], half, face, spread[n], flat)
                elif not keep:
                    pixels.copy(px, starts[5], kept[n])
            for i in range(fit.OWN):
                # far from its place they would explain a side that is not there
                variance = f.own[i] if sigma_px < m.COARSE_PX else m.LEAST_OWN[i]
                own_prior[i] = 1.0 / (variance * z[3] ** 2)
            if it == 0:
                fit.all_residuals(px, starts, 4, half, blur_px, noise, z, own_level, sigma_px**2)
                widen = fit.widen_of(px, starts, 4, m.WIDEN, few)
            elif doubtful and sigma_px < 1.0:
                fit.all_residuals(px, starts, 1, half, blur_px, noise, z, own_level, sigma_px**2)
                fit.trust(px, starts[4], widen, bins)
                if it > 3 and _judged(px, starts[5], noise, z, widen)[0] < m.HOPELESS:
                    break
            fit.all_equations(
                px, starts, 2 if it == 0 else 1, half, blur_px, noise, z, own_level, f.usual,
                own_prior, sigma_px**2, widen, room, kept_sides, equations,
            )  # fmt: skip
            prior[0] = prior[1] = 1.0 / f.start_px**2
            prior[2] = (half / (1.5 * f.start_px)) ** 2
            prior[5] = prior[6] = 1.0 / (m.PLANE_SIGMA * z[3]) ** 2
            prior[3] = 0.0
            if f.expected > 0.0:
                prior[3] = 1.0 / (m.GAIN_SIGMA * f.expected) ** 2
                equations[3, fit.NUMBERS] += prior[3] * (f.expected - z[3])
            if not fit.solve(equations, prior, work):
                settled = False
                break
            _step(work, half, patch, f, z)
            settled = True
            for side in range(4):
                fit.restore(kept_sides[side], work[:, 7], z[3], own_level[side])
            sure_px = math.sqrt(max(work[0, 8], 0.0))
            judged = sigma_px < max(m.JUDGED_PX, 2 * sure_px) and f.step_px < m.SETTLED * sure_px
            if judged and (not fresh[n] or it > 4):
                if doubtful or fresh[n]:
                    break
                seen = _judged(px, starts[5], noise, z, widen)
                doubtful = seen[0] < m.ALIKE or seen[3] > m.MISFIT  # an arm came in
                if not doubtful:
                    break
            sigma_px = min(0.4 * sigma_px, 0.5 * f.step_px + m.MODEL_PX)
        groups = starts[5]
        f.visible = f.ring = f.ratio = 0.0
        if not settled:
            f.nats = f.wider_weight = 0.0
            starts[:] = 0
            continue
        f.gain, f.side_px = z[3], 2 * half
        f.off[:] = 0.0
        for side in range(4):
            for i in range(fit.OWN):
                f.sides[side, i] = own_level[side, i] / z[3]
                f.off[i] += (f.sides[side, i] - f.usual[side, i]) ** 2 / 4
                f.off[i] += kept_sides[side, i, 8 + i] / (4 * z[3] ** 2)
        for i in range(3):
            f.ground[i] = z[4 + i]
        f.sigma_m = math.sqrt(max((work[0, 8] + work[1, 9]) / 2, 0.0)) / patch.scale
        f.sigma_rad = math.sqrt(max(work[2, 10], 0.0))
        if not judged:
            fit.all_residuals(px, starts, 1, half, blur_px, noise, z, own_level, m.MODEL_PX**2)
        widen = fit.widen_of(px, starts, 1, m.WIDEN_JUDGED, few)
        f.visible, f.ring, f.ratio, f.misfit = _judged(px, groups, noise, z, widen)
        f.close = close[n] or f.visible < m.ALIKE or f.misfit > m.MISFIT
        if f.close:
            near = min(3.5 * blur_px + 1.0, half / 2)
            fit.side_nats(
                px, starts, half, blur_px, noise, z, own_level, near, widen, side_room, sides
            )
            f.weakest, f.nats = sides.min(), 0.0
            for i in range(4):
                f.nats += min(max(sides[i], m.SIDE_NATS[0]), m.SIDE_NATS[1])
            f.wider, f.wider_weight = fit.widening(
                px, groups, half, blur_px, noise, z, 2 * widen * m.AGREE
            )
            faces.brightness(px, groups, half, blur_px, z, own[n], own_px[n])
        if fresh[n]:
            starts[:] = 0  # of a face that is not kept


@njit(cache=True)
def _lies_in(patch, f, half_m, near):
    """Return whether a block at the start of f can be fitted with the patch that is kept."""
    if patch.starts[5] == 0 or not -0.1 < patch.near_px - near < 0.5:
        return False
    moved = math.sqrt((f.x - patch.x) ** 2 + (f.y - patch.y) ** 2) + abs(f.yaw - patch.yaw) * half_m
    return moved * patch.scale < 1.0


@njit(cache=True)
def _gather(image, c, heights, n, half_m, near, table, f, patch, px, at):
    """Make a patch for the block n at f."""
    d = np.empty(12)
    pixels.taylor(c, f.x, f.y, f.yaw, d)
    patch.x, patch.y, patch.yaw, patch.scale = f.x, f.y, f.yaw, pixels.scale_of(d)
    patch.near_px = near
    table[0] = 0.0
    if heights.shape[0]:
        theta = arctan2(-d[7], d[1])
        outline.tabulate(
            c, heights[n], d[0], d[6], theta, half_m * patch.scale, 0, table, outline.SHINE_PX,
            False,
        )  # fmt: skip
    rows, cols = image.shape
    pixels.gather(
        rows, cols, d, half_m, near, near + m.OUTSIDE_PX, table, c[SENSE], px, at, patch.starts
    )


@njit(cache=True)
def _from_patch(patch, f, z):
    """Set the pose of z from that of f."""
    cs, sn = cos(patch.yaw), sin(patch.yaw)
    dx, dy = (f.x - patch.x) * patch.scale, (f.y - patch.y) * patch.scale
    z[0], z[1], z[2] = cs * dx + sn * dy, cs * dy - sn * dx, f.yaw - patch.yaw


@njit(cache=True)
def _step(work, half, patch, f, z):
    """Take the step in column 7 of work; set the pose of f, and its step."""
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
    cs, sn = cos(patch.yaw), sin(patch.yaw)
    f.x = patch.x + (cs * z[0] - sn * z[1]) / patch.scale
    f.y = patch.y + (sn * z[0] + cs * z[1]) / patch.scale
    f.yaw = patch.yaw + z[2]
    f.step_px = max(step, abs(turn) * half)


@njit(cache=True)
def _judged(px, groups, noise, z, widen):
    """Return visible, ring, ratio and misfit of FOUND, from every third pixel."""
    agree = area = ratio = chi = n = ring = ringed = 0.0
    gain2, ground = z[3] ** 2, z[4]
    for i in range(0, groups * LANES, 3):
        k, lane = i // LANES, i % LANES
        part = px[k, lane + AREA]
        if part == 0.0:
            continue
        q = min(px[k, lane + Q] / widen, m.AGREE)
        good = q < m.AGREE
        if good:
            chi += q
            n += 1.0
        if px[k, lane + EDGE] > 0.5:
            area += part
            if good:
                agree += part
            grey = px[k, lane + GREY]
            s2 = max(noise[0] + noise[1] * grey, m.LEAST_VARIANCE)
            s2 = widen * (s2 + gain2 * px[k, lane + SPREAD])
            ratio += part * (min((grey - ground) ** 2 / s2, m.AGREE) - q) / 2
        elif part == 1.0:
            ring += 1.0
            if good:
                ringed += 1.0
    area = max(area, 1.0)
    return agree / area, ringed / max(ring, 1.0), ratio / area, chi / max(n, 1.0) * widen

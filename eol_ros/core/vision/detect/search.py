# SPDX-License-Identifier: Apache-2.0
"""Where squares are sought in one image, and which of them are believed: one compiled call each.

First where blocks are expected, then about those that were not there, then wherever light is left
that nothing explains. What a square is compared with stands in `known`, one row of numbers.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, hypot, sin
from eol_ros.core.prefetch import CACHE_LINE, prefetch
from eol_ros.core.vision.detect import edges, outline, profiles, scan, usual_outline
from eol_ros.core.vision.detect.edges import (
    ALONE,
    ASIDE,
    CLOSE,
    CONTRAST,
    HALF,
    LEVEL,
    MISFIT,
    QUALITY,
    SIGMA,
    THETA,
    VISIBLE,
    WORST,
    U,
    V,
)

HALF_SIGMA_PX = 0.25  # how well the size of a block is known beforehand
ROUGHLY = 0.05  # and, while nothing is known, as a share of the size
TIGHT_PX = 0.05  # and with a calibration
# Sigma above which a square is not reported: of one that is whole; of one of which much does not
# agree, for it may be an arm's edge or a lamp's that the rest was fitted to; and of one, whole or
# not, whose usual outline is known, for its sigma holds by how much an arm may lead it.
MOST_WHOLE_PX, MOST_PARTLY_PX, MOST_KNOWN_PX = 0.3, 0.24, 0.4
# By so much a block may stand aside at most, half of the strip that an arm hides along one side.
MOST_ASIDE_PX = 1.0
# least share of edges that agree, of the worst side, and least quality
FOLLOWED = (0.25, 0.0, 0.04)
PREDICTED = (0.30, 0.0, 0.10)
NEW = (0.60, 0.30, 0.40)
# An edge of an arm may look like a side. Of a block of which less than POORLY agrees, an outline so
# far from where it is expected (half sides, and half sides for each second since it was seen), or
# so turned (rad), is no answer. CLOSE, and seen so lately, it is one if FOLLOWED agrees.
POORLY = 0.6
AWAY, AWAY_A_S, TURNED = 0.10, 3.6, 0.15
LATELY_S = 0.1
# Of the contrast that the block had when it was last seen whole.
MIN_CONTRAST, MAX_CONTRAST = 0.65, 1.9
# From this quality on, and so sure, an outline where the lattice misses a block is that block's: if
# it was never seen whole, its battery may be weak, and a reflection may stand beside it for ever.
OUTLINE, OUTLINE_PX = 0.25, 0.12
FAINTEST = 0.2  # of the usual contrast: less is no block
LIT = 0.12  # where less of a block's place is lit, none is asked for
# Share of its contrast by which light falls at each side of a block that is sought, how much of its
# sides shows at least, and how many places are tried.
STEEP, LEAST_SHOWN, SOUGHT = 0.5, 0.3, 2
# Images before a light that was no square is tried again, and before it counts as another one; how
# many lights are tried in one image while the lattice is followed, of covers with relief fewer, as
# each costs three fits.
RETRY_IMAGES, FORGET_IMAGES = 12, 60
MOST_TRIED, SOFT_MOST_TRIED = 2, 1
ENOUGH, AGREEING_GAIN, LEAST_AGREEING = 12, 0.1, 0.6
SAME_PX = 10.0
BESIDE_PX = 20.0

HIDDEN = 0.25  # less of the outline than this in view, and the block counts as hidden
FAINT = 0.6  # less of it, and it must stand where its neighbours allow
# From here on, and so sure, it is believed at once where its neighbours allow.
SOUND, SOUND_PX = 0.45, 0.24

# `known`: contrast of blocks, least light of a cover, edge blur px, whether a calibration gave the
# sizes, the image's number, lights refused, the share of edges that agree where a block is whole,
# how many lights are left to be tried in the next image, and then half side and shear over the
# image, each a quadratic of six terms.
CONTRASTS, THRESHOLD, BLUR, CALIBRATED, TURN, REFUSED, AGREEING, LEFT, FIELD = range(9)
KNOWN = FIELD + 18


@njit(inline='always')
def _quadratic(known, which, u, v):
    k = FIELD + 6 * which
    return (
        known[k]
        + u * (known[k + 1] + known[k + 3] * u + known[k + 4] * v)
        + v * (known[k + 2] + known[k + 5] * v)
    )


@njit(cache=True)
def expected(known, shape, u, v):
    """Return half side in px, and shear (two numbers), of a block at `u`, `v`."""
    u, v = u / shape[1] - 0.5, v / shape[0] - 0.5
    return _quadratic(known, 0, u, v), _quadratic(known, 1, u, v), _quadratic(known, 2, u, v)


@njit(cache=True, inner=True)
def attempt(
    image, known, u, v, theta, own, half, searches, table, usual, room, square,
    predicted=False, since_s=np.inf, home_u=np.nan, home_v=np.nan,
):  # fmt: skip
    """Fit a square from `u`, `v`, `theta`; `square` (FIELDS,) says how it went.

    own: contrast that it is known to have, or 0. predicted: a block of the lattice should be
    here, which was seen `since_s` ago, and rested at `home_u`, `home_v`, NaN: not known.
    half: of its side, px; 0 where `known` says it.
    searches: see edges.fit_square; table: see outline; usual: see usual_outline; room: edges.Room.

    Returns whether a block is here that cannot be placed, since an arm hides one of two sides.
    """
    size, re, im = expected(known, image.shape, u, v)
    sure, tight = HALF_SIGMA_PX, TIGHT_PX if known[CALIBRATED] > 0 else 0.0
    if half > 0:
        size, sure = half, ROUGHLY * half
    square[U], square[V], square[THETA] = u, v, theta
    contrasts, blur = known[CONTRASTS], known[BLUR]
    lately = CLOSE * size if since_s < LATELY_S else 0.0
    prior = edges.Known(
        half=size, half_sigma=sure, tight=tight, shear=(re, im), blur=blur,
        least=FAINTEST * contrasts, predicted=predicted, u=u, v=v, close=lately, home_u=home_u,
        home_v=home_v, table=table, usual=usual,
    )  # fmt: skip
    edges.fit_square(image, square, prior, searches, room)
    # grains that sparkle and specks take their part of any block's edge: what is left is all of it
    square[VISIBLE] /= known[AGREEING]
    square[WORST] /= known[AGREEING]
    square[QUALITY] /= known[AGREEING] ** 2
    # a hand may stand where a block should; it is dimmer, or its edges are not all there
    contrast = square[CONTRAST]
    moved = hypot(square[U] - u, square[V] - v)
    close = edges.near(square, u, v, lately, home_u, home_v)
    if own > 0:  # a block known by its brightness may have an arm beside it that is as bright
        dim = contrast < MIN_CONTRAST * own or contrast > MAX_CONTRAST * max(own, contrasts)
    else:
        dim = contrast < 0.5 * contrasts
        if predicted and square[QUALITY] >= OUTLINE and square[SIGMA] < OUTLINE_PX:
            dim = False
        elif not close:  # what was a block just now is none half beside one
            square[QUALITY] *= square[ALONE]
    some = close or (square[VISIBLE] >= PREDICTED[0] and square[QUALITY] >= PREDICTED[2])
    most = MOST_WHOLE_PX if square[VISIBLE] > edges.WHOLE or close else MOST_PARTLY_PX
    most = MOST_KNOWN_PX if usual_outline.trusted(usual) else most
    if predicted and moved >= CLOSE * size and square[QUALITY] < OUTLINE:
        most = OUTLINE_PX  # three sides of a block, of which one may be an arm's
    good = (
        some
        and moved < size
        and square[LEVEL] >= known[THRESHOLD]
        and abs(square[HALF] / size - 1.0) < (0.25 if half > 0 else 0.06)
        and contrast > FAINTEST * contrasts
        and not (dim and square[VISIBLE] < 0.8)
        and square[QUALITY] >= 0.0
    )
    good = good and square[SIGMA] ** 2 - square[ASIDE] ** 2 < most * most
    if not good or square[ASIDE] > MOST_ASIDE_PX:
        square[QUALITY] = 0.0
    return good and square[ASIDE] > MOST_ASIDE_PX


@njit(inline='always')
def _stray(square, u, v, theta, since_s):
    """Return whether a fit shows little, and stands where a block can hardly have come."""
    turned = square[THETA] - theta
    turned = abs(turned - round(turned / (math.pi / 2)) * (math.pi / 2))
    far = hypot(square[U] - u, square[V] - v) > (AWAY + AWAY_A_S * since_s) * square[HALF]
    return square[VISIBLE] < POORLY and (far or turned > TURNED)


@njit(inline='always')
def _misled(image, square, u, v, since_s, home_u, home_v, usual):
    """Return whether a square has an arm's edge for a side, unless it is where it was just now.

    A block that an arm led away from where it rested is led until it shows well or is back there.
    """
    if square[QUALITY] <= 0.0:
        return False
    left = edges.from_home(square, home_u, home_v) > CLOSE
    led = left and usual[usual_outline.LED] > 0
    usual[usual_outline.LED] = 0.0
    lately = CLOSE * square[HALF] if since_s < LATELY_S else 0.0
    if edges.near(square, u, v, lately, home_u, home_v) or square[VISIBLE] >= edges.THREE_SIDES:
        return False
    over = STEEP * square[CONTRAST]
    u, v, theta, half = square[U], square[V], square[THETA], square[HALF]
    led = led or scan.side_within(image, u, v, theta, half, over)
    usual[usual_outline.LED] = led and left and usual[usual_outline.QUARTER] >= 0
    return led


@njit(cache=True, inner=True)
def keep(fits, tried, kept, n, least):
    """Append to `kept`, best first, which of the `tried` fits are good and on their own ground.

    least: share of edges that agree, of the worst side, and quality. Returns the number kept.
    """
    for _ in range(tried):
        best = 0
        for i in range(1, tried):
            if fits[i, QUALITY] > fits[best, QUALITY]:
                best = i
        fit = fits[best]
        free = (
            n < len(kept)
            and fit[VISIBLE] >= least[0]
            and fit[WORST] >= least[1]
            and fit[QUALITY] >= least[2]
        )
        for j in range(n if free else 0):
            du, dv = kept[j, U] - fit[U], kept[j, V] - fit[V]
            if du * du + dv * dv < (1.4 * fit[HALF]) ** 2:
                free = False
                break
        if free:
            kept[n] = fit
            n += 1
        fit[QUALITY] = -1.0
    return n


@njit(cache=True, inner=True)
def _tabulate(known, shape, camera, outlines, near, i, table):
    """Fill `table` for the block of row `i` of `near`, without a name one that stands for all."""
    if len(outlines):
        u, v, theta, _, quarter = near[i, :5]
        half = expected(known, shape, u, v)[0]
        which = i if quarter >= 0 and i < len(outlines) - 1 else len(outlines) - 1
        outline.tabulate(camera, outlines[which], u, v, theta, half, int(max(quarter, 0.0)), table)


@njit(inline='always')
def _lit(known, grid, tiles, u, v, theta, half):
    """Return whether enough light falls at a place for a block to be asked for."""
    over = max(FAINTEST * known[CONTRASTS], 8.0)
    return scan.lit(grid, tiles, u, v, theta, half, over, LIT)


@njit(cache=True)
def bare(known, shape, grid, tiles, places, found):
    """Fill found (k,) bool: at which `places` (k, >= 3), u, v, theta, lies nothing but platform.

    That is as dark as at the darkest quarter of all places, so that arms over others do not count
    for the platform. shape: of the image; a place that is not all in it is not bare.
    """
    height, width = shape
    levels, n = np.full(len(places), 255, np.uint8), 0
    halves = np.empty(len(places))
    for i in range(len(places)):
        u, v, theta = places[i, 0], places[i, 1], places[i, 2]
        halves[i] = expected(known, shape, u, v)[0]
        reach = halves[i] * (abs(cos(theta)) + abs(sin(theta)))
        found[i] = reach < u < width - reach and reach < v < height - reach
        if found[i]:
            levels[n] = tiles[int(v) // scan.TILE_PX, int(u) // scan.TILE_PX]
            n += 1
    dark = np.minimum(tiles, np.sort(levels)[n // 4])
    for i in range(len(places)):
        u, v, theta = places[i, 0], places[i, 1], places[i, 2]
        if found[i]:
            found[i] = not _lit(known, grid, dark, u, v, theta, halves[i])


@njit(cache=True, inner=True)
def _fetch(image, u, v, theta, half):
    """Ask for the pixels of a block, about so large and so turned, before they are needed."""
    height, width = image.shape
    reach = half * (abs(cos(theta)) + abs(sin(theta))) + profiles.REACH_PX
    if not (reach < u < width - reach - 1 and reach < v < height - reach - 1):
        return
    left, right = int(u - reach), int(u + reach)
    for row in range(int(v - reach), int(v + reach) + 1):
        begin = image.ctypes.data + row * width
        for column in range(left, right + CACHE_LINE, CACHE_LINE):
            prefetch(begin + column)


@njit(cache=True)
def at_predictions(
    image, known, grid, tiles, near, camera, outlines, table, usual, work, ends, fits, kept
):
    """Measure blocks where they are expected, `near` (k, 8).

    Its columns: u, v, theta, contrast or 0, the right angles from theta to the block's own x axis,
    -1 where that is not known, how many seconds ago it was seen, inf for not known, and u, v of
    where it rested while its fellows did, NaN for not known. camera:
    Calibration.packed(); outlines: CoverOutlines.over; table (outline.SIZE,) is room for one, 0
    where covers are flat.

    Where one is not, it is fitted where about most of its sides show. Returns how many are in
    `kept`.
    """
    room, places = edges.room(work, ends), np.empty((SOUGHT, 3))
    doubted = np.zeros((len(near), edges.FIELDS))
    tried = 0
    for i in range(len(near)):
        u, v, theta, own, _, since_s, home_u, home_v = near[i]
        if not (math.isfinite(u) and math.isfinite(v) and math.isfinite(theta)):
            continue
        half = expected(known, image.shape, u, v)[0]
        if i + 1 < len(near):
            _fetch(image, near[i + 1, 0], near[i + 1, 1], theta, half)
        if _lit(known, grid, tiles, u, v, theta, half):
            _tabulate(known, image.shape, camera, outlines, near, i, table)
            mine = usual[i if near[i, 4] >= 0 and i < len(usual) - 1 else len(usual) - 1]
            mine[usual_outline.QUARTER] = near[i, 4]
            mine[usual_outline.LEARNS] = (int(known[TURN]) + i) % usual_outline.EACH == 0
            usual_outline.follow(mine, u, v)
            unsure = attempt(
                image, known, u, v, theta, own, 0.0, 0, table, mine, room, fits[tried], True,
                since_s, home_u, home_v,
            )  # fmt: skip
            if unsure or _misled(image, fits[tried], u, v, since_s, home_u, home_v, mine):
                # it is there: if its light were tried once more, edges of arms could pass for its
                scan.erase(grid, tiles, fits, tried, tried + 1, scan.STEP)
                near[i, 0] = np.nan
                continue
            if _stray(fits[tried], u, v, theta, since_s):
                fits[tried, VISIBLE] = fits[tried, QUALITY] = 0.0
            doubted[i] = fits[tried]
            tried += 1
    n = keep(fits, tried, kept, 0, FOLLOWED)
    if n == len(near):
        return n
    tried = 0
    for i in range(len(near)):
        u, v, theta, own, _, since_s, home_u, home_v = near[i]
        there = not (math.isfinite(u) and math.isfinite(v) and math.isfinite(theta))
        for j in range(n):
            there = there or hypot(kept[j, U] - u, kept[j, V] - v) <= BESIDE_PX
        if there:
            continue
        half = expected(known, image.shape, u, v)[0]
        over = STEEP * own if own > 0 else max(FAINTEST * known[CONTRASTS], 20.0)
        scan.seek(image, tiles, u, v, theta, half, over, kept, n, places)
        mine = usual[i if near[i, 4] >= 0 and i < len(usual) - 1 else len(usual) - 1]
        mine[usual_outline.LEARNS] = 0.0
        for k in range(len(places)):
            if places[k, 2] < LEAST_SHOWN or tried == len(fits):
                break
            fit = fits[tried]
            near[i, 0], near[i, 1], near[i, 2] = places[k, 0], places[k, 1], theta
            for rough in (2, 0):  # and once more from where it was found
                _tabulate(known, image.shape, camera, outlines, near, i, table)
                attempt(
                    image, known, near[i, 0], near[i, 1], near[i, 2], own, 0.0, rough, table, mine,
                    room, fit, True,
                )  # fmt: skip
                found = fit[VISIBLE] >= PREDICTED[0] and fit[QUALITY] >= PREDICTED[2]
                whole = fit[VISIBLE] > edges.WHOLE  # whatever is known of this block
                found &= fit[SIGMA] < (MOST_WHOLE_PX if whole else MOST_PARTLY_PX)
                rested = edges.from_home(doubted[i], home_u, home_v) <= CLOSE
                unsure = found and edges.either(fit, doubted[i], rested)
                if found and not unsure:
                    unsure = _misled(image, fit, u, v, since_s, home_u, home_v, mine)
                if not found or unsure or _stray(fit, u, v, theta, since_s):
                    fit[VISIBLE] = fit[QUALITY] = 0.0
                    break
                near[i, 0], near[i, 1], near[i, 2] = fit[U], fit[V], fit[THETA]
            tried += 1
            if fit[QUALITY] > 0.0 or unsure:
                break
    return keep(fits, tried, kept, n, PREDICTED)


@njit(cache=True, inner=True)
def _near(places, n, u, v):
    """Return which of the first `n` places is near `u`, `v`, or -1."""
    for i in range(n):
        if abs(places[i, 0] - u) <= SAME_PX and abs(places[i, 1] - v) <= SAME_PX:
            return i
    return -1


@njit(cache=True)
def at_lights(
    image, known, starts, refused, most, camera, outlines, table, usual, work, ends, fits, kept, n
):
    """Try squares at lights `starts` (m, 4): u, v, theta, half side or 0 where it is known.

    refused (m, 3), u, v and image number of those that were tried before: an arm stays an arm.
    most: up to how many lights to try now, of flat covers beside all that are new; the others come
    in the next image. Returns how many are in `kept`, of which there were `n` before. See
    at_predictions.
    """
    room = edges.room(work, ends)
    one, other = np.zeros((1, 8)), np.zeros(edges.FIELDS)
    old = 0
    for i in range(int(known[REFUSED])):
        if known[TURN] - refused[i, 2] < FORGET_IMAGES:
            refused[old] = refused[i]
            old += 1
    tried = left = 0
    many = min(len(starts), len(fits))
    first = int(known[TURN]) * most % max(many, 1)
    for k in range(2 * many):
        i = (first + k) % many
        row = _near(refused, old, starts[i, 0], starts[i, 1])
        if (row < 0) != (k < many):  # first the new ones, then the others
            continue
        if row >= 0 and known[TURN] - refused[row, 2] < RETRY_IMAGES:
            starts[i, 0] = np.nan
        elif math.isnan(starts[i, 0]):
            continue
        elif tried >= most and (row >= 0 or len(outlines)):
            starts[i, 0] = np.nan
            left += 1
        else:
            attempt(
                image,
                known,
                starts[i, 0],
                starts[i, 1],
                starts[i, 2],
                0.0,
                starts[i, 3],
                2,
                table,
                usual[-1],
                room,
                fits[tried],
            )
            if len(outlines):
                # a cover with relief may be too poor a square: now as one, whichever it may be
                one[0, 0], one[0, 1] = fits[tried, U], fits[tried, V]
                one[0, 2], one[0, 4] = fits[tried, THETA], -1.0
                _tabulate(known, image.shape, camera, outlines, one, 0, table)
                fits[tried, QUALITY] = 0.0
                for rough in (0, 2):
                    attempt(
                        image,
                        known,
                        one[0, 0],
                        one[0, 1],
                        one[0, 2],
                        0.0,
                        starts[i, 3],
                        rough,
                        table,
                        usual[-1],
                        room,
                        other,
                    )
                    good = other[QUALITY] >= NEW[2] and other[WORST] >= NEW[1]
                    if good and other[QUALITY] > fits[tried, QUALITY]:
                        fits[tried] = other
                    if good and other[VISIBLE] >= edges.DOUBTFUL:
                        break
                table[0] = 0.0
            tried += 1
    n = keep(fits, tried, kept, n, NEW)
    for i in range(min(len(starts), len(fits))):
        u, v = starts[i, 0], starts[i, 1]
        if math.isnan(u) or _near(kept, n, u, v) >= 0:
            continue
        row = _near(refused, old, u, v)
        if row < 0 and old < len(refused):
            row = old
            old += 1
        if row >= 0:
            refused[row, 0], refused[row, 1], refused[row, 2] = u, v, known[TURN]
    known[REFUSED], known[LEFT] = old, left
    return n


@njit(cache=True)
def learn_usual(known, kept, n):
    """Take from squares seen whole, if there are enough of them, what is usual here.

    That is their contrast, and the share of their edges that agrees: a quarter of all squares in
    sight are taken to be whole.
    """
    whole = np.empty(n)
    m = 0
    for i in range(n):
        if kept[i, VISIBLE] > 0.9 and kept[i, QUALITY] > 0.7:
            whole[m] = kept[i, CONTRAST]
            m += 1
    if m >= 4:
        known[CONTRASTS] = np.median(whole[:m])
    if n >= ENOUGH:
        share = np.quantile(kept[:n, VISIBLE], 0.75) * known[AGREEING]
        known[AGREEING] += AGREEING_GAIN * (max(min(share, 1.0), LEAST_AGREEING) - known[AGREEING])


@njit(cache=True)
def report(kept, blobs):
    """Write the first squares of `kept` to `blobs` (n,), a BLOB array."""
    for i in range(len(blobs)):
        blob = blobs[i]
        blob.u, blob.v, blob.theta = kept[i, U], kept[i, V], kept[i, THETA]
        blob.side_px, blob.visibility = 2 * kept[i, HALF], min(kept[i, VISIBLE], 1.0)
        blob.sigma_px, blob.quality = kept[i, SIGMA], kept[i, QUALITY]
        blob.contrast, blob.misfit = kept[i, CONTRAST], kept[i, MISFIT]


@njit(cache=True)
def by_block(blobs, seen, index, visibility, contrast):
    """Fill visibility and contrast (25,) of the blocks `seen` as blobs[index], 0 of the others."""
    for i in range(len(index)):
        visibility[i] = blobs[index[i]].visibility if seen[i] else 0.0
        contrast[i] = blobs[index[i]].contrast if seen[i] else 0.0


@njit(cache=True)
def judged(blobs, tracking):
    """Return whether all blobs (n,) are good, and which are good, faint and sound (n,) bool."""
    n, all_good = len(blobs), True
    good, faint, sound = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        shown = blobs[i].visibility
        faint[i] = shown < FAINT
        sound[i] = shown >= SOUND and blobs[i].sigma_px < SOUND_PX
        # while not tracking, no neighbours say where a faint one may stand
        good[i] = shown >= HIDDEN if tracking else not faint[i] or sound[i]
        all_good &= good[i]
    return all_good, good, faint, sound

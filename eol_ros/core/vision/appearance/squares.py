# SPDX-License-Identifier: Apache-2.0
"""Find the blocks of a table in one image of a camera that nobody has calibrated.

A candidate is bright and has dark ground all around it; where its light falls by half gives its
centre and its shape, a parallelogram. So a square predicts its four neighbours, under any tilt
of the camera. The largest set of squares that agree gives a homography, by which the others
are found and all are fitted as the tracker does.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from eol_ros.core import algebra, elementary
from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, cos, sin
from eol_ros.core.table import Table
from eol_ros.core.vision.appearance import find, model
from eol_ros.core.vision.appearance.follow import Follower
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from eol_ros.said import said

SQUARE = np.dtype([('u', 'f8'), ('v', 'f8'), ('theta', 'f8'), ('side_px', 'f8')])
"""A block in an image: the middle of its sides, px; the angle of its x axis, u right and v up."""

SIDES_PX = 14.0, 220.0  # of squares that are looked for
_SCALE = 1.25  # from one size to the next: a size finds squares 0.75 to 1.25 times as wide
_AROUND = 1.8  # half sides: between a square's corner and the next square, however both are turned
_INSIDE = 0.7  # half sides
_RAYS = 32
_CONTRAST = 6.0  # grey levels of a square at least, and in standard deviations of the noise
_MOST = 400  # candidates
_LONG = 1.4  # mean of a shape's two squared axes, in their product's root: 1.04 at a tilt of 40 deg
_CORNERS = 0.02  # fourth harmonic of a shape's radius: 0.06 of a square, none of a disc
_NEAR = 0.35  # pitches between a square and where its neighbour predicts it
_FEWEST = 9  # squares from which the others are predicted
_ASTRAY = 3.0  # of the median distance of squares from their nodes
_CELLS = 9  # places along each axis that are searched about a node


class Squares(NamedTuple):
    """The blocks of one image: (cells,) SQUARE by id, which of them are seen, and the camera.

    calibration is None if no lattice was found; `why` then says so.
    """

    blocks: np.ndarray
    seen: np.ndarray
    calibration: Calibration | None
    why: str


def find_squares(image: np.ndarray, start: Calibration, mirror: bool) -> Squares:
    """Return the blocks in an image (h, w) uint8, read-only, that is still.

    start: lens, covers and table; its homography is not used. The rim is turned by less than 45
    degrees and the far edge of the table is on top of the image; in a mirror columns run to the
    left.
    """
    table = start.table
    blocks, seen = np.zeros(table.cells, SQUARE), np.zeros(table.cells, bool)
    px, cells = lattice(image, table)
    noise = find.noise_by_level(image, np.empty(2))
    many = len(px) >= fewest(table) and np.ptp(cells, axis=0).min() > 1
    camera = _camera(image, cells, px, start, noise) if many else None
    if camera is None:
        count = len(px)
        few = said('squares_seen', count=count, all=table.count)
        return Squares(blocks, seen, None, few if count < table.count else said('not_in_rows'))
    if mirror:
        camera = camera.in_mirror()
    follower = Follower(camera)
    follower.update(0.0, image)
    found = follower.update(
        0.01, image
    )  # again: some lack a side until the width of edges is known
    sides = follower.found
    clear = (sides['weakest'] > model.WEAKEST_NATS) | (sides['nats'] > model.THREE_NATS)
    seen[:] = found['seen'] & clear
    return Squares(squares_of(camera, found), seen, camera, '')


def squares_of(camera: Calibration, found: np.ndarray) -> np.ndarray:
    """Return the squares (n,) SQUARE that blocks (n,) with x, y and yaw look like."""
    xy, yaw = np.column_stack([found['x'], found['y']]), found['yaw']
    side_m = camera.table.block_side_m
    half = side_m / 2 * np.stack([elementary.cos(yaw), elementary.sin(yaw)], axis=1)
    across = half[:, ::-1] * [-1.0, 1.0]
    sides = camera.to_pixels(np.concatenate([xy + half, xy + across, xy - half, xy - across]))
    px, blocks = camera.to_pixels(xy), np.zeros(len(xy), SQUARE)
    blocks['u'], blocks['v'] = sides.reshape(4, -1, 2).mean(axis=0).T
    blocks['theta'] = camera.yaw_to_image(px, yaw)
    blocks['side_px'] = camera.side_px(px, side_m)
    return blocks


def fewest(table: Table) -> int:
    """Return from how many squares the others of a table are predicted."""
    return min(_FEWEST, max(4, table.count // 2))


def lattice(image: np.ndarray, table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Return px (n, 2) and column, row (n, 2), from any origin, of the most squares that agree.

    Columns run to the right, rows up.
    """
    found = np.zeros((_MOST, 6))
    noise = find.noise_by_level(image, np.empty(2))
    pitch_x, pitch_y = table.pitch_m
    size = min(table.columns * pitch_x, table.rows * pitch_y) / table.block_side_m
    most = min(SIDES_PX[1], min(image.shape) / size * _SCALE)
    contrast = _CONTRAST * max(math.sqrt(noise), 1.0)
    n = _candidates(image, SIDES_PX[0], most, contrast, found)
    across, along = 2 * pitch_x / table.block_side_m, 2 * pitch_y / table.block_side_m
    cells, walked = np.zeros((n, 2), np.int64), found[:n].copy()
    mine = _walk(walked, across, along, cells)
    if across != along:  # a square does not say which of its axes is x
        other, again = np.zeros((n, 2), np.int64), found[:n].copy()
        its = _walk(again, along, across, other)
        if its.sum() > mine.sum():
            mine, cells, walked = its, other, again
    px, right, up = np.split(walked[mine], 3, axis=1)
    # columns run less than 45 degrees from right, by the angle of Calibration.yaw_to_image
    along, away = right[:, 0].sum() - up[:, 1].sum(), -right[:, 1].sum() - up[:, 0].sum()
    column, row = cells[mine].T
    if abs(along) < abs(away):
        column, row = (-row, column) if away > 0 else (row, -column)
    elif along < 0:
        column, row = -column, -row
    return px, np.stack([column, row], axis=1)


def _camera(
    image: np.ndarray, cells: np.ndarray, px: np.ndarray, start: Calibration, noise: float
) -> Calibration | None:
    """Return the camera that sees the lattice of which some squares are at px (n, 2)."""
    low, high, table = cells.min(axis=0), cells.max(axis=0), start.table
    rows, columns = table.rows, table.columns
    size, pitch_m = np.array([columns, rows]), np.array(table.pitch_m)
    first, last = np.minimum(high - size + 1, low), np.maximum(low + size - 1, high)
    x, y = (np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
    nodes = pitch_m * np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    camera = _solved(pitch_m * cells, px, start)
    if camera is None:
        return None
    there, response = _search(image, camera, nodes, noise)
    all_of, block = response.reshape(len(y), len(x)), np.where(table.present, 1.0, -1.0)
    windows = sliding_window_view(all_of, (rows, columns))
    sums = (windows * table.grid(block)).sum(axis=(2, 3))
    j, i = np.unravel_index(sums.argmax(), sums.shape)
    mine = (np.arange(len(y))[:, None] - j) // rows == 0
    mine = (mine & ((np.arange(len(x)) - i) // columns == 0)).ravel()
    there, response = there[mine][table.ids], response[mine][table.ids]
    nodes, rest = nodes[mine][table.ids], table.rest[table.ids]
    for _ in range(4):
        good = response > model.MIN_RESPONSE
        far = elementary.hypot(*(camera.to_pixels(nodes) - there).T)
        # blocks that somebody has pushed lie far from where the others put them
        good &= far <= _ASTRAY * np.median(far[good]) if good.any() else good
        if good.sum() < fewest(table):
            return None
        camera = _solved(rest[good], there[good], start)
        if camera is None:
            return None
        nodes = rest
        there, response = _search(image, camera, rest, noise)
    return camera


def _solved(xy: np.ndarray, px: np.ndarray, start: Calibration) -> Calibration | None:
    """Return `start` with the homography of points xy (n, 2) m at px (n, 2); None without one.

    Direct linear transformation (Hartley and Zisserman, Multiple View Geometry, 4.1).
    """
    scale, middle = float(max(start.image_width, start.image_height)), xy.mean(axis=0)
    flat = start.undistort(px) / scale
    x, y = (xy - middle).T
    rows, one, zero = [], np.ones(len(x)), np.zeros((3, len(x)))
    for axis in range(2):
        to = flat[:, axis]
        own = [x, y, one]
        both = [*own, *zero] if axis == 0 else [*zero, *own]
        rows.append(np.stack([*both, -to * x, -to * y], axis=1))
    try:
        h = algebra.least_squares(np.concatenate(rows), flat.T.reshape(-1, 1))[:, 0]
        matrix = np.append(h, 1.0).reshape(3, 3) * np.array([[scale], [scale], [1.0]])
        matrix[:, 2] -= matrix[:, 0] * middle[0] + matrix[:, 1] * middle[1]
        return replace(start, homography=matrix / matrix[2, 2])
    except (np.linalg.LinAlgError, ConfigError):
        return None


def _search(
    image: np.ndarray, camera: Calibration, nodes: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return px (n, 2) and response (n,) of what stands out most near nodes (n, 2) m."""
    packed, lengths = camera.packed(), model.Lengths.of(camera.table)
    reach = _CELLS // 2 * lengths.cell
    places, angles = np.zeros((2, _CELLS, _CELLS), np.float32)
    xy, response = np.empty((len(nodes), 2)), np.empty(len(nodes))
    for k, (x, y) in enumerate(nodes - reach):
        find.respond(image, packed, lengths, x, y, noise, -0.4, 5, 0.2, places, angles)
        i, j = np.unravel_index(places.argmax(), places.shape)
        xy[k], response[k] = (x + j * lengths.cell, y + i * lengths.cell), places[i, j]
    return camera.to_pixels(xy), response


@njit(cache=True)
def _candidates(image, least_px, most_px, contrast, found):
    """Fill found (most, 6) with centre and half sides (right, up) of squares; return how many."""
    rows, cols = image.shape
    n, side, du, dv = 0, least_px, np.empty(16, np.int64), np.empty(16, np.int64)
    while side <= most_px:
        half = side / 2
        for k in range(16):
            du[k] = int(round(_AROUND * half * cos(k * math.pi / 8)))
            dv[k] = int(round(_AROUND * half * sin(k * math.pi / 8)))
        margin, step = int(_AROUND * half) + 1, int(side / 6)
        for v in range(margin, rows - margin, step):
            for u in range(margin, cols - margin, step):
                limit, darker = image[v, u] - contrast, 0
                for k in range(16):
                    darker += image[v + dv[k], u + du[k]] < limit
                    if darker < k - 3:
                        break
                if darker < 12:
                    continue
                if _among(found[:n], u, v, half * half):
                    continue
                f = found[n]
                if _shape(image, u, v, half, contrast, f):
                    n += not _among(found[:n], f[0], f[1], f[2] * f[5] - f[3] * f[4])
                    if n == found.shape[0]:
                        return n
        side *= _SCALE
    return n


@njit(cache=True)
def _among(found, u, v, area):
    """Return whether a square about as large lies there; a bright core of a cover is smaller."""
    for i in range(found.shape[0]):
        its = abs(found[i, 2] * found[i, 5] - found[i, 3] * found[i, 4])
        far2 = (found[i, 0] - u) ** 2 + (found[i, 1] - v) ** 2
        if far2 < its and 0.4 * its < abs(area) < 2.5 * its:
            return True
    return False


@njit(cache=True)
def _light(image, u, v):
    """Return the light at a place between pixels, or -1 outside of the image."""
    i, j = int(math.floor(v)), int(math.floor(u))
    if i < 0 or j < 0 or i + 1 >= image.shape[0] or j + 1 >= image.shape[1]:
        return -1.0
    b, a = v - i, u - j
    return (1 - b) * ((1 - a) * image[i, j] + a * image[i, j + 1]) + b * (
        (1 - a) * image[i + 1, j] + a * image[i + 1, j + 1]
    )


@njit(cache=True)
def _radii(image, u, v, half, contrast, radius):
    """Fill radius (_RAYS,) with how far from the centre light falls by half; return if it does."""
    inner = _light(image, u, v)
    for k in range(8):
        inner += _light(
            image,
            u + _INSIDE * half * cos(k * math.pi / 4),
            v + _INSIDE * half * sin(k * math.pi / 4),
        )
    inner, ground, n = inner / 9, 0.0, 0
    for k in range(_RAYS):
        angle = k * 2 * math.pi / _RAYS
        light = _light(image, u + _AROUND * half * cos(angle), v + _AROUND * half * sin(angle))
        if 0.0 <= light < inner:
            ground += light
            n += 1
    if n < _RAYS // 2 or inner - ground / n < contrast:
        return False
    level, step, open_rays = (inner + ground / n) / 2, half / 12, 0
    for k in range(_RAYS):
        cs, sn = cos(k * 2 * math.pi / _RAYS), sin(k * 2 * math.pi / _RAYS)
        radius[k], before, t = 0.0, inner, 0.4 * half
        while t < _AROUND * half:
            light = _light(image, u + t * cs, v + t * sn)
            if light < level:
                if light >= 0.0:
                    part = (level - light) / max(before - light, 1e-9)
                    radius[k] = t - min(part, 1.0) * step
                break
            before = light
            t += step
        open_rays += radius[k] == 0.0
    for k in range(_RAYS):
        if radius[k] == 0.0:
            radius[k] = radius[(k + _RAYS // 2) % _RAYS]
    return open_rays <= _RAYS // 8


@njit(cache=True)
def _shape(image, u, v, half, contrast, out):
    """Set out (6,) to the centre and the half sides of the parallelogram about u, v, if any.

    By the moments of what its outline encloses: those of a square under an affine map, up to its
    turn, which the corners tell.
    """
    radius, first = np.empty(_RAYS), half
    xx = xy = yy = 0.0
    for _ in range(3):
        if not _radii(image, u, v, half, contrast, radius):
            return False
        area = x = y = xx = xy = yy = 0.0
        for k in range(_RAYS):
            r, angle = radius[k], k * 2 * math.pi / _RAYS
            cs, sn = cos(angle), sin(angle)
            area += r**2 / 2
            x, y = x + r**3 / 3 * cs, y + r**3 / 3 * sn
            xx, xy, yy = xx + r**4 / 4 * cs * cs, xy + r**4 / 4 * cs * sn, yy + r**4 / 4 * sn * sn
        if area <= 0.0:
            return False
        x, y = x / area, y / area
        xx, xy, yy = xx / area - x * x, xy / area - x * y, yy / area - y * y
        u, v, half = u + x, v + y, math.sqrt(area * 2 * math.pi / _RAYS) / 2
        if not 0.7 * first < half < 1.4 * first:
            return False
    root = math.sqrt(max(xx * yy - xy * xy, 1e-9))
    if xx + yy > 2 * _LONG * root:
        return False
    # the root of the matrix of moments, by which a square of half side 1 becomes this one
    size = math.sqrt(3.0 / (xx + yy + 2 * root))
    a, b, d = (xx + root) * size, xy * size, (yy + root) * size
    det, total, real, imag = a * d - b * b, 0.0, 0.0, 0.0
    for k in range(_RAYS):
        angle = k * 2 * math.pi / _RAYS
        p, q = radius[k] * cos(angle) - x, radius[k] * sin(angle) - y
        p, q = (d * p - b * q) / det, (a * q - b * p) / det
        r = math.sqrt(p * p + q * q)
        psi = 4 * arctan2(q, p)
        total, real, imag = total + r, real + r * cos(psi), imag + r * sin(psi)
    if math.sqrt(real * real + imag * imag) < _CORNERS * total:
        return False
    turn = arctan2(-imag, -real) / 4
    cs, sn = cos(turn), sin(turn)
    out[0], out[1] = u, v
    out[2], out[3] = a * cs + b * sn, b * cs + d * sn
    out[4], out[5] = a * sn - b * cs, b * sn - d * cs
    return True


@njit(cache=True)
def _walk(found, pitch_x, pitch_y, cells):
    """Return which squares (n,) are on the largest lattice, and set its cells (n, 2).

    pitch_x, pitch_y: in half sides.
    """
    n = found.shape[0]
    mine, best = np.zeros(n, np.bool_), 0
    visited, queue, at = np.zeros(n, np.bool_), np.empty(n, np.int64), np.zeros((n, 2), np.int64)
    for seed in range(n):
        if visited[seed]:
            continue
        queue[0], count, done, at[seed] = seed, 1, 0, 0
        visited[seed] = True
        while done < count:
            here = queue[done]
            h = found[here]
            done += 1
            for way in range(4):
                right, up = (1, 0, -1, 0)[way], (0, 1, 0, -1)[way]
                px, py = pitch_x * right, pitch_y * up
                du, dv = px * h[2] + py * h[4], px * h[3] + py * h[5]
                there, nearest = -1, _NEAR**2 * (du * du + dv * dv)
                for j in range(n):
                    far2 = (found[j, 0] - h[0] - du) ** 2 + (found[j, 1] - h[1] - dv) ** 2
                    if far2 < nearest:
                        there, nearest = j, far2
                if there < 0 or visited[there]:
                    continue
                t = found[there]
                ratio = (t[2] * t[5] - t[3] * t[4]) / (h[2] * h[5] - h[3] * h[4])
                if not 0.6 < ratio < 1.6:
                    continue
                most, one = -math.inf, (t[2], t[3], t[4], t[5])
                turned = one
                for _ in range(4):
                    alike = one[0] * h[2] + one[1] * h[3] + one[2] * h[4] + one[3] * h[5]
                    if alike > most:
                        most, turned = alike, one
                    one = one[2], one[3], -one[0], -one[1]
                t[2], t[3], t[4], t[5] = turned
                at[there, 0], at[there, 1] = at[here, 0] + right, at[here, 1] + up
                visited[there] = True
                queue[count] = there
                count += 1
        if count > best:
            best = count
            mine[:] = False
            for k in range(count):
                mine[queue[k]] = True
                cells[queue[k]] = at[queue[k]]
    return mine

# SPDX-License-Identifier: Apache-2.0
"""How bright a block's cover is, place by place: learned over many looks.

A face is a map of CELLS x CELLS over the square, as shares of its gain, and the variance of pixels
about it, within each cell and over looks.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.table import Table
from eol_ros.core.vision.appearance import model
from eol_ros.core.vision.appearance.model import (
    AGREE,
    CELLS,
    CELLS_ALIKE,
    COVER_SIGMA,
    LANES,
    SPREAD_LOOKS,
    YOUNG,
)
from eol_ros.core.vision.appearance.pixels import AREA, GREY, LIGHT, LIGHT_A, LIGHT_B, A, B

_LEAST, _MOST = model.SPREAD


class Faces:
    """The faces of n blocks.

    light, spread (n, CELLS, CELLS): brightness, and by what variance pixels deviate from it. looks
    (n,): how often each was looked at. own (n, 2, CELLS, CELLS): brightness of the cover in the
    last image, and mean squared deviation of its pixels from the face. own_px: pixels in each cell.
    """

    def __init__(self, n: int):
        shape = (n, CELLS, CELLS)
        self.light, self.spread = np.ones(shape, np.float32), np.full(shape, _MOST, np.float32)
        self.own_px, self._sum, self._off, self._count = np.zeros((4, *shape), np.float32)
        self.own = np.zeros((n, 2, CELLS, CELLS), np.float32)
        self.looks = np.zeros(n)

    def forget(self, block: int) -> None:
        """Begin again with a block whose cover is another one."""
        self.light[block], self.spread[block] = 1.0, _MOST
        for sums in (self._sum, self._off, self._count, self.looks):
            sums[block] = 0

    def recall(self, block: int, light: np.ndarray, spread: np.ndarray, looks: float) -> None:
        """Take a face that was learned before, as the mean of so many looks."""
        self.light[block], self.spread[block], self.looks[block] = light, spread, looks
        self._count[block] = looks
        self._sum[block] = looks * self.light[block]

    def turn(self, order: np.ndarray, quarters: int) -> None:
        """Give each block the face of block order (n,), turned back by quarters."""
        for maps in (self.light, self.spread, self._sum, self._off, self._count):
            maps[:] = np.rot90(maps[order], quarters, (1, 2))
        self.looks[:] = self.looks[order]

    def quarters(
        self, table: Table, seen: np.ndarray, known: np.ndarray, noise: float
    ) -> np.ndarray:
        """Return nats (turns,) of each turn of a table, of its covers in this image.

        seen, known (n,): whose own brightness is of this image, and whose face is learned. noise:
        variance of a pixel, gains squared. Cells err together with their neighbours.
        """
        nats = np.zeros(len(table.turns))
        comparable = seen & known[table.turned_ids].all(axis=0)
        for k, quarters in enumerate(table.turns):
            for block in np.flatnonzero(comparable):
                true = table.turned_ids[k, block]
                own = np.rot90(self.own[block, 0], quarters).astype(float)
                px = np.rot90(self.own_px[block], quarters)
                there, face = px > 0, self.light[true]
                off = own[there] * (face[there].sum() / own[there].sum()) - face[there]
                variance = self.spread[true][there] + noise / px[there] + COVER_SIGMA**2
                nats[k] -= np.minimum(off**2 / variance, AGREE).sum() / 2 / CELLS_ALIKE
        return nats

    @property
    def maps(self) -> tuple[np.ndarray, ...]:
        """Return light, spread, and the sums that they are drawn from."""
        return self.light, self.spread, self._sum, self._off, self._count


@njit(cache=True)
def learn_face(block, maps, own, own_px, looks, noise, whole):
    """Take a look: the last image's brightness, with the variance `noise` of a pixel.

    maps, own, own_px, looks: of Faces. whole: no cell is covered by something else, however it
    differs from before. Returns whether the face was drawn again.
    """
    looks[block] += 1
    n = round(looks[block])
    young = n <= YOUNG
    light, spread, total, off, count = (
        maps[0][block], maps[1][block], maps[2][block], maps[3][block], maps[4][block],
    )  # fmt: skip
    _add(
        light, spread, total, off, count, own[block], own_px[block], young or whole, young, noise,
        1 / min(n, SPREAD_LOOKS),
    )  # fmt: skip
    if not (n == YOUNG or (not young and n % model.REDRAWN == 0)):
        return False
    _draw(light, spread, total, off, count, n == YOUNG)
    if n >= model.MAX_LOOKS:
        total *= np.float32(0.75)
        count *= np.float32(0.75)
        looks[block] *= 0.75
    return True


@njit(cache=True)
def brightness(px, groups, half, blur, fit, own, counts):
    """Set own and counts of one block to what px shows of its cover; see Faces.

    Of pixels that lie so far inside that their edge function is 1.
    """
    light, off = own
    own[:] = 0.0
    counts[:] = 0.0
    per_cell = CELLS / (2 * half)
    cs, sn = cos(fit[2]), sin(fit[2])
    safe = half - 2 * blur
    for i in range(groups * LANES):
        k, z = i // LANES, i % LANES
        if px[k, z + AREA] == 0.0:
            continue
        x, y = px[k, z + A] - fit[0], px[k, z + B] - fit[1]
        a, b = cs * x + sn * y, cs * y - sn * x
        if abs(a) > safe or abs(b) > safe:
            continue
        p, q = int((a + half) * per_cell), int((b + half) * per_cell)
        seen = (px[k, z + GREY] - fit[4] - (fit[5] * a + fit[6] * b) / half) / fit[3]
        light[q, p] += seen
        face = px[k, z + LIGHT] + px[k, z + LIGHT_A] * a + px[k, z + LIGHT_B] * b
        off[q, p] += (seen - face) ** 2
        counts[q, p] += 1.0
    for q in range(CELLS):
        for p in range(CELLS):
            if counts[q, p] > 0.0:
                light[q, p] /= counts[q, p]
                off[q, p] /= counts[q, p]


@njit(cache=True)
def fill(cells, counts, otherwise):
    """Give cells without a look the mean of those within two cells, or `otherwise`."""
    for q in range(CELLS):
        for p in range(CELLS):
            if counts[q, p] > 0.0:
                continue
            total, n = 0.0, 0
            for reach in range(1, 3):
                for j in range(max(q - reach, 0), min(q + reach + 1, CELLS)):
                    for i in range(max(p - reach, 0), min(p + reach + 1, CELLS)):
                        if counts[j, i] > 0.0:
                            total += cells[j, i]
                            n += 1
                if n:
                    break
            cells[q, p] = total / n if n else otherwise


@njit(cache=True)
def _add(light, spread, total, total_off, count, own, own_px, whole, young, noise, rate):
    for j in range(CELLS):
        for i in range(CELLS):
            if own_px[j, i] <= 0.0:
                continue
            r2, quiet = (own[0, j, i] - light[j, i]) ** 2, noise / own_px[j, i]
            if whole or r2 < AGREE * (spread[j, i] + quiet):
                total[j, i] += own[0, j, i]
                count[j, i] += 1.0
            v = max(own[1, j, i] - noise, 0.0)
            if young:
                total_off[j, i] += v
            else:
                v = spread[j, i] + rate * (min(v, 20 * spread[j, i]) - spread[j, i])
                spread[j, i] = min(max(v, _LEAST), _MOST)


@njit(cache=True)
def _draw(light, spread, total, total_off, count, first):
    for j in range(CELLS):
        for i in range(CELLS):
            if count[j, i] > 0.0:
                light[j, i] = total[j, i] / count[j, i]
                if first:
                    spread[j, i] = min(max(total_off[j, i] / count[j, i], _LEAST), _MOST)
    fill(light, count, 1.0)
    if first:
        fill(spread, count, _MOST)

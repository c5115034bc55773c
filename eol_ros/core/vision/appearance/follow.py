# SPDX-License-Identifier: Apache-2.0
"""Follow all blocks by the faces of their covers, from image to image.

Each block is predicted, registered and judged by itself. Its neighbours say where it can be at
all; a block out of sight is looked for where they put it. With most blocks out of sight the whole
lattice is sought.
"""

import copy
import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.vision.appearance import find, fit, model, neighbours, pixels
from eol_ros.core.vision.appearance.faces import Faces, learn_face
from eol_ros.core.vision.appearance.model import YOUNG
from eol_ros.core.vision.appearance.register import FOUND, register
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.covers import FLAT
from eol_ros.core.vision.calibration.model import Calibration

BLOCK = np.dtype(
    [
        ('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'),
        ('vx', 'f8'), ('vy', 'f8'), ('spin', 'f8'),  # m/s, rad/s
        ('seen', '?'), ('known', '?'),  # now; its face is learned
        ('evidence', 'f8'),  # nats that it is a block, over images
        ('gain', 'f8'),  # its usual one, without the camera's exposure
        # from where its neighbours put it, along the axes of the lattice there, and from its turn
        ('right', 'f8'), ('up', 'f8'), ('yaw_offset', 'f8'),
        ('sure_px', 'f8'),  # standard deviation of that, of a block out of sight
        ('fresh', 'i8'),  # images in a row in which another face was in its place
    ]
)  # fmt: skip
"""One block from image to image."""


class Follower:
    """All blocks of one table.

    blocks: (cells,) BLOCK; a block out of sight is where its neighbours put it. found: (cells,)
    FOUND, of the last image. ambiguous: whether the lattice may lie a quarter turn, or two or
    three, further round. least: fewer blocks in sight than this count as none. changed_s: (cells,)
    when a block was last found to have another cover, -inf for never.
    """

    def __init__(self, calibration: Calibration, trust_start: bool = True):
        self.table = table = calibration.table
        self.rest, n = table.rest, table.cells
        self.lengths = model.Lengths.of(table)
        self.least = min(model.LEAST, table.count // 2 + 1)
        self._seen_blocks = max(round(model.SEEN_SHARE * table.count), self.least)
        self._take_camera(calibration)
        self.blocks, self.found = np.zeros(n, BLOCK), np.zeros(n, FOUND)
        self.found['own'], self.found['side_usual'], self.found['more'] = self._most_own, 1.0, 1.0
        self.found['edge_px'] = model.MODEL_PX
        self.blocks['x'], self.blocks['y'] = self.rest.T
        self.faces, self._patches = Faces(n), pixels.empty_patches(n)
        self.noise, self.quiet = np.ones(2), 1.0
        self.blur_px, self._blur_looks = model.FIRST_BLUR_PX[0], 0
        self.exposure = 1.0
        self.last_s = -math.inf
        self.lattice = False  # whether it was ever found
        self.ambiguous = not trust_start and len(table.turns) > 1
        # when it was last in sight, sought in vain, and sought because all blocks were lost at once
        self._seen_s = self._sought_s = self._jumped_s = -math.inf
        self._near, self._weights = (
            np.zeros((n, 4)),
            neighbours.weigh(table.rest, self.lengths.width),
        )
        self._all, self._turn, self._lost, self._images = table.ids.copy(), 0, 0, 0
        self._places, self._angles = np.zeros((2, 13, 13), np.float32)
        self.changed_s = np.full(n, -math.inf)
        self._unknown, self._close = np.zeros((2, n), bool)  # in this image; see register
        self._stood, self._stands_s = np.full((n, 2), np.nan), math.inf  # where, and since when
        # which blocks were seen since the lattice was found; when it is sought once more if not all
        self._met, self._again_s, self._pause_s = np.zeros(n, bool), math.inf, model.AGAIN_S[0]

    def _take_camera(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self.packed, self.px_per_m = calibration.packed(), calibration.px_per_m()
        self.heights, covers = FLAT, calibration.covers
        if covers is not None:
            self.heights = covers.over(calibration.cover_height_m)
        self._most_own = model.MOST_OWN[covers is not None]

    def recalibrate(self, calibration: Calibration) -> None:
        """Take another calibration of the same camera: blocks stay where they are in the image."""
        before, blocks = self._calibration, self.blocks
        xy = np.column_stack([blocks['x'], blocks['y']])
        along = np.column_stack([elementary.cos(blocks['yaw']), elementary.sin(blocks['yaw'])])
        there = calibration.to_table(before.to_pixels(xy))
        ahead = calibration.to_table(before.to_pixels(xy + self.lengths.half_side * along)) - there
        self._take_camera(calibration)
        turn = elementary.arctan2(ahead[:, 1], ahead[:, 0]) - blocks['yaw']
        blocks['x'], blocks['y'] = there.T
        blocks['yaw'] += (turn + math.pi) % math.tau - math.pi
        for name in ('vx', 'vy', 'spin', 'right', 'up', 'yaw_offset'):
            blocks[name] = 0.0
        self._patches[0]['starts'] = 0

    def rests(self) -> bool:
        """Return whether all blocks in sight have stood still for REST_S."""
        return self.last_s - self._stands_s > model.REST_S and bool(self.blocks['seen'].any())

    def lose(self) -> None:
        """Take no block to be in sight."""
        self.blocks['seen'] = False

    def update(self, stamp_s: float, image: np.ndarray) -> np.ndarray:
        """Take the next image (h, w) uint8, read-only; return blocks."""
        blocks, found = self.blocks, self.found
        if self._images % model.NOISE_EVERY == 0:
            self.quiet = find.noise_by_level(image, self.noise)
        self._images += 1
        passed_s = stamp_s - self.last_s
        seen = blocks['seen'].sum()
        if not self.lattice or self._lost > model.LOST_IMAGES or seen < self.least:
            good = self._acquire(stamp_s, image)
            passed_s = math.inf
        else:
            ahead_s = passed_s if 0.0 < passed_s < model.MAX_AHEAD_S else 0.0
            self._ahead(ahead_s)
            self._register(image, self._all)
            good = self._judge(self._all)
            lost = np.flatnonzero(blocks['seen'] & ~good)  # may have jumped
            if len(lost):
                _start_wide(blocks, found, lost, ahead_s)
                self._register(image, lost, rounds=model.ROUNDS_LOST)
                good[lost] = self._judge(lost)[lost]
            lost = np.flatnonzero(self.table.present & ~good)
            sought_s = max(self._sought_s, self._jumped_s)
            few = len(self._all) - len(lost) < self.least  # all may have jumped at once
            if few and not 0.0 <= stamp_s - sought_s < model.SEEK_S:
                before, self._jumped_s = self._sought_s, stamp_s
                blocks['evidence'] = np.minimum(blocks['evidence'], 0.0)  # it is of other places
                good, passed_s = self._acquire(stamp_s, image), math.inf
                if good.sum() < self.least:  # a dark or blurred image: search in the next one, too
                    self._sought_s = before
            else:
                if len(lost):  # one an image: a search takes as long as eight blocks in sight
                    self._turn += 1
                    self._seek(stamp_s, image, lost[self._turn % len(lost)], good)
                self._doubt(image, good)
        if self.lattice:
            _take(blocks, found, self._near, good, passed_s, self.lengths.near)
            self._learn(passed_s)
            self._lost = 0 if good.sum() >= self._seen_blocks else self._lost + 1
            if good.sum() >= self.least:
                self._seen_s = stamp_s
        self._met |= blocks['seen']
        xy, seen = np.column_stack([blocks['x'], blocks['y']]), blocks['seen']
        if not (seen.any() and np.abs(xy - self._stood)[seen].max() <= model.REST_M):
            self._stood, self._stands_s = xy, stamp_s
        self.last_s = stamp_s
        return blocks

    def _ahead(self, ahead_s: float) -> None:
        """Predict all blocks, `ahead_s` after the last image."""
        _predict(
            self.blocks, self.found, self._near, self.rest, self._weights, ahead_s, self.px_per_m
        )  # fmt: skip

    def _register(
        self, image: np.ndarray, which: np.ndarray, fresh: bool = False, rounds: int = model.ROUNDS
    ) -> None:
        self._expect()
        _ready(
            self.blocks, self.found, fresh, self.exposure, self._images, self._unknown, self._close
        )
        faces = self.faces
        register(
            image, self.packed, self.heights, self.lengths.half_side, self.blur_px, self.noise,
            faces.light, faces.spread, self._unknown, rounds, self._close,
            which, self.found, faces.own, faces.own_px, *self._patches,
        )  # fmt: skip

    def _expect(self) -> None:
        """Expect of covers that were never looked at what the sides of the others have in common.

        The covers of one table fall off alike. A lamp beside a cover that nothing is known of would
        otherwise be taken for its own light.
        """
        new = self.faces.looks == 0
        if not new.any():
            return
        known, found = self.blocks['known'], self.found
        if known.sum() < self.least:
            return
        sides = found['usual'][known].reshape(-1, fit.OWN)
        variance = sides.var(axis=0) + found['own'][known].mean(axis=0)
        found['usual'][new] = sides.mean(axis=0)
        found['own'][new] = np.clip(variance, model.LEAST_OWN, self._most_own)
        found['side_usual'][new] = np.median(found['side_usual'][known])

    def _judge(self, which: np.ndarray, fresh: bool = False) -> np.ndarray:
        """Return those of `which` (cells,) that were found in this image."""
        good = np.zeros(len(self.blocks), bool)
        _accept(
            self.blocks, self.found, self._near, which, fresh, self.table.count, self.least,
            self.px_per_m, self.lengths, good,
        )  # fmt: skip
        return good

    def _seek(self, stamp_s: float, image: np.ndarray, block: int, good: np.ndarray) -> None:
        """Search for a block where its neighbours predict it; set whether it is there in good."""
        near, found, one = self._near[block], self.found[block : block + 1], np.array([block])
        if near[3] < 3:
            return
        reach = self._places.shape[0] // 2 * self.lengths.cell
        find.respond(
            image, self.packed, self.lengths, near[0] - reach, near[1] - reach, self.quiet,
            near[2] + self.blocks['yaw_offset'][block] - 0.4, 5, 0.2, self._places, self._angles,
        )  # fmt: skip
        i, j = np.unravel_index(self._places.argmax(), self._places.shape)
        if self._places[i, j] < model.MIN_RESPONSE:
            return
        place = near[0] - reach + j * self.lengths.cell, near[1] - reach + i * self.lengths.cell
        for fresh in (False, True):
            found['x'], found['y'], found['yaw'] = *place, self._angles[i, j]
            found['start_px'] = model.LOST_PX
            self._register(image, one, fresh, model.ROUNDS_LOST)
            good[block] = self._judge(one, fresh)[block]
            if good[block] or not self.blocks['known'][block]:
                break
        if not (good[block] and fresh):
            self.blocks['fresh'][block] = 0
        elif self._relearn(block):
            self.changed_s[block] = stamp_s
        else:
            good[block] = False

    def _doubt(self, image: np.ndarray, good: np.ndarray) -> None:
        """Try one block whose face leaves a side unexplained without it.

        A face that was learned while an arm lay beside the block is wrong, and would place it
        wrongly for ever.
        """
        blocks, found = self.blocks, self.found
        odd = blocks['known'] & found['close'] & (found['weakest'] < model.WEAKEST_NATS)
        blocks['fresh'][good & found['close'] & ~odd] = 0
        odd = np.flatnonzero(odd & good)
        if not len(odd):
            return
        block = int(odd[self._images % len(odd)])
        was = found[block].copy()
        found['start_px'][block] = model.LOST_PX
        self._register(image, np.array([block]), fresh=True)
        better = self._judge(np.array([block]), fresh=True)[block]
        if not (better and found['nats'][block] >= 4 * model.SIDE_NATS[1]):  # all sides are clear
            blocks['fresh'][block] = 0
        elif self._relearn(block):
            return
        found[block] = was

    def _relearn(self, block: int) -> bool:
        """Count an image that shows another face; return whether the block's own was forgotten."""
        self.blocks['fresh'][block] += 1
        if self.blocks['fresh'][block] < model.RELEARN:
            return False
        self._forget(block)
        return True

    def _forget(self, block: int) -> None:
        self.faces.forget(block)
        self._patches[0]['starts'][block] = 0
        self.found['own'][block], self.found['usual'][block] = self._most_own, 0.0
        self.found['lasting'][block] = 0.0
        self.found['side_usual'][block] = 1.0
        for name in ('known', 'gain', 'fresh'):
            self.blocks[name][block] = 0

    def _acquire(self, stamp_s: float, image: np.ndarray) -> np.ndarray:
        """Seek the whole lattice; return (cells,) which blocks were found.

        Not again at once after it was sought in vain: a search takes as long as ten images.
        """
        blocks, found = self.blocks, self.found
        if 0.0 <= stamp_s - self._sought_s < model.SEEK_S:
            self.lose()
            return np.zeros(len(blocks), bool)
        lattice = find.find_lattice(image, self.packed, self.table, self.quiet)
        if lattice.response < model.MIN_SUM:
            self._sought_s = stamp_s
            self.lose()
            return np.zeros(len(blocks), bool)
        nodes, turn = self._named(lattice.nodes)
        found['x'], found['y'] = nodes[:, 0], nodes[:, 1]
        quarter = find.QUARTER
        square = turn + (nodes[:, 2] - turn + quarter / 2) % quarter - quarter / 2
        if self.lattice:  # a face that is known says which side is which
            square = blocks['yaw'] + (square - blocks['yaw'] + quarter / 2) % quarter - quarter / 2
        found['yaw'] = square
        self._near[:] = np.column_stack(
            [nodes[:, :2], np.full(len(nodes), turn), np.full(len(nodes), len(nodes))]
        )
        again = self.lattice or bool(blocks['known'].any())
        if again:
            self._approach(image)
        else:
            self._focus(image)
        self.lattice = True
        self.lose()
        blocks['right'] = blocks['up'] = 0.0
        blocks['sure_px'] = model.LOST_PX
        if again:  # faces are known
            self._orient(stamp_s)
            found['start_px'] = 1.0
            self._register(image, self._all)
        good = self._judge(self._all)
        few = good.sum() < self._seen_blocks
        if few:
            self._sought_s = stamp_s
        self._met[:], self._pause_s = False, model.AGAIN_S[0]
        self._again_s = stamp_s + (self._pause_s if few else 0.0)
        return good

    def elsewhere(self, stamp_s: float, image: np.ndarray) -> 'Follower | None':
        """Return what follows the same blocks as a lattice a row further on, if they are one.

        None while all blocks have been seen, and between two looks. Where arms hide the blocks of
        two borders, the lattice can be found a row beside its place.
        """
        if (
            self._met[self._all].all()
            or stamp_s < self._again_s
            or self.blocks['seen'].sum() < self.least
        ):
            return None
        self._again_s = stamp_s + self._pause_s
        self._pause_s = min(2 * self._pause_s, model.AGAIN_S[1])
        table = self.table
        index, seen = table.grid(np.arange(table.cells)), self.blocks['seen']
        for axis in (0, 1):
            for way in (1, -1):
                order = np.roll(index, way, axis)
                new = np.take(index, 0 if way > 0 else -1, axis)
                new = new[table.present[new]]
                left = int(seen[np.take(index, -1 if way > 0 else 0, axis)].sum())
                moved = seen[order.ravel()]
                if left + model.MORE > len(new) or moved[~table.present].any():
                    continue
                room = pixels.empty_patches(table.cells)  # too large to be copied
                other = copy.deepcopy(self, {id(self._patches): room})
                other._rename(order.ravel(), new)
                good = other.blocks['seen'].copy()
                for block in new:
                    other._seek(stamp_s, image, block, good)
                if good[new].sum() >= left + model.MORE:
                    _take(other.blocks, other.found, other._near, good, math.inf, self.lengths.near)
                    return other
        return None

    def _rename(self, order: np.ndarray, new: np.ndarray) -> None:
        """Give each block what block order (n,) had; of the blocks `new` nothing is known."""
        for rows in (self.blocks, self.found, self.changed_s, self._met):
            rows[:] = rows[order]
        self.faces.turn(order, 0)
        for block in new:
            self._forget(int(block))
        self.blocks['seen'][new] = self._met[new] = False
        for name in ('right', 'up', 'yaw_offset', 'evidence'):
            self.blocks[name][new] = 0.0
        self.blocks['sure_px'][new] = model.LOST_PX
        self._patches[0]['starts'] = 0
        self._ahead(0.0)
        self._pause_s, self._again_s = model.AGAIN_S[0], -math.inf

    def _approach(self, image: np.ndarray) -> float:
        """Fit all blocks from places that are some px off; return the evidence of their sides."""
        found = self.found
        # before a face is known, fits are repeated until the width of edges has converged
        for start_px in (5.0,) if self.blocks['known'].any() else (5.0, 3.0, 2.0, 1.0):
            found['start_px'] = start_px
            self._register(image, self._all, fresh=True)
            self._sharpen((found['visible'] > 0.8) & (found['ratio'] > 2.0))
        return float(np.clip(found['nats'], *model.IMAGE_NATS).sum())

    def _focus(self, image: np.ndarray) -> None:
        """Fit all blocks of the first image, with the blur of least misfit.

        Where few blocks show all their sides, with the one of most evidence.
        """
        start, found, usual_px = self.found.copy(), self.found, model.FIRST_BLUR_PX[0]
        best, best_px, tried = (-math.inf, 0.0), 0.0, list[float]()
        for blur_px in model.FIRST_BLUR_PX:
            near, far = sorted((best_px, blur_px))
            if best[0] == math.inf:
                needless = any(near < one < far for one in tried)  # beyond one that is worse
            else:
                needless = bool(tried) and blur_px < usual_px  # a sharp lens shows sides there, too
            if needless:
                continue
            found[:], self.blur_px, self._blur_looks = start, blur_px, 0
            nats, rows = self._approach(image), found[self._all]
            clear = rows['nats'] > model.CLEAR_NATS
            rank = (nats, 0.0)
            if 2 * clear.sum() > len(clear):
                rank = (math.inf, -float(np.median(rows['misfit'][clear])))
            tried.append(blur_px)
            if rank > best:
                best, best_px, kept = rank, blur_px, (self.blur_px, self._blur_looks, found.copy())
        self.blur_px, self._blur_looks, found[:] = kept
        self._register(image, self._all, fresh=True)

    def _orient(self, stamp_s: float) -> None:
        """Turn the ids as covers or places say; else the turn is open, if it was dark for long."""
        found = self.found
        clear = (found['visible'] > 0.8) & (found['nats'] > model.ACCEPT_NATS)
        noise = self.quiet / max(float(np.median(found['gain'])), 1.0) ** 2
        turns, known = self.table.turns, self.blocks['known']
        if len(turns) == 1:
            return
        nats = self.faces.quarters(self.table, clear, known, noise)
        best = int(nats.argmax())
        if nats[best] - np.delete(nats, best).max() > model.TURN_NATS:
            self.turn(turns[best], faces=False)
            return
        same = np.array([self._same(clear, quarters) for quarters in turns])
        best, enough = int(same.argmax()), model.SAME_SHARE * self.table.count
        if same[best] >= enough and 2 * np.delete(same, best).max() <= same[best]:
            self.turn(turns[best], faces=False)
        elif model.SAME_S < stamp_s - self._seen_s < math.inf:
            self.ambiguous = True

    def _order(self, quarters: int) -> np.ndarray:
        """Return which id (cells,) each has when the lattice really stands quarters further."""
        return self.table.unturned_ids[self.table.turns.index(quarters)]

    def _same(self, clear: np.ndarray, quarters: int) -> int:
        """Return how many blocks stand where they stood, turned by quarters about their middle.

        Of those `clear` (cells,) to see. Blocks stand off their lattice by millimetres: nobody who
        turns the table by a quarter puts them so.
        """
        order, places = self._order(quarters), np.column_stack([self.blocks['x'], self.blocks['y']])
        middle, (c, s) = (
            places[self._all].mean(axis=0),
            ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters],
        )
        x, y = (places - middle).T
        found = self.found[order]
        far = elementary.hypot(
            found['x'] - middle[0] - c * x + s * y, found['y'] - middle[1] - s * x - c * y
        )
        return int((far[clear[order]] < model.SAME_M).sum())

    def turn(self, quarters: int, faces: bool = True) -> None:
        """Rename all blocks: the lattice really stands quarters x 90 degrees further round.

        faces: whether faces were learned under the names that were wrong.
        """
        self.ambiguous = False
        if quarters == 0:
            return
        order, blocks, found = self._order(quarters), self.blocks, self.found
        was, was_found = blocks.copy(), found.copy()
        blocks[:], found[:], self._near[:] = blocks[order], found[order], self._near[order]
        if faces:
            self.faces.turn(order, quarters)
            for name in ('usual', 'side_usual'):
                found[name] = np.roll(found[name], -quarters, axis=1)
        else:
            for name in ('known', 'gain', 'yaw_offset', 'fresh'):
                blocks[name] = was[name]
            for name in ('own', 'usual', 'side_usual'):
                found[name] = was_found[name]
        blocks['yaw'] += quarters * find.QUARTER
        found['yaw'] += quarters * find.QUARTER
        around = np.round(np.median(blocks['yaw'][self._all]) / math.tau) * math.tau
        blocks['yaw'] -= around
        found['yaw'] -= around
        blocks['right'] = blocks['up'] = 0.0
        blocks['sure_px'] = model.LOST_PX
        self._patches[0]['starts'] = 0

    def _named(self, nodes: np.ndarray) -> tuple[np.ndarray, float]:
        """Return nodes (cells, 3) by id, and the lattice's turn: of the table's turns the nearest.

        To where blocks were when they were last seen, or at first to none. nodes (count, 3): of
        the blocks, by an order that one of the turns makes right.
        """
        blocks, ids, best = self.blocks, self._all, (math.inf, nodes, 0.0)
        there = np.full((self.table.cells, 3), np.nan)
        there[ids] = nodes
        x, y = self.rest[ids].T
        for turned in self.table.turned_ids:
            at = there[turned]
            r = at[ids, :2] - at[ids, :2].mean(axis=0)
            turn = elementary.arctan2(
                (x * r[:, 1] - y * r[:, 0]).sum(), (x * r[:, 0] + y * r[:, 1]).sum()
            )
            far = elementary.hypot(at[ids, 0] - blocks['x'][ids], at[ids, 1] - blocks['y'][ids])
            cost = float(np.minimum(far, 0.1).mean()) if self.lattice else abs(turn)
            if cost < best[0]:
                best = cost, at, turn
        at = best[1]
        at[~self.table.present] = 0.0
        return at, best[2]

    def _learn(self, passed_s: float) -> None:
        blocks, found, faces = self.blocks, self.found, self.faces
        if not blocks['known'].all():
            doubted = ~blocks['known'] & (blocks['evidence'] <= 0) & (faces.looks > 0)
            for block in np.flatnonzero(doubted):
                self._forget(int(block))  # what was looked at was none, or only part of one
        still = np.zeros(len(blocks), bool)
        self.exposure = _learn(
            blocks, found, faces.maps, faces.own, faces.own_px, faces.looks, self._patches[0],
            self.noise, self._most_own, min(passed_s, model.MAX_AHEAD_S) * self.px_per_m,
            self.exposure, self.least, still,
        )  # fmt: skip
        self._sharpen(still)

    def _sharpen(self, good: np.ndarray) -> None:
        """Learn how blurred edges are, from blocks that are seen well."""
        if self._calibration.covers is not None and self._blur_looks >= model.BLUR_LOOKS:
            return
        wider = _wider(self.found, good, self.least)
        if math.isfinite(wider):
            self._blur_looks = min(self._blur_looks + 1, 60)
            low, high = model.BLUR_PX
            self.blur_px = min(max(self.blur_px + wider / max(self._blur_looks - 3, 1), low), high)


@njit(cache=True)
def _ready(blocks, found, fresh, exposure, images, unknown, close):
    """Set the gains to expect, whose face is not known, and which to look at closely."""
    for i in range(blocks.shape[0]):
        b = blocks[i]
        known = b.known and not fresh
        found[i].expected = b.gain * exposure if known else 0.0
        unknown[i] = not known
        close[i] = not known or not b.seen or (i + images) % model.CLOSELY == 0


@njit(cache=True)
def _learn(
    blocks, found, maps, own, own_px, looks, patches, noise, most_own, px_per_mps, exposure, least,
    still,
):  # fmt: skip
    """Learn the faces of blocks that are seen well; return the camera's exposure.

    maps, own, own_px, looks: of Faces. px_per_mps: way in an image, px, of a block at 1 m/s. still
    (n,): set to which of those in full view stand still.
    """
    gains, count = np.empty(blocks.shape[0]), 0
    for i in range(blocks.shape[0]):
        b, f = blocks[i], found[i]
        moved_px = math.sqrt(b.vx * b.vx + b.vy * b.vy) * px_per_mps
        # an arm over a block crosses a side: with four clear sides all light is the cover's own
        clear = f.nats > model.CLEAR_NATS
        alike = f.visible > model.WHOLE and f.nats > (8.0 if b.known else 4.0) and f.ring > 0.85
        alike = alike or (not b.known and f.nats > model.THREE_NATS)  # a lamp lights the fourth
        seen = b.seen and f.close and b.fresh == 0 and (clear or alike)
        if seen and moved_px < model.LEARN_PX:
            variance = max(noise[0] + noise[1] * min(f.gain, 255.0), model.LEAST_VARIANCE)
            if learn_face(i, maps, own, own_px, looks, variance / f.gain**2, clear):
                patches[i].starts[:] = 0
            # expectation maximisation (Dempster, Laird and Rubin, 1977)
            rate = 1 / min(looks[i], model.OWN_LOOKS)
            for k in range(fit.OWN):
                variance = f.own[k] + rate * (f.off[k] - f.own[k])
                f.own[k] = min(max(variance, model.LEAST_OWN[k]), most_own[k])
                for side in range(4):
                    f.usual[side, k] += rate * (f.free[side, k] - f.usual[side, k])
            for k in range(fit.INFLUENCES):
                for j in range(3):
                    f.lasting[k, j] += rate * (f.influence[k, j] - f.lasting[k, j])
            if b.known:
                rate = 1 / min(looks[i] - YOUNG + 1, model.OWN_LOOKS)
                for side in range(4):
                    misfit = min(f.side_misfit[side], model.SIDE_MISFIT * f.side_usual[side])
                    f.side_usual[side] += rate * (misfit - f.side_usual[side])
            b.gain += (f.gain / exposure - b.gain) / min(looks[i], 60.0)
            b.known = looks[i] >= YOUNG
        still[i] = b.seen and f.visible > model.WHOLE and moved_px < model.STILL_PX
        if still[i] and b.known:
            gains[count] = f.gain / b.gain
            count += 1
    return np.median(gains[:count]) if count >= least else exposure


@njit(cache=True)
def _wider(found, good, least):
    """Return by how many px edges of the blocks `good` (n,) are wider than the blur, or NaN."""
    wider, count = np.empty(found.shape[0]), 0
    for i in range(found.shape[0]):
        f = found[i]
        if good[i] and f.close and f.wider_weight > 0.0:
            wider[count] = f.wider / f.wider_weight
            count += 1
    return np.median(wider[:count]) if count >= least else math.nan


@njit(inline='always')
def _edge_px(way_px):
    moved = model.MOVING_SHARE * way_px
    return math.sqrt(model.MODEL_PX**2 + moved * moved)


@njit(cache=True)
def _predict(blocks, found, near, rest, weights, ahead_s, px_per_m):
    """Set the starts of `found` by velocity, or for blocks out of sight by their neighbours."""
    n = blocks.shape[0]
    xy, seen = np.empty((n, 2)), np.empty(n, np.bool_)
    for i in range(n):
        b = blocks[i]
        xy[i, 0], xy[i, 1], seen[i] = b.x + b.vx * ahead_s, b.y + b.vy * ahead_s, b.seen
    neighbours.predict(rest, weights, xy, seen, near)
    for i in range(n):
        b, f = blocks[i], found[i]
        f.x, f.y, f.yaw = xy[i, 0], xy[i, 1], b.yaw + b.spin * ahead_s
        if b.seen:
            way_px = math.sqrt(b.vx * b.vx + b.vy * b.vy) * ahead_s * px_per_m
            b.sure_px = model.PREDICTED_PX + model.PREDICTED_SHARE * way_px
            f.edge_px = _edge_px(way_px)
        elif near[i, 3] >= 3:
            cs, sn = cos(near[i, 2]), sin(near[i, 2])
            f.x = near[i, 0] + cs * b.right - sn * b.up
            f.y = near[i, 1] + sn * b.right + cs * b.up
            f.yaw = near[i, 2] + b.yaw_offset
            way_px = math.sqrt((f.x - b.x) ** 2 + (f.y - b.y) ** 2) * px_per_m
            b.sure_px += model.UNSEEN_PX + model.PREDICTED_SHARE * way_px
            f.edge_px = _edge_px(way_px)
            b.x, b.y, b.yaw = f.x, f.y, f.yaw
        b.sure_px = min(b.sure_px, model.LOST_PX)
        f.start_px = b.sure_px


def _start_wide(blocks: np.ndarray, found: np.ndarray, which: np.ndarray, ahead_s: float) -> None:
    """Start blocks that were not found where they are predicted once more, with a wide prior."""
    for name, rate in (('x', 'vx'), ('y', 'vy'), ('yaw', 'spin')):
        found[name][which] = blocks[name][which] + blocks[rate][which] * ahead_s
    found['start_px'][which] = model.LOST_PX


@njit(inline='always')
def _enters(b, f, px_per_m):
    """Return whether to accept a lost block where it was found.

    All sides must be clear, or the standard deviation small: smaller far from the predicted place,
    where the border of an arm may look like a side.
    """
    if f.nats > model.CLEAR_NATS and f.ring > model.MIN_RING_YOUNG:
        return True
    far_px = math.sqrt((f.x - b.x) ** 2 + (f.y - b.y) ** 2) * px_per_m
    sure_px = model.SURE_PX[0 if far_px < model.EXPECTED_PX else 1]
    return f.sigma_m * px_per_m < sure_px and f.nats > model.PART_NATS


@njit(cache=True)
def _accept(blocks, found, near, which, fresh, count, least, px_per_m, lengths, good):
    """Set which blocks of `which` are in sight, and the evidence of all of these.

    Evidence adds up from image to image (Wald, Sequential Analysis, 1947). count: of the table's
    blocks. least: so many clear ones tell the usual gain.
    """
    low, high = model.IMAGE_NATS
    gains, clear, known = np.empty(len(found)), 0, 0
    for i in range(len(found)):
        known += blocks[i].known
        if found[i].nats > model.CLEAR_NATS:
            gains[clear] = found[i].gain
            clear += 1
    usual_gain = np.median(gains[:clear]) if clear > least else 0.0
    first_nats = model.ACCEPT_NATS if known > count // 2 else model.FIRST_NATS
    for k in range(which.shape[0]):
        i = which[k]
        b, f = blocks[i], found[i]
        young = fresh or not b.known
        total = b.evidence + (min(max(f.nats, low), high) if f.close else 0.0)
        far = 0.0
        if near[i, 3] >= 3:
            far = math.sqrt((f.x - near[i, 0]) ** 2 + (f.y - near[i, 1]) ** 2)
        if young:
            gain_ok = f.gain > model.MIN_GAIN * usual_gain
        else:
            gain_ok = model.GAINS[0] * f.expected < f.gain < model.GAINS[1] * f.expected
        explained = (model.AGREE - f.misfit) / (model.AGREE - max(f.side_usual.mean(), 1.0))
        explained = min(explained, 1.0)
        good[i] = (
            f.visible * explained > (model.MIN_VISIBLE_YOUNG if young else model.MIN_VISIBLE)
            and f.ring * explained > (model.MIN_RING_YOUNG if young else model.MIN_RING)
            and f.ratio > model.MIN_RATIO
            and total > (0.0 if b.seen else first_nats)
            and (
                not young
                or f.weakest > model.WEAKEST_NATS
                or f.nats > model.THREE_NATS
                or (
                    f.ring * explained > model.CLEAR_RING
                    and f.sigma_m * px_per_m < model.SURE_PX[0]
                )
            )
            and (f.start_px < model.LOST_PX or young or _enters(b, f, px_per_m))
            and (f.nats > 0.0 or (f.visible > model.MOSTLY and f.nats > model.NO_SIDES))
            and (not fresh or f.nats > model.FRESH_NATS)
            and f.step_px < model.LAST_STEP_PX
            and f.sigma_m * px_per_m < model.MAX_SIGMA_PX
            and gain_ok
            and far < (lengths.lose if b.seen else lengths.stray)
        )
        f.evidence = min(max(total, model.NATS[0]), model.NATS[1]) if f.visible > 0.3 else 0.0


@njit(cache=True)
def _take(blocks, found, near, good, passed_s, least_m):
    """Set places, velocities and what is in sight."""
    n = blocks.shape[0]
    for i in range(n):
        for j in range(i):
            if good[i] and good[j]:
                dx, dy = found[i].x - found[j].x, found[i].y - found[j].y
                if dx * dx + dy * dy < least_m**2:
                    good[i if found[i].visible < found[j].visible else j] = False
    for i in range(n):
        b, f = blocks[i], found[i]
        b.evidence = f.evidence
        b.vx = b.vy = b.spin = 0.0
        if good[i]:
            if b.seen and 0.0 < passed_s < 0.5:
                b.vx, b.vy = (f.x - b.x) / passed_s, (f.y - b.y) / passed_s
                b.spin = (f.yaw - b.yaw) / passed_s
            b.x, b.y, b.yaw = f.x, f.y, f.yaw
            if near[i, 3] >= 3:
                cs, sn = cos(near[i, 2]), sin(near[i, 2])
                dx, dy = f.x - near[i, 0], f.y - near[i, 1]
                b.right, b.up = cs * dx + sn * dy, cs * dy - sn * dx
                b.yaw_offset = f.yaw - near[i, 2]
        b.seen = good[i]


@njit(cache=True)
def to_pixels(camera, xy, step_px, px):
    """Fill px (n, 2) with the pixels of places xy (n, 2) on the table, on a grid of `step_px`."""
    for i in range(len(xy)):
        u, v = mapping.to_pixel(camera, xy[i, 0], xy[i, 1])
        px[i, 0], px[i, 1] = np.rint(u / step_px) * step_px, np.rint(v / step_px) * step_px

# SPDX-License-Identifier: Apache-2.0
"""Which light is which block, through arms, false lights and darkness.

Seen blocks are followed by prediction and assignment; hidden ones are carried along by their
neighbours; lights that come out again are given back only when one answer is clear. Blocks are tied
by springs and cannot pass one another, so the order of the lattice is a fact that heals every
mistake: an audit compares the order on each image, and acts with patience. After a total loss the
lattice is read from nothing; a square lattice looks the same after a quarter turn, and where time
and speed leave that open it is said (`ambiguous`), not guessed in silence.
"""

from collections.abc import Callable

import numpy as np

from eol_ros.core import algebra
from eol_ros.core.geometry import N_BLOCKS, rest_lattice
from eol_ros.core.vision.identity.association import continued, placed, read_lattice
from eol_ros.core.vision.identity.false_detections import Lamps
from eol_ros.core.vision.identity.fitting import affine, rotate_cell, turn
from eol_ros.core.vision.identity.tracking import (
    CANDIDATES,
    FEW,
    QUARTER,
    advance,
    conclude,
    forget_named,
    suspect_swaps,
    turn_yaws,
)
from eol_ros.core.vision.identity.yaw_signature import Yaws
from eol_ros.core.vision.states import LOST, SEARCHING, TRACKING

LOST_S = 0.05  # with fewer than FEW blocks in sight for so long, the lattice is lost
AUDIT_S = 0.1  # how often the whole lattice is fitted again, when there is reason to
AGREE = 3  # so many readings must say the same before ids change
COAST_S = 0.7  # for so long a turning rim is thought to turn on in the dark
TURN_RATE = 2.2  # rad/s, fastest that visitors turn the rim
JUMP_S = 0.25  # a break in the images longer than this ends all following
REST_S = 0.1  # a lattice that has not moved for so long rests
UNMOVED, UNMOVED_M = 20, 0.001  # so many blocks, so near to where they were in the light
TELLING = 5.0  # and so much nearer than after a quarter turn
ORDER_M2 = 1e-3  # two neighbours that have changed places add 2.4e-3 to the misfit of the lattice
# What a lattice keeps of each block, and what goes with it to another id.
OF_BLOCKS = ('xy', 'velocity', 'yaw', 'seen', 'sigma', 'index', 'seen_s', 'firm')
Vouch = Callable[[np.ndarray, np.ndarray], bool]
Bare = Callable[[np.ndarray, np.ndarray], np.ndarray]


def wrap_quarter(angle: np.ndarray | float) -> np.ndarray | float:
    """Return `angle` modulo a quarter turn, in [-pi/4, pi/4)."""
    return (angle + np.pi / 4) % QUARTER - np.pi / 4


class Lattice:
    """Keeps the 25 identities: a pure function of the sequence of detections.

    After each `update`: xy (25, 2) m, yaw (25,) rad unwrapped, seen (25,), sigma (25,) m, index
    (25,) of the detection or -1, state, ambiguous, angle (of the whole lattice, rad).
    """

    def __init__(self, trust_start: bool = True):
        self.rest = rest_lattice()
        self.trust_start = trust_start
        self.xy = np.full((N_BLOCKS, 2), np.nan)
        self.velocity = np.zeros((N_BLOCKS, 2))
        self.yaw = np.zeros(N_BLOCKS)
        self.seen, self.firm = np.zeros((2, N_BLOCKS), bool)  # and followed since it was not faint
        self.sigma = np.full(N_BLOCKS, np.inf)
        self.index = np.full(N_BLOCKS, -1)
        self.seen_s = np.full(N_BLOCKS, -np.inf)
        self.state = SEARCHING
        self.ambiguous = False
        self.angle = 0.0
        self.turn_rate = 0.0  # rad/s, of the lattice, over the last images
        self.known_s = -np.inf  # when the lattice angle was last followed by at least one block
        self.enough_s = -np.inf  # when enough blocks were last seen
        self.last_s = -np.inf
        self.audit_s = -np.inf
        self.rest_xy = np.full((N_BLOCKS, 2), np.nan)  # where the blocks began to rest
        self.rest_s = np.inf
        self.swaps = np.zeros((N_BLOCKS, N_BLOCKS))
        self.opinion = np.full(N_BLOCKS, -1)  # the last audit's reading, as ids of detections
        self.around_xy = np.zeros((0, 2))  # while it is not placed: where its blocks may stand,
        self.around_yaw = np.zeros(0)  # and how they are turned there
        self.agreed = 0
        self.candidate_xy = np.full((CANDIDATES, 2), np.nan)
        self.candidate_born = np.full(CANDIDATES, np.inf)
        self.candidate_seen = np.full(CANDIDATES, -np.inf)
        self.candidate_index = np.full(CANDIDATES, -1)
        self.lamps = Lamps(CANDIDATES)
        self.renamings = 0  # times that ids may have come to mean other blocks
        self.yaws = Yaws()

    def update(
        self,
        stamp_s: float,
        xy: np.ndarray,
        yaw: np.ndarray,
        sigma: np.ndarray,
        faint: np.ndarray | None = None,
        vouch: Vouch | None = None,
        sound: np.ndarray | None = None,
        bare: Bare | None = None,
    ) -> None:
        """Take the detections of one image: xy (n, 2) m, yaw (n,) rad modulo 90 deg, sigma (n,) m.

        faint (n,) bool: little of the outline is in view, so that it may be something else's.
        sound (n,) bool: so good an outline that it can be nothing but a block; None for not known.
        vouch: whether the covers of the detections (25,), -1 for none, of blocks turned by (25,)
        rad, are those of a lattice that is known, whichever way round it lies.
        bare: at which places (k, 2) m, of blocks turned by (k,) rad, is nothing but platform (k,).
        """
        step = stamp_s - self.last_s
        if not 0.0 < step < JUMP_S:
            step = 1.0 / 60.0
            self.velocity[:] = 0.0
        self.last_s = stamp_s
        kept = None
        if self.lamps.count and len(xy):
            ahead = self.velocity * step
            kept = self.lamps.others(stamp_s, xy, self.xy, ahead, self.seen, sound)
            if kept is not None:
                xy, yaw, sigma = xy[kept], yaw[kept], sigma[kept]
                faint = faint[kept] if faint is not None else None
                sound = sound[kept] if sound is not None else None
        if self.state == TRACKING:
            self._follow(stamp_s, step, xy, yaw, sigma, faint, sound)
            self.lamps.learn(stamp_s, self.xy, self.seen, self.candidate_xy, self.candidate_born)
        if self.state != TRACKING:
            self._search(stamp_s, xy, yaw, sigma, vouch, kept, bare)
        if kept is not None:
            self.index = np.where(self.index >= 0, kept[self.index], -1)

    def turn_ids(self, quarters: int) -> None:
        """Rename all blocks: the lattice really stands `quarters` x 90 degrees further round."""
        if quarters % 4:
            if not self.ambiguous:  # what was learnt was learnt under other names
                self.yaws = Yaws()
            to = np.array([rotate_cell(b, quarters) for b in range(N_BLOCKS)])
            order = np.argsort(to)
            for name in OF_BLOCKS:
                setattr(self, name, getattr(self, name)[order])
            self.swaps[:] = 0.0
            self._renamed()
            self.agreed = 0
            self.angle += quarters * QUARTER
            self.yaw += quarters * QUARTER
            turns = np.round((self.angle - self._start_angle()) / (2 * np.pi)) * 2 * np.pi
            self.angle -= turns
            self.yaw -= turns
        self.ambiguous = False

    def _renamed(self) -> None:
        self.lamps.renamed()
        self.renamings += 1

    def _start_angle(self) -> float:
        return 0.0

    def _follow(
        self,
        stamp_s: float,
        step: float,
        xy: np.ndarray,
        yaw: np.ndarray,
        sigma: np.ndarray,
        faint: np.ndarray | None,
        sound: np.ndarray | None,
    ) -> None:
        none = np.zeros(len(xy), bool)
        was = self.seen
        before, self.index, many, odd = advance(
            stamp_s, step, xy, none if faint is None else faint, self.xy, self.velocity, was,
            self.sigma, self.firm, self.rest, self.angle, self.candidate_xy, self.candidate_born,
            self.candidate_seen, self.candidate_index,
        )  # fmt: skip
        if many or odd:
            self.seen, followed = self.index >= 0, self.index
            read = self._whole_audit(stamp_s, xy, yaw, many)
            was = was & (self.index == followed)  # where another block was says nothing of speed
        else:
            self.agreed, read = 0, False
        self.seen, rests, pair = conclude(
            stamp_s, step, xy, sigma, none if sound is None else sound, not read, before, was,
            self.index, self.angle, self.xy, self.velocity, self.sigma, self.firm, self.seen_s,
            self.rest_xy, self.swaps, self.candidate_xy, self.candidate_born, self.candidate_index,
        )  # fmt: skip
        if not rests:
            self.rest_s = stamp_s
        while pair >= 0:
            self._exchange(pair // N_BLOCKS, pair % N_BLOCKS)
            pair = suspect_swaps(self.xy, self.seen, self.angle, 0.0, self.swaps)
        self.angle, self.turn_rate, count = turn_yaws(
            step, yaw, self.xy, self.seen, self.index, self.rest, self.yaw, self.angle,
            self.turn_rate,
        )  # fmt: skip
        if not self.ambiguous and self.yaws.due(stamp_s):
            self.yaws.learn(stamp_s, self.xy, self.yaw_offsets(), self.seen)
        if count:
            self.known_s = stamp_s
        if count >= FEW:
            self.enough_s = stamp_s
        elif stamp_s - self.enough_s > LOST_S:
            self._lose()

    def yaw_offsets(self) -> np.ndarray:
        """Return the yaw of each block against the lattice's, modulo 90 degrees, (25,) rad."""
        return np.asarray(wrap_quarter(self.yaw - self.angle))

    def _exchange(self, a: int, b: int) -> None:
        """Exchange two neighbours that, for long enough, have stood crosswise on the lattice."""
        for name in OF_BLOCKS:
            array = getattr(self, name)
            array[[a, b]] = array[[b, a]]
        self._renamed()
        self.swaps[[a, b], :] = 0.0
        self.swaps[:, [a, b]] = 0.0

    def _whole_audit(self, stamp_s: float, xy: np.ndarray, yaw: np.ndarray, many: bool) -> bool:
        """Read the lattice from nothing and adopt the reading when it keeps explaining more.

        With many lights waiting it is asked on every image, and two answers that leave all that is
        seen as it is are enough; else now and then, with more patience.
        """
        if stamp_s - self.audit_s < AUDIT_S and not many:
            return False
        self.audit_s = stamp_s
        index, angle, sure = read_lattice(xy, yaw, self.xy, True)
        if not sure:
            self.agreed = 0
            return False
        index = self._nearest_turn(index, angle, self.angle)[0]
        more = (index >= 0).sum() - self.seen.sum()
        worse = self._misfit(xy, self.index)
        better = self._misfit(xy, index)
        both = (index >= 0) & (self.index >= 0)
        if (
            (np.array_equal(index[both], self.index[both]) and more <= 0)
            or better > (0.7 * worse if more <= 0 else 1.5 * worse + 1e-4)
            or more < 0
        ):
            self.agreed = 0
            return False
        named = self._named(index)
        self.agreed = self.agreed + 1 if np.array_equal(named, self.opinion) else 1
        self.opinion = named
        leaves = np.array_equal(index[self.seen], self.index[self.seen])
        if self.agreed < (2 if many and leaves else AGREE):
            return False
        self.agreed = 0
        self._adopt(stamp_s, index, xy, yaw)
        return True

    def _named(self, index: np.ndarray) -> np.ndarray:
        """Say a reading in terms of the present ids, so that readings of two images can agree."""
        owner = {int(i): b for b, i in enumerate(self.index) if i >= 0}
        return np.array([owner.get(int(i), -1) for i in index])

    def _misfit(self, xy: np.ndarray, index: np.ndarray) -> float:
        """Mean squared departure from a lattice that may stretch and shear, m^2."""
        held = index >= 0
        if held.sum() < 6:
            return np.inf
        place = xy[index]
        fit = affine(self.rest, place, held)
        off = (fit[0] + algebra.matmul(self.rest, fit[1:]) - place)[held]
        return float((off**2).sum(1).mean())

    @staticmethod
    def _nearest_turn(index: np.ndarray, angle: float, believed: float) -> tuple[np.ndarray, float]:
        """Turn a reading by quarters until it is nearest to the angle believed in."""
        quarters = int(np.round((believed - angle) / QUARTER))
        turned = np.full(N_BLOCKS, -1)
        for block in range(N_BLOCKS):
            turned[rotate_cell(block, quarters % 4)] = index[block]
        return turned, angle + quarters * QUARTER

    def _search(
        self,
        stamp_s: float,
        xy: np.ndarray,
        yaw: np.ndarray,
        sigma: np.ndarray,
        vouch: Vouch | None,
        kept: np.ndarray | None,
        bare: Bare | None,
    ) -> None:
        known = self.state == LOST
        self.index = np.full(N_BLOCKS, -1)
        self.seen = np.zeros(N_BLOCKS, bool)
        if known:
            self.sigma = np.minimum(self.sigma + 0.005, 0.5)
        index, angle, sure = read_lattice(xy, yaw, np.where(known, self.xy, self.rest), known)
        self.around_xy = continued(xy, index)
        self.around_yaw = np.full(len(self.around_xy), angle)
        if bare is not None and len(self.around_xy) > N_BLOCKS:
            moved, only = placed(xy, index, bare(self.around_xy, self.around_yaw))
            if only:
                index, sure = moved, True
        if not sure:
            self.agreed = 0
            return
        blind_s = stamp_s - self.known_s if known else 0.0
        # A hand that was turning the rim when the light went will have gone on a little.
        believed = self.angle + self.turn_rate * min(blind_s, COAST_S)
        index, angle = self._nearest_turn(index, angle, believed)
        off = angle - self.angle
        self.agreed += 1
        if self.agreed < AGREE and (index < 0).any():
            shown = index if kept is None else np.where(index >= 0, kept[index], -1)
            turned = angle + np.asarray(wrap_quarter(yaw[index] - angle))
            if vouch is None or not vouch(shown, turned):
                return
        self.agreed = 0
        if not known:
            self.ambiguous = not self.trust_start
        elif not self._unmoved(index, xy):
            self.ambiguous |= QUARTER - abs(off) <= TURN_RATE * blind_s
        self.angle = angle
        self.yaw[:] = angle
        self.state = TRACKING
        self.enough_s = stamp_s
        self._adopt(stamp_s, index, xy, yaw)
        self.sigma[self.seen] = sigma[self.index[self.seen]]

    def _unmoved(self, index: np.ndarray, xy: np.ndarray) -> bool:
        """Whether all stands as before the darkness, and would not so after a quarter turn.

        Blocks rest some millimetres off their lattice, each its own way: that tells turns apart.
        """
        off = np.full(4, np.inf)
        for quarters in range(4):
            turned = self._nearest_turn(index, 0.0, quarters * QUARTER)[0]
            held = turned >= 0
            if held.sum() < UNMOVED:
                return False
            place = xy[turned[held]]
            before = self.xy[held] - (self.xy[held].mean(0) if quarters else 0.0)
            for _ in range(quarters):  # where a rim turned so would have taken them
                before = np.stack([-before[:, 1], before[:, 0]], axis=1)
            off[quarters] = np.sqrt(
                ((place - (place.mean(0) if quarters else 0.0) - before) ** 2).mean()
            )
        return bool(off[0] < UNMOVED_M and off[1:].min() > TELLING * max(off[0], UNMOVED_M / 2))

    def rename(
        self, stamp_s: float, index: np.ndarray, xy: np.ndarray, yaw: np.ndarray, sigma: np.ndarray
    ) -> bool:
        """Take `index` (25,) for the blocks' detections, unless their order speaks against it.

        Blocks cannot pass one another; so names that fit the lattice worse are refused.
        """
        if self._misfit(xy, index) > self._misfit(xy, self.index) + ORDER_M2:
            return False
        velocity = np.zeros_like(self.velocity)
        owner = self._named(index)
        velocity[owner >= 0] = self.velocity[owner[owner >= 0]]
        self._adopt(stamp_s, index, xy, yaw)
        self.velocity = velocity
        self.sigma[self.seen] = sigma[index[self.seen]]
        self.agreed = 0
        return True

    def drop(self, block: int, place: np.ndarray) -> None:
        """Take the light of `block` for nobody's; the block is hidden, and stands at `place`."""
        self.index[block] = -1
        self.seen[block] = False
        self.xy[block] = place
        self.velocity[block] = 0.0

    def _adopt(self, stamp_s: float, index: np.ndarray, xy: np.ndarray, yaw: np.ndarray) -> None:
        """Take a reading of the lattice as the truth; hidden blocks go where their fellows say."""
        self.velocity[index != self.index] = 0.0
        self.firm &= index == self.index
        self._renamed()
        self.index = index
        self.seen = index >= 0
        self.swaps[:] = 0.0
        self.xy[self.seen] = xy[index[self.seen]]
        forget_named(self.xy, self.seen, self.candidate_xy, self.candidate_born)
        fit = affine(self.rest, self.xy, self.seen)
        self.xy[~self.seen] = fit[0] + algebra.matmul(self.rest[~self.seen], fit[1:])
        self.sigma[~self.seen] = 0.02
        near = self.angle + np.asarray(wrap_quarter(yaw[index[self.seen]] - self.angle))
        self.yaw[self.seen] = near
        self.yaw[~self.seen] = self.angle
        self.seen_s[self.seen] = stamp_s
        self.known_s = stamp_s

    def break_off(self, stamp_s: float) -> None:
        """An image that cannot be used: nothing is seen, and what was known begins to age."""
        self.last_s = stamp_s
        self.seen = np.zeros(N_BLOCKS, bool)
        self.index = np.full(N_BLOCKS, -1)
        if self.state == TRACKING and stamp_s - self.enough_s > LOST_S:
            self._lose()

    def move(self, xy: np.ndarray) -> None:
        """Take places (25, 2) in metres of a better calibration; identities stay."""
        self.xy = np.array(xy, float)
        self.velocity[:] = 0.0
        angle = turn(self.rest, self.xy, np.isfinite(xy[:, 0]))
        self.yaw += angle - self.angle
        self.angle = angle

    def rests(self) -> bool:
        """Whether all seen blocks have stayed where they are for REST_S."""
        return bool(self.last_s - self.rest_s > REST_S and self.seen.any())

    def _lose(self) -> None:
        self.state = LOST
        self.around_xy = np.zeros((0, 2))
        self.agreed = 0
        self.candidate_born[:] = np.inf
        self.velocity[:] = 0.0

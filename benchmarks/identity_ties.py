# SPDX-License-Identifier: Apache-2.0
"""How many slips settle which way round the lattice lies, and how many must any method have?"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from eol_ros.core.geometry import N_BLOCKS

LOST_TAPS = 0.03
NOISE_M = 13e-6  # 0.007 px
SLIPS = (3, 5, 10)
ERROR = 1e-5
NEVER_HZ = 1e-6  # taps of a block at rest: the table has none
AGAIN_HZ = 0.2  # of a block that stuck and went on between two images
HIDDEN_HZ = 0.65  # of one under an arm
SETTLE_IMAGES = 20, 60  # between two trials


class Knowing:
    """The bound: a judge that knows the table's every slip in sight to the microsecond.

    It knows the rates of all that happens, the jitter of the taps, also which slips come next; what
    it does not know are the slips under arms. It is as sure as the tracker has to be.
    """

    def __init__(self, since_s: float, jitter_s: float):
        self.since_s = since_s
        self.jitter_s = jitter_s
        self.taps: list[tuple[float, int]] = []
        self.slips: list[tuple[float, int, bool]] = []  # when, which block, whether from rest
        self.images: list[tuple[float, np.ndarray, np.ndarray]] = []  # stamp, in sight, at rest

    def look(self, moment: Any, true: np.ndarray, begun: list[tuple[float, int]]) -> None:
        """Take one image's truth: its moment, the blocks in sight, the slips since the last."""
        shown = np.isin(np.arange(N_BLOCKS), true)
        rested = self.images[-1][2] if self.images else moment.stuck
        self.images.append((moment.stamp_s, shown, moment.stuck))
        self.slips += [(on, block, bool(rested[block])) for on, block in begun if shown[block]]

    def needed(self) -> float:
        """Return after how many slips it knew; inf when it never did."""
        slips = sorted(s for s in self.slips if s[0] >= self.since_s)
        stamps = np.array([image[0] for image in self.images])
        count = 0
        for k, (now, _, from_rest) in enumerate(slips):
            count += from_rest
            belief = np.array(
                [self._belief(q, slips[: k + 1], slips[k + 1 :], stamps, now) for q in range(4)]
            )
            if np.exp(belief[1:] - belief[0]).sum() < ERROR:
                return count
        return np.inf

    def _belief(
        self, quarters: int, slips: list, later: list, stamps: np.ndarray, now: float
    ) -> float:
        from eol_ros.core.vision.identity.symmetry import TURNED, UNTURNED

        heard = 1.0 - LOST_TAPS
        far_s = 5.0 * self.jitter_s
        chance: dict[tuple[float, int], float] = {}
        total = 0.0
        for tap in self.taps:
            stamp_s, name = tap
            if not self.since_s + far_s < stamp_s <= now + far_s:
                continue
            place = int(UNTURNED[quarters, name])
            at = min(int(np.searchsorted(stamps, stamp_s)), len(stamps) - 1)
            _, shown, stuck = self.images[at]
            rate = NEVER_HZ if stuck[place] else AGAIN_HZ
            rate = rate if shown[place] else HIDDEN_HZ
            rate += heard * sum(self._density(stamp_s - s) for s, b, _ in later if b == place)
            chance[tap] = rate
            total += np.log(rate)
        for stamp_s, place, _ in slips:
            name = int(TURNED[quarters, place])
            answers = sum(
                self._density(t[0] - stamp_s) / chance[t]
                for t in chance
                if t[1] == name and abs(t[0] - stamp_s) < far_s
            )
            total += np.log(LOST_TAPS + heard * answers)
        return float(total)

    def _density(self, apart_s: float) -> float:
        return float(
            np.exp(-0.5 * (apart_s / self.jitter_s) ** 2) / (self.jitter_s * np.sqrt(2 * np.pi))
        )


def trials(
    count: int, seed: int, jitter_s: float, noise_m: float = NOISE_M
) -> Iterator[tuple[int, float, float, bool]]:
    """Yield slips and seconds until the tracker knew, slips that the bound took, whether right.

    A trial begins at some moment of the table's life: the ids are turned by some quarters, and from
    now on images and taps tell. Arms hide blocks, there are false lights, 3 % of taps are lost.
    """
    from benchmarks.stick_slip import Onlooker, Table
    from eol_ros.core.vision.identity.fitting import rotate_cell
    from eol_ros.core.vision.identity.identity import Identity

    table = Table(seed, 60.0, askew_rad=0.0)  # only taps shall tell
    onlooker = Onlooker(seed, noise_m, losses_per_hour=0.0)
    random = np.random.default_rng([seed, 17])
    identity = Identity()
    lattice = identity.lattice
    knowing: Knowing | None = None
    heard, pause = 0, 120
    while count:
        moment = table.step()
        seen = onlooker.look(moment)
        begun, heard = table.begun[heard:], len(table.begun)
        taps = [
            (on + random.normal(0, jitter_s), block)
            for on, block in begun
            if random.random() > LOST_TAPS
        ]
        for stamp_s, block in taps:
            identity.tap(stamp_s, block, jitter_s)
        if knowing is not None:
            knowing.taps += taps
            knowing.look(moment, seen.true, begun)
        identity.update(moment.stamp_s, seen.xy, seen.yaw, seen.sigma)
        pause -= 1
        if knowing is None and pause <= 0 and lattice.state == 1 and not lattice.ambiguous:
            lattice.turn_ids(int(random.integers(0, 4)))
            lattice.ambiguous = True
            identity.confirmed, identity.onsets = False, None
            knowing = Knowing(moment.stamp_s, jitter_s)
        elif knowing is not None and not lattice.ambiguous:
            held = np.flatnonzero(lattice.index >= 0)
            names = seen.true[lattice.index[held]]
            # Which turn the names stand for; one lost name more or less is not the question here.
            votes = [int((names == [rotate_cell(b, q) for b in held]).sum()) for q in range(4)]
            turn = int(np.argmax(votes))
            slips = identity.coincidence.took
            yield slips, moment.stamp_s - knowing.since_s, min(knowing.needed(), slips), turn == 0
            lattice.turn_ids(turn)
            identity.confirmed = True
            knowing, pause = None, int(random.integers(*SETTLE_IMAGES))
            count -= 1


def measure(count: int, seed: int, jitter_s: float, noise_m: float = NOISE_M) -> dict[str, float]:
    """Run `count` trials and return their figures."""
    rows = zip(*trials(count, seed, jitter_s, noise_m), strict=True)
    slips, seconds, bound, right = (np.array(column) for column in rows)
    share = {f'decided_by_{n}_slips_percent': 100 * float((slips <= n).mean()) for n in SLIPS}
    best = {f'bound_by_{n}_slips_percent': 100 * float((bound <= n).mean()) for n in SLIPS}
    return {
        'trials': float(count),
        **share,
        **best,
        'seconds_median': float(np.median(seconds)),
        'seconds_p95': float(np.quantile(seconds, 0.95)),
        'wrong_decisions': float((~right).sum()),
    }

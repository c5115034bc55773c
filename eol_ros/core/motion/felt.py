# SPDX-License-Identifier: Apache-2.0
"""Provisional slips: published at a tap of a block's accelerometer, before an image shows them.

A tap comes some 6 ms after a block breaks loose; the first image that shows it beyond doubt comes
10 to 40 ms after. So a slip is published provisionally at its tap if most taps of this kind were
slips. VERDICT_S later the images confirm or retract it.

A kind of taps: those within one octave of strength, of blocks that rested before or of blocks that
moved. A slip begins with (mu_s - mu_k) g, which depends on the table; hands and feet on the table
mostly cause weaker taps. A block that nearly stops and goes on gives the same signal as one that
breaks loose, on worn grit one time in ten. So the probability that a tap is a slip is the share of
taps of its kind that the images have confirmed lately (the mean of a Beta posterior). By the prior,
strong taps count as slips until one is retracted, weak ones only after many were slips.

The result depends on the stamps of taps and images alone, not on their delays. A tap is judged by
the images at least LAG_S older than it, and waits for them if they are late: a replay decides the
same.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eol_ros.core import elementary

PROVISIONAL = 1
CONFIRMED = 2
RETRACTED = 3
LAG_S = 0.05  # least age of images that judge a tap, three at 60/s: most have come by its report
VERDICT_S = 0.1  # from a tap to the image that confirms or retracts it: twice what a START takes
REST_S, REST_IMAGES = 0.25, 4  # window, and fewest images in it that show where a block rests
WHOLE = 0.75  # least share of the images of that window: if more are lost, slips go unseen
LOST = 1.5  # gap, in periods, of a lost image; a tap beside one teaches nothing
KEPT_S = 0.5  # how long images and verdicts are kept; later taps are not judged by them
WEAKEST_MPS2 = 0.16  # the firmware's threshold, 16 mg, where the first octave begins
OCTAVES = 6
WEAK = 2  # number of lowest octaves: hits on the rim and footsteps lie there
PRIOR, PRIOR_WEAK = (199.8, 200.0), (0.5, 1.0)  # prior: taps confirmed, and all taps
MOVES_MPS, MOVES_S = 0.003, 0.02  # least speed of a moving block, and over which time
MEMORY = 1000.0  # verdicts after which one counts for 1/e


class Knock(NamedTuple):
    """A report of a block's accelerometer: stamp, standard deviation of it, peak."""

    stamp_ns: int
    block: int
    sigma_s: float
    strength_mps2: float = 0.0

    @property
    def stamp_s(self) -> float:
        """The stamp in seconds, as core counts time."""
        return self.stamp_ns * 1e-9


@dataclass(frozen=True)
class FeltSlip:
    """A provisional slip or its verdict, as in eol_msgs/FeltSlip.

    `slip` is the number of the slip that confirms it, else 0; `x` and `y`, m, are where the block
    was LAG_S before.
    """

    kind: int
    knock: Knock
    x: float
    y: float
    probability: float
    slip: int = 0

    @property
    def block(self) -> int:
        """Id of the block."""
        return self.knock.block


class _Image(NamedTuple):
    stamp_s: float
    x: np.ndarray
    y: np.ndarray
    seen: np.ndarray


class _Verdict(NamedTuple):
    stamp_s: float
    kind: tuple[int, int]  # 1: it moved; octave
    confirmed: bool


class Felt:
    """Decides which taps are published as provisional slips, and learns from their verdicts.

    level: least probability of a tap that is published; 1: none is.
    """

    def __init__(self, level: float):
        self.level = level
        self.reset()

    def reset(self) -> None:
        """Forget all: the stamps begin again."""
        self._images: deque[_Image] = deque()
        self._held: list[Knock] = []  # until the images come that judge them
        self._open: dict[Knock, tuple[tuple[int, int], FeltSlip | None]] = {}  # None: not published
        self._counts = np.array([[PRIOR_WEAK] * WEAK + [PRIOR] * (OCTAVES - WEAK)] * 2)
        self._late: deque[_Verdict] = deque()  # not in the counts yet

    def tap(self, knock: Knock) -> list[FeltSlip]:
        """Take a tap; return its provisional slip if it is published now."""
        if self._images and self._images[-1].stamp_s > knock.stamp_s - LAG_S:
            return self._decide(knock)
        self._held.append(knock)
        return []

    def look(
        self, stamp_s: float, x: np.ndarray, y: np.ndarray, seen: np.ndarray
    ) -> list[FeltSlip]:
        """Take the (n,) blocks of an image; return the slips of taps that waited for it."""
        if self._images and not stamp_s > self._images[-1].stamp_s:
            return []
        self._images.append(_Image(stamp_s, np.array(x), np.array(y), np.array(seen, bool)))
        while self._images[0].stamp_s < stamp_s - KEPT_S:
            self._images.popleft()
        while self._late and self._late[0].stamp_s < stamp_s - KEPT_S:
            _count(self._counts, self._late.popleft())
        ready = [knock for knock in self._held if knock.stamp_s - LAG_S < stamp_s]
        self._held = [knock for knock in self._held if knock.stamp_s - LAG_S >= stamp_s]
        return [told for knock in sorted(ready) for told in self._decide(knock)]

    def judge(self, stamp_s: float, knock: Knock, slip: int) -> list[FeltSlip]:
        """Record which slip (0: none) a tap was, by the image of `stamp_s`; return the verdict."""
        if knock not in self._open:
            return []
        kind, told = self._open.pop(knock)
        if self._seen_throughout(knock):
            self._late.append(_Verdict(stamp_s, kind, slip > 0))
        return [replace(told, kind=CONFIRMED if slip else RETRACTED, slip=slip)] if told else []

    def _seen_throughout(self, knock: Knock) -> bool:
        """Whether no image about `knock` is missing, nor its block in any."""
        about = [i for i in self._images if i.stamp_s > knock.stamp_s - LAG_S]
        if len(about) < 2:
            return False
        gaps = np.diff([i.stamp_s for i in self._images])
        whole = bool(np.diff([i.stamp_s for i in about]).max() < LOST * np.median(gaps))
        return whole and all(i.seen[knock.block] for i in about)

    def _decide(self, knock: Knock) -> list[FeltSlip]:
        until_s = knock.stamp_s - LAG_S
        before = [image for image in self._images if image.stamp_s <= until_s]
        after_s = self._images[len(before)].stamp_s
        if not before or after_s >= knock.stamp_s + VERDICT_S:
            return []
        image = before[-1]
        rest = [i for i in before if i.stamp_s > until_s - REST_S]
        known = sum(i.seen[knock.block] for i in rest)
        if known < REST_IMAGES or not image.seen[knock.block]:
            return []
        if known < WHOLE * REST_S / np.median(np.diff([i.stamp_s for i in rest])):
            return []
        kind = int(_moves(rest, knock.block)), _octave(knock)
        probability = self._probability(kind, until_s)
        x, y = float(image.x[knock.block]), float(image.y[knock.block])
        told = FeltSlip(PROVISIONAL, knock, x, y, probability)
        self._open[knock] = kind, told if probability >= self.level else None
        return [told] if probability >= self.level else []

    def _probability(self, kind: tuple[int, int], until_s: float) -> float:
        """Return the share of taps of this kind that images up to `until_s` have confirmed."""
        counts = self._counts.copy()
        for verdict in self._late:
            if verdict.stamp_s <= until_s:
                _count(counts, verdict)
        confirmed, of = counts[kind].tolist()
        return confirmed / of


def _octave(knock: Knock) -> int:
    above = knock.strength_mps2 / WEAKEST_MPS2
    if not above > 1.0:
        return 0
    return min(math.frexp(above)[1] - 1, OCTAVES - 1)


def _moves(images: list[_Image], block: int) -> bool:
    """Return whether `block` moves in the last of `images`, where it is seen."""
    seen = [i for i in images if i.seen[block]]
    last = seen[-1]
    lately = [i for i in seen[:-1] if i.stamp_s >= last.stamp_s - MOVES_S] or seen[-2:-1]
    far = elementary.hypot(last.x[block] - lately[0].x[block], last.y[block] - lately[0].y[block])
    return far > MOVES_MPS * (last.stamp_s - lately[0].stamp_s)


def _count(counts: np.ndarray, verdict: _Verdict) -> None:
    counts[verdict.kind] *= 1.0 - 1.0 / MEMORY
    counts[verdict.kind] += float(verdict.confirmed), 1.0

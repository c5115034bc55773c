# SPDX-License-Identifier: Apache-2.0
"""Patterns of flashing blocks: how complex are they, and is that more than chance?

A moment is a span of time, its pattern the blocks that flashed in it. Measures are counts on the
lattice and judge nothing; whether a pattern is due to chance is asked against surrogates that keep
what needs no explanation: how often each block flashes, and how many do in each moment.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from eol_ros.core.science.powerlaw import too_few
from eol_ros.errors import EolError

FEWEST = 30  # moments
MOST = 300  # that are asked; of more, so many evenly over the time
SURROGATES = 399  # the least p-value of four tests at once is then 0.02
SWEEPS = 3  # trades of every moment with another, between two surrogates
REJECTED = 0.05
SHIFT_S = (1.0, 5.0)  # each block's flashes are moved by so much, to either side


class TooFew(EolError):
    """These patterns carry no test."""


def _square(patterns: np.ndarray) -> np.ndarray:
    lit = np.asarray(patterns, bool)
    if lit.ndim != 3 or lit.shape[1] != lit.shape[2] or lit.shape[1] < 3:
        raise ValueError(f'patterns are (k, n, n) with n of 3 or more; these are {lit.shape}')
    return lit


def edges(patterns: np.ndarray) -> np.ndarray:
    """Return how many pairs of 4-neighbours are unequal, (k,): 0..40 on 5x5."""
    lit = _square(patterns)
    down = (lit[:, 1:] != lit[:, :-1]).sum(axis=(1, 2))
    return down + (lit[:, :, 1:] != lit[:, :, :-1]).sum(axis=(1, 2))


def turns(patterns: np.ndarray) -> np.ndarray:
    """Return how many corners the outlines of the lit regions have, (k,); a diagonal touch is two.

    It is the complexity of Chipman, J. Exp. Psychol. Gen. 106 (1977) 269.
    """
    lit = np.pad(_square(patterns), ((0, 0), (1, 1), (1, 1))).astype(np.int8)
    a, b, c, d = lit[:, :-1, :-1], lit[:, :-1, 1:], lit[:, 1:, :-1], lit[:, 1:, 1:]
    count = a + b + c + d
    diagonal = (count == 2) & (a == d)
    return (count % 2 + 2 * diagonal).sum(axis=(1, 2))


def regions(patterns: np.ndarray) -> np.ndarray:
    """Return how many connected regions there are, lit and dark together, (k,); 4-neighbours.

    Nath and others call it intricacy.
    """
    lit = _square(patterns)
    flat = ndimage.generate_binary_structure(3, 1)
    flat[0] = flat[2] = False  # patterns do not touch each other
    total = np.zeros(len(lit), int)
    for kind in (lit, ~lit):
        labels, _ = ndimage.label(kind, flat)  # numbered on from pattern to pattern
        last = np.maximum.accumulate(labels.max(axis=(1, 2), initial=0))
        total += np.diff(last, prepend=0)
    return total


MEASURES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    'turns': turns,
    'edges': edges,
    'regions': regions,
}


def traded(moments: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return `moments`, (k, blocks) of bool, after every row has traded with another.

    Of two rows, the blocks that are lit in one alone are dealt out again, to each as many as it
    had: each block's and each moment's count stays (curveball: Strona and others, Nat. Commun. 5
    (2014) 4114). The way back is as likely as the way there.
    """
    made = moments.copy()
    pairs = rng.permutation(len(made))[: len(made) // 2 * 2].reshape(2, -1)
    one, other = made[pairs[0]], made[pairs[1]]
    differ = one ^ other
    keys = np.where(differ, rng.random(differ.shape), 2.0)
    rank = keys.argsort(axis=1).argsort(axis=1)
    mine = differ & (rank < (one & differ).sum(axis=1, keepdims=True))
    both = one & other
    made[pairs[0]], made[pairs[1]] = both | mine, both | (differ & ~mine)
    return made


@dataclass(frozen=True)
class Compared:
    """A mean over all moments, beside that of surrogates.

    p_value: two-sided, alone. p_holm: after Holm's correction for all that were asked. extreme:
    it lies beyond all surrogates, so that more of them could make both smaller.
    """

    name: str
    mean: float
    by_chance: float
    p_value: float
    p_holm: float
    extreme: bool

    @property
    def clear(self) -> bool:
        """Whether chance does not give this."""
        return self.p_holm < REJECTED

    @property
    def verdict(self) -> str:
        """How it compares with chance, for people."""
        if not self.clear:
            return 'as by chance'
        return f'{"more" if self.mean > self.by_chance else "less"} than by chance'

    @property
    def figures(self) -> str:
        """Both means and the corrected p-value, for people."""
        p = f'p {"at most " if self.extreme else ""}{self.p_holm:.2g}'
        return f'{self.mean:.3g} against {self.by_chance:.3g}, {p}'


@dataclass(frozen=True)
class Patterns:
    """What was asked of the patterns, and what came of it."""

    moments: int
    asked: int
    static: list[Compared]
    follows: Compared

    @property
    def random(self) -> bool:
        """Whether nothing tells them from chance."""
        return not any(c.clear for c in (*self.static, self.follows))

    @property
    def sentences(self) -> list[str]:
        """The verdict for people."""
        of = f'{self.asked} of {self.moments}' if self.asked < self.moments else f'{self.moments}'
        head = 'patterns of light are not random' if not self.random else (
            'patterns of light: chance is not ruled out'
        )  # fmt: skip
        each = '; '.join(
            f'{verdict}: {", ".join(f"{c.name} ({c.figures})" for c in of_it)}'
            for verdict in ('more than by chance', 'less than by chance', 'as by chance')
            if (of_it := [c for c in self.static if c.verdict == verdict])
        )
        return [
            f'{head} ({of} moments; chance: each block and each moment flashes as often): {each}',
            'light in time: of two blocks that flash one moment after the other, '
            f'{self.follows.name} {self.follows.verdict} ({self.follows.figures}; chance: each '
            f'block shifted by {SHIFT_S[0]:g} to {SHIFT_S[1]:g} s)',
        ]


def ask(
    flashes: np.ndarray, rate_hz: float, rng: np.random.Generator, surrogates: int = SURROGATES
) -> Patterns:
    """Ask whether the patterns of flashes are due to chance, and how they differ from it.

    flashes: (t, n, n) of bool, which blocks flashed in each moment, `rate_hz` a second, dark
    moments included. surrogates: how many of either kind. Raises TooFew with fewer than 30 moments
    with some blocks lit and some dark.

    The test of the static measures is exact whatever the mixing of the chain (serial method: J.
    Besag, P. Clifford, Biometrika 76 (1989) 633), as long as moments do not depend on each other;
    where they do, chance is rejected too often (docs/explanation/science.md). All p-values are
    corrected together (S. Holm, Scand. J. Stat. 6 (1979) 65).
    """
    flashes = _square(flashes)
    count = flashes.sum(axis=(1, 2))
    some = np.flatnonzero((count > 0) & (count < flashes[0].size)) if len(flashes) else count
    if len(some) < FEWEST:
        raise TooFew(too_few(len(some), 'moment', 'a test', FEWEST))
    used = some[np.linspace(0, len(some) - 1, min(len(some), MOST)).astype(int)]
    side = flashes.shape[1]
    found = flashes[used].reshape(len(used), -1)

    def values(moments: np.ndarray) -> list[float]:
        stack = moments.reshape(-1, side, side)
        return [float(measure(stack).mean()) for measure in MEASURES.values()]

    drawn = np.array([values(moments) for moments in _chain(found, surrogates, rng)])
    own = np.array(values(found))
    follows, shifted = _follows(flashes, rate_hz, rng, surrogates)
    ps = [_two_sided(own[k], drawn[:, k]) for k in range(len(own))]
    ps.append(_two_sided(follows, shifted))
    holm = _holm(np.array(ps))
    least = 2 / (surrogates + 1)
    compared = [
        Compared(name, float(mean), float(chance.mean()), p, float(p_holm), p <= least)
        for name, mean, chance, p, p_holm in zip(
            (*MEASURES, 'neighbours'), (*own, follows), (*drawn.T, shifted), ps, holm, strict=True
        )
    ]
    return Patterns(len(some), len(used), compared[:-1], compared[-1])


def _chain(found: np.ndarray, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Return `count` surrogates from both sides of `found` in a chain where it stands anywhere."""
    before = int(rng.integers(0, count + 1))
    made = []
    for steps in (before, count - before):
        now = found
        for _ in range(steps):
            for _ in range(SWEEPS):
                now = traded(now, rng)
            made.append(now)
    return made


def _follows(
    flashes: np.ndarray, rate_hz: float, rng: np.random.Generator, surrogates: int
) -> tuple[float, np.ndarray]:
    """Return the share of neighbours among two blocks of which one flashes a moment after another.

    And the same, (surrogates,), with each block's flashes moved in time by a lag of its own. A
    share, so that it does not matter how many blocks flash in a moment: hands move all of them.
    """
    series = flashes.reshape(len(flashes), -1).astype(np.float32)
    blocks, side = series.shape[1], flashes.shape[1]
    row, column = np.divmod(np.arange(blocks), side)
    apart = abs(row[:, None] - row) + abs(column[:, None] - column)
    least, most = (max(1, round(s * rate_hz)) for s in SHIFT_S)
    reach = min(2 * most + 1, len(series) - 1)
    # how often b flashes so many moments after a, from -reach on
    later = np.array([series[: len(series) - d].T @ series[d:] for d in range(reach + 1)])
    every = np.concatenate([later[:0:-1].transpose(0, 2, 1), later])
    a, b = np.indices(apart.shape)

    def share(lags: np.ndarray) -> float:
        pairs = every[np.clip(1 + lags[a] - lags[b] + reach, 0, 2 * reach), a, b]
        return float(pairs[apart == 1].sum() / max(pairs[apart > 0].sum(), 1))

    drawn = [
        share(rng.integers(least, most + 1, blocks) * rng.choice((-1, 1), blocks))
        for _ in range(surrogates)
    ]
    return share(np.zeros(blocks, int)), np.array(drawn)


def _two_sided(own: float, drawn: np.ndarray) -> float:
    close = 1e-12 * max(1.0, abs(own))
    low = 1 + int((drawn <= own + close).sum())
    high = 1 + int((drawn >= own - close).sum())
    return min(1.0, 2 * min(low, high) / (len(drawn) + 1))


def _holm(p_values: np.ndarray) -> np.ndarray:
    order = np.argsort(p_values, kind='stable')
    steps = np.minimum(1, p_values[order] * np.arange(len(order), 0, -1))
    corrected = np.empty(len(order))
    corrected[order] = np.maximum.accumulate(steps)
    return corrected

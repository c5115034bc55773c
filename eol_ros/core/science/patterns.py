# SPDX-License-Identifier: Apache-2.0
"""How a pattern of lit and dark blocks looks, in numbers: complexity, order, symmetry.

Krpan and van Tilburg found beauty greatest at high complexity with little randomness; Chipman
measured complexity by turns, Birkhoff divided order by it. These are exact counts on the little
lattice, not judgements; algorithmic complexity (BDM) says little on 5x5 and is left out.
"""

from dataclasses import dataclass, fields

import numpy as np

Pattern = np.ndarray


@dataclass(frozen=True)
class Measures:
    """Of one pattern. Edges, turns, components: counts. Entropies in bits. Order: 0..1."""

    lit: int
    edges: int
    turns: int
    components: int
    symmetries: int
    entropy_2x2: float
    local_complexity: float

    @property
    def order(self) -> float:
        """Share of the seven symmetries of the square that it has."""
        return self.symmetries / 7

    @property
    def birkhoff(self) -> float:
        """Order over complexity (Birkhoff 1933), which is turns; nan without turns."""
        return self.order / self.turns if self.turns else float('nan')


def measures(pattern: Pattern) -> Measures:
    """Return the measures of `pattern`, (n, n) of bool."""
    lit = np.asarray(pattern, bool)
    if lit.ndim != 2 or lit.shape[0] != lit.shape[1]:
        raise ValueError(f'a pattern is square; this one has shape {lit.shape}')
    return Measures(
        lit=int(lit.sum()),
        edges=edges(lit),
        turns=turns(lit),
        components=components(lit),
        symmetries=symmetries(lit),
        entropy_2x2=_entropy(_windows(lit)),
        local_complexity=local_complexity(lit),
    )


def edges(lit: Pattern) -> int:
    """Return how many pairs of 4-neighbours are unequal: 0..40 on 5x5."""
    return int((lit[1:] != lit[:-1]).sum() + (lit[:, 1:] != lit[:, :-1]).sum())


def turns(lit: Pattern) -> int:
    """Return how many corners the outlines of the lit regions have; a diagonal touch is two."""
    windows = _windows(np.pad(lit, 1))
    count = windows.sum(axis=1)
    diagonal = (count == 2) & (windows[:, 0] == windows[:, 3])
    return int((count % 2).sum() + 2 * diagonal.sum())


def components(lit: Pattern) -> int:
    """Return how many connected regions there are, lit and dark together (4-neighbours)."""
    parent = np.arange(lit.size)

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    side = lit.shape[1]
    flat = lit.ravel()
    for k in range(lit.size):
        for near in ((k + 1) if (k + 1) % side else -1, k + side):
            if 0 <= near < lit.size and flat[near] == flat[k]:
                parent[root(near)] = root(k)
    return len({root(k) for k in range(lit.size)})


def symmetries(lit: Pattern) -> int:
    """Return how many of the seven turns and mirrors of the square leave it as it is."""
    turned = [np.rot90(m, k) for m in (lit, lit.T) for k in range(4)]
    return sum(np.array_equal(lit, t) for t in turned[1:])


def local_complexity(lit: Pattern) -> float:
    """Return the mean information that a block has beyond its neighbour, bits: 0..1.

    Mean over four directions of the conditional entropy H(block | neighbour): mean information
    gain, as Javaheri Javid et al. (2016) use it for binary images.
    """
    pairs = (
        (lit[:, :-1], lit[:, 1:]),
        (lit[:-1], lit[1:]),
        (lit[:-1, :-1], lit[1:, 1:]),
        (lit[:-1, 1:], lit[1:, :-1]),
    )
    gains = []
    for one, other in pairs:
        both = np.stack([one.ravel(), other.ravel()], axis=1)
        gains.append(_entropy(both) - _entropy(both[:, 1:]))
    return float(np.mean(gains))


@dataclass(frozen=True)
class Comparison:
    """A measure over a series of patterns, beside patterns of as many lit blocks at random places.

    `p_less`: how often a random series has as small a mean.
    """

    mean: float
    shuffled_mean: float
    p_less: float


def against_shuffled(
    patterns: np.ndarray, rng: np.random.Generator, repeats: int = 200
) -> dict[str, Comparison]:
    """Compare `patterns`, (k, n, n) of bool, with themselves shuffled, measure by measure."""
    names = [f.name for f in fields(Measures) if f.name != 'lit']
    patterns = np.asarray(patterns, bool)
    true = _means(patterns, names)
    flat = patterns.reshape(len(patterns), -1)
    drawn = np.array(
        [_means(rng.permuted(flat, axis=1).reshape(patterns.shape), names) for _ in range(repeats)]
    )
    less = ((drawn <= true).sum(axis=0) + 1) / (repeats + 1)
    return {
        name: Comparison(float(true[k]), float(drawn[:, k].mean()), float(less[k]))
        for k, name in enumerate(names)
    }


def _means(patterns: np.ndarray, names: list[str]) -> np.ndarray:
    rows = [measures(p) for p in patterns]
    return np.array([[getattr(m, name) for name in names] for m in rows]).mean(axis=0)


def _windows(lit: Pattern) -> np.ndarray:
    """All 2x2 windows, (k, 4): top left, top right, bottom left, bottom right."""
    parts = (lit[:-1, :-1], lit[:-1, 1:], lit[1:, :-1], lit[1:, 1:])
    return np.stack([p.ravel() for p in parts], axis=1).astype(int)


def _entropy(rows: np.ndarray) -> float:
    """Entropy of the rows as symbols, bits."""
    codes = np.asarray(rows, int) @ (1 << np.arange(rows.shape[1]))
    share = np.bincount(codes) / len(codes)
    share = share[share > 0]
    return float(-(share * np.log2(share)).sum())

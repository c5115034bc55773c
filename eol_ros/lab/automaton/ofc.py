# SPDX-License-Identifier: Apache-2.0
"""The earthquake automaton of Olami, Feder and Christensen, Phys. Rev. Lett. 68 (1992) 1244.

It is the quasi-static limit of the table of Brown, Scholz and Rundle, Geophys. Res. Lett. 18 (1991)
215: blocks on springs K_L to a driven plate and K_C to each other, friction that drops to nothing
while a block slides, one jump to rest. Stress is force over strength, and a toppling site hands
each neighbour alpha = K_C / (4 K_C + K_L) of what it had.

    drive     all sites rise together until the greatest reaches 1
    layer     all sites at or above 1 topple together: to 0, and each of the four neighbours + alpha
    times
              the old stress; a site may receive in the layer in which it toppled
    event     layers until no site is at or above 1; what crosses the open boundary is lost

*Size* counts topplings, *area* distinct sites, *duration* layers.
"""

from fractions import Fraction
from typing import NamedTuple

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.lab.automaton.ofc_kernel import SHARE_BITS, SINK, topple

ONE = 1 << 50  # the threshold in fixed point: a step is 9e-16
LARGEST_SIDE = 4096


class Events(NamedTuple):
    """What a run gives, one entry an event: int64 arrays of equal length, or of length 0.

    `first` is row * side + column of the site that starts it, the lowest of several.
    """

    size: np.ndarray
    area: np.ndarray
    duration: np.ndarray
    first: np.ndarray

    @classmethod
    def empty(cls, count: int, full: bool = True) -> 'Events':
        """Return arrays for `count` events; without `full`, for their sizes only."""
        return cls(*(np.zeros(count if full or k == 0 else 0, np.int64) for k in range(4)))

    @classmethod
    def joined(cls, parts: list['Events']) -> 'Events':
        """Return the events of `parts` one after another."""
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


def check(side: int, alpha: float | Fraction) -> None:
    """Raise ConfigError unless the lattice and alpha make sense."""
    if not 1 <= side <= LARGEST_SIDE:
        raise ConfigError(f'lattice size {side} is not between 1 and {LARGEST_SIDE}')
    if not 0 <= alpha <= Fraction(1, 4):
        raise ConfigError(f'alpha {alpha} is not between 0 and 1/4: above that nothing ever rests')


def padded(values: np.ndarray) -> np.ndarray:
    """Return (L, L) integers with sinks around them, flat, as the inner loop wants them."""
    side = len(values)
    rows = np.full((side + 2, side + 1), SINK, np.int64)
    rows[1 : side + 1, 1:] = values
    return np.append(rows.ravel(), SINK)


def unpadded(stress: np.ndarray, side: int) -> np.ndarray:
    """Return the (L, L) sites of a flat padded lattice."""
    return stress[:-1].reshape(side + 2, side + 1)[1 : side + 1, 1:]


class Automaton:
    """The automaton in 64-bit fixed point: bit-identical everywhere, and fast.

    stress: (L, L) in [0, 1). alpha is rounded to a multiple of 2^-32 and gifts are rounded down to
    a multiple of 2^-50; sites that would tie exactly may therefore part in the last bit, which is
    what `ExactAutomaton` is for.
    """

    arithmetic = 'fixed point, 2^-50'

    def __init__(self, stress: np.ndarray, alpha: float):
        self.side = len(stress)
        check(self.side, alpha)
        if stress.shape != (self.side, self.side):
            raise ConfigError(f'the lattice is square; this start has shape {stress.shape}')
        if not (np.isfinite(stress).all() and stress.min() >= 0 and stress.max() < 1):
            raise ConfigError('stress at the start lies in [0, 1), each site below its threshold')
        self._share = round(alpha * (1 << SHARE_BITS))
        self._stress = padded((np.asarray(stress, float) * ONE).astype(np.int64))

    @classmethod
    def random(cls, side: int, alpha: float, seed: int) -> 'Automaton':
        """Return an automaton with stress evenly spread over [0, 1)."""
        check(side, alpha)
        return cls(np.random.default_rng(seed).random((side, side)), alpha)

    @property
    def stress(self) -> np.ndarray:
        """The stress of each site between events, (L, L)."""
        return unpadded(self._stress, self.side) / ONE

    def run(self, count: int, full: bool = False) -> Events:
        """Return the next `count` events; without `full` their sizes only."""
        events = Events.empty(count, full)
        topple(self._stress, self.side, ONE, self._share, events)
        return events


class ExactAutomaton:
    """The automaton in exact arithmetic: every stress is a whole number over one denominator.

    numerators: (L, L) whole numbers, below `denominator`. Each toppling may need the denominator
    times that of alpha, so the numbers are Python's own long integers.
    """

    arithmetic = 'exact, long integers'
    GROW = 16  # powers of alpha's denominator that the common denominator grows by at a time
    NEAR = 1e-9  # of the threshold: doubles sort the sites, integers decide among those this close

    def __init__(self, numerators: np.ndarray, denominator: int, alpha: Fraction):
        self.side = side = len(numerators)
        check(side, alpha)
        if numerators.shape != (side, side) or numerators.dtype.kind not in 'iu':
            raise ConfigError(
                f'the start is a square of whole numbers; this one is {numerators.dtype} of '
                f'shape {numerators.shape}'
            )
        if numerators.min() < 0 or numerators.max() >= denominator:
            raise ConfigError(
                f'numerators at the start lie in 0..{denominator - 1}, each site below its '
                f'threshold; these lie in {numerators.min()}..{numerators.max()}'
            )
        self.alpha, self.one = alpha, denominator
        self._value: list[int] = numerators.ravel().tolist()
        self._drive = 0
        self._rough = np.array([v / denominator for v in self._value])
        self._next_to = [
            [
                r * side + c
                for r, c in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1))
                if 0 <= r < side and 0 <= c < side
            ]
            for i in range(side)
            for j in range(side)
        ]

    @property
    def stress(self) -> np.ndarray:
        """The stress of each site between events, (L, L) of Fraction."""
        values = [Fraction(v + self._drive, self.one) for v in self._value]
        return np.array(values, object).reshape(self.side, self.side)

    def run(self, count: int, full: bool = True) -> Events:
        """Return the next `count` events; `full` is that of `Automaton.run`, always true here."""
        events = Events.empty(count)
        for k in range(count):
            size, area, duration, first = self._event()
            events.size[k], events.area[k] = size, area
            events.duration[k], events.first[k] = duration, first
        return events

    def _event(self) -> tuple[int, int, int, int]:
        value = self._value
        near = np.flatnonzero(self._rough >= self._rough.max() - self.NEAR)
        top = max(value[j] for j in near)
        layer = [int(j) for j in near if value[j] == top]
        first, size, duration, touched = layer[0], 0, 0, set()
        self._drive = self.one - top
        while layer:
            size += len(layer)
            duration += 1
            touched.update(layer)
            layer = self._layer(layer)
        return size, len(touched), duration, first

    def _layer(self, layer: list[int]) -> list[int]:
        full = [self._value[j] + self._drive for j in layer]
        if any(v % self.alpha.denominator for v in full):
            scale = self.alpha.denominator**self.GROW
            self._value = [v * scale for v in self._value]
            full = [v * scale for v in full]
            self.one, self._drive = self.one * scale, self._drive * scale
        value, threshold = self._value, self.one - self._drive
        changed = set(layer)
        for j in layer:
            value[j] = -self._drive
        for j, v in zip(layer, full, strict=True):
            gift = v // self.alpha.denominator * self.alpha.numerator
            for to in self._next_to[j]:
                value[to] += gift
                changed.add(to)
        for j in changed:
            self._rough[j] = value[j] / self.one
        return sorted(j for j in changed if value[j] >= threshold)

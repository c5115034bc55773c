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


def check(side: int, alpha: float) -> None:
    """Raise ConfigError unless the lattice and alpha make sense."""
    if not 1 <= side <= LARGEST_SIDE:
        raise ConfigError(f'lattice size {side} is not between 1 and {LARGEST_SIDE}')
    if not 0 <= alpha <= 0.25:
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
    a multiple of 2^-50; sites that would tie exactly may therefore part in the last bit.
    """

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

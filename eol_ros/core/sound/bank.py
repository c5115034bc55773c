# SPDX-License-Identifier: Apache-2.0
"""The sound of a corpus in memory, and the voices that read it."""

import math
from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core.compiled import njit
from eol_ros.core.sound.mixer_layout import FOREVER, GUARD, VOICE
from eol_ros.core.sound.pan import pan
from eol_ros.core.sound.ranks import rank_shares
from eol_ros.core.sound.ring import Ring
from eol_ros.core.sound.triggers import MAX_GAIN, MAX_RATE, MIN_RATE, TRIGGER

EDGE_S = 0.002  # the shortest edge: anything steeper is heard as a click


class Bank:
    """The sound of one corpus in memory: what its grains are read from.

    A grain that reaches beyond its sound is cut at its end.

    Parameters
    ----------
    sounds : sequence of ndarray
        Each (n,) float32 at the mixer's rate.
    file : array_like
        (g,) which of `sounds` a grain is of.
    start, duration : array_like
        (g,) in s.
    sample_rate : float
        Of the mixer, in Hz.
    places : array_like, optional
        (g, 2) where on the table each grain lies, m; NaN for none.
    descriptors : mapping, optional
        Values (g,) by name; NaN for none.
    guarded : bool
        GUARD zeros lie before and behind each of `sounds` in its memory, so none is copied.

    Examples
    --------
    >>> bank = Bank([np.zeros(48000, np.float32)], [0, 0], [0.0, 0.5], [0.5, 0.5], 48000)
    >>> len(bank)
    2
    """

    def __init__(
        self,
        sounds: Sequence[np.ndarray],
        file: ArrayLike,
        start: ArrayLike,
        duration: ArrayLike,
        sample_rate: float,
        places: ArrayLike | None = None,
        descriptors: Mapping[str, np.ndarray] | None = None,
        guarded: bool = False,
    ):
        self.sample_rate = sample_rate
        self._describe(descriptors)
        self.places = None if places is None else np.asarray(places, float).reshape(-1, 2)
        self._file = np.asarray(file, np.int64)
        self._sounds = [
            s if guarded else np.pad(np.asarray(s, np.float32), GUARD)[GUARD:-GUARD] for s in sounds
        ]
        self._first = np.round(np.asarray(start, float) * sample_rate).astype(np.int64)
        length = np.round(np.asarray(duration, float) * sample_rate).astype(np.int64)
        room = np.array([len(s) for s in sounds], np.int64)[self._file] - self._first
        self.length = np.clip(length, 0, np.maximum(room, 0))  # (g,) samples
        begins = np.array([s.ctypes.data for s in self._sounds], np.int64)
        self.address = begins[self._file] + 4 * self._first  # (g,) of sample 0

    def __len__(self) -> int:
        return len(self.length)

    def _describe(self, descriptors: Mapping[str, np.ndarray] | None) -> None:
        self._descriptors = descriptors or {}
        self._shares: dict[str, np.ndarray] = {}

    def shares(self, name: str) -> np.ndarray:
        """Return the rank (g,) in 0..1 of each grain by a descriptor; 0 where there is none."""
        if name not in self._shares:
            values = self._descriptors.get(name)
            found = np.zeros(len(self)) if values is None else rank_shares(values)
            self._shares[name] = found
        return self._shares[name]

    def placed(
        self, places: ArrayLike, descriptors: Mapping[str, np.ndarray] | None = None
    ) -> 'Bank':
        """Return a bank of the same sound in the same memory, its grains at `places` (g, 2), m."""
        bank = copy(self)
        bank.places = np.asarray(places, float).reshape(-1, 2)
        bank._describe(descriptors)
        return bank


@njit(cache=True)
def _playable(t, grains):
    if not (0 <= t.grain < grains and math.isfinite(t.time_s)):
        return False
    if not (0 <= t.gain <= MAX_GAIN and MIN_RATE <= t.rate <= MAX_RATE and -1 <= t.pan <= 1):
        return False
    return 0 <= t.attack_s < math.inf and 0 <= t.release_s < math.inf


@njit(cache=True)
def playable(triggers, grains):
    """Return which of `triggers` (n,) TRIGGER can be sounded, shape (n,) bool.

    A trigger is refused when a number is not finite, its grain is not in the corpus, its gain is
    negative or above `MAX_GAIN`, its rate outside `MIN_RATE`..`MAX_RATE`, its pan outside -1..1 or
    an edge of its envelope negative.
    """
    good = np.empty(len(triggers), np.bool_)
    for i in range(len(triggers)):
        good[i] = _playable(triggers[i], grains)
    return good


@njit(cache=True)
def _voices(triggers, length, address, sample_rate, channels, out, number):
    """Write the voices of those `triggers` (n,) that can play into `out` (n,) VOICE.

    `number` (n,) takes which trigger each is of. Return how many there are.
    """
    n = 0
    least = EDGE_S * sample_rate
    for i in range(len(triggers)):
        t = triggers[i]
        if not (_playable(t, len(length)) and length[t.grain] >= 4):
            continue
        rate = np.float64(t.rate)
        last = int((length[t.grain] - 1) / rate)
        if last < 3:
            continue
        v = out[n]
        v.time_s, v.rate, v.length, v.steal = t.time_s, rate, last + 1, FOREVER
        v.source = address[t.grain]
        attack = max(np.float64(t.attack_s) * sample_rate, least)
        release = max(np.float64(t.release_s) * sample_rate, least)
        squeeze = min(1.0, last / (attack + release))  # edges longer than the grain share it
        v.attack = max(1, int(attack * squeeze))
        v.release = max(1, int(release * squeeze))
        v.channel_a, v.channel_b, a, b = pan(np.float64(t.pan), channels)
        v.gain_a, v.gain_b = a * t.gain, b * t.gain
        number[n] = i
        n += 1
    return n


def warm_up() -> None:
    """Compile or load what makes voices, before a sound waits for it."""
    nothing, none = np.zeros(0, TRIGGER), np.zeros(0, np.int64)
    playable(nothing, 0)
    _voices(nothing, none, none, 48000.0, 2, np.zeros(0, VOICE), none)


def voice_rows(
    triggers: np.ndarray,
    bank: Bank,
    channels: int,
    first: np.ndarray | None = None,
    ring: Ring | None = None,
) -> np.ndarray:
    """Return the voices (m,) VOICE of those `triggers` (n,) TRIGGER that can play, in order.

    They read the memory of `bank` by its address: keep the bank for as long as they sound. `first`
    (n,): the row of the mixer's sums at which the `channels` loudspeakers of each begin; None: 0.
    These stand in a row, and `pan` says where; those of a `ring` about the table, and the place of
    the grain on it says where.
    """
    return numbered_rows(triggers, bank, channels, first, ring)[0]


def numbered_rows(
    triggers: np.ndarray,
    bank: Bank,
    channels: int,
    first: np.ndarray | None = None,
    ring: Ring | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what `voice_rows` does, and the number (m,) of the trigger that each is of."""
    t = np.ascontiguousarray(triggers)
    v, number = np.zeros(len(t), VOICE), np.empty(len(t), np.int64)
    count = _voices(t, bank.length, bank.address, float(bank.sample_rate), channels, v, number)
    v, number = v[:count], number[:count]
    if ring is not None:
        placed = t[number]
        v['channel_a'], v['channel_b'], a, b = ring.pan(*_places(placed, bank))
        v['gain_a'], v['gain_b'] = a * placed['gain'], b * placed['gain']
    if first is not None:
        v['channel_a'] += first[number]
        v['channel_b'] += first[number]
    return v, number


def _places(triggers: np.ndarray, bank: Bank) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (n,) of the grains, m; one without a place lies on the line across, by pan."""
    x, y = triggers['pan'].astype(float), np.zeros(len(triggers))
    if bank.places is not None:
        at = bank.places[triggers['grain']]
        known = np.isfinite(at).all(axis=1)
        x, y = np.where(known, at.T, (x, y))
    return x, y

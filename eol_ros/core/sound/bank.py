# SPDX-License-Identifier: Apache-2.0
"""The sound of a corpus in memory, the voices that read it, and how long it must stay there."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core.sound.mixer_layout import FOREVER, GUARD, VOICE
from eol_ros.core.sound.pan import pan
from eol_ros.core.sound.projection import rank_shares
from eol_ros.core.sound.ring import Ring
from eol_ros.core.sound.triggers import playable

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
    ):
        self.sample_rate = sample_rate
        self._describe(descriptors)
        self.places = None if places is None else np.asarray(places, float).reshape(-1, 2)
        sizes = [len(s) for s in sounds]
        self._samples = np.zeros(sum(sizes) + GUARD * (len(sizes) + 1), np.float32)
        begins = np.empty(len(sizes), np.int64)
        at = GUARD
        for i, sound in enumerate(sounds):
            self._samples[at : at + len(sound)] = sound
            begins[i] = at
            at += len(sound) + GUARD
        self._backwards: np.ndarray | None = None
        file = np.asarray(file, np.int64)
        first = np.round(np.asarray(start, float) * sample_rate).astype(np.int64)
        length = np.round(np.asarray(duration, float) * sample_rate).astype(np.int64)
        room = np.array(sizes, np.int64)[file] - first
        self.length = np.clip(length, 0, np.maximum(room, 0))  # (g,) samples
        self.address = self._samples.ctypes.data + 4 * (begins[file] + first)  # (g,) of sample 0

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

    @property
    def backwards(self) -> np.ndarray:
        """Addresses (g,) of the last sample of each grain, of a copy that goes back from there.

        The copy is made when somebody first asks for it.
        """
        if self._backwards is None:
            self._backwards = self._samples[::-1].copy()
        size, start = self._samples.nbytes, self._samples.ctypes.data
        return self._backwards.ctypes.data + size - (self.address - start) - 4 * self.length

    def placed(
        self, places: ArrayLike, descriptors: Mapping[str, np.ndarray] | None = None
    ) -> 'Bank':
        """Return a bank of the same sound in the same memory, its grains at `places` (g, 2), m."""
        bank = copy(self)
        bank.places = np.asarray(places, float).reshape(-1, 2)
        bank._describe(descriptors)
        return bank


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
    good = playable(triggers, len(bank))
    good[good] &= bank.length[triggers['grain'][good]] >= 4
    t = triggers[good]
    v = np.zeros(len(t), VOICE)
    v['time_s'] = t['time_s']
    v['rate'] = np.abs(t['rate'])
    v['source'] = bank.address[t['grain']]
    back = t['rate'] < 0
    if back.any():
        v['source'][back] = bank.backwards[t['grain'][back]]
    v['length'] = ((bank.length[t['grain']] - 1) / v['rate']).astype(np.int64) + 1
    last = v['length'] - 1
    least = EDGE_S * bank.sample_rate
    attack = np.maximum(t['attack_s'].astype(float) * bank.sample_rate, least)
    release = np.maximum(t['release_s'].astype(float) * bank.sample_rate, least)
    squeeze = np.minimum(1.0, last / (attack + release))  # edges longer than the grain share it
    v['attack'] = np.maximum(1, np.floor(attack * squeeze))
    v['release'] = np.maximum(1, np.floor(release * squeeze))
    v['steal'] = FOREVER
    if ring is None:
        v['channel_a'], v['channel_b'], a, b = pan(t['pan'], channels)
    else:
        v['channel_a'], v['channel_b'], a, b = ring.pan(*_places(t, bank))
    v['gain_a'], v['gain_b'] = a * t['gain'], b * t['gain']
    if first is not None:
        v['channel_a'] += first[good]
        v['channel_b'] += first[good]
    long = v['length'] >= 4
    return v[long], np.flatnonzero(good)[long]


def _places(triggers: np.ndarray, bank: Bank) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (n,) of the grains, m; one without a place lies on the line across, by pan."""
    x, y = triggers['pan'].astype(float), np.zeros(len(triggers))
    if bank.places is not None:
        at = bank.places[triggers['grain']]
        known = np.isfinite(at).all(axis=1)
        x, y = np.where(known, at.T, (x, y))
    return x, y


class Lent:
    """Banks that voices may still read by their address, though nobody else keeps them.

    A trigger waits in the ring, starts at most `ahead` frames after it is taken from there, and
    sounds no longer than the longest of its bank: only then may the memory go.
    """

    def __init__(self, ahead: int):
        self._ahead = ahead
        self._loans: dict[int, _Loan] = {}

    def __len__(self) -> int:
        return len(self._loans)

    def lend(self, bank: Bank, longest: int, head: int) -> None:
        """Voices of up to `longest` frames have been pushed; the ring's head is at `head` now."""
        loan = self._loans.setdefault(id(bank), _Loan(bank))
        loan.longest, loan.head, loan.until = max(longest, loan.longest), head, None

    def settle(self, tail: int, frame: int) -> None:
        """Let go of what can no longer be read; `tail` of the ring and `frame` are now."""
        for key, loan in list(self._loans.items()):
            if loan.until is None and tail >= loan.head:
                loan.until = frame + self._ahead + loan.longest
            elif loan.until is not None and frame > loan.until:
                del self._loans[key]


@dataclass
class _Loan:
    bank: Bank
    longest: int = 0  # frames
    head: int = 0  # of the ring, after the last push
    until: int | None = None  # frame; None while some may still be in the ring

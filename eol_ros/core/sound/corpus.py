# SPDX-License-Identifier: Apache-2.0
"""The corpus: every grain of the sound with its descriptors and its place in the space."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from eol_ros.settings import DESCRIPTORS, MAP_AXES

COLUMNS = ('start_s', 'duration_s', *DESCRIPTORS[:-1], 'x', 'y')  # all but the file
GRAIN = np.dtype([('file', 'i4'), *((name, 'f8') for name in COLUMNS)])
AXES = ('centroid_mean_hz', 'periodicity_mean')  # of the paper: x, y

READ_PER_S = 50.0  # seconds of sound that are read in a second
LEAST_READING_S, MOST_READING_S = 1.0, 30.0


def grain_dtype(further: Iterable[str] = ()) -> np.dtype:
    """Return the dtype of grains that have `further` descriptors, too."""
    return np.dtype([*GRAIN.descr, *((name, 'f8') for name in further)])


def widened(grains: np.ndarray, further: Iterable[str]) -> np.ndarray:
    """Return a copy of `grains` (n,) that has `further` descriptors, too; NaN where it had none.

    Examples
    --------
    >>> wider = widened(np.zeros(1, GRAIN), ['spectral_flux'])
    >>> wider['flatness'].tolist(), wider['spectral_flux'].tolist()
    ([0.0], [nan])
    """
    known, wanted = grains.dtype.names or (), {*(grains.dtype.names or ()), *further}
    found = np.zeros(len(grains), grain_dtype(n for n in MAP_AXES if n in wanted - {*COLUMNS}))
    for name in found.dtype.names or ():
        found[name] = grains[name] if name in known else np.nan
    return found


@dataclass(frozen=True)
class Source:
    """One sound file that grains were cut from."""

    path: str
    sample_rate: int  # Hz
    duration_s: float
    sha256: str = ''  # of the file's bytes

    @property
    def name(self) -> str:
        """What `weights` and `regions` call it: its file without the ending; `ice` is made."""
        name = self.path.rpartition('/')[2]
        stem = name.rpartition('.')[0] or name
        return 'ice' if re.fullmatch(r'ice-\d+-\d+', stem) else stem

    @property
    def folder(self) -> str:
        """The name of the folder it lies in, by which they call all sounds in there."""
        return self.path.rpartition('/')[0].rpartition('/')[2]


@dataclass(frozen=True)
class Corpus:
    """Sources and their grains.

    Parameters
    ----------
    sources : tuple of Source
        The recordings.
    grains : ndarray
        (n,) GRAIN, or with further descriptors (`grain_dtype`): `file` indexes `sources`;
        `pitch_hz` is NaN where there is none; `x`, `y` lie in 0..1, or are NaN for a grain that
        has no place because it is silent.
    x_name, y_name : str
        The descriptors of the axes.
    digest : str
        Of its content.
    notes : tuple of str
        What was left out in making it, for people.

    Examples
    --------
    >>> grains = np.zeros(2, GRAIN)
    >>> grains['x'] = grains['y'] = 0.5, np.nan
    >>> corpus = Corpus((Source('ice.wav', 48000, 1.0, ''),), grains)
    >>> len(corpus), corpus.placed.tolist()
    (2, [True, False])
    """

    sources: tuple[Source, ...]
    grains: np.ndarray
    x_name: str = AXES[0]
    y_name: str = AXES[1]
    digest: str = ''  # SHA-256 of audio and settings
    notes: tuple[str, ...] = ()  # what was wrong with the sources yet could be lived with

    def __len__(self) -> int:
        return len(self.grains)

    @property
    def sample_rate(self) -> int:
        """Rate of the first source, Hz."""
        return self.sources[0].sample_rate

    @property
    def reading_s(self) -> float:
        """How long the node `sound` is given to read the sounds in, s."""
        sound_s = sum(source.duration_s for source in self.sources)
        return min(max(sound_s / READ_PER_S, LEAST_READING_S), MOST_READING_S)

    @property
    def placed(self) -> np.ndarray:
        """Which grains have a place in the space, shape (n,) bool."""
        return np.isfinite(self.grains['x']) & np.isfinite(self.grains['y'])

    def same_as(self, other: 'Corpus') -> bool:
        """Whether both have the same sounds, cut and placed alike."""
        alike = self.sources == other.sources and self.digest == other.digest
        return alike and self.grains.tobytes() == other.grains.tobytes()

    @property
    def descriptors(self) -> tuple[str, ...]:
        """Names of what the grains are described by."""
        return tuple(name for name in MAP_AXES if name in (self.grains.dtype.names or ()))

    def values(self, name: str) -> np.ndarray:
        """Return one descriptor of every grain, shape (n,)."""
        if name not in self.descriptors:
            raise KeyError(name)
        return self.grains[name]


def table_bounds(side_m: float) -> tuple[float, float, float, float]:
    """Return the square that the space covers: x min, y min, x max, y max in metres."""
    return (-side_m / 2, -side_m / 2, side_m / 2, side_m / 2)

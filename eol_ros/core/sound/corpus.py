# SPDX-License-Identifier: Apache-2.0
"""The corpus: every grain of the sound with its descriptors and its place in the space."""

import re
from dataclasses import dataclass

import numpy as np

from eol_ros.settings import DESCRIPTORS

COLUMNS = ('start_s', 'duration_s', *DESCRIPTORS[:-1], 'x', 'y')  # all but the file
GRAIN = np.dtype([('file', 'i4'), *((name, 'f8') for name in COLUMNS)])
AXES = ('centroid_mean_hz', 'periodicity_mean')  # of the paper: x, y

READ_PER_S = 50.0  # seconds of sound that are read in a second
LEAST_READING_S, MOST_READING_S = 1.0, 30.0


@dataclass(frozen=True)
class Source:
    """One sound file that grains were cut from."""

    path: str
    sample_rate: int  # Hz
    duration_s: float
    sha256: str = ''  # of the file's bytes

    @property
    def name(self) -> str:
        """Name in `weights` and `regions`: the file without its ending; `ice` for the default."""
        name = self.path.rpartition('/')[2]
        stem = name.rpartition('.')[0] or name
        return 'ice' if re.fullmatch(r'ice-\d+-\d+', stem) else stem

    @property
    def folder(self) -> str:
        """Name of its folder, which stands there for all sounds in the folder."""
        return self.path.rpartition('/')[0].rpartition('/')[2]


@dataclass(frozen=True)
class Corpus:
    """Sources and their grains.

    Parameters
    ----------
    sources : tuple of Source
        The recordings.
    grains : ndarray
        (n,) GRAIN: `file` indexes `sources`; `pitch_hz` is NaN where there is none; `x`, `y` lie in
        0..1, or are NaN for a grain that has no place because it is silent.
    x_name, y_name : str
        The descriptors of the axes.
    digest : str
        Digest of the content.
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
    notes: tuple[str, ...] = ()  # faults of the sources that did not prevent the corpus

    def __len__(self) -> int:
        return len(self.grains)

    @property
    def sample_rate(self) -> int:
        """Rate of the first source, Hz."""
        return self.sources[0].sample_rate

    @property
    def reading_s(self) -> float:
        """Time that the node `sound` gets to read the sounds, s."""
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


def table_bounds(side_m: float) -> tuple[float, float, float, float]:
    """Return the square that the space covers: x min, y min, x max, y max in metres."""
    return (-side_m / 2, -side_m / 2, side_m / 2, side_m / 2)

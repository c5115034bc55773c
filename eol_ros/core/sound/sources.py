# SPDX-License-Identifier: Apache-2.0
"""Several sounds in one corpus: how much of each is played, and where its grains lie."""

from collections.abc import Sequence

import numpy as np

from eol_ros.errors import ConfigError

REGIONS = {
    'left': (0.0, 0.0, 0.5, 1.0),
    'right': (0.5, 0.0, 1.0, 1.0),
    'near': (0.0, 0.0, 1.0, 0.5),
    'far': (0.0, 0.5, 1.0, 1.0),
}
WHOLE = (0.0, 0.0, 1.0, 1.0)


def weights(lines: Sequence[str], names: Sequence[str]) -> np.ndarray:
    """Return the weight of each of the sounds `names`, (n,) in 0..1; 1 where nothing is said.

    Lines that name other sounds count when these are there.

    Examples
    --------
    >>> weights(['ice 0.25'], ['ice', 'harbour']).tolist()
    [0.25, 1.0]
    """
    said = _by_name(lines)
    return np.array([float(said.get(name, 1.0)) for name in names])


def regions(lines: Sequence[str], names: Sequence[str]) -> list[tuple[float, ...]]:
    """Return where in the unit square each of the sounds `names` lies: x min, y min, x max, y max.

    Raises ConfigError for a line that names no sound, or no region.

    Examples
    --------
    >>> regions(['ice left'], ['ice', 'harbour'])
    [(0.0, 0.0, 0.5, 1.0), (0.0, 0.0, 1.0, 1.0)]
    """
    found = {}
    for name, word in _by_name(lines).items():
        if name not in names:
            raise ConfigError(
                f'regions {f"{name} {word}"!r}: no sound of this name; there are {", ".join(names)}'
            )
        try:
            box = REGIONS.get(word) or tuple(float(part) for part in word.split(','))
            left, low, right, high = box
        except ValueError:
            raise ConfigError(f'regions: {word!r} is no region') from None
        if not (0 <= left < right <= 1 and 0 <= low < high <= 1):
            raise ConfigError(
                f'regions: {word!r} is no region; x min < x max and y min < y max in 0..1'
            )
        found[name] = box
    return [found.get(name, WHOLE) for name in names]


def _by_name(lines: Sequence[str]) -> dict[str, str]:
    """Return the word behind each name in lines "NAME WORD"; of one name the last line counts."""
    parted = [line.rpartition(' ') for line in lines]
    return {name.strip(): word for name, _, word in parted}

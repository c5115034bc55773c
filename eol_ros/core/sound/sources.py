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


def by_name(lines: Sequence[str], names: Sequence[str], setting: str) -> dict[str, str]:
    """Return the word behind each name in lines "NAME WORD"; names must be among `names`.

    Raises ConfigError that says which line is wrong.
    """
    found = {}
    for line in lines:
        name, _, word = line.rpartition(' ')
        if name.strip() not in names:
            raise ConfigError(
                f'{setting} {line!r}: no sound of this name; there are {", ".join(names)}'
            )
        found[name.strip()] = word
    return found


def weights(lines: Sequence[str], names: Sequence[str]) -> np.ndarray:
    """Return the weight of each of the sounds `names`, (n,) in 0..1; 1 where nothing is said.

    Lines that name other sounds count when these are there.

    Examples
    --------
    >>> weights(['ice 0.25'], ['ice', 'harbour']).tolist()
    [0.25, 1.0]
    """
    said = {line.rpartition(' ')[0].strip(): float(line.rpartition(' ')[2]) for line in lines}
    return np.array([said.get(name, 1.0) for name in names])


def regions(lines: Sequence[str], names: Sequence[str]) -> list[tuple[float, ...]]:
    """Return where in the unit square each of the sounds `names` lies: x min, y min, x max, y max.

    Raises ConfigError for a line that names no sound, or no region.

    Examples
    --------
    >>> regions(['ice left'], ['ice', 'harbour'])
    [(0.0, 0.0, 0.5, 1.0), (0.0, 0.0, 1.0, 1.0)]
    """
    found = {}
    for name, word in by_name(lines, names, 'regions').items():
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

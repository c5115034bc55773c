# SPDX-License-Identifier: Apache-2.0
"""Several sounds in one corpus: how much of each is played, and where its grains lie."""

from collections.abc import Sequence

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.said import said

REGIONS = {
    'left': (0.0, 0.0, 0.5, 1.0),
    'right': (0.5, 0.0, 1.0, 1.0),
    'near': (0.0, 0.0, 1.0, 0.5),
    'far': (0.0, 0.5, 1.0, 1.0),
}
WHOLE = (0.0, 0.0, 1.0, 1.0)


def weights(lines: Sequence[str], names: Sequence[str], folders: Sequence[str] = ()) -> np.ndarray:
    """Return the weight of each of the sounds `names`, (n,) in 0..1; 1 without a line.

    A line names a sound or a folder; `folders` has the folder of each sound. The line of a sound
    counts before that of its folder. Lines with other names wait for such sounds.

    Examples
    --------
    >>> weights(['ice 0.25', 'voices 0.5'], ['ice', 'take-1'], ['cache', 'voices']).tolist()
    [0.25, 0.5]
    """
    return np.array([float(word or 1.0) for word in _said(lines, names, folders)])


def absent(
    lines: Sequence[str],
    names: Sequence[str],
    folders: Sequence[str] = (),
    empty: Sequence[str] = (),
) -> list[str]:
    """Return a message for each line, as in `weights`, that names no sound and no folder.

    Examples
    --------
    >>> absent(['ice 0.25', 'harbor 0.5'], ['ice', 'harbour'])
    ["'harbor 0.5': no sound of this name; there are ice, harbour"]
    """
    return [
        _no_sound(name, word, names, folders, empty)
        for name, word in _by_name(lines).items()
        if name not in (*names, *folders, *empty)
    ]


def regions(
    lines: Sequence[str],
    names: Sequence[str],
    folders: Sequence[str] = (),
    empty: Sequence[str] = (),
) -> list[tuple[float, ...]]:
    """Return where in the unit square each of the sounds `names` lies: x min, y min, x max, y max.

    Lines as in `weights`. Raises ConfigError for one that names no sound and no folder, of those of
    the sounds or of `empty`, which may get some, or no region.

    Examples
    --------
    >>> regions(['ice left'], ['ice', 'harbour'])
    [(0.0, 0.0, 0.5, 1.0), (0.0, 0.0, 1.0, 1.0)]
    """
    found: dict[str, tuple[float, ...]] = {'': WHOLE}
    for name, word in _by_name(lines).items():
        if name not in (*names, *folders, *empty):
            raise ConfigError(f'regions {_no_sound(name, word, names, folders, empty)}')
        try:
            box = REGIONS.get(word) or tuple(float(part) for part in word.split(','))
            left, low, right, high = box
        except ValueError:
            raise ConfigError(f'regions: {word!r} is no region') from None
        if not (0 <= left < right <= 1 and 0 <= low < high <= 1):
            raise ConfigError(
                f'regions: {word!r} is no region; x min < x max and y min < y max in 0..1'
            )
        found[word] = box
    return [found[word] for word in _said(lines, names, folders)]


def _no_sound(
    name: str, word: str, names: Sequence[str], folders: Sequence[str], empty: Sequence[str]
) -> str:
    there = [n for n, f in zip(names, folders or names, strict=True) if f not in empty]
    return said('no_such_sound', line=f'{f"{name} {word}"!r}', names=', '.join([*there, *empty]))


def _said(lines: Sequence[str], names: Sequence[str], folders: Sequence[str]) -> list[str]:
    """Return the word behind the name of each sound or its folder, '' without a line."""
    said = _by_name(lines)
    both = zip(names, folders or [''] * len(names), strict=True)
    return [said.get(name) or said.get(folder, '') for name, folder in both]


def _by_name(lines: Sequence[str]) -> dict[str, str]:
    """Return the word behind each name in lines "NAME WORD"; of one name the last line counts."""
    parted = [line.rpartition(' ') for line in lines]
    return {name.strip(): word for name, _, word in parted}

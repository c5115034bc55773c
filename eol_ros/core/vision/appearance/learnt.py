# SPDX-License-Identifier: Apache-2.0
"""What was learned of the blocks' covers, as bytes: kept over a restart, and written into bags."""

import numpy as np

from eol_ros.core.vision.appearance import fit
from eol_ros.core.vision.appearance.faces import Faces
from eol_ros.core.vision.appearance.model import CELLS, YOUNG
from eol_ros.errors import ConfigError

_COVER = np.dtype(
    [
        ('light', '<f2', (CELLS, CELLS)), ('spread', '<f2', (CELLS, CELLS)),  # see Faces
        ('gain', '<f4'), ('usual', '<f4', (4, fit.OWN)), ('own', '<f4', fit.OWN),  # see FOUND
        ('side_usual', '<f4', 4),
        ('looks', '<f4'),  # fewer than YOUNG: nothing is known of this cover
    ]
)  # fmt: skip


def pack(faces: Faces, blocks: np.ndarray, found: np.ndarray) -> bytes:
    """Return what was learned of n covers; blocks (n,) BLOCK, found (n,) FOUND."""
    covers = np.zeros(len(blocks), _COVER)
    known = blocks['known']
    covers['light'], covers['spread'] = faces.light, faces.spread
    covers['gain'], covers['looks'] = blocks['gain'], np.where(known, faces.looks, 0)
    for name in ('usual', 'own', 'side_usual'):
        covers[name] = found[name]
    covers[~known] = np.zeros((), _COVER)
    return covers.tobytes()


def check(data: bytes, n: int) -> np.ndarray:
    """Return the covers (n,) in what `pack` gave; raise ConfigError where it gave no such thing."""
    if len(data) != n * _COVER.itemsize:
        raise ConfigError(
            f'learned covers have {len(data)} bytes; those of {n} blocks have {n * _COVER.itemsize}'
        )
    covers = np.frombuffer(data, _COVER)
    known = covers[covers['looks'] > 0]
    positive = all((known[name] > 0).all() for name in ('light', 'spread', 'gain', 'side_usual'))
    finite = all(np.isfinite(covers[name]).all() for name in _COVER.names or ())
    if not (finite and positive and (known['looks'] >= YOUNG).all() and (known['own'] > 0).all()):
        raise ConfigError('learned covers are damaged: not all numbers are finite and positive')
    return covers


def unpack(covers: np.ndarray, faces: Faces, blocks: np.ndarray, found: np.ndarray) -> None:
    """Take the covers (n,) of `check` for those that were learned."""
    for n in np.flatnonzero(covers['looks'] > 0):
        cover = covers[n]
        faces.recall(int(n), cover['light'], cover['spread'], float(cover['looks']))
        blocks['gain'][n], blocks['known'][n] = cover['gain'], True
        for name in ('usual', 'own', 'side_usual'):
            found[name][n] = cover[name]

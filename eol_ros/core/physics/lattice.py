# SPDX-License-Identifier: Apache-2.0
"""A scene as the flat arrays that the compiled kernels take.

All springs stand in one list: those between blocks first, then those to the rim, whose second end
is point n + a, the a-th anchor.
"""

from typing import TYPE_CHECKING

import numpy as np

from eol_ros.core.physics.kernel_args import Lattice

if TYPE_CHECKING:
    from eol_ros.core.physics.scene import Scene


def lattice_of(scene: 'Scene') -> Lattice:
    """Return the springs and blocks of a scene for the kernels."""
    n, between, rim = scene.n, scene.between, scene.to_frame
    first, k = np.concatenate([between.i, rim.i]), np.concatenate([between.k, rim.k])
    number = np.arange(len(k))
    inner, outer = number[: len(between.k)], number[len(between.k) :]
    ends, others = np.concatenate([between.i, between.j]), np.concatenate([between.j, between.i])
    both, spring = np.concatenate([between.k, between.k]), np.concatenate([inner, inner])
    order = np.lexsort((spring, ends))
    rim_order = np.argsort(rim.i, kind='stable')
    pulls = rim.k[:, None] * np.column_stack([np.ones(len(rim.k)), rim.anchor])
    drive = np.zeros((n, 3))
    np.add.at(drive, rim.i, pulls)
    arms = np.hypot(rim.anchor[:, 0], rim.anchor[:, 1])
    return Lattice(
        n,
        first,
        np.concatenate([between.j, n + np.arange(len(outer), dtype=np.int64)]),
        k,
        np.concatenate([between.natural, rim.natural]),
        np.concatenate([between.rest, rim.rest]),
        rim.anchor,
        np.searchsorted(ends[order], np.arange(n + 1)),
        others[order],
        both[order],
        spring[order],
        np.searchsorted(rim.i[rim_order], np.arange(n + 1)),
        outer[rim_order],
        _sums(ends, both, n) + _sums(rim.i, rim.k, n),
        drive,
        _sums(rim.i, rim.k * arms, n),
        float(arms.max(initial=0.0)),
        scene.mass,
        1.0 / scene.mass,
        scene.static_limit,
        scene.kinetic_force,
        bool(scene.geometric),
        bool(scene.dim1),
    )


def _sums(block: np.ndarray, amount: np.ndarray, n: int) -> np.ndarray:
    """Return the sum of the amounts of each block, as floats: numpy gives integers for none."""
    return np.bincount(block, amount, n).astype(float)


def spans(
    scene: 'Scene', u: np.ndarray, rim: np.ndarray, yaw: np.ndarray | None = None
) -> np.ndarray:
    """Return by how much the far end of each spring has left its near end, (s, 2) m.

    u: (n, 2) m, of the blocks; rim: (a, 2) m, of the anchors; yaw: (n,) rad, where blocks rotate.
    """
    lattice, ends = scene.lattice, np.concatenate([u, rim])
    d = ends[lattice.second] - ends[lattice.first]
    if yaw is not None and scene.rotation is not None:
        inner = lattice.second < scene.n
        d -= rotated(scene.rotation.arm, yaw[lattice.first])
        d[inner] += rotated(scene.rotation.arm_j[inner], yaw[lattice.second[inner]])
    return d


def rotated(arm: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Return by how much points `arm` (s, 2) of blocks are displaced by their yaw (s,)."""
    c, s = -2 * np.sin(yaw / 2) ** 2, np.sin(yaw)
    x, y = arm[:, 0], arm[:, 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=1)

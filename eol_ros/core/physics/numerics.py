# SPDX-License-Identifier: Apache-2.0
"""What the solvers measure alike: lengths, forces at their limit, and the energy of a run."""

from collections.abc import Callable

import numpy as np

from eol_ros.core import algebra
from eol_ros.core.physics.lattice import spans
from eol_ros.core.physics.result import Energy, Run
from eol_ros.core.physics.scene import Scene

ON_LIMIT = 1e-13  # a force this close to the limit, relative, is on it: simultaneous breaks
MISSED = 1e-4  # of the largest energy, or J: more than any tolerance leaves open
GAUSS_X, GAUSS_W = algebra.gauss_legendre(10)  # for the powers of a step, on 0..1
GAUSS_X, GAUSS_W = 0.5 * (GAUSS_X + 1), 0.5 * GAUSS_W


def length_scale(scene: Scene) -> float:
    """Return the displacement (m) at which a spring first balances friction, or the offsets.

    That of blocks too heavy to move would make steps too coarse: it is at most the size of the
    scene, the longest spring at rest or the farthest anchor. Without either it is not limited.
    """
    return max(_displacement(scene, np.min), 1e-12)


def _displacement(scene: Scene, of: Callable[[np.ndarray], float]) -> float:
    """Return `length_scale` without a floor; `of` chooses among the blocks with friction."""
    lattice = scene.lattice
    stiff = lattice.k.max(initial=0.0)
    holding = lattice.static[lattice.static > 0]
    hold = float(of(holding)) / stiff if stiff > 0 and len(holding) else 0.0
    size = max(lattice.far, float(np.hypot(*lattice.rest.T).max(initial=0.0)))
    return max(min(hold, size or hold), float(np.abs(scene.u0).max()))


def usual_size(scene: Scene) -> tuple[Scene, float]:
    """Return (scene, size): the scene with lengths and g `size` times as large.

    Constants of the solvers in m and m/s suit slips of about 1 m/s. The speed of slips is estimated
    as sqrt(acceleration x length) of the median block with friction. `size` is a power of 2^20, so
    that scaling does not round; it is 1 for ordinary scenes.
    """
    static = scene.static_limit / scene.mass
    holding = static[static > 0]
    square = float(np.median(holding)) * _displacement(scene, np.median) if len(holding) else 0.0
    if not 0.0 < square < np.inf:  # no friction, or beyond double precision
        return scene, 1.0
    size = 2.0 ** (-20 * round(np.clip(0.5 * np.log2(square), -60, 60) / 20))
    return (scene, 1.0) if size == 1.0 else (scene.scaled(size), size)


def elastic_energy(scene: Scene, u: np.ndarray, t: float, yaw: np.ndarray | None = None) -> float:
    """Return the energy (J) held in the springs; u (n, 2) m, yaw (n,) rad, at t."""
    lattice = scene.lattice
    d = spans(scene, u, scene.drive.displacement(t, lattice.anchors), yaw)
    if not scene.geometric:
        if scene.dim1:
            d = d[:, :1]
        return float(0.5 * np.sum(lattice.k[:, None] * d**2))
    d = d + lattice.rest
    return float(0.5 * np.sum(lattice.k * (np.hypot(d[:, 0], d[:, 1]) - lattice.natural) ** 2))


def kinetic_energy(scene: Scene, v: np.ndarray, spin: np.ndarray | None = None) -> float:
    """Return the energy (J) of motion for velocities v (n, 2) m/s, spin (n,) rad/s."""
    energy = 0.5 * np.sum(scene.mass[:, None] * v**2)
    if spin is not None and scene.rotation is not None:
        energy += np.sum(scene.mass * scene.rotation.side_m**2 / 12 * spin**2)
    return float(energy)


def keep_ledger(
    run: Run,
    scene: Scene,
    u: np.ndarray,
    v: np.ndarray,
    work_and_heat: np.ndarray,
    yaw: np.ndarray | None = None,
    spin: np.ndarray | None = None,
) -> None:
    """Give `run` its energy ledger, J, from the start to its end, and a note if that is far off.

    u, v: (n, 2), m and m/s, at the end. work_and_heat: (2,), J, of the drive and of friction. yaw,
    spin: (n,) rad and rad/s, where blocks rotate.
    """
    rotation = scene.rotation
    yaw0, spin0 = (rotation.yaw0, rotation.spin0) if rotation else (None, None)
    run.energy = Energy(
        float(work_and_heat[0]),
        kinetic_energy(scene, v, spin) - kinetic_energy(scene, scene.v0, spin0),
        elastic_energy(scene, u, run.t_reached, yaw) - elastic_energy(scene, scene.u0, 0.0, yaw0),
        float(work_and_heat[1]),
    )
    missed = run.energy.residual_J
    if abs(missed) > MISSED * max(1.0, *map(abs, vars(run.energy).values())):
        run.notes.append(
            f'the energy ledger misses {missed:.2g} J: a finer tolerance (--tol) may tell whether'
            ' that counts'
        )

# SPDX-License-Identifier: Apache-2.0
"""What the solvers measure alike: lengths, forces at their limit, and the energy of a run."""

import numpy as np

from eol_ros.core import algebra
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.result import Energy
from eol_ros.core.physics.scene import Scene

ON_LIMIT = 1e-13  # a force this close to the limit, relative, is on it: simultaneous breaks
GAUSS_X, GAUSS_W = algebra.gauss_legendre(10)  # for the powers of a step, on 0..1
GAUSS_X, GAUSS_W = 0.5 * (GAUSS_X + 1), 0.5 * GAUSS_W


def length_scale(scene: Scene, model: Model) -> float:
    """Return the displacement (m) at which a spring first balances friction, or the offsets."""
    stiff = model.k.max(initial=0.0)
    holding = model.static[model.static > 0]
    hold = float(holding.min()) / stiff if stiff > 0 and len(holding) else 0.0
    return max(hold, float(np.abs(scene.u0).max()), 1e-12)


def energy_ledger(
    scene: Scene, model: Model, u: np.ndarray, v: np.ndarray, t: float, work_and_heat: np.ndarray
) -> Energy:
    """Return the energy ledger, J, between the start and the state at t.

    u, v: (n, 2), m and m/s. work_and_heat: (2,), J, of the drive and of friction.
    """
    return Energy(
        float(work_and_heat[0]),
        model.kinetic_energy(v) - model.kinetic_energy(scene.v0),
        model.elastic_energy(u, t) - model.elastic_energy(scene.u0, 0.0),
        float(work_and_heat[1]),
    )

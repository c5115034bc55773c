# SPDX-License-Identifier: Apache-2.0
"""No friction, linear springs: the sum of the normal modes, at any time at once.

With y = M^(1/2) u the equation y'' = -S y + f t has the symmetric matrix S = M^(-1/2) K M^(-1/2);
in its eigenvectors every mode is one oscillator. The rim's pull grows with t, for which each mode
has the particular solution f t / w^2; a mode of zero frequency flies freely.
"""

import numpy as np

from eol_ros.core.physics.drive import NONE, VELOCITY
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.result import Energy, Run
from eol_ros.core.physics.scene import Scene

FREE = 1e-12  # of the highest w^2: below it a mode has no spring at all
MOST_BLOCKS = 2000  # the matrix is dense


def applies(scene: Scene) -> bool:
    """Return True if no friction acts, and springs and drive allow modes."""
    return bool(
        not np.any(scene.kinetic_force)
        and not np.any(scene.static_limit)
        and not scene.geometric
        and scene.drive.kind in (NONE, VELOCITY)
        and scene.n <= MOST_BLOCKS
    )


def solve(scene: Scene, model: Model, times: np.ndarray, ledger: bool) -> Run:
    """Return the run of a scene without friction, sampled at `times` (p,), s."""
    n, root = model.n, np.sqrt(model.mass)
    stiffness = np.zeros((n, n))
    rim = model.second >= n
    i, j, k = model.first[~rim], model.second[~rim], model.k[~rim]
    np.add.at(stiffness, (i, i), k)
    np.add.at(stiffness, (j, j), k)
    np.subtract.at(stiffness, (i, j), k)
    np.subtract.at(stiffness, (j, i), k)
    pull = np.zeros(n)
    np.add.at(pull, model.first[rim], model.k[rim])
    stiffness[np.diag_indices(n)] += pull
    square, shape = np.linalg.eigh(stiffness / np.outer(root, root))
    square = np.where(square > FREE * square[-1], square, 0.0)
    w = np.sqrt(square)
    u_out, v_out = np.zeros((len(times), n, 2)), np.zeros((len(times), n, 2))
    modal = np.zeros((2, 2, n))  # axis, amplitude of cos and sin
    for axis in range(1 if model.rail else 2):
        rate = (shape.T @ (pull / root)) * (
            model.drive.par[axis] if model.drive.kind == VELOCITY else 0.0
        )
        at, moving = square > 0, square == 0
        drift = np.divide(rate, square, out=np.zeros(n), where=at)  # particular solution: drift * t
        y0 = shape.T @ (root * scene.u0[:, axis])
        d0 = shape.T @ (root * scene.v0[:, axis])
        sine = np.divide(d0 - drift, w, out=np.zeros(n), where=at)
        angle = np.outer(times, w)
        c, s = np.cos(angle), np.sin(angle)
        y = y0 * c + sine * s + np.outer(times, drift)
        d = w * (sine * c - y0 * s) + drift
        y[:, moving] = y0[moving] + np.outer(times, d0[moving])
        d[:, moving] = d0[moving]
        u_out[:, :, axis] = (y @ shape.T) / root
        v_out[:, :, axis] = (d @ shape.T) / root
        modal[axis] = np.where(at, y0, 0.0), sine
    if model.rail:
        u_out[:, :, 1] = scene.u0[:, 1]
    run = Run(
        'modal',
        'ok',
        times,
        u_out,
        v_out,
        np.empty(0),
        np.empty(0, np.int64),
        np.empty(0, np.int8),
        1,
        float(scene.duration_s),
    )
    if ledger:
        end = float(times[-1])
        gain_k = model.kinetic_energy(v_out[-1]) - model.kinetic_energy(scene.v0)
        gain_e = model.elastic_energy(u_out[-1], end) - model.elastic_energy(scene.u0, 0.0)
        run.energy = Energy(_work(model, shape, w, pull, modal, end), gain_k, gain_e, 0.0)
    return run


def _work(
    model: Model,
    shape: np.ndarray,
    w: np.ndarray,
    pull: np.ndarray,
    modal: np.ndarray,
    t: float,
) -> float:
    """Return the drive work (J): V times the integral of sum k (V t - u), in closed form."""
    if model.drive.kind != VELOCITY:
        return 0.0
    root = np.sqrt(model.mass)
    weights = shape.T @ (pull / root)
    total = 0.0
    for axis in range(1 if model.rail else 2):
        speed = model.drive.par[axis]
        if speed == 0.0:
            continue
        at = w > 0
        drift = np.divide(weights * speed, w**2, out=np.zeros_like(w), where=at)
        inverse = np.divide(1.0, w, out=np.zeros_like(w), where=at)
        swing = modal[axis, 0] * np.sin(w * t) * inverse
        swing += modal[axis, 1] * 2 * np.sin(w * t / 2) ** 2 * inverse
        integral = 0.5 * drift * t * t + swing
        total += speed * (0.5 * pull.sum() * speed * t * t - weights @ integral)
    return float(total)

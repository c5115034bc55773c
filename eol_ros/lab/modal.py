# SPDX-License-Identifier: Apache-2.0
"""No friction, linear springs: the sum of the normal modes, at any time at once.

With y = M^(1/2) u the equation y'' = -S y + f t has the symmetric matrix S = M^(-1/2) K M^(-1/2);
in its eigenvectors every mode is one oscillator. The rim's pull grows with t, for which each mode
has the particular solution f t / w^2. Blocks that no spring ties to the rim fly freely: one mode of
zero frequency for each such set, whatever the size of w.
"""

import numpy as np

from eol_ros.core.physics.drive import NONE, VELOCITY
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.result import Energy, Run
from eol_ros.core.physics.scene import Scene

SOFT = 1e-4  # of the highest w^2: below it eigenvalues of S have lost four digits or more
PHASE = 1e-6  # rad: a larger error at the end is told
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
    w, shape = frequencies(model, stiffness / np.outer(root, root))
    square = w**2
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
    spread = min(w[-1] / w[w > 0].min(initial=np.inf), SOFT**-0.5)
    phase = float(np.finfo(float).eps * w[-1] * spread * times[-1])
    if phase > PHASE:
        run.notes.append(f'the phases of the modes are known to {phase:.0e} rad at the end')
    if ledger:
        end = float(times[-1])
        gain_k = model.kinetic_energy(v_out[-1]) - model.kinetic_energy(scene.v0)
        gain_e = model.elastic_energy(u_out[-1], end) - model.elastic_energy(scene.u0, 0.0)
        run.energy = Energy(_work(model, shape, w, pull, modal, end), gain_k, gain_e, 0.0)
    return run


def frequencies(model: Model, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frequencies (n,) rad/s, rising, and the modes (n, n) of S = `square`.

    Where soft and stiff springs meet, they are the singular values of A, S = A^T A with a row for
    each spring: their error is 2e-16 of the highest w, that of eigenvalues so much of its square.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n, root = model.n, np.sqrt(model.mass)
    tied, rim = model.k > 0, model.second >= model.n
    i, j = model.first[tied & ~rim], model.second[tied & ~rim]
    edges = coo_array((np.ones(len(i)), (i, j)), (n, n))
    count, label = connected_components(edges, directed=False)
    free = count - len(np.unique(label[model.first[tied & rim]]))
    found, shape = np.linalg.eigh(square)
    if free < n and found[free] < SOFT * found[-1]:
        rows = np.zeros((max(len(model.k), n), n))
        s = np.arange(len(model.k))
        rows[s, model.first] = -np.sqrt(model.k) / root[model.first]
        rows[s[~rim], model.second[~rim]] = np.sqrt(model.k[~rim]) / root[model.second[~rim]]
        _, w, back = np.linalg.svd(rows, full_matrices=False)
        w, shape = w[::-1], back[::-1].T
    else:
        w = np.sqrt(np.maximum(found, 0.0))
    w[:free] = 0.0
    return w, shape


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

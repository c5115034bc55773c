# SPDX-License-Identifier: Apache-2.0
"""What solvers are measured against and share no code with: formulas, mpmath, SciPy."""

from collections.abc import Callable

import numpy as np

from eol_ros.core.physics.scene import Scene
from support import physics_rotating, scipy_solver, stepping

CAPTURE_MPS, ARM_S = 1e-8, 1e-6  # a hundredth and a tenth of what a peer takes


def still(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u where nothing ever moves."""
    return np.broadcast_to(scene.u0, (len(times), scene.n, 2))


def as_one(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u of blocks that are all alike and move as one block on its spring to the rim.

    Between slips it rests; a slip is m x'' = k (V t - x) - F_k from rest at k (V t - x) = F_s.
    """
    lattice = scene.lattice
    k, m = lattice.drive[0, 0], lattice.mass[0]
    speed, w = float(np.hypot(*scene.drive.par[:2])), np.sqrt(k / m)
    static, kinetic = lattice.static[0], lattice.friction[0]
    slip = 2 / w * (np.pi - np.arctan2((static - kinetic) * w, k * speed))
    drop = 2 * (static - kinetic) / k
    period = drop / speed + slip
    after = times - static / (k * speed)
    cycle = np.floor(after / period)
    s = np.clip(after - cycle * period, 0.0, slip)
    lag = (static - kinetic) / k
    moved = lag * (1 - np.cos(w * s)) + speed * s - speed / w * np.sin(w * s)
    x = np.where(after < 0, 0.0, cycle * (drop + speed * slip) + moved)
    way = scene.drive.par[:2] / speed
    return np.broadcast_to((x[:, None] * way)[:, None], (len(times), scene.n, 2))


def carried(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u of one block that always slides: it swings about where the rim drags it."""
    lattice = scene.lattice
    k, speed = lattice.drive[0, 0], scene.drive.par[0]
    w = np.sqrt(k / lattice.mass[0])
    lag = lattice.friction[0] / k
    a, b = scene.u0[0, 0] + lag, (scene.v0[0, 0] - speed) / w
    # full periods are taken off in long double: the phase of 1e8 s has 10 digits before the point
    angle = np.fmod(times.astype(np.longdouble) * np.longdouble(w), 2 * np.longdouble(np.pi))
    angle = angle.astype(float)
    u = np.zeros((len(times), 1, 2))
    u[:, 0, 0] = speed * times - lag + a * np.cos(angle) + b * np.sin(angle)
    return u


def modes_of_mpmath(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u at the last of `times`, without friction and drive, by mpmath in 40 digits."""
    from mpmath import mp

    lattice, n = scene.lattice, scene.n
    digits, mp.dps = mp.dps, 40
    try:
        stiff = mp.zeros(n, n)
        for i, j, k in zip(lattice.first, lattice.second, lattice.k, strict=True):
            stiff[int(i), int(i)] += mp.mpf(float(k))
            if j < n:
                stiff[int(j), int(j)] += mp.mpf(float(k))
                stiff[int(i), int(j)] -= mp.mpf(float(k))
                stiff[int(j), int(i)] -= mp.mpf(float(k))
        mass = [mp.sqrt(mp.mpf(float(m))) for m in lattice.mass]
        for i in range(n):
            for j in range(n):
                stiff[i, j] /= mass[i] * mass[j]
        squares, shapes = mp.eigsy(stiff)
        out = np.zeros((1, n, 2))
        t = mp.mpf(float(times[-1]))
        swing = [mp.cos(mp.sqrt(square) * t) for square in squares]
        for axis in range(1 if lattice.rail else 2):
            start = [mass[i] * mp.mpf(float(scene.u0[i, axis])) for i in range(n)]
            parts = [sum(shapes[i, q] * start[i] for i in range(n)) for q in range(n)]
            for i in range(n):
                total = sum(shapes[i, q] * parts[q] * swing[q] for q in range(n))
                out[0, i, axis] = float(total / mass[i])
        return out
    finally:
        mp.dps = digits


def events_of_scipy(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u by SciPy's DOP853 between its own located events, tolerance 3e-13."""
    return scipy_solver.scipy_run(scene, times, 3e-13, CAPTURE_MPS, ARM_S)[0]


def coarse_events_of_scipy(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return the same with stops as the peers have them, where finer ones do not come to an end."""
    return scipy_solver.scipy_run(scene, times, 3e-13)[0]


def sliding_of_scipy(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u by SciPy's DOP853 where all blocks slide from the start on, tolerance 3e-13."""
    return scipy_solver.scipy_sliding(scene, times, 3e-13)


def rotating_of_scipy(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u by SciPy's DOP853 of blocks that rotate, between its own events."""
    return physics_rotating.solve(scene, times, 3e-13)[0]


def steps_of_moreau(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return u in steps, which share nothing with the others but the scene.

    Its error is in proportion to the step, so that of two lengths it is told and taken away.
    """
    whole, half = (stepping.solve(scene, times, h).u for h in (4e-6, 2e-6))
    return 2 * half - whole


Oracle = Callable[[Scene, np.ndarray], np.ndarray]
ORACLES: dict[str, Oracle] = {
    'formula, at rest': still,
    'formula, one block': as_one,
    'formula, sliding block': carried,
    'mpmath modes, 40 digits': modes_of_mpmath,
    'SciPy DOP853, events': events_of_scipy,
    'SciPy DOP853, events, stops below 1e-6 m/s': coarse_events_of_scipy,
    'SciPy DOP853, all slide': sliding_of_scipy,
    'SciPy DOP853, rotation': rotating_of_scipy,
    'own stepping, extrapolated': steps_of_moreau,
}

# SPDX-License-Identifier: Apache-2.0
"""Random scenes, and by how many times their error is the tolerance asked for.

The reference is SciPy's DOP853 between events of its own. It is certain where a second run of it,
with stops at another speed, has the same events and differs by no more than the tolerance, and
where no block stops in the plane under a pull above friction: slower yet, it may reverse.
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.physics import builders
from eol_ros.core.physics.result import sample_times
from eol_ros.core.physics.scene import Scene, from_mapping
from eol_ros.lab.choose import along_x, simulate
from support import physics_rotating
from support.scipy_solver import Event, scipy_run
from support.witness import spring_forces

SURE = (3e-13, 1e-8, 1e-6)  # relative tolerance; a stop's speed, m/s; how long after a start, s
CHECK = (1e-11, 3e-8, 3e-6)
SAMPLES = 40


class Judged(NamedTuple):
    """A scene's path, the tolerance asked for, the error in units of it, NaN if not certain."""

    path: str
    tolerance: float
    error: float
    events: int
    motion_m: float


def draw(seed: int, rotates: bool = False) -> tuple[builders.Plain, float]:
    """Return a scene, the same for both values of `rotates` but for that, and a tolerance."""
    random = np.random.default_rng([seed, 49])
    rows, columns = random.integers(1, 4, 2)
    n, k = int(rows * columns), 10 ** random.uniform(1, 2.7)
    static = random.uniform(0.3, 1.0, n)
    along_x = bool(random.random() < 0.4)
    drive = {'kind': 'constant_velocity', 'par': [0.05, 0.0 if along_x else 0.03]}
    if not along_x and random.random() < 0.5:
        drive = {'kind': 'circle_and_rotation', 'par': [0.06, 1.5, 0.12, 1.1]}
    build = builders.table if random.random() < 0.6 else builders.plate
    spring = {'k': k} if build is builders.table else {'k_plate': k, 'k_between': 2 * k}
    size_m = 0.4 * 0.3 * builders.GRAVITY * 0.1 / k
    scene = build(
        drive, random.uniform(0.5, 2.0), int(rows), int(columns), **spring,
        geometric=not along_x and bool(random.random() < 0.5),
        mass=random.uniform(0.1, 0.5, n), mu_s=static, mu_k=static * random.uniform(0.3, 0.95, n),
        u0=builders.offsets(n, size_m, seed, along_x),
        v0=random.uniform(-0.3, 0.3, (n, 2)) * [1, not along_x],
    )  # fmt: skip
    spin = np.random.default_rng([seed, 7])
    if rotates:
        scene['rotation'] = {
            'side': float(10 ** spin.uniform(-2, -0.5)),
            'yaw0': spin.uniform(-0.3, 0.3, n).tolist(),
            'spin0': spin.uniform(-3, 3, n).tolist(),
        }
    return scene, 10 ** random.uniform(-11, -4)


def _places(scene: Scene, u: np.ndarray, yaw: np.ndarray | None) -> np.ndarray:
    """Return u (k, n, 2), or (k, n, 3) with lever * yaw, m, where blocks rotate."""
    if yaw is None:
        return u
    return np.dstack([u, physics_rotating.Springs(scene).lever * yaw[:, :, None]])


def _reference(scene: Scene, times: np.ndarray, *exact: float) -> tuple[np.ndarray, list[Event]]:
    if scene.rotation is None:
        return scipy_run(scene, times, *exact)
    u, yaw, events = physics_rotating.solve(scene, times, *exact)
    return _places(scene, u, yaw), events


def _pull(scene: Scene, places: np.ndarray, t: float) -> np.ndarray:
    if scene.rotation is None:
        return spring_forces(scene, places, t)
    return physics_rotating.Springs(scene).pull(t, places)


def judge(seed: int, rotates: bool = False) -> Judged:
    """Return how a scene's error compares with its tolerance, of the largest displacement."""
    given, tolerance = draw(seed, rotates)
    scene = from_mapping(given)
    times = sample_times(scene.duration_s, scene.duration_s / SAMPLES)
    run = simulate(scene, scene.duration_s / SAMPLES, tolerance=tolerance, ledger=False)
    found = _places(scene, run.u, run.yaw)
    truth, events = _reference(scene, times, *SURE)
    stops = [(when, block) for when, block, start in events if not start]
    every = np.union1d(times, [when for when, _ in stops])
    check, again = _reference(scene, every, *CHECK)
    place = np.searchsorted(every, [when for when, _ in stops])
    pulls = [
        np.linalg.norm(_pull(scene, check[k], when)[block]) / scene.kinetic_force[block]
        for k, (when, block) in zip(place, stops, strict=True)
    ]
    doubtful = (rotates or not along_x(scene)) and max(pulls, default=0.0) > 1
    check = check[np.isin(every, times)]
    motion = float(np.abs(truth - truth[0]).max())
    alike = [event[1:] for event in events] == [event[1:] for event in again]
    certain = alike and not doubtful and np.abs(check - truth).max() <= tolerance * motion
    error = float(np.abs(found - truth).max()) / (tolerance * motion) if certain else np.nan
    path = f'{run.path} with rotation' if rotates else run.path
    return Judged(path, tolerance, error, len(events), motion)

# SPDX-License-Identifier: Apache-2.0
"""Scenes solved by SciPy between its own events: a witness, and a peer of the benchmarks."""

import numpy as np
from numba import njit

from eol_ros.core.physics.drive import VELOCITY
from eol_ros.core.physics.scene import Scene
from eol_ros.lab.stepping.moreau_jean import place_anchors, rim_pose, spring_forces

CAPTURE_MPS = 1e-6
STUCK_M = 5e-4  # by which the rim moves in a step, where nothing slides
ARM_S = 1e-5  # after a break a stop is looked for only once the block has gathered speed


def scipy_events(scene: Scene, times: np.ndarray, rtol: float) -> np.ndarray:
    """DOP853 of SciPy between its own located events; u at `times`."""
    return scipy_run(scene, times, rtol)[0]


def scipy_run(
    scene: Scene,
    times: np.ndarray,
    rtol: float,
    capture_mps: float = CAPTURE_MPS,
    arm_s: float = ARM_S,
) -> tuple[np.ndarray, list[tuple[float, int, int]]]:
    """Return what `scipy_events` does, and its events: when, which block, 1 a break or 0 a stop.

    Forces are compiled; steps, roots and what happens at them are SciPy's and NumPy's. A block
    slower than `capture_mps` stops; the error of that goes as its square.
    """
    from scipy.integrate import solve_ivp

    lattice, n = scene.lattice, scene.n
    out, events = np.zeros((len(times), n, 2)), []
    y, t = np.concatenate([scene.u0.ravel(), scene.v0.ravel()]), 0.0
    on, since = np.any(scene.v0 != 0, axis=1), np.full(n, -1.0)
    lead = np.zeros((n, 2))
    done = 0
    _, given = _initial_values(scene, smooth=False)
    forces, rail, drive = given[1:9], given[12], given[13:]

    def force(s, y):
        return _pull(s, y, *forces, rail, *drive)

    def slope(s, y):  # s counts from the last event: t may be 1e9 s, of which digits are lost
        return _slope(t + s, y, *given, on, lead)

    def breaks(s, y):
        return (lattice.static - np.linalg.norm(force(t + s, y), axis=1))[~on].min(initial=1.0)

    def stops(s, y):
        speed = np.linalg.norm(y[2 * n :].reshape(-1, 2), axis=1)
        return np.where(t + s > since + arm_s, speed - capture_mps, 1.0)[on].min(initial=1.0)

    def set_off(pull, broken=False):
        size = np.linalg.norm(pull, axis=1)
        near = 1e-11
        if broken:  # stiff springs pass their limit by more than that in the last digit of t
            near = max(near, ((lattice.static - size) / lattice.static)[~on].min(initial=1.0))
        for i in np.flatnonzero(~on & (size >= lattice.static * (1 - near)) & (since < t)):
            on[i], since[i], lead[i] = True, t, pull[i] / size[i]
            events.append((t, int(i), 1))

    set_off(force(0.0, y))
    breaks.terminal = stops.terminal = True
    breaks.direction = stops.direction = -1
    w = np.sqrt(8 * lattice.k.max() / lattice.mass.min())
    fastest = max(np.hypot(*scene.drive.par[:2]) if scene.drive.kind == VELOCITY else 0.1, 1e-30)
    while t < times[-1]:
        run = solve_ivp(
            slope,
            (0.0, times[-1] - t),
            y,
            'DOP853',
            rtol=rtol,
            atol=rtol * 1e-3,
            dense_output=True,
            events=(breaks, stops),
            max_step=0.1 * np.pi / w if on.any() else STUCK_M / fastest,
        )
        end = t + run.t[-1]
        while done < len(times) and times[done] <= end:
            out[done] = (run.sol(times[done] - t) if end > t else y)[: 2 * n].reshape(-1, 2)
            done += 1
        y, t = run.y[:, -1].copy(), end
        v = y[2 * n :].reshape(-1, 2)
        pull = force(t, y)
        size = np.linalg.norm(pull, axis=1)
        speed = np.linalg.norm(v, axis=1)
        for i in np.flatnonzero(on):
            if speed[i] <= capture_mps * (1 + 1e-6) and t > since[i] + arm_s:
                v[i] = 0.0
                if size[i] <= lattice.static[i]:
                    on[i] = False
                    events.append((t, int(i), 0))
                else:
                    since[i], lead[i] = t, pull[i] / size[i]
        set_off(pull, len(run.t_events[0]) > 0)
    out[done:] = y[: 2 * n].reshape(-1, 2)
    return out, events


@njit(cache=True)
def _pull(
    t, y, n, first, second, k, natural, rest, anchors, geometric, rail, kind, par, knots, cubics
):
    """Return the force of the springs (n, 2) on the blocks."""
    ends, force = np.zeros((n + len(anchors), 2)), np.zeros((n + len(anchors), 2))
    for i in range(n):
        ends[i, 0], ends[i, 1] = y[2 * i], y[2 * i + 1]
    x, z, phi = rim_pose(kind, par, knots, cubics, t)
    place_anchors(ends, n, anchors, x, z, phi)
    spring_forces(ends, force, first, second, k, natural, rest, geometric)
    if rail:
        force[:, 1] = 0.0
    return force[:n]


@njit(cache=True)
def _slope(
    t, y, smooth, n, first, second, k, natural, rest, anchors, geometric, mass, static, kinetic,
    rail, kind, par, knots, cubics, on, lead,
):  # fmt: skip
    """The right-hand side: sharp friction mu_k on blocks that are `on`; the others stand still.

    Or, where `smooth`, with friction tanh(|v| / 1e-4) that falls from mu_s to mu_k. A block without
    speed sets off along `lead`, or along the pull where `lead` is zero.
    """
    force = _pull(
        t, y, n, first, second, k, natural, rest, anchors, geometric, rail, kind, par, knots, cubics
    )
    out = np.zeros(4 * n)
    for i in range(n):
        if not on[i]:
            continue
        vx, vy = y[2 * n + 2 * i], y[2 * n + 2 * i + 1]
        out[2 * i], out[2 * i + 1] = vx, vy
        speed = np.sqrt(vx * vx + vy * vy)
        if not smooth and speed < 1e-12:
            vx, vy = lead[i, 0], lead[i, 1]
            if vx == 0.0 and vy == 0.0:
                vx, vy = force[i, 0], force[i, 1]
            speed = np.sqrt(vx * vx + vy * vy)
        hold = kinetic[i] / speed if speed > 0.0 else 0.0
        if smooth:
            hold = kinetic[i] + (static[i] - kinetic[i]) * np.exp(-((speed / 1e-3) ** 2))
            hold *= np.tanh(speed / 1e-4) / max(speed, 1e-12)
        out[2 * n + 2 * i] = (force[i, 0] - hold * vx) / mass[i]
        out[2 * n + 2 * i + 1] = 0.0 if rail else (force[i, 1] - hold * vy) / mass[i]
    return out


def _initial_values(scene: Scene, smooth: bool) -> tuple[np.ndarray, tuple]:
    """Return y(0) and the arguments of `_slope` after t and y, but for its last two; compiles."""
    m = scene.lattice
    start = np.concatenate([scene.u0.ravel(), scene.v0.ravel()])
    given = (
        smooth, m.n, m.first, m.second, m.k, m.natural, m.rest, m.anchors, m.geometric, m.mass,
        m.static, m.friction, m.rail, *scene.drive,
    )  # fmt: skip
    _slope(0.0, start, *given, *_all_slide(scene))
    return start, given


def _all_slide(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    return np.ones(scene.n, bool), np.zeros((scene.n, 2))


def scipy_smooth(scene: Scene, times: np.ndarray, method: str) -> np.ndarray:
    """LSODA or Radau on friction made smooth; the right-hand side is compiled."""
    from scipy.integrate import solve_ivp

    start, given = _initial_values(scene, smooth=True)
    args = (*given, *_all_slide(scene))
    run = solve_ivp(
        _slope, (0, times[-1]), start, method, t_eval=times, rtol=1e-6, atol=1e-9, args=args
    )
    return run.y[: 2 * scene.n].T.reshape(-1, scene.n, 2)


def scipy_sliding(scene: Scene, times: np.ndarray, rtol: float) -> np.ndarray:
    """DOP853 of SciPy without events, where every block slides throughout; u at `times`."""
    from scipy.integrate import solve_ivp

    start, given = _initial_values(scene, smooth=False)
    run = solve_ivp(
        _slope,
        (0, times[-1]),
        start,
        'DOP853',
        t_eval=times,
        rtol=rtol,
        atol=rtol * 1e-2,
        args=(*given, *_all_slide(scene)),
    )
    return run.y[: 2 * scene.n].T.reshape(-1, scene.n, 2)

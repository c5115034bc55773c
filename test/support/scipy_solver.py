# SPDX-License-Identifier: Apache-2.0
"""Scenes solved by SciPy between its own events: a witness, and a peer of the benchmarks."""

from collections.abc import Callable

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.drive import VELOCITY
from eol_ros.core.physics.scene import Scene
from support.stepping import place_anchors, rim_pose, spring_forces

CAPTURE_MPS = 1e-6
STUCK_M = 5e-4  # by which the rim moves in a step, where nothing slides
ARM_S = 1e-5  # after a break a stop is looked for only once the block has gathered speed
Event = tuple[float, int, int]  # when, which block, 1 a break or 0 a stop


def scipy_events(scene: Scene, times: np.ndarray, rtol: float) -> np.ndarray:
    """DOP853 of SciPy between its own located events; u at `times`."""
    return scipy_run(scene, times, rtol)[0]


def scipy_run(
    scene: Scene,
    times: np.ndarray,
    rtol: float,
    capture_mps: float = CAPTURE_MPS,
    arm_s: float = ARM_S,
) -> tuple[np.ndarray, list[Event]]:
    """Return what `scipy_events` does, and its events.

    Forces are compiled. A block slower than `capture_mps` stops; the error of that goes as its
    square.
    """
    start, given = _initial_values(scene, smooth=False)
    forces, rail, drive = given[1:9], given[12], given[13:]
    w = np.sqrt(8 * scene.lattice.k.max() / scene.mass.min())
    fastest = max(np.hypot(*scene.drive.par[:2]) if scene.drive.kind == VELOCITY else 0.1, 1e-30)
    return between_events(
        scene, start, times, rtol, capture_mps, arm_s,
        slope=lambda t, y, on, lead: _slope(t, y, *given, on, lead),
        pull=lambda t, y: _pull(t, y, *forces, rail, *drive),
        way=lambda i, pull: pull / np.linalg.norm(pull),
        longest=lambda on: 0.1 * np.pi / w if on.any() else STUCK_M / fastest,
    )  # fmt: skip


def between_events(
    scene: Scene,
    y: np.ndarray,
    times: np.ndarray,
    rtol: float,
    capture_mps: float,
    arm_s: float,
    *,
    slope: Callable[[float, np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    pull: Callable[[float, np.ndarray], np.ndarray],
    way: Callable[[int, np.ndarray], np.ndarray],
    longest: Callable[[np.ndarray], float],
) -> tuple[np.ndarray, list[Event]]:
    """Return places (k, n, d) at `times` and events; steps and roots are SciPy's.

    y: places and velocities (2 n d,) at first. slope(t, y, on, lead): their rates, where blocks
    `on` (n,) slide, and leave rest along lead (n, d). pull(t, y): what springs do to each block,
    (n, d). way(i, pull): along which block i leaves rest. longest(on): a step, s.
    """
    from scipy.integrate import solve_ivp

    n, half = scene.n, len(y) // 2
    static, kinetic = scene.static_limit, scene.kinetic_force
    places, v = y[:half].reshape(n, -1), y[half:].reshape(n, -1)
    out, events = np.zeros((len(times), *places.shape)), []
    on, since = np.any(v != 0, axis=1) | (static == 0), np.full(n, -1.0)
    lead, t, done = np.zeros(places.shape), 0.0, 0

    def rates(s, y):  # s counts from the last event: t may be 1e9 s, of which digits are lost
        return slope(t + s, y, on, lead)

    def breaks(s, y):
        return (static - np.linalg.norm(pull(t + s, y), axis=1))[~on].min(initial=1.0)

    def stops(s, y):
        speed = np.linalg.norm(y[half:].reshape(n, -1), axis=1)
        late = on & (kinetic > 0) & (t + s > since + arm_s)
        return (speed - capture_mps)[late].min(initial=1.0)

    def set_off(force, broken=False):
        size = np.linalg.norm(force, axis=1)
        near = 1e-11
        if broken:  # stiff springs pass their limit by more than that in the last digit of t
            near = max(near, (1 - size[~on] / static[~on]).min(initial=1.0))
        for i in np.flatnonzero(~on & (size >= static * (1 - near)) & (since < t)):
            on[i], since[i], lead[i] = True, t, way(i, force[i])
            events.append((t, int(i), 1))

    set_off(pull(0.0, y))
    breaks.terminal = stops.terminal = True
    breaks.direction = stops.direction = -1
    while t < times[-1]:
        run = solve_ivp(
            rates, (0.0, times[-1] - t), y, 'DOP853', rtol=rtol, atol=rtol * 1e-3,
            dense_output=True, events=(breaks, stops), max_step=longest(on),
        )  # fmt: skip
        end = t + run.t[-1]
        while done < len(times) and times[done] <= end:
            out[done] = (run.sol(times[done] - t) if end > t else y)[:half].reshape(n, -1)
            done += 1
        y, t = run.y[:, -1].copy(), end
        v, force = y[half:].reshape(n, -1), pull(t, y)
        size, speed = np.linalg.norm(force, axis=1), np.linalg.norm(v, axis=1)
        slow = on & (speed <= capture_mps * (1 + 1e-6)) & (t > since + arm_s) & (kinetic > 0)
        for i in np.flatnonzero(slow):
            v[i] = 0.0
            if size[i] <= static[i]:
                on[i] = False
                events.append((t, int(i), 0))
            else:
                since[i], lead[i] = t, way(i, force[i])
        set_off(force, len(run.t_events[0]) > 0)
    out[done:] = y[:half].reshape(n, -1)
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

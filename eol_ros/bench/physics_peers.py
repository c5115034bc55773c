# SPDX-License-Identifier: Apache-2.0
"""Other people's solvers on our scenes: SciPy, MuJoCo, pymunk. Each returns samples of u.

Every peer gets the scene as it is, and what it lacks is said where it is emulated.
"""

import numpy as np

from eol_ros.core.physics.model import Model
from eol_ros.core.physics.scene import Scene

CAPTURE_MPS = 1e-6
ARM_S = 1e-5  # after a break a stop is looked for only once the block has gathered speed


def scipy_events(scene: Scene, times: np.ndarray, rtol: float) -> np.ndarray:
    """DOP853 of SciPy between its own located events, sliding blocks only; u at `times`."""
    from scipy.integrate import solve_ivp

    model, n = Model.of(scene), scene.n
    out = np.zeros((len(times), n, 2))
    u, v, t = scene.u0.copy(), scene.v0.copy(), 0.0
    on, since = np.any(v != 0, axis=1), np.full(n, -1.0)
    lead = np.zeros((n, 2))
    rail = np.array([1.0, 0.0]) if model.rail else np.ones(2)
    done = 0

    def force(here, s):
        return model.force(here, s) * rail

    while t < times[-1]:
        slots = np.flatnonzero(on)

        def place(y, slots=slots, u=u, v=v):
            here, rate = u.copy(), v.copy()
            here[slots], rate[slots] = np.split(y.reshape(-1, 2), 2)
            return here, rate

        def slope(s, y, slots=slots):
            here, rate = place(y, slots)
            rate = rate[slots]
            size = np.linalg.norm(rate, axis=1)[:, None]
            unit = np.where(size > 1e-12, rate / np.maximum(size, 1e-300), lead[slots])
            pull = force(here, s)[slots] - model.kinetic[slots, None] * unit
            return np.concatenate([rate.ravel(), (pull / model.mass[slots, None]).ravel()])

        def breaks(s, y, slots=slots, on=on):
            room = model.static - np.linalg.norm(force(place(y, slots)[0], s), axis=1)
            return room[~on].min(initial=1.0)

        def stops(s, y, slots=slots):
            speed = np.linalg.norm(place(y, slots)[1][slots], axis=1)
            return np.where(s > since[slots] + ARM_S, speed - CAPTURE_MPS, 1.0).min(initial=1.0)

        breaks.terminal = stops.terminal = True
        breaks.direction = stops.direction = -1
        start = np.concatenate([u[slots].ravel(), v[slots].ravel()])
        w = np.sqrt(8 * model.k.max() / model.mass.min())
        run = solve_ivp(
            slope, (t, times[-1]), start, 'DOP853', rtol=rtol, atol=rtol * 1e-3, dense_output=True,
            events=(breaks, stops), max_step=0.1 * np.pi / w if len(slots) else 0.02,
        )
        end = run.t[-1]
        while done < len(times) and times[done] <= end:
            out[done] = place(run.sol(times[done]))[0] if end > t else u
            done += 1
        u, v = place(run.y[:, -1])
        t = end
        pull = force(u, t)
        size = np.linalg.norm(pull, axis=1)
        speed = np.linalg.norm(v, axis=1)
        for i in np.flatnonzero(on):
            if speed[i] <= CAPTURE_MPS * (1 + 1e-6) and t > since[i] + ARM_S:
                v[i] = 0.0
                if size[i] <= model.static[i]:
                    on[i] = False
                else:
                    since[i], lead[i] = t, pull[i] / size[i]
        for i in np.flatnonzero(~on & (size >= model.static * (1 - 1e-11)) & (since < t)):
            on[i], since[i], lead[i] = True, t, pull[i] / size[i]
    out[done:] = u
    return out


def scipy_smooth(scene: Scene, times: np.ndarray, method: str) -> np.ndarray:
    """LSODA or Radau on friction made smooth: tanh(|v|/1e-4), falling from mu_s to mu_k."""
    from scipy.integrate import solve_ivp

    model, n = Model.of(scene), scene.n
    rail = np.array([1.0, 0.0]) if model.rail else np.ones(2)

    def slope(t, y):
        u, v = np.split(y.reshape(-1, 2), 2)
        speed = np.linalg.norm(v, axis=1)
        fall = model.kinetic + (model.static - model.kinetic) * np.exp(-((speed / 1e-3) ** 2))
        hold = fall * np.tanh(speed / 1e-4) / np.maximum(speed, 1e-12)
        pull = (model.force(u, t) - hold[:, None] * v) * rail
        return np.concatenate([v.ravel(), (pull / model.mass[:, None]).ravel()])

    start = np.concatenate([scene.u0.ravel(), scene.v0.ravel()])
    run = solve_ivp(slope, (0, times[-1]), start, method, t_eval=times, rtol=1e-6, atol=1e-9)
    return run.y[: 2 * n].T.reshape(len(times), n, 2)


def mujoco(scene: Scene, times: np.ndarray, step_s: float, stiff: bool) -> np.ndarray:
    """MuJoCo: slide joints with frictionloss, tendons as springs; along x, mu_s = mu_k."""
    import mujoco as mj

    model, lattice = Model.of(scene), Model.of(scene).lattice
    soft = f'solreffriction="{2 * step_s} 1" solimpfriction="0.9999 0.99999 1e-6"' if stiff else ''
    bodies, tendons = [], []
    for i in range(scene.n):
        bodies.append(
            f'<body pos="0 {i} 0"><joint name="j{i}" type="slide" axis="1 0 0" '
            f'stiffness="{lattice.drive[i, 0]}" frictionloss="{model.kinetic[i]}" {soft}/>'
            f'<geom type="box" size=".04 .04 .04" mass="{model.mass[i]}"/></body>'
        )
    for i, j, k in zip(model.first, model.second, model.k):
        if j < scene.n:
            tendons.append(
                f'<fixed stiffness="{k}" springlength="0"><joint joint="j{i}" coef="1"/>'
                f'<joint joint="j{j}" coef="-1"/></fixed>'
            )
    xml = (
        f'<mujoco><option timestep="{step_s}" gravity="0 0 0" integrator="Euler">'
        '<flag contact="disable"/></option><worldbody>'
        f'{"".join(bodies)}</worldbody><tendon>{"".join(tendons)}</tendon></mujoco>'
    )
    world = mj.MjModel.from_xml_string(xml)
    data = mj.MjData(world)
    data.qpos[:] = scene.u0[:, 0]
    pull, out = lattice.drive[:, 0] * model.par[0], np.zeros((len(times), scene.n, 2))
    for sample in range(len(times)):
        while data.time < times[sample] - 0.5 * step_s:
            data.qfrc_applied[:] = pull * (data.time + 0.5 * step_s)
            mj.mj_step(world, data)
        out[sample, :, 0] = data.qpos
    return out


def pymunk(scene: Scene, times: np.ndarray, step_s: float) -> np.ndarray:
    """pymunk: a pivot of bounded force per block is its friction; mu_s = mu_k only."""
    import pymunk as pm

    model = Model.of(scene)
    space = pm.Space()
    space.iterations = 50
    bodies = []
    for i in range(scene.n):
        body = pm.Body(model.mass[i], float('inf'))
        body.position = tuple(scene.u0[i])
        pivot = pm.PivotJoint(space.static_body, body, (0, 0), (0, 0))
        pivot.max_bias, pivot.max_force = 0.0, model.kinetic[i]
        space.add(body, pivot)
        bodies.append(body)
    out, t = np.zeros((len(times), scene.n, 2)), 0.0
    for sample in range(len(times)):
        while t < times[sample] - 0.5 * step_s:
            here = np.array([tuple(body.position) for body in bodies])
            pull = model.force(here, t + 0.5 * step_s)
            for body, f in zip(bodies, pull):
                body.force = tuple(f)
            space.step(step_s)
            t += step_s
        out[sample] = [tuple(body.position) for body in bodies]
    return out

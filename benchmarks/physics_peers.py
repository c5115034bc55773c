# SPDX-License-Identifier: Apache-2.0
"""Other people's solvers on our scenes: MuJoCo, pymunk. Each gives samples of u.

Every peer gets the scene as it is, and what it lacks is said where it is emulated.
"""

import numpy as np
from support.witness import spring_forces

from eol_ros.core.physics.scene import Scene


def mujoco(scene: Scene, times: np.ndarray, step_s: float, stiff: bool) -> np.ndarray:
    """MuJoCo: slide joints with frictionloss, tendons as springs; along x, mu_s = mu_k."""
    import mujoco as mj

    lattice = scene.lattice
    soft = f'solreffriction="{2 * step_s} 1" solimpfriction="0.9999 0.99999 1e-6"' if stiff else ''
    bodies, tendons = [], []
    for i in range(scene.n):
        bodies.append(
            f'<body pos="0 {i} 0"><joint name="j{i}" type="slide" axis="1 0 0" '
            f'stiffness="{lattice.drive[i, 0]}" frictionloss="{scene.kinetic_force[i]}" {soft}/>'
            f'<geom type="box" size=".04 .04 .04" mass="{scene.mass[i]}"/></body>'
        )
    for i, j, k in zip(lattice.first, lattice.second, lattice.k, strict=True):
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
    pull, out = lattice.drive[:, 0] * scene.drive.par[0], np.zeros((len(times), scene.n, 2))
    for sample in range(len(times)):
        while data.time < times[sample] - 0.5 * step_s:
            data.qfrc_applied[:] = pull * (data.time + 0.5 * step_s)
            mj.mj_step(world, data)
        out[sample, :, 0] = data.qpos
    return out


def mujoco_plane(scene: Scene, times: np.ndarray, step_s: float) -> np.ndarray:
    """MuJoCo in the plane: balls on slide joints touch a floor, an elliptic cone of friction.

    Springs and rim are forces of ours. One coefficient of friction only.
    """
    import mujoco as mj

    mu = scene.kinetic_force / (scene.mass * scene.g)
    bodies = [
        f'<body pos="{2 * i} 0 .04"><joint type="slide" axis="1 0 0"/>'
        '<joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>'
        f'<geom type="sphere" size=".04" mass="{scene.mass[i]}" friction="{mu[i]} 0 0" '
        'condim="3" solref="0.004 1" solimp="0.99 0.999 1e-5"/></body>'
        for i in range(scene.n)
    ]
    world = mj.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step_s}" gravity="0 0 -{scene.g}" cone="elliptic" '
        'impratio="100" integrator="implicitfast"/><worldbody>'
        f'<geom type="plane" size="200 200 1" friction="0 0 0"/>{"".join(bodies)}</worldbody>'
        '</mujoco>'
    )
    data, out = mj.MjData(world), np.zeros((len(times), scene.n, 2))
    place, push = data.qpos.reshape(-1, 3), data.qfrc_applied.reshape(-1, 3)
    place[:, :2] = scene.u0
    for sample in range(len(times)):
        while data.time < times[sample] - 0.5 * step_s:
            push[:, :2] = spring_forces(scene, place[:, :2], data.time + 0.5 * step_s)
            mj.mj_step(world, data)
        out[sample] = place[:, :2]
    return out


def pymunk(scene: Scene, times: np.ndarray, step_s: float) -> np.ndarray:
    """pymunk: a pivot of bounded force per block is its friction; mu_s = mu_k only."""
    import pymunk as pm

    space = pm.Space()
    space.iterations = 50
    bodies = []
    for i in range(scene.n):
        body = pm.Body(scene.mass[i], float('inf'))
        body.position = tuple(scene.u0[i])
        pivot = pm.PivotJoint(space.static_body, body, (0, 0), (0, 0))
        pivot.max_bias, pivot.max_force = 0.0, scene.kinetic_force[i]
        space.add(body, pivot)
        bodies.append(body)
    out, t = np.zeros((len(times), scene.n, 2)), 0.0
    for sample in range(len(times)):
        while t < times[sample] - 0.5 * step_s:
            here = np.array([tuple(body.position) for body in bodies])
            pull = spring_forces(scene, here, t + 0.5 * step_s)
            for body, f in zip(bodies, pull, strict=True):
                body.force = tuple(f)
            space.step(step_s)
            t += step_s
        out[sample] = [tuple(body.position) for body in bodies]
    return out

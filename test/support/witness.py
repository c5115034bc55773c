# SPDX-License-Identifier: Apache-2.0
"""A second witness of a run, from its samples alone: Newton's law, and static friction.

The energy ledger closes for whatever motion the forces of the solver make. It does not see a break
that was missed, a block that stopped where its spring pulls too hard, or a wrong order of events:
blocks at rest do no work. Here each block that slides from one sample to the next must change its
momentum by the impulse of springs and friction, and each that rests must be held by mu_s m g.
Samples are joined by cubics, impulses follow by Simpson's rule: nothing of a solver is used.
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.lattice import spans
from eol_ros.core.physics.result import Run
from eol_ros.core.physics.scene import Scene

SLOW_MPS = 0.02  # below, the direction of friction may change too quickly for the samples


class Gaps(NamedTuple):
    """What a run leaves open; `steps` sliding steps of blocks were looked at, `rests` at rest."""

    momentum: float  # largest, of the impulse of the friction on that block
    overload: float  # largest force on a block at rest beyond static friction, of that
    steps: int
    rests: int


def gaps(scene: Scene, run: Run) -> Gaps:
    """Return how far a run without rotation departs from its equations.

    run: sampled some 50 times per period of the fastest vibration; with steps h the rule errs as
    h^4.
    """
    lattice, t = scene.lattice, run.t
    rests = resting(run, scene)
    momentum = overload = 0.0
    steps = held = 0
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]
        u, v, w = run.u[k : k + 2], run.v[k : k + 2], np.hypot(*run.v[k : k + 2].T).T
        whole = ~np.isin(
            np.arange(scene.n),
            run.event_block[(run.event_t >= t[k]) & (run.event_t <= t[k + 1])],
        )
        if not whole.all():
            continue  # forces are not smooth across an event
        on = ~rests[k] & (w.min(axis=0) > SLOW_MPS) & (scene.kinetic_force > 0)
        middle = u.mean(axis=0) + 0.125 * h * (v[0] - v[1])
        rate = 1.5 * (u[1] - u[0]) / h - 0.25 * (v[0] + v[1])
        total = np.zeros((scene.n, 2))
        for share, place, speed, now in (
            (1 / 6, u[0], v[0], t[k]),
            (4 / 6, middle, rate, t[k] + 0.5 * h),
            (1 / 6, u[1], v[1], t[k + 1]),
        ):
            size = np.maximum(np.hypot(*speed.T), 1e-300)[:, None]
            pull = spring_forces(scene, place, now)
            total += share * h * (pull - lattice.friction[:, None] * speed / size)
        if scene.dim1:
            total[:, 1] = 0.0
        miss = np.hypot(*(lattice.mass[:, None] * (v[1] - v[0]) - total).T)
        if on.any():
            momentum = max(momentum, float((miss[on] / (h * lattice.friction[on])).max()))
        pull = spring_forces(scene, u[0], t[k])
        size = np.abs(pull[:, 0]) if scene.dim1 else np.hypot(*pull.T)
        still = rests[k] & (lattice.static > 0)
        if still.any():
            overload = max(overload, float((size[still] / lattice.static[still]).max() - 1))
        steps, held = steps + int(on.sum()), held + int(still.sum())
    return Gaps(momentum, overload, steps, held)


def spring_forces(
    scene: Scene, u: np.ndarray, t: float, yaw: np.ndarray | None = None
) -> np.ndarray:
    """Return the spring force (n, 2) N on each block displaced by u (n, 2) and `yaw` (n,)."""
    lattice = scene.lattice
    along = spans(scene, u, scene.drive.displacement(t, lattice.anchors), yaw)
    if lattice.geometric:
        along = along + lattice.rest
        length = np.hypot(*along.T)
        stretched = np.divide(lattice.natural, length, out=np.zeros_like(length), where=length > 0)
        along = (1 - stretched)[:, None] * along
    pull, total = lattice.k[:, None] * along, np.zeros((lattice.n + len(lattice.anchors), 2))
    np.add.at(total, lattice.first, pull)
    np.subtract.at(total, lattice.second, pull)
    return total[: lattice.n]


def resting(run: Run, scene: Scene) -> np.ndarray:
    """Return which blocks are at rest at each sample, (k, n) bool, from the events alone."""
    rests = np.broadcast_to(~scene.v0.any(axis=1), (len(run.t), scene.n)).copy()
    rests &= scene.static_limit > 0
    for when, block, start in zip(run.event_t, run.event_block, run.event_start, strict=True):
        rests[run.t > when, block] = not start
    return rests

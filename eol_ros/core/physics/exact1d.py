# SPDX-License-Identifier: Apache-2.0
"""The exact path: motion along x with linear springs, event by event, to rounding."""

import numpy as np

from eol_ros.core.physics import exact1d_kernel
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.run import Energy, Limits, Run
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import WORDS

ORDER = 14
TRUNCATION = 2e-17  # of the displacements' scale: below their rounding


class Lattice1D:
    """The scene's springs along x as rows: each block's neighbours, and what the rim pulls with."""

    def __init__(self, model: Model) -> None:
        n, between = model.n, model.second < model.n
        a, b, k = model.first[between], model.second[between], model.k[between]
        ends, others, both = np.concatenate([a, b]), np.concatenate([b, a]), np.concatenate([k, k])
        order = np.argsort(ends, kind='stable')
        self.near = others[order]
        self.k_near = both[order]
        starts = np.searchsorted(ends[order], np.arange(n + 1))
        self.first, self.last = starts[:-1].astype(np.int64), starts[1:].astype(np.int64)
        rim = ~between
        self.rim_block, self.rim_k, self.rim_at = model.first[rim], model.k[rim], model.anchors
        self.k_sum = np.bincount(ends, both, n) + np.bincount(self.rim_block, self.rim_k, n)
        pulls = self.rim_k[:, None] * np.column_stack([np.ones(len(self.rim_k)), model.anchors])
        self.drive = np.zeros((n, 3))
        np.add.at(self.drive, self.rim_block, pulls)


def solve(
    scene: Scene, model: Model, times: np.ndarray, limits: Limits, ledger: bool, order: int = ORDER
) -> Run:
    """Return the run of a scene whose blocks move along x only; y is held at its start."""
    lattice = Lattice1D(model)
    u, v = scene.u0[:, 0].copy(), scene.v0[:, 0].copy()
    scale = length_scale(scene, model)
    u_out, v_out = np.zeros((len(times), model.n)), np.zeros((len(times), model.n))
    log_t, log_block = np.empty(limits.events), np.empty(limits.events, np.int64)
    log_start = np.empty(limits.events, np.int8)
    books, state = np.zeros(2), np.zeros(model.n, np.int8)
    status, t, events, steps = exact1d_kernel.run(
        u,
        v,
        scene.duration_s,
        order,
        TRUNCATION * scale,
        lattice.near,
        lattice.first,
        lattice.last,
        lattice.k_near,
        lattice.k_sum,
        lattice.drive,
        1.0 / model.mass,
        model.static,
        model.kinetic,
        model.weakening,
        model.kind,
        model.par,
        model.knots,
        model.cubics,
        times,
        u_out,
        v_out,
        log_t,
        log_block,
        log_start,
        limits.steps,
        lattice.rim_block,
        lattice.rim_k,
        lattice.rim_at,
        books,
        ledger,
        state,
    )
    held = np.broadcast_to(scene.u0[:, 1], u_out.shape)
    end = np.column_stack([u, scene.u0[:, 1]])
    run = Run(
        'exact',
        WORDS[status],
        times,
        np.stack([u_out, held], axis=2),
        np.stack([v_out, np.zeros_like(v_out)], axis=2),
        log_t[:events].copy(),
        log_block[:events].copy(),
        log_start[:events].copy(),
        steps,
        t,
    )
    if ledger:
        run.energy = books_of(scene, model, end, np.column_stack([v, 0 * v]), t, books)
    return run


def length_scale(scene: Scene, model: Model) -> float:
    """Return the displacement (m) at which a spring balances friction, or the scene's own offsets."""
    stiff = model.k.max(initial=0.0)
    hold = float(np.median(model.static)) / stiff if stiff > 0 else 0.0
    return max(hold, float(np.abs(scene.u0).max()), 1e-12)


def books_of(
    scene: Scene, model: Model, u: np.ndarray, v: np.ndarray, t: float, books: np.ndarray
) -> Energy:
    """Return the energy ledger between the start and the state u, v at t."""
    return Energy(
        float(books[0]),
        model.kinetic_energy(v) - model.kinetic_energy(scene.v0),
        model.elastic_energy(u, t) - model.elastic_energy(scene.u0, 0.0),
        float(books[1]),
    )

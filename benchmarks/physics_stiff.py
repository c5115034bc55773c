# SPDX-License-Identifier: Apache-2.0
"""Stiff scenes in the plane and along a line: time reached, error, and a peer beside ours."""

import time
from collections.abc import Callable

import numpy as np

from benchmarks import physics_peers as peers
from eol_ros.core.physics import builders, choose, presets
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.result import Limits, Run, sample_times
from eol_ros.core.physics.scene import Scene, from_mapping

LIMITS = Limits(events=1_000_000, steps=2_000_000)
SCIPY = 'scipy DOP853 3e-13'  # no events: every block slides from the start on
TIGHTER = 'ours, tolerance / 100'
EQUAL = {'mu_s': 0.65, 'mu_k': 0.65}


def masses(n: int = 25) -> list[float]:
    """Return masses from 1e-6 to 1e3 kg, evenly in their logarithm, in a drawn order."""
    return np.random.default_rng(7).permutation(np.logspace(-6, 3, n)).tolist()


def scenes() -> dict[str, tuple]:
    """Return scenes, what their error is taken against, and a tolerance if not the default."""
    aside = builders.offsets(25, 0.005, 3)
    pull, circle = presets.PULL, presets.CIRCLE
    return {
        'k = 1e6, geometric, 1 s': (
            builders.table(pull, 1.0, k=1e6, geometric=True, u0=aside),
            SCIPY,
        ),
        'k = 1e6, linear, 1 s': (builders.table(pull, 1.0, k=1e6, u0=aside), SCIPY),
        'K_C / K_L = 1e6, circled, 5 s': (builders.plate(circle, 5.0, k_between=2e7), TIGHTER),
        'masses 1e-6 to 1e3, geometric, 2 s': (
            builders.table(pull, 2.0, geometric=True, mass=masses(), u0=aside),
            TIGHTER,
        ),
        'masses 1e-6 to 1e3, linear, 2 s': (
            builders.table(pull, 2.0, mass=masses(), u0=aside),
            TIGHTER,
        ),
        'mu_s = mu_k, S4L, 5 s, 1e-6': (presets.scene('S4L') | EQUAL | {'T': 5.0}, TIGHTER, 1e-6),
        'mu_s = mu_k, S4L, 5 s': (presets.scene('S4L') | EQUAL | {'T': 5.0}, TIGHTER),
        'mu_s = mu_k, S4G, 5 s, 1e-6': (presets.scene('S4G') | EQUAL | {'T': 5.0}, TIGHTER, 1e-6),
        'mu_s = mu_k, S4G, 5 s': (presets.scene('S4G') | EQUAL | {'T': 5.0}, TIGHTER),
        'one block, k = 1e12, 1 s': (builders.single(pull, 1.0, k=1e12), ''),
        'K_C / K_L = 5e10, along x, 7 s': (
            builders.plate(pull, 7.0, k_between=1e12, u0=builders.offsets(25, 1e-9, 6, True)),
            '',
        ),
    }


def _timed(work: Callable) -> tuple[Run, float]:
    begin = time.process_time()
    run = work()
    return run, (time.process_time() - begin) * 1e3


def row(
    name: str, given: dict, against: str, tolerance: float | None = None, repeat: int = 3
) -> dict:
    """Return how one scene ends, its cost, and its error where there is something to tell it by."""
    scene = from_mapping(given)
    model, sample_s = Model.of(scene), scene.duration_s / 10

    def ours(tolerance: float | None = tolerance) -> Run:
        return choose.simulate(
            scene, sample_s, tolerance=tolerance, limits=LIMITS, ledger=False, model=model
        )

    ours()  # compiles
    run, ms = min((_timed(ours) for _ in range(repeat)), key=lambda timed: timed[1])
    found = {
        'case': name,
        'path': run.path,
        'status': run.status,
        't_reached': run.t_reached,
        'events': len(run.event_t),
        'steps': run.steps,
        'swept': run.swept,
        'ms': ms,
    }
    if against == SCIPY:
        times = sample_times(scene.duration_s, sample_s)
        truth = peers.scipy_sliding(scene, times, 3e-13)
        peer, peer_ms = _timed(lambda: peers.scipy_sliding(scene, times, 1e-9))
        found |= {
            'error_m': _error(run.u, truth),
            'against': SCIPY,
            'peer': 'scipy DOP853 1e-9',
            'peer_ms': peer_ms,
            'peer_error_m': _error(peer, truth),
        }
    elif against == TIGHTER:
        fine = ours((tolerance or _tolerance(scene)) / 100)
        found |= {'error_m': _error(run.u, fine.u), 'against': TIGHTER}
    return found


def _tolerance(scene: Scene) -> float:
    from eol_ros.core.physics.event.solver import default_tolerance

    return default_tolerance(scene)


def _error(u: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(u - truth).max())


def rows(progress: Callable, only: str = '') -> list[dict]:
    """Return the rows whose name has `only`."""
    wanted = {name: case for name, case in scenes().items() if only in name}
    return [row(name, *case) for name, case in progress(wanted.items(), 'stiff', len(wanted))]

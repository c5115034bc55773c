# SPDX-License-Identifier: Apache-2.0
"""One task of a parameter sweep: from the parameters of a model to the law of its cascades.

A task depends on its parameters alone, its seed among them: whatever process computes it, in any
order, the numbers are the same to the bit on processors of one kind (docs/explanation/science.md).
"""

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from eol_ros.core.physics import builders
from eol_ros.core.physics.result import Limits, Run
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.twin.hands import PUSH_MPS, Rim, Visitors
from eol_ros.core.science import powerlaw
from eol_ros.core.table import Table as Shape
from eol_ros.errors import EolError
from eol_ros.lab import choose
from eol_ros.lab.automaton.ofc import Automaton
from eol_ros.lab.science.quiescent import cascades
from eol_ros.settings import setting

DRIVES = ('pull', 'circle', 'hands')
CIRCLE_M, CIRCLE_YAW, CIRCLE_YAW_PACE = 0.06, 0.12, 0.7 / 0.9  # as in the scenes S4
HANDS_MPS = sum(PUSH_MPS) / 2  # the mean speed of a push
HANDS_STEP_S = 1 / 30
MOST_DISORDER = 0.5  # a uniform law of that deviation is still above zero
EVENTS_AT_ONCE = 1 << 16  # of an automaton, in memory
Plain = dict[str, Any]


@dataclass(frozen=True)
class _Law:
    """How the law of the areas is fitted."""

    fit_from: int = setting(1, 'least area of the fit', 'blocks', 1, 1_000_000)
    fit_to: int = setting(
        0, 'greatest area of the fit; 0: half of all blocks', 'blocks', 0, 100_000_000
    )
    bootstrap: int = setting(
        200, 'samples for tau_error and p_value; 0: neither is computed', '', 0, 10_000
    )
    seed: int = setting(1, 'random seed of start, disorder and hands', '', 0, 2**31)


@dataclass(frozen=True)
class _Blocks(_Law):
    """What table, plate and train have in common."""

    stiffness: float = setting(40.0, 'stiffness of a spring between blocks', 'N/m', 1e-6, 1e12)
    mu_static: float = setting(builders.MU_STATIC, 'static friction', '', 0.0, 100.0)
    friction_drop: float = setting(
        1 - builders.MU_KINETIC / builders.MU_STATIC,
        'share of static friction that a sliding block lacks', '', 0.0, 1.0,
    )  # fmt: skip
    disorder: float = setting(
        0.0, 'standard deviation of friction from block to block over its mean',
        '', 0.0, MOST_DISORDER,
    )  # fmt: skip
    offset_m: float = setting(
        0.001, 'greatest distance of a block from its place at the start', 'm', 0.0, 1.0
    )
    drive: str = setting(
        'pull', 'motion of the rim: along x, on a circle with rotation, or by visitors',
        choices=DRIVES,
    )  # fmt: skip
    speed_mps: float = setting(
        0.001,
        f'speed of the drive; with hands the mean of a push (visitors: {HANDS_MPS:g})',
        'm/s',
        1e-9,
        10.0,
    )
    travel_m: float = setting(
        8.0, 'travel of the drive; the duration is travel_m / speed_mps', 'm', 1e-6, 1e6
    )
    geometric: bool = setting(False, 'springs turn with their blocks instead of being linear')
    skip: float = setting(0.5, 'share of the cascades, the first ones, left out', '', 0.0, 0.99)


@dataclass(frozen=True)
class _Rows(_Blocks):
    rows: int = setting(5, 'rows of blocks', '', 1, 1000)
    columns: int = setting(0, 'columns of blocks; 0: as many as rows', '', 0, 1000)


@dataclass(frozen=True)
class Table(_Rows):
    """The table of the paper: the outer blocks hang in a rim."""

    stiffness_ratio: float = setting(
        1.0, 'stiffness over that of the springs to the rim', '', 1e-9, 1e9
    )


@dataclass(frozen=True)
class Plate(_Rows):
    """The plate of Brown, Scholz and Rundle: every block hangs from above."""

    stiffness_ratio: float = setting(
        2.0, 'stiffness over that of the springs to the plate', '', 1e-9, 1e9
    )


@dataclass(frozen=True)
class Train(_Blocks):
    """The train of Burridge and Knopoff: a row along x under the plate."""

    blocks: int = setting(5, 'number of blocks in the row', '', 1, 100_000)
    stiffness_ratio: float = setting(
        2.0, 'stiffness over that of the springs to the plate', '', 1e-9, 1e9
    )


@dataclass(frozen=True)
class Ofc(_Law):
    """The earthquake automaton of Olami, Feder and Christensen."""

    size: int = setting(32, 'sites along a side', '', 1, 4096)
    alpha: float = setting(0.2, 'share that each neighbour gets', '', 0.0, 0.25)
    events: int = setting(10_000, 'number of events recorded', '', 1, 1_000_000_000)
    warmup: int = setting(
        10_000, 'number of events before the recorded ones', '', 0, 10_000_000_000
    )


MODELS: dict[str, type[Table | Plate | Train | Ofc]] = {
    'table': Table, 'plate': Plate, 'train': Train, 'ofc': Ofc,
}  # fmt: skip


@dataclass(frozen=True)
class Result:
    """What comes of a task. None: not known, or no such thing in this model."""

    status: str = dataclasses.field(metadata={'doc': 'ok, or why there are no figures'})
    cascades: int | None = setting(None, 'number of cascades after the skipped ones')
    slips: int | None = setting(None, 'number of slips, or of topplings, in these cascades')
    mean_area: float | None = setting(None, 'mean area of a cascade', 'blocks')
    greatest_area: int | None = setting(None, 'greatest area of a cascade', 'blocks')
    system_wide: float | None = setting(None, 'share of cascades of at least half of all blocks')
    rate_hz: float | None = setting(None, 'cascades in a simulated second', 'Hz')
    sliding: float | None = setting(None, 'share of time in which any block slides')
    nearest_tau: float | None = setting(
        None, 'tau of the nearest power law of areas, rejected or not'
    )
    tau: float | None = setting(
        None, 'exponent of the density of areas; none where the law is rejected'
    )
    b_value: float | None = setting(None, 'exponent of N(>= area), tau - 1')
    tau_error: float | None = setting(None, 'standard error of tau, dependent cascades included')
    ks: float | None = setting(None, 'Kolmogorov-Smirnov distance of the law')
    p_value: float | None = setting(None, 'p-value of the power law; below 0.05 it is rejected')
    areas: str | None = setting(None, 'number of cascades of each area, as area:count')


RESULTS = tuple(field.name for field in dataclasses.fields(Result))


def key(model: str, parameters: Mapping[str, Any]) -> str:
    """Return what names a task: a digest of the model and all its parameters."""
    text = json.dumps([model, dict(parameters)], sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


def compute(model: str, parameters: Mapping[str, Any]) -> Result:
    """Run a model and return the law of its cascades.

    `parameters` has a value for each field of `MODELS[model]`. `status` gives the reason if a task
    cannot be simulated.
    """
    task = MODELS[model](**parameters)
    try:
        return _ofc(task) if isinstance(task, Ofc) else _simulated(task, _built(task))
    except EolError as error:
        return Result(str(error))


def _built(task: Table | Plate | Train) -> Plain:
    """Return the scene of a task."""
    drive, seconds, loose = _drive(task), _seconds(task), task.stiffness / task.stiffness_ratio
    if isinstance(task, Train):
        return _set(task, builders.train(drive, seconds, task.blocks, loose))
    shape = Shape(rows=task.rows, columns=task.columns or task.rows)
    if isinstance(task, Plate):
        return _set(task, builders.plate(drive, seconds, shape.rows, shape.columns, loose))
    scene = builders.table(drive, seconds, shape=shape)
    for spring in scene['springs_to_frame']:
        spring['k'] = loose
    return _set(task, scene)


def _set(task: _Blocks, scene: Plain) -> Plain:
    """Give a scene the springs, the friction and the start of its task."""
    along_x = task.drive == 'pull' and not task.geometric
    n = scene['n']
    for spring in scene['springs_between_blocks']:
        spring['k'] = task.stiffness
    factors = _disorder(n, task.disorder, task.seed)
    scene |= {
        'mu_s': (task.mu_static * factors).tolist(),
        'mu_k': (task.mu_static * (1 - task.friction_drop) * factors).tolist(),
        'geometric': task.geometric,
        'dim1': along_x,
        'u0': builders.offsets(n, task.offset_m, task.seed, along_x),
    }
    return scene


def _simulated(task: _Blocks, scene: Plain) -> Result:
    sample_s = max(scene['T'], 1e-9)
    run = choose.simulate(from_mapping(scene), sample_s, ledger=False, limits=Limits())
    if run.status != 'ok':
        return Result(f'stopped at {run.t_reached:g} s: {run.status}')
    sizes, areas = cascades(run.event_block, run.event_start)
    first = int(task.skip * len(areas))
    found = _law(task, areas[first:], int(sizes[first:].sum()), scene['n'])
    rate_hz = len(areas) / run.t_reached if run.t_reached else None
    return dataclasses.replace(found, rate_hz=rate_hz, sliding=_sliding(run))


def _sliding(run: Run) -> float:
    moving = np.where(run.event_start != 0, 1, -1).cumsum()
    spans = np.diff(np.append(run.event_t, run.t_reached))
    return float(spans[moving > 0].sum() / run.t_reached) if run.t_reached else 0.0


def _ofc(task: Ofc) -> Result:
    model = Automaton.random(task.size, task.alpha, task.seed)
    for begun in range(0, task.warmup, EVENTS_AT_ONCE):
        model.run(min(EVENTS_AT_ONCE, task.warmup - begun))
    areas, slips = [], 0
    for begun in range(0, task.events, EVENTS_AT_ONCE):
        events = model.run(min(EVENTS_AT_ONCE, task.events - begun), full=True)
        areas.append(events.area.astype(np.int32))
        slips += int(events.size.sum())
    return _law(task, np.concatenate(areas), slips, task.size**2)


def _law(task: _Law, areas: np.ndarray, slips: int, blocks: int) -> Result:
    if not len(areas):
        return Result('no cascades', 0, 0, areas='')
    counts = powerlaw.histogram(areas)
    there = np.flatnonzero(counts)
    plain: dict[str, Any] = {
        'cascades': len(areas), 'slips': slips, 'mean_area': float(areas.mean()),
        'greatest_area': len(counts) - 1,
        'system_wide': float((2 * areas >= blocks).mean()),
        'areas': ' '.join(f'{a}:{counts[a]}' for a in there),
    }  # fmt: skip
    try:
        found = powerlaw.fit(counts, task.fit_from, task.fit_to or max(blocks // 2, 2))
        plain |= {'nearest_tau': found.tau, 'ks': found.ks}
        if task.bootstrap > 1:
            rng = np.random.default_rng(task.seed)
            tested = powerlaw.goodness(areas, [found], rng, repeats=task.bootstrap)
            plain |= {'p_value': tested.p_value}
            if tested.p_value >= powerlaw.REJECTED:
                plain |= {'tau': found.tau, 'b_value': found.b_value, 'tau_error': tested.error}
    except powerlaw.FitError as reason:
        return Result(f'no fit: {reason}', **plain)
    return Result('ok', **plain)


def _disorder(n: int, deviation: float, seed: int) -> np.ndarray:
    """Return a factor of friction for each block: uniform, mean 1."""
    drawn = np.random.default_rng([seed, 0x67726974]).uniform(-math.sqrt(3), math.sqrt(3), n)
    return 1 + deviation * drawn


def _seconds(task: _Blocks) -> float:
    return task.travel_m / task.speed_mps


def _drive(task: _Blocks) -> Plain:
    if task.drive == 'pull':
        return {'kind': 'constant_velocity', 'par': [task.speed_mps, 0.0]}
    if task.drive == 'circle':
        pace = task.speed_mps / CIRCLE_M
        par = [CIRCLE_M, pace, CIRCLE_YAW, CIRCLE_YAW_PACE * pace]
        return {'kind': 'circle_and_rotation', 'par': par}
    return {'kind': 'poses', 'par': _hands(task.seed, _seconds(task), task.speed_mps / HANDS_MPS)}


def _hands(seed: int, seconds: float, pace: float) -> list[list[float]]:
    """Return rows t, x, y, yaw of a rim that runs free under simulated visitors.

    Their gestures are drawn at their own pace, and time is stretched: pauses, too.
    """
    visitors, rim = Visitors(seed), Rim()
    steps = max(1, math.ceil(seconds * pace / HANDS_STEP_S))
    rows = [[0.0, 0.0, 0.0, 0.0]]
    for step in range(1, steps + 1):
        rim.advance(HANDS_STEP_S, visitors.hands(step * HANDS_STEP_S, rim.pose))
        rows.append([step * HANDS_STEP_S / pace, *rim.pose.tolist()])
    return rows

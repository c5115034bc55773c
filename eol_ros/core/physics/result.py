# SPDX-License-Identifier: Apache-2.0
"""What a simulation gives back, and what it may cost."""

import math
from dataclasses import dataclass, field

import numpy as np

from eol_ros.core.physics.kernel_args import Log
from eol_ros.core.physics.status import NOT_FINITE, OK, WORDS

OK_WORD = WORDS[OK]


@dataclass(frozen=True)
class Limits:
    """Bounds of the work: no simulation runs on for ever."""

    events: int = 4_000_000
    steps: int = 20_000_000


@dataclass(frozen=True)
class Energy:
    """The energy ledger of a run, in joules; what friction takes is heat."""

    work_J: float  # noqa: N815 the unit is the name
    kinetic_J: float  # noqa: N815 change since the start
    elastic_J: float  # noqa: N815 change since the start
    friction_J: float  # noqa: N815

    @property
    def residual_J(self) -> float:  # noqa: N802
        """What the ledger misses."""
        return self.work_J - self.kinetic_J - self.elastic_J - self.friction_J


@dataclass
class Run:
    """What a simulation gives: k samples of n blocks, and e events.

    Parameters
    ----------
    path, status : str
        The solver, and 'ok' or why it ended early.
    t : ndarray
        (k,) s; a run that ended early has the samples that it reached.
    u, v : ndarray
        (k, n, 2) m from rest, and m/s.
    event_t : ndarray
        (e,) s, rising.
    event_block, event_start : ndarray
        (e,) which block; 1 where it breaks loose, 0 where it sticks.
    steps : int
        Of the solver.
    t_reached : float
        s; less than asked for where it ended early.
    energy : Energy, optional
        Work, kinetic, elastic and friction, in J, and what the ledger misses.
    yaw, spin : ndarray, optional
        (k, n) rad and rad/s, where blocks rotate.
    notes : list of str
        For people.

    Examples
    --------
    >>> from eol_ros.core.physics import builders, scene
    >>> from eol_ros.lab import choose
    >>> drive = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
    >>> run = choose.simulate(scene.from_mapping(builders.single(drive, 4.0)), sample_s=1.0)
    >>> run.t.tolist(), run.u.shape
    ([0.0, 1.0, 2.0, 3.0, 4.0], (5, 1, 2))
    """

    path: str
    status: str
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    event_t: np.ndarray
    event_block: np.ndarray
    event_start: np.ndarray  # 1 breaks loose, 0 sticks
    steps: int
    t_reached: float
    energy: Energy | None = None
    yaw: np.ndarray | None = None  # (k, n) rad, where blocks rotate
    spin: np.ndarray | None = None  # (k, n) rad/s
    notes: list[str] = field(default_factory=list)


def in_time(log: Log, events: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, blocks and starts of the first `events` of a log, in order of time."""
    order = np.argsort(log.t[:events], kind='stable')
    return log.t[order], log.block[order], log.start[order]


def cut_short(run: Run, duration_s: float, limits: Limits) -> Run:
    """Return a run that ended early without samples that it did not reach, and with a note.

    The note says how far the run came and what would let it go on.
    """
    if run.status == OK_WORD:  # what is no number stays none until the last sample
        last = run.u[-1].sum() + run.v[-1].sum()
        if math.isfinite(last + run.energy.residual_J if run.energy else last):
            return run
    finite = np.isfinite(run.u).all(axis=(1, 2)) & np.isfinite(run.v).all(axis=(1, 2))
    if run.status == OK_WORD:
        run.status = WORDS[NOT_FINITE]
    whole = np.logical_and.accumulate(finite)
    if run.status == WORDS[NOT_FINITE]:
        run.t_reached = min(run.t_reached, float(run.t[whole].max(initial=0.0)))
    kept = (run.t <= run.t_reached) & whole
    for name in ('t', 'u', 'v', 'yaw', 'spin'):
        samples = getattr(run, name)
        if samples is not None:
            setattr(run, name, samples[kept])
    share = run.t_reached / duration_s if duration_s > 0 else 1.0
    came = f'{run.status} at {run.t_reached:.6g} of {duration_s:g} s'
    if run.status == 'step limit':
        more = f'; at this pace the whole takes {limits.steps / share:.1g} steps' if share else ''
        advice = f'more than {limits.steps} steps (--max-steps) let it go on{more}'
    elif run.status == 'event limit':
        more = f'; at this pace the whole has {limits.events / share:.1g} events' if share else ''
        advice = f'more than {limits.events} events (--max-events) let it go on{more}'
    else:
        advice = (
            'forces or speeds leave the range of double precision there: take lengths, masses and '
            'stiffness nearer to each other'
        )
    run.notes.append(f'{came}: {advice}')
    return run


def sample_times(duration_s: float, sample_s: float) -> np.ndarray:
    """Return 0, sample_s, 2 sample_s ... and the end, (p,), s."""
    if duration_s <= 0:
        return np.zeros(1)
    count = int(np.floor(duration_s / sample_s * (1 + 1e-12)))
    times = np.arange(count + 1) * sample_s
    if duration_s - times[-1] > 1e-9 * duration_s:
        times = np.append(times, duration_s)
    times[-1] = min(times[-1], duration_s)
    return times

# SPDX-License-Identifier: Apache-2.0
"""What a simulation gives back, and what it may cost."""

from dataclasses import dataclass, field

import numpy as np


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
        (k,) s.
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
    swept : int
        Of the steps, those of the event path that sweep over reversals of friction.
    notes : list of str
        For people.

    Examples
    --------
    >>> from eol_ros.core.physics import builders, choose, scene
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
    swept: int = 0  # of the steps, those of the event path that sweep over reversals of friction
    notes: list[str] = field(default_factory=list)


def sample_times(duration_s: float, sample_s: float) -> np.ndarray:
    """Return 0, sample_s, 2 sample_s ... and the end."""
    if duration_s <= 0:
        return np.zeros(1)
    count = int(np.floor(duration_s / sample_s * (1 + 1e-12)))
    times = np.arange(count + 1) * sample_s
    if duration_s - times[-1] > 1e-9 * duration_s:
        times = np.append(times, duration_s)
    times[-1] = min(times[-1], duration_s)
    return times

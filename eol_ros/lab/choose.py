# SPDX-License-Identifier: Apache-2.0
"""Chooses, once, the least that is enough for a scene, and runs it."""

import numpy as np

from eol_ros.core.physics.drive import NONE, VELOCITY
from eol_ros.core.physics.result import Limits, Run, cut_short, sample_times
from eol_ros.core.physics.scene import Scene
from eol_ros.errors import UsageError


def choose_path(scene: Scene) -> str:
    """Return the path for a scene: exact where `along_x`, else event."""
    return 'exact' if along_x(scene) else 'event'


def along_x(scene: Scene) -> bool:
    """Return True if a rim at constant speed pulls along x alone, by linear springs."""
    if scene.geometric or scene.rotation is not None or scene.drive.kind not in (NONE, VELOCITY):
        return False
    aside = np.any(scene.u0[:, 1]) or np.any(scene.v0[:, 1]) or scene.drive.par[1]
    return scene.dim1 or not aside


def simulate(
    scene: Scene,
    sample_s: float = 0.1,
    path: str = 'auto',
    tolerance: float | None = None,
    limits: Limits | None = None,
    ledger: bool = True,
) -> Run:
    """Solve the stick-slip motion of a scene.

    Parameters
    ----------
    scene : Scene
        From `from_mapping`.
    sample_s : float
        Distance of the samples in the result.
    path : str
        The solver: auto, exact or event.
    tolerance : float, optional
        Relative tolerance of the event path.
    limits : Limits, optional
        Most events and steps.
    ledger : bool
        Keep the energy ledger, at some cost in time.

    Returns
    -------
    Run
        Samples, events and energies. Where a limit was reached, `status` says so, samples end
        there, and a note says what would let the run go on.

    Raises
    ------
    UsageError
        Path `exact` cannot solve this scene, or path `event` does not accept the tolerance.

    References
    ----------
    R. Burridge, L. Knopoff, Bull. Seismol. Soc. Am. 57 (1967) 341. S. R. Brown, C. H. Scholz,
    J. B. Rundle, Geophys. Res. Lett. 18 (1991) 215. Error against run time:
    docs/explanation/numerics.

    Examples
    --------
    >>> from eol_ros.core.physics import builders
    >>> from eol_ros.core.physics.scene import from_mapping
    >>> drive = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
    >>> run = simulate(from_mapping(builders.single(drive, 20.0)))
    >>> run.status, int(run.event_start.sum()), round(float(run.event_t[0]), 3)
    ('ok', 10, 2.759)
    >>> abs(run.energy.residual_J) < 1e-12
    True
    """
    if path not in ('auto', 'exact', 'event'):
        raise UsageError(f'path {path!r}: choose auto, exact or event')
    limits = limits or Limits()
    given = scene, sample_times(scene.duration_s, sample_s), limits, ledger
    if (choose_path(scene) if path == 'auto' else path) == 'exact':
        if not along_x(scene):
            raise UsageError(
                'path exact: for linear springs that a rim at constant speed pulls along x; '
                'use event'
            )
        from eol_ros.lab.exact.solver import solve as solve_exact

        return cut_short(solve_exact(*given), scene.duration_s, limits)
    from eol_ros.core.physics.event import solver as event

    tolerance = event.default_tolerance(scene) if tolerance is None else tolerance
    if not event.TIGHTEST <= tolerance <= event.LOOSEST:
        raise UsageError(
            f'tolerance {tolerance:g} is not within {event.TIGHTEST:g} to {event.LOOSEST:g}; '
            'a larger one would lose events'
        )
    solve = event.solve
    if scene.rotation is not None:
        from eol_ros.core.physics.rotation.solver import solve
    return cut_short(solve(*given, tolerance), scene.duration_s, limits)

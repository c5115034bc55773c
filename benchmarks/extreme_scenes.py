# SPDX-License-Identifier: Apache-2.0
"""Spring-block scenes at the edge of what the model and double precision allow.

Each says what its error is taken against, on which stretch, beside which peer, how it ends and what
holds there. `eol bench extremes` measures them, test/bench/test_extremes.py holds their status.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eol_ros.core.physics import builders
from eol_ros.core.physics.builders import Plain, offsets, plate, single, table
from eol_ros.core.table import Table
from eol_ros.lab import presets
from eol_ros.settings import TwinSettings

PULL, CIRCLE, STILL = presets.PULL, presets.CIRCLE, {'kind': 'none'}
ASLANT = {'kind': 'constant_velocity', 'par': [0.012, 0.016]}
AWAY = {'kind': 'poses', 'par': [[0, 1, 0, 0], [1, 1, 0, 0]]}
EQUAL = {'mu_s': 0.65, 'mu_k': 0.65}
FREE = {'mu_s': 0.0, 'mu_k': 0.0}
COARSE = 'SciPy DOP853, events, stops below 1e-6 m/s'
STEPS = 'own stepping, extrapolated'
EVENTS, SLIDE = 'SciPy DOP853, events', 'SciPy DOP853, all slide'
ONE, REST, MODES = 'formula, one block', 'formula, at rest', 'mpmath modes, 40 digits'

STEPPED = (
    "SciPy's steps do not end; the reference is of first order, extrapolated from steps of 4 and 2"
    ' us'
)


@dataclass(frozen=True)
class Case:
    """One row of the table.

    Args:
        name: of the row; `where` is 'line' or 'plane'.
        build: gives the scene.
        oracle: key of ORACLES, or '' where there is none.
        stretch_s: error and peer are of the first so many seconds; 0: of the whole.
        peer: key of PEERS, or ''.
        ends: the status that it has.
        tolerance: of the event path; None: the default.
        long: takes over a second; its test is among the long ones.
        holds: what a reader should know.
    """

    name: str
    where: str
    build: Callable[[], Plain]
    oracle: str = ''
    stretch_s: float = 0.0
    peer: str = ''
    ends: str = 'ok'
    tolerance: float | None = None
    long: bool = False
    holds: str = ''


def _pull(speed: float) -> Plain:
    return {'kind': 'constant_velocity', 'par': [speed, 0.0]}


def _line(n: int = 25, size_m: float = 0.005) -> list[list[float]]:
    return offsets(n, size_m, 5, along_x=True)


def _plane(n: int = 25, size_m: float = 0.005) -> list[list[float]]:
    return offsets(n, size_m, 3)


def masses(n: int = 25) -> list[float]:
    """Return masses from 1e-6 to 1e3 kg, evenly in their logarithm, in a drawn order."""
    return np.random.default_rng(7).permutation(np.logspace(-6, 3, n)).tolist()


def uneven(scene: Plain) -> Plain:
    """Return `scene` with stiffness from 1e-3 to 1e9 N/m, in a drawn order."""
    springs = [*scene['springs_between_blocks'], *scene['springs_to_frame']]
    drawn = np.random.default_rng(8).permutation(np.logspace(-3, 9, len(springs)))
    for spring, k in zip(springs, drawn, strict=True):
        spring['k'] = float(k)
    return scene


def compressed(scene: Plain, natural_m: float) -> Plain:
    """Return `scene` with springs of `natural_m`, longer than there is room for."""
    for spring in [*scene['springs_between_blocks'], *scene['springs_to_frame']]:
        spring['L0'] = natural_m
    return scene


def _lone(duration_s: float) -> Plain:
    """Return one block that lags by what friction holds: it swings about that, and never stops."""
    lag = 0.65 * TwinSettings.block_kg * builders.GRAVITY / builders.STIFFNESS
    return single(PULL, duration_s, **EQUAL, u0=[[-lag, 0.0]], v0=[[0.03, 0.0]])


def _stepped() -> list[list[float]]:
    return [[x + (i == 12), y] for i, (x, y) in enumerate(offsets(25, 0.005, 2))]


def _many(side: int, build: Callable[..., Plain], duration_s: float, **more) -> Plain:
    return build(PULL, duration_s, rows=side, columns=side, **more)


def cases() -> list[Case]:
    """Return all rows, those along a line first."""
    return [*_along_a_line(), *_in_the_plane(), *_tolerances()]


def _along_a_line() -> list[Case]:
    def row(name, build, *given, **more):
        return Case(name, 'line', build, *given, **more)

    found = [
        row('K_C / K_L = 1e6', lambda: presets.scene('S6a'), EVENTS, 6.2, 'radau'),
        row('K_C / K_L = 5e10', lambda: plate(PULL, 4e-6, k_between=1e12, u0=_line(25, 1e-9)),
            EVENTS, 1e-6, 'dop853'),
        row('K_C / K_L = 5e10, all at once', lambda: plate(PULL, 7.0, k_between=1e12), ONE),
        row('one block, k = 1e12', lambda: single(PULL, 1.0, k=1e12), ONE),
        row('table, k = 1e12', lambda: table(PULL, 4e-4, k=1e12, u0=_line()), EVENTS, 1e-4,
            'dop853', holds='a second has 4e7 reversals, each worked out'),
        row('masses 1e-6 to 1e3 kg', lambda: plate(PULL, 0.025, mass=masses(), u0=_line()),
            COARSE, 0.005, 'dop853'),
        row('stiffness 1e-3 to 1e9 N/m', lambda: uneven(plate(PULL, 0.005, u0=_line(25, 1e-9))),
            EVENTS, 0.001, 'dop853'),
        row('mass x 1e-4, g x 1e4', lambda: presets.scene('S6b'), EVENTS, 6.0, 'dop853',
            holds='g is multiplied too, so that weights stay'),
        row('rim at 1e-9 m/s for 5e8 s', lambda: plate(_pull(1e-9), 5e8, u0=_line()),
            EVENTS, 1e8, 'dop853'),
        row('rim at 1e-9 m/s for 1e9 s, one block', lambda: single(_pull(1e-9), 1e9), ONE),
        row('rim at 10 m/s', lambda: plate(_pull(10.0), 10.0, u0=_line()), EVENTS, 5.0, 'dop853'),
        row('mu_s = mu_k', lambda: presets.scene('S3E'), EVENTS, 6.0, 'mujoco',
            holds='a block stops exactly on its limit, and rounding decides'),
        row('mu_s = mu_k, K_C / K_L = 1e6', lambda: presets.scene('S6a') | EQUAL, STEPS, 0.0,
            'mujoco', holds=STEPPED),
        row('100 blocks at one instant', lambda: _many(10, plate, 20.0), ONE,
            holds='all break together, and stay together'),
        row('400 blocks at one instant', lambda: _many(20, plate, 20.0), ONE),
        row('mu = 0 for 1e8 s', lambda: table(STILL, 1e8, u0=_line(25, 0.01), dim1=True, **FREE),
            MODES,
            holds='the phase of 1e8 s has ten digits before its point'),
        row('mu = 1e9', lambda: table(PULL, 1e5, mu_s=1e9, mu_k=1e9), REST),
        row('no drive for 1e5 s', lambda: table(STILL, 1e5, u0=offsets(25, 1e-3, 1)), REST),
        row('one block for 1e5 s', lambda: single(PULL, 1e5), ONE),
        row('one block that slides for 1e8 s', lambda: _lone(1e8), 'formula, sliding block',
            holds='it never stops: it swings about where it is dragged'),
        row('one block that sticks and slips for 1e8 s', lambda: single(PULL, 1e8),
            ONE, 1e6, ends='event limit', holds='1.1e8 events, and the limit is 4e6'),
        row('one block, T = 0', lambda: single(PULL, 0.0), REST),
        row('K_C / K_L = 1e6, 400 blocks', lambda: _many(20, plate, 10.0, k_between=2e7), ONE),
        row('mass x 1e-4, g x 1e4, 400 blocks',
            lambda: _many(20, plate, 10.0, mass=2.5e-5, g=9.81e4, u0=_line(400)), EVENTS, 3.0),
        row('K_C / K_L = 1e6, 10000 blocks', lambda: _many(100, plate, 5.6, k_between=2e7), ONE,
            long=True),
        row('mass x 1e-4, g x 1e4, 10000 blocks',
            lambda: _many(100, plate, 5.6, mass=2.5e-5, g=9.81e4, u0=_line(10_000)),
            EVENTS, 2.0, long=True),
        row('mu = 1e9, 10000 blocks', lambda: _many(100, table, 1e5, mu_s=1e9, mu_k=1e9), REST,
            long=True),
    ]  # fmt: skip
    return found


def _in_the_plane() -> list[Case]:
    def row(name, build, *given, **more):
        return Case(name, 'plane', build, *given, **more)

    side = Table().block_side_m
    turning = {'side': side, 'yaw0': [0.1] * 9, 'spin0': [1.0, -2.0, 3.0] * 3}
    return [
        row('k = 1e6, geometric', lambda: table(PULL, 1.0, k=1e6, geometric=True, u0=_plane()),
            SLIDE, peer='sliding'),
        row('k = 1e6, linear', lambda: table(PULL, 1.0, k=1e6, u0=_plane()), SLIDE, peer='sliding'),
        row('k = 1e12, geometric',
            lambda: table(PULL, 5e-5, k=1e12, geometric=True, u0=_plane(25, 1e-9)),
            SLIDE, 1e-5, 'sliding', holds='1e7 steps a second of the scene'),
        row('K_C / K_L = 1e6, circled', lambda: plate(CIRCLE, 5.0, k_between=2e7), EVENTS, 2.2,
            'radau'),
        row('masses 1e-6 to 1e3 kg, geometric',
            lambda: table(PULL, 0.1, geometric=True, mass=masses(), u0=_plane()), EVENTS, 0.02,
            'dop853'),
        row('masses 1e-6 to 1e3 kg, linear', lambda: table(PULL, 0.1, mass=masses(), u0=_plane()),
            EVENTS, 0.02, 'dop853'),
        row('stiffness 1e-3 to 1e9 N/m, geometric',
            lambda: compressed(
                uneven(table(PULL, 0.015, geometric=True, u0=_plane(25, 1e-9))), Table().gap_m
            ), EVENTS, 0.003, 'dop853'),
        row('stiffness 1e-3 to 1e9 N/m, linear',
            lambda: uneven(table(PULL, 0.05, u0=_plane(25, 1e-9))), EVENTS, 0.01, 'dop853'),
        row('mass x 1e-4, g x 1e4',
            lambda: table(PULL, 5.0, geometric=True, mass=2.5e-5, g=9.81e4, u0=_plane()), EVENTS,
            2.5, 'dop853', holds='g is multiplied too, so that weights stay'),
        row('rim at 1e-9 m/s for 5e8 s',
            lambda: table(_pull(1e-9), 5e8, geometric=True, u0=_plane()), EVENTS, 1e8, 'dop853',
            long=True),
        row('rim at 10 m/s', lambda: table(_pull(10.0), 0.25, geometric=True, u0=_plane()),
            EVENTS, 0.05, 'dop853', holds='springs stretch to metres'),
        row('blocks that turn, mu = 0',
            lambda: table(STILL, 1.0, 3, 3, geometric=True, u0=_plane(9), rotation=turning, **FREE),
            'SciPy DOP853, rotation', long=True),
        row('mu_s = mu_k, S4L', lambda: presets.scene('S4L') | EQUAL | {'T': 5.0}, STEPS, 2.5,
            'mujoco plane', holds=STEPPED),
        row('mu_s = mu_k, S4G', lambda: presets.scene('S4G') | EQUAL | {'T': 5.0}, STEPS, 2.5,
            'mujoco plane', holds=STEPPED),
        row('mu_s = mu_k, k = 1e6',
            lambda: table(PULL, 0.2, k=1e6, geometric=True, u0=_plane(), **EQUAL), SLIDE,
            peer='sliding'),
        row('mu_s = mu_k from rest',
            lambda: table(PULL, 10.0, geometric=True, u0=offsets(25, 0.01, 1), **EQUAL), STEPS,
            2.5, 'mujoco plane', holds=STEPPED),
        row('buckling, aligned',
            lambda: compressed(table(PULL, 2.5, k=400.0, geometric=True), 0.15),
            EVENTS, 0.5, 'dop853',
            holds='a balance that any push ends: it is kept exactly until the rim breaks it'),
        row('buckling, 1 mm aside',
            lambda: compressed(table(PULL, 1.5, k=400.0, geometric=True, u0=_plane(25, 1e-3)),
                               0.15), EVENTS, 0.3, 'dop853'),
        row('a block set off by a metre',
            lambda: table(STILL, 2.0, geometric=True, u0=_stepped()), EVENTS, 0.0, 'dop853',
            holds='blocks pass through each other: the model has no contact'),
        row('the rim set off by a metre',
            lambda: table(AWAY, 2.5, geometric=True, u0=offsets(25, 0.005, 2)), EVENTS, 0.5,
            'dop853', holds='the same'),
        row('springs through length zero', lambda: table(AWAY, 1.5, geometric=True),
            EVENTS, 0.3, 'dop853',
            holds='a force of k L0 reverses at once, and there a step ends'),
        row('100 blocks at one instant', lambda: plate(ASLANT, 20.0, 10, 10), ONE),
        row('400 blocks at one instant', lambda: plate(ASLANT, 20.0, 20, 20), ONE,
            long=True),
        row('one block, circled', lambda: table(CIRCLE, 10.0, 1, 1, geometric=True), EVENTS, 0.0,
            'dop853'),
        row('table, 10000 blocks',
            lambda: _many(100, table, 3.0, geometric=True, u0=offsets(10_000, 0.005, 5)),
            EVENTS, 2.0, long=True),
    ]  # fmt: skip


def _tolerances() -> list[Case]:
    """Return the ordinary table at every tolerance that is taken."""

    def build():
        return presets.scene('S3G') | {'T': 5.0}

    return [
        Case(
            f'ordinary table at tolerance {t:g}', 'plane', build, EVENTS, 0.0, 'dop853', tolerance=t
        )
        for t in (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 1e-14, 1e-15)
    ]

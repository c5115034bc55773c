# SPDX-License-Identifier: Apache-2.0
"""The tangent of the exact path: how an infinitely small change of the start grows.

Between events it obeys the linear equations of the sliding blocks, without their friction. At an
event it jumps by the saltation matrix (Leine and Nijmeijer, Dynamics and Bifurcations of
Non-Smooth Mechanical Systems, 2004, ch. 7): 1 + (F+ - F-) grad(g) / (dg/dt), where g = 0 is the
condition of the event and F the rate of the state before and after it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.drive import NONE, VELOCITY
from eol_ros.core.physics.exact import solver
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.result import Limits, Run
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import OK, WORDS
from eol_ros.errors import ConfigError

FINER = 0.3  # rad of the fastest mode between the places where a speed is looked at
AT_REST = 1e-7  # of the greatest speed: such a block is about to stop
BISECTIONS = 60
PARTS = 10  # of a run, by whose growth the error of the exponent is estimated
SKIPPED = 0.1  # of a run, until the change points where it grows fastest


@dataclass(frozen=True)
class Tangent:
    """How a small change grew: log of its size at the times `t` (k,), from 0 on.

    `du` (n,) m and `dv` (n,) m/s are the change at the end over its size; its size counts dv in
    units of `pace_hz` times du. `log_du` (k,) is the log of the greatest |du|, of a start of size
    1. `reversals`: blocks that reversed without stopping.
    """

    t: np.ndarray
    log_size: np.ndarray
    log_du: np.ndarray
    du: np.ndarray
    dv: np.ndarray
    pace_hz: float
    events: int
    reversals: int

    def exponent(self) -> tuple[float, float]:
        """Return the largest Lyapunov exponent, 1/s, and its standard error over parts of the run.

        Raises ConfigError where there are fewer events than parts.
        """
        if len(self.t) < PARTS or not self.t[-1] > 0:
            raise ConfigError(f'{len(self.t)} events: too few for a Lyapunov exponent')
        edges = np.linspace(SKIPPED * self.t[-1], self.t[-1], PARTS + 1)
        rates = np.diff(np.interp(edges, self.t, self.log_size)) / np.diff(edges)
        return float(rates.mean()), float(rates.std(ddof=1) / np.sqrt(PARTS))


class _Linear:
    """Blocks along x on linear springs: the matrix of stiffness, and the modes of any of them."""

    def __init__(self, model: Model):
        n = model.n
        self.model = model
        self.stiff = np.zeros((n, n))
        inner = model.second < n
        np.add.at(self.stiff, (model.first, model.first), model.k)
        second = model.second[inner]
        np.add.at(self.stiff, (second, second), model.k[inner])
        np.subtract.at(self.stiff, (model.first[inner], second), model.k[inner])
        np.subtract.at(self.stiff, (second, model.first[inner]), model.k[inner])
        self.speed = float(model.drive.par[0]) if model.drive.kind == VELOCITY else 0.0
        self.drive = model.lattice.drive[:, 0] * self.speed  # N/s of the moving rim
        self.at_zero = model.force(np.zeros((n, 2)), 0.0)[:, 0]
        self._modes: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def pace_hz(self) -> float:
        """The fastest of the blocks, each by itself, rad/s."""
        return float(np.sqrt((self.stiff.diagonal() / self.model.mass).max()))

    def force(self, u: np.ndarray, t: float) -> np.ndarray:
        """Return the spring forces (n,) N."""
        return self.at_zero + self.drive * t - self.stiff @ u

    def modes(self, sliding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return w (m,) rad/s and shapes (m, m), scaled by mass, of the blocks that slide."""
        name = sliding.tobytes()
        if name not in self._modes:
            root = np.sqrt(self.model.mass[sliding])
            square, shape = np.linalg.eigh(
                self.stiff[np.ix_(sliding, sliding)] / np.outer(root, root)
            )
            free = square <= 1e-12 * square[-1]
            self._modes[name] = np.sqrt(np.where(free, 0.0, square)), shape / root[:, None]
        return self._modes[name]


class _Motion(NamedTuple):
    """Modes that obey y'' = -w^2 y + p + r t from y and the rate d at t = 0, each (m,)."""

    w: np.ndarray
    y: np.ndarray
    d: np.ndarray
    p: np.ndarray
    r: np.ndarray

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return y and its rate at the times s (k,), each (m, k)."""
        w, y, d, p, r = (values[:, None] for values in self)
        free = w == 0.0
        some = np.where(free, 1.0, w)
        sine, cosine = np.sin(some * s), np.cos(some * s)
        held, drift = p / some**2, r / some**2
        at = held + drift * s + (y - held) * cosine + (d - drift) * sine / some
        rate = drift - (y - held) * some * sine + (d - drift) * cosine
        at = np.where(free, y + s * (d + s * (p / 2 + s * r / 6)), at)
        return at, np.where(free, d + s * (p + s * r / 2), rate)


def tangent(scene: Scene, du: np.ndarray, dv: np.ndarray, limits: Limits | None = None) -> Tangent:
    """Return how a change (du, dv) of the start of a scene grows in its time.

    Parameters
    ----------
    scene : Scene
        Along x, with linear springs and constant friction; the rim still or at constant speed.
    du, dv : ndarray
        (n,) of any size: only its direction counts. A block that does not slide has no dv.
    limits : Limits
        Of steps and events.

    Returns
    -------
    Tangent
        Size against time, and the change at the end.

    Raises
    ------
    ConfigError
        Another kind of scene, or one that the limits cut short.

    Examples
    --------
    >>> from eol_ros.core.physics import builders, scene
    >>> drive = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
    >>> one = scene.from_mapping(builders.single(drive, 30.0))
    >>> abs(tangent(one, np.ones(1), np.zeros(1)).log_size[-1]) < 0.1  # a lone block remembers
    True
    """
    from eol_ros.core.physics.choose import along_x

    model = Model.of(scene)
    if not along_x(scene) or model.weakening > 0 or model.drive.kind not in (NONE, VELOCITY):
        raise ConfigError(
            'the tangent is that of blocks along x with linear springs and constant friction, '
            'behind a rim that is still or goes at constant speed'
        )
    limits = limits or Limits()
    run = solver.solve(scene, model, np.array([0.0, scene.duration_s]), limits, False)
    if run.status != WORDS[OK]:
        raise ConfigError(
            f'the run ended at {run.t_reached:g} of {scene.duration_s:g} s: {run.status}'
        )
    at_events = solver.solve(scene, model, run.event_t, limits, False)
    return _Walk(scene, model, du, dv).through(run, at_events)


class _Walk:
    """From event to event; `u` and `v` are those of the run, `du` and `dv` the change."""

    def __init__(self, scene: Scene, model: Model, du: np.ndarray, dv: np.ndarray):
        self.model, self.linear = model, _Linear(model)
        self.u, self.v = scene.u0[:, 0].copy(), scene.v0[:, 0].copy()
        self.slides = (self.v != 0.0) | (model.static == 0.0)
        self.side = np.sign(self.v) * (model.kinetic > 0)
        self.du, self.dv = np.array(du, float), np.where(self.slides, dv, 0.0)
        self.t, self.log_size, self.reversals = 0.0, 0.0, 0

    def through(self, run: Run, at_events: Run) -> Tangent:
        """Follow all events of a run, whose states at them are known."""
        self._rescale()
        self.log_size = 0.0
        self._told: list[tuple[float, float, float]] = []
        self._tell()
        for k in range(len(run.event_t)):
            self._slide(float(run.event_t[k]))
            self.u, v = at_events.u[k, :, 0].copy(), at_events.v[k, :, 0]
            i = int(run.event_block[k])
            self.v = np.where(self.slides, v, 0.0)
            if run.event_start[k]:
                self._breaks(i)
            else:
                self.slides[i], self.side[i], self.v[i], self.dv[i] = False, 0.0, 0.0, 0.0
            self._rescale()
            self._tell()
        self._slide(run.t_reached)
        self._rescale()
        self._tell()
        t, log_size, log_du = np.array(self._told).T
        return Tangent(
            t, log_size, log_du, self.du, self.dv, self.linear.pace_hz, len(run.event_t),
            self.reversals,
        )  # fmt: skip

    def _tell(self) -> None:
        far = float(np.abs(self.du).max())
        self._told.append((self.t, self.log_size, self.log_size + np.log(max(far, 1e-300))))

    def _rescale(self) -> None:
        size = float(np.sqrt((self.du**2).sum() + ((self.dv / self.linear.pace_hz) ** 2).sum()))
        if size > 0:
            self.du, self.dv = self.du / size, self.dv / size
            self.log_size += np.log(size)

    def _breaks(self, i: int) -> None:
        """Let a stuck block slide: it does so the earlier, the more the change pulls at it."""
        linear, m = self.linear, self.model
        force = linear.force(self.u, self.t)[i]
        side = float(np.sign(force))
        rate = side * (linear.drive[i] - linear.stiff[i] @ self.v)
        self.slides[i], self.side[i] = True, side * (m.kinetic[i] > 0)
        if self.t > 0 and rate > 0:  # at the start the limit is exceeded, not reached
            pull = -side * (linear.stiff[i] @ self.du)
            start = side * (m.static[i] - m.kinetic[i]) / m.mass[i]
            self.dv[i] = start * pull / rate

    def _slide(self, end: float) -> None:
        """Move on to a time, and reverse what has stopped and is pulled back at once."""
        while self.t < end:
            sliding = np.flatnonzero(self.slides)
            if not len(sliding):
                self.t = end
                return
            h = end - self.t
            w, shape = self.linear.modes(sliding)
            back = (shape * self.model.mass[sliding][:, None]).T
            rest = np.where(self.slides, 0.0, self.u)
            push = self.linear.force(rest, self.t)[sliding]
            push -= self.side[sliding] * self.model.kinetic[sliding]
            p, r = shape.T @ push, shape.T @ self.linear.drive[sliding]
            motion = _Motion(w, back @ self.u[sliding], back @ self.v[sliding], p, r)
            until, who = self._reversal(motion, shape, h, sliding)
            s = np.array([until])
            at, rate = motion.at(s)
            self.u[sliding], self.v[sliding] = (shape @ at)[:, 0], (shape @ rate)[:, 0]
            held = np.where(self.slides, 0.0, self.du)
            pull = shape.T @ -(self.linear.stiff @ held)[sliding]
            small = _Motion(w, back @ self.du[sliding], back @ self.dv[sliding], pull, 0 * pull)
            at, rate = small.at(s)
            self.du[sliding], self.dv[sliding] = (shape @ at)[:, 0], (shape @ rate)[:, 0]
            self.t = end if who < 0 else self.t + until
            if who >= 0:
                self._reverse(who)

    def _reversal(
        self, motion: _Motion, shape: np.ndarray, h: float, sliding: np.ndarray
    ) -> tuple[float, int]:
        """Return when the first block reverses within h, and which; h and -1: none does."""
        count = 2 + int(np.ceil(h * motion.w.max(initial=0.0) / FINER))
        s = np.linspace(0.0, h, count)
        speed = (shape @ motion.at(s)[1]) * self.side[sliding][:, None]
        speed[:, 0] = 1.0  # has just begun, or just reversed
        ends = np.abs(speed[:, -1]) <= AT_REST * np.abs(speed[:, 1:]).max(initial=0.0)
        speed[ends, -1] = 1.0
        against = (speed < 0) & (self.side[sliding] != 0)[:, None]
        if not against.any():
            return h, -1
        last = int(np.argmax(against.any(axis=0)))
        best, who = h, -1
        for c in np.flatnonzero(against[:, last]).tolist():
            low, high = s[last - 1], s[last]
            for _ in range(BISECTIONS):
                middle = np.array([(low + high) / 2])
                rate = shape[c] @ motion.at(middle)[1][:, 0]
                if rate * self.side[sliding[c]] > 0:
                    low = middle[0]
                else:
                    high = middle[0]
            if high < best:
                best, who = float(high), int(sliding[c])
        return best, who

    def _reverse(self, i: int) -> None:
        force = self.linear.force(self.u, self.t)[i]
        before = force - self.side[i] * self.model.kinetic[i]
        after = force + self.side[i] * self.model.kinetic[i]
        self.side[i] = -self.side[i]
        self.dv[i] *= after / before
        self.v[i] = 0.0
        self.reversals += 1

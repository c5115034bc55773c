# SPDX-License-Identifier: Apache-2.0
"""How the rim moves: pose (x, y, phi) against time, and the displacement of points fixed to it.

An anchor at A in the rim's frame is displaced by u = c(t) + (R(phi(t)) - 1) A.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from eol_ros.errors import ConfigError

LARGEST = 1e50  # of any number of a scene, and of 1 / mass: k u / m can still be squared
CLOSEST = 1e-13  # of the time: what lies between closer poses is lost in its rounding
NONE, VELOCITY, CIRCLE, POSES = range(4)
KINDS = {'none': NONE, 'constant_velocity': VELOCITY, 'circle_and_rotation': CIRCLE, 'poses': POSES}
PARAMETERS = {
    'constant_velocity': ('vx', 'vy'),
    'circle_and_rotation': ('R', 'w', 'phi0', 'w2'),
}


def as_numbers(key: str, value: Any, wanted: str) -> np.ndarray:
    """Return numbers in lists as an array of floats.

    Raises ConfigError, in words of `wanted`, for text, for lists of unequal length and for whole
    numbers beyond 64 bits.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.array(None)
    if array.dtype.kind not in 'iuf':
        raise ConfigError(f'{key} is {shown(value)}: {wanted} are wanted')
    return array.astype(float)


def shown(value: Any) -> str:
    """Return what was found as text of 60 characters at most."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + '...'


class Drive(NamedTuple):
    """A drive in the form that solvers and their kernels take.

    `par` holds (vx, vy, 0, 0) or (R, w, phi0, w2); `knots` (p+1,) s and `cubics` (p, 3, 4) are
    the piecewise cubic of `poses`: coefficients of 1, s, s^2, s^3, s the time since the knot.
    Before the first knot and after the last the pose is held.
    """

    kind: int
    par: np.ndarray
    knots: np.ndarray
    cubics: np.ndarray

    @classmethod
    def make(cls, kind: str, *par: float) -> 'Drive':
        """Return a drive of a kind with plain parameters."""
        four = np.zeros(4)
        four[: len(par)] = par
        return cls(KINDS[kind], four, np.zeros(1), np.zeros((0, 3, 4)))

    @classmethod
    def through(cls, rows: np.ndarray, rates: np.ndarray | None = None) -> 'Drive':
        """Return the cubic Hermite drive through `rows` (p+1, 4): t, x, y, phi.

        `rates` (p+1, 3) are the velocities there; without them each is the slope of the parabola
        through the pose and its neighbours (one-sided at the ends; two rows: a straight line).
        Slopes are limited so that no piece leaves its chord by more than 8/27 of the larger change
        of pose beside it. Evenly spaced rows need no limit; a jump beside a long piece does.
        """
        t, q = rows[:, 0], rows[:, 1:]
        h = np.diff(t)[:, None]
        slope = np.diff(q, axis=0) / h
        if rates is None:
            rates = np.gradient(q, t, axis=0, edge_order=2 if len(t) > 2 else 1)
            change = np.abs(np.diff(q, axis=0))
            most = np.maximum(change[:-1], change[1:])
            most = np.concatenate([most[:1], most, most[-1:]]) if len(most) else change[[0, 0]]
            for end in (slice(1, None), slice(-1)):
                spare = most[end] / h
                rates[end] = np.clip(rates[end], slope - spare, slope + spare)
        c2 = (3 * slope - 2 * rates[:-1] - rates[1:]) / h
        c3 = (rates[:-1] + rates[1:] - 2 * slope) / h**2
        return cls(POSES, np.zeros(4), t.copy(), np.stack([q[:-1], rates[:-1], c2, c3], axis=2))

    @classmethod
    def from_mapping(cls, given: Any) -> 'Drive':
        """Check {"kind", "par"} and return the drive; raises ConfigError."""
        if not isinstance(given, Mapping) or 'kind' not in given:
            raise ConfigError(f'drive is {shown(given)}: {{"kind", "par"}} is wanted')
        for key in given:
            if key not in ('kind', 'par'):
                raise ConfigError(
                    f'drive has the unknown key {shown(str(key))}; it wants kind and par'
                )
        kind = given['kind']
        if not isinstance(kind, str) or kind not in KINDS:
            raise ConfigError(f'drive kind {shown(kind)} is not known: {", ".join(KINDS)} are')
        par = given.get('par')
        if kind == 'none':
            return cls.make(kind)
        if isinstance(par, Mapping):
            names = PARAMETERS.get(kind, ())
            if set(par) != set(names):
                wanted = ', '.join(names) or 'rows t, x, y, phi'
                raise ConfigError(f'drive par of {kind} wants {wanted}')
            par = [par[name] for name in names]
        values = as_numbers('drive par', par, 'numbers')
        if not np.all(np.abs(values) <= LARGEST):
            raise ConfigError(f'drive par of {kind}: numbers of at most {LARGEST:g} are wanted')
        if kind == 'poses':
            if values.ndim != 2 or values.shape[1] != 4 or len(values) < 2:
                raise ConfigError('drive par of poses wants two or more rows t, x, y, phi')
            t = values[:, 0]
            if np.any(np.diff(t) <= CLOSEST * np.abs(t[1:])):
                raise ConfigError(
                    f'drive par of poses wants rising times, each by {CLOSEST:g} of itself or more'
                )
            return cls.through(values)
        names = PARAMETERS[kind]
        if values.shape != (len(names),):
            raise ConfigError(f'drive par of {kind} wants {", ".join(names)}')
        return cls.make(kind, *values)

    def scaled(self, size: float) -> 'Drive':
        """Return the same motion with lengths `size` times as large."""
        par = self.par * (size if self.kind == VELOCITY else np.array([size, 1.0, 1.0, 1.0]))
        return self._replace(par=par, cubics=self.cubics * np.array([[size], [size], [1.0]]))

    def pose(self, t: float | np.ndarray) -> np.ndarray:
        """Return (x, y, phi) at `t`, shape t.shape + (3,)."""
        t = np.asarray(t, float)
        if self.kind == VELOCITY:
            return np.stack([self.par[0] * t, self.par[1] * t, 0 * t], axis=-1)
        if self.kind == CIRCLE:
            r, w, phi0, w2 = self.par
            angle = w * t
            return np.stack(
                [r * np.sin(angle), 2 * r * np.sin(angle / 2) ** 2, phi0 * np.sin(w2 * t)], axis=-1
            )
        if self.kind == POSES:
            held = np.clip(t, self.knots[0], self.knots[-1])
            piece = np.clip(np.searchsorted(self.knots, held, 'right') - 1, 0, len(self.cubics) - 1)
            s = (held - self.knots[piece])[..., None]
            c = self.cubics[piece]
            return c[..., 0] + s * (c[..., 1] + s * (c[..., 2] + s * c[..., 3]))
        return np.zeros(t.shape + (3,))

    def displacement(self, t: float, anchors: np.ndarray) -> np.ndarray:
        """Return the displacement (a, 2) at `t` of the rim's points `anchors` (a, 2)."""
        x, y, phi = self.pose(t)
        s, c = np.sin(phi), -2 * np.sin(phi / 2) ** 2
        ax, ay = anchors[:, 0], anchors[:, 1]
        return np.stack([x + c * ax - s * ay, y + s * ax + c * ay], axis=1)

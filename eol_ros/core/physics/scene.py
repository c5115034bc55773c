# SPDX-License-Identifier: Apache-2.0
"""The scene of a spring-block simulation: what is given, checked once, held as arrays.

The keys are those of the JSON files (docs/reference/physics_scene.md); SI units. Springs between
blocks pull along `dir`, a unit vector from block i to block j (or to the anchor); `Lnom` is their
length in the rest lattice between the points where they are fixed, `L0` their natural length.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from eol_ros.core.physics.drive import LARGEST, Drive, as_numbers, shown
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.lattice import lattice_of
from eol_ros.errors import ConfigError, nearest

KEYS = (
    'n',
    'mass',
    'mu_s',
    'mu_k',
    'g',
    'geometric',
    'dim1',
    'springs_between_blocks',
    'springs_to_frame',
    'drive',
    'u0',
    'v0',
    'T',
)
OPTIONAL = ('rotation',)
ROTATION_KEYS = ('side',)
BETWEEN = ('i', 'j', 'k', 'L0', 'dir', 'Lnom')
ARMS = ('arm', 'arm_j')  # optional, with rotation
TO_FRAME = ('i', 'k', 'L0', 'dir', 'Lnom', 'anchor')
MAX_BLOCKS = 1_000_000
UNIT = 1e-6  # by how much the length of a direction may differ from 1


@dataclass(frozen=True)
class Springs:
    """Springs as arrays over s: ends, stiffness `k` (N/m), natural length (m), rest vector (m)."""

    i: np.ndarray
    j: np.ndarray  # the other block; empty for springs to the rim
    k: np.ndarray
    natural: np.ndarray
    rest: np.ndarray  # (s, 2): Lnom * dir
    anchor: np.ndarray  # (s, 2): where it is fixed to the rim, rim frame; empty between blocks


@dataclass(frozen=True)
class Rotation:
    """Blocks that rotate: squares under even pressure; see `rotating_series`."""

    side_m: float
    yaw0: np.ndarray  # (n,) rad
    spin0: np.ndarray  # (n,) rad/s
    arm: np.ndarray  # (s, 2) m: where each spring is fixed to its first block, in its frame
    arm_j: np.ndarray  # (s, 2): to its second; springs between blocks first, then those to the rim


@dataclass(frozen=True)
class Scene:
    """A checked scene; arrays over the blocks have n rows. Raises nothing: see `from_mapping`."""

    n: int
    mass: np.ndarray  # (n,) kg
    mu_s: np.ndarray  # (n,)
    mu_k: np.ndarray  # (n,)
    g: float  # m/s^2
    geometric: bool
    dim1: bool  # blocks run on rails along x: y is held
    between: Springs
    to_frame: Springs
    drive: Drive
    u0: np.ndarray  # (n, 2) m
    v0: np.ndarray  # (n, 2) m/s
    duration_s: float
    rotation: Rotation | None = None
    source: Mapping[str, Any] | None = field(default=None, repr=False, compare=False)

    @property
    def static_limit(self) -> np.ndarray:
        """The force (N) at which each block breaks loose, shape (n,)."""
        return self.mu_s * self.mass * self.g

    @property
    def kinetic_force(self) -> np.ndarray:
        """The friction (N) on each sliding block, shape (n,)."""
        return self.mu_k * self.mass * self.g

    def scaled(self, size: float) -> 'Scene':
        """Return the scene with lengths and g `size` times as large; displacements scale alike."""
        between, to_frame = (
            replace(s, natural=s.natural * size, rest=s.rest * size, anchor=s.anchor * size)
            for s in (self.between, self.to_frame)
        )
        rotation = self.rotation
        if rotation is not None:
            side, arm, arm_j = rotation.side_m, rotation.arm, rotation.arm_j
            rotation = replace(rotation, side_m=side * size, arm=arm * size, arm_j=arm_j * size)
        return replace(
            self,
            g=self.g * size,
            between=between,
            to_frame=to_frame,
            drive=self.drive.scaled(size),
            u0=self.u0 * size,
            v0=self.v0 * size,
            rotation=rotation,
        )

    @cached_property
    def lattice(self) -> Lattice:
        """The same as the arrays that the kernels take."""
        return lattice_of(self)


def from_mapping(given: Mapping[str, Any]) -> Scene:
    """Check what a JSON file says of a scene.

    Parameters
    ----------
    given : mapping
        Plain data, as `builders.table` returns or a file holds.

    Returns
    -------
    Scene
        Arrays in SI units, for `simulate`.

    Raises
    ------
    ConfigError
        One line with the key, what was found there and what is wanted.

    Examples
    --------
    >>> from eol_ros.core.physics import builders
    >>> drive = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
    >>> from_mapping(builders.single(drive, 10.0)).n
    1
    """
    if not isinstance(given, Mapping):
        raise ConfigError(f'a physics scene is an object with the keys {", ".join(KEYS)}')
    _keys('the scene', given, KEYS, OPTIONAL)
    n = _whole('n', given['n'], 1, MAX_BLOCKS)
    mass = _per_block('mass', given['mass'], n, positive=True)
    mu_s = _per_block('mu_s', given['mu_s'], n)
    mu_k = _per_block('mu_k', given['mu_k'], n)
    wrong = np.flatnonzero(mu_k > mu_s)
    if len(wrong):
        b = wrong[0]
        raise ConfigError(
            f'mu_k = {mu_k[b]:g} of block {b} is above mu_s = {mu_s[b]:g}: '
            'kinetic friction cannot exceed static friction'
        )
    geometric = _flag('geometric', given['geometric'])
    between = _springs('springs_between_blocks', given, n, BETWEEN, geometric)
    to_frame = _springs('springs_to_frame', given, n, TO_FRAME, geometric)
    dim1 = _flag('dim1', given['dim1'])
    u0 = _array('u0', given['u0'], (n, 2))
    v0 = given['v0']
    v0 = np.zeros((n, 2)) if isinstance(v0, str) and v0 == 'zero' else _array('v0', v0, (n, 2))
    if dim1 and np.any(v0[:, 1]):
        raise ConfigError('v0 has speeds along y, and dim1 lets the blocks move along x only')
    return Scene(
        n,
        mass,
        mu_s,
        mu_k,
        _number('g', given['g'], least=0.0),
        geometric,
        dim1,
        between,
        to_frame,
        Drive.from_mapping(given['drive']),
        u0,
        v0,
        _number('T', given['T'], least=0.0),
        _rotation(given, n, dim1),
        given,
    )


def _rotation(given: Mapping[str, Any], n: int, dim1: bool) -> Rotation | None:
    rows = [*given['springs_between_blocks'], *given['springs_to_frame']]
    option = given.get('rotation')
    if option is None:
        if any(key in row for row in rows for key in ARMS):
            raise ConfigError("a spring has an arm, which wants the key 'rotation' of the scene")
        return None
    _keys('rotation', option, ROTATION_KEYS, ('yaw0', 'spin0'))
    if dim1:
        raise ConfigError('rotation is for blocks free in the plane: dim1 false')
    side = _number('rotation.side', option['side'], above=0.0)
    arms = np.zeros((2, len(rows), 2))
    for s, row in enumerate(rows):
        half = 0.5 * side * np.asarray(row['dir'], float)  # the middle of the edge it leaves from
        arms[0, s] = _array(f'spring {s}.arm', row.get('arm', half), (2,))
        arms[1, s] = _array(f'spring {s}.arm_j', row.get('arm_j', -half), (2,))
    start = [
        _array(f'rotation.{key}', option.get(key, [0.0] * n), (n,)) for key in ('yaw0', 'spin0')
    ]
    return Rotation(side, *start, *arms)


def _keys(where: str, given: Any, wanted: Sequence[str], optional: Sequence[str] = ()) -> None:
    if not isinstance(given, Mapping):
        raise ConfigError(
            f'{where} is {shown(given)}: an object with {", ".join(wanted)} is wanted'
        )
    for key in wanted:
        if key not in given:
            raise ConfigError(f"{where} lacks the key '{key}'; it wants {', '.join(wanted)}")
    for key in given:
        if key not in wanted and key not in optional:
            hint = nearest(str(key), [*wanted, *optional])
            raise ConfigError(f'{where} has the unknown key {shown(str(key))}. {hint}')


def _number(key: str, value: Any, least: float | None = None, above: float | None = None) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ConfigError(f'{key} is {shown(value)}: a number is wanted')
    try:
        value = float(value)
    except OverflowError:  # a whole number too large for one
        value = np.inf
    if not abs(value) <= LARGEST:
        raise ConfigError(f'{key} is {value:g}: a number of at most {LARGEST:g} is wanted')
    if least is not None and value < least:
        raise ConfigError(f'{key} is {value:g}: {least:g} or more is wanted')
    if above is not None and value <= above:
        raise ConfigError(f'{key} is {value:g}: more than {above:g} is wanted')
    return value


def _whole(key: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ConfigError(f'{key} is {shown(value)}: a whole number is wanted')
    if not least <= value <= most:
        raise ConfigError(f'{key} is {shown(value)}: {least} to {most} is wanted')
    return int(value)


def _flag(key: str, value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ConfigError(f'{key} is {shown(value)}: true or false is wanted')
    return bool(value)


def _array(key: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    words = ' x '.join(map(str, shape))
    array = as_numbers(key, value, f'{words} numbers')
    if array.shape != shape:
        found = ' x '.join(map(str, array.shape)) or 'a single number'
        raise ConfigError(f'{key} has {found}: {words} numbers are wanted')
    for bad in np.argwhere(~(np.abs(array) <= LARGEST))[:1]:
        raise ConfigError(
            f'{key}{bad.tolist()} is {array[tuple(bad)]:g}: a number of at most {LARGEST:g} is'
            ' wanted'
        )
    return array


def _per_block(key: str, value: Any, n: int, positive: bool = False) -> np.ndarray:
    if isinstance(value, list | tuple | np.ndarray):
        array = _array(key, value, (n,))
    else:
        array = np.full(n, _number(key, value))
    wrong = np.flatnonzero(array < 1 / LARGEST if positive else array < 0)
    if len(wrong):
        wanted = f'{1 / LARGEST:g} or more' if positive else '0 or more'
        raise ConfigError(f'{key} is {array[wrong[0]]:g} for block {wrong[0]}: {wanted} is wanted')
    return array


def _springs(
    key: str, given: Mapping[str, Any], n: int, wanted: Sequence[str], geometric: bool
) -> Springs:
    rows = given[key]
    if not isinstance(rows, list | tuple):
        raise ConfigError(f'{key} is {shown(rows)}: a list of springs is wanted')
    i, j, k, natural, rest, anchor = [], [], [], [], [], []
    for s, row in enumerate(rows):
        here = f'{key}[{s}]'
        _keys(here, row, wanted, ARMS if 'j' in wanted else ARMS[:1])
        i.append(_whole(f'{here}.i', row['i'], 0, n - 1))
        k.append(_number(f'{here}.k', row['k'], least=0.0))
        natural.append(_number(f'{here}.L0', row['L0'], least=0.0))
        direction = _array(f'{here}.dir', row['dir'], (2,))
        length = _number(f'{here}.Lnom', row['Lnom'], least=0.0)
        size = float(np.hypot(*direction))
        if length > 0 and abs(size - 1) > UNIT:
            raise ConfigError(f'{here}.dir has the length {size:g}: a unit vector is wanted')
        rest.append(length * direction)
        if 'j' in wanted:
            j.append(_whole(f'{here}.j', row['j'], 0, n - 1))
            if j[-1] == i[-1]:
                raise ConfigError(f'{here} ties block {i[-1]} to itself')
        else:
            anchor.append(_array(f'{here}.anchor', row['anchor'], (2,)))
        if geometric and natural[-1] > 0 and not np.any(rest[-1]):
            raise ConfigError(f'{here} has no direction: with L0 > 0 it wants dir and Lnom')
    return Springs(
        np.array(i, np.int64),
        np.array(j, np.int64),
        np.array(k, float),
        np.array(natural, float),
        np.array(rest, float).reshape(-1, 2),
        np.array(anchor, float).reshape(-1, 2),
    )

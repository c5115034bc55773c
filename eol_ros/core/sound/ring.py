# SPDX-License-Identifier: Apache-2.0
"""Loudspeakers about the table: where each stands, and what it plays of a sound on the table.

V. Pulkki, "Virtual sound source positioning using vector base amplitude panning", J. Audio Eng.
Soc. 45 (1997) 456: a direction p between two loudspeakers l1, l2 (unit vectors) is p = g1 l1 +
g2 l2, eq. 7; the gains are scaled to g1^2 + g2^2 = 1, eq. 10.

Directions are azimuths seen from the middle of the table as ITU-R BS.2051 counts them: 0 degrees
straight ahead of who stands at the front edge (y of frame `table`), positive to the left.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from eol_ros.core import elementary
from eol_ros.errors import ConfigError, each
from eol_ros.settings import SoundSettings


@dataclass(frozen=True)
class Speaker:
    """One loudspeaker: azimuth in degrees."""

    name: str
    azimuth: float


def parse(lines: Sequence[str]) -> list[Speaker]:
    """Return the loudspeakers that the lines of a scene name, in order of the card's outputs.

    Raises
    ------
    ConfigError
        A line is not `NAME AZIMUTH`, or two lines have one name or one direction.

    Examples
    --------
    >>> parse(['left 30', 'right -30'])[1]
    Speaker(name='right', azimuth=-30.0)
    """
    found: list[Speaker] = []

    def add(line: str) -> None:
        try:
            name, word = line.split()
            speaker = Speaker(name, float(word))
        except ValueError:
            speaker = Speaker('', math.nan)
        if not math.isfinite(speaker.azimuth):
            what = 'NAME AZIMUTH, in degrees, such as: left 30'
            raise ConfigError(f'{line!r} is not a loudspeaker: {what}')
        for other in found:
            if other.name == speaker.name:
                raise ConfigError(f'{line!r}: there is a loudspeaker {other.name} already')
            if abs(_turn(other.azimuth - speaker.azimuth)) < 1:
                raise ConfigError(f'{line!r}: {other.name} stands in that direction already')
        found.append(speaker)

    each(add, lines)
    return found


def _turn(degrees: float) -> float:
    return (degrees + 180) % 360 - 180


def mistakes(settings: SoundSettings) -> Iterator[tuple[str, str]]:
    """Yield each setting of the outputs that does not fit the others, and what is wrong with it."""
    s = settings
    try:
        parse(s.speakers)
    except ConfigError as error:
        yield 'speakers', str(error)
    wanted = len(s.speakers) + s.sub_output
    if s.speakers and s.channels != wanted:
        sub = ' and one for the sub voice' if s.sub_output else ''
        yield 'channels', f'is {s.channels}; {len(s.speakers)} speakers{sub} make {wanted}'
    if s.sub_output and s.channels < 2:
        yield 'sub_output', 'takes one of 2 channels at least; there is 1'
    if s.sub_low_hz > s.sub_high_hz:
        yield 'sub_low_hz', f'is {s.sub_low_hz:g}, sub_high_hz is {s.sub_high_hz:g}: no higher'


def output_names(settings: SoundSettings) -> list[str]:
    """Return the name of each output, in order."""
    s = settings
    grains = [speaker.name for speaker in parse(s.speakers)]
    if not grains:
        count = s.channels - s.sub_output
        grains = ['left', 'right'] if count == 2 else [f'channel {k + 1}' for k in range(count)]
        grains = ['mono'] if count == 1 else grains
    return grains + ['sub'] * s.sub_output


class Ring:
    """Pans by x and y between the two loudspeakers on either side.

    Where these are 180 degrees apart or more there is no sound between them; the nearer has it.

    Examples
    --------
    Four in a square; the second and third are left and behind.

    >>> ring = Ring(parse(['front 0', 'left 90', 'back 180', 'right -90']))
    >>> a, b, gain_a, gain_b = ring.pan(np.array([0.0, -0.3]), np.array([0.3, -0.3]))
    >>> int(a[1]), int(b[1]), bool(abs(gain_a[1] ** 2 - 0.5) < 1e-6)
    (1, 2, True)
    """

    def __init__(self, speakers: Sequence[Speaker]):
        azimuth = np.array([s.azimuth % 360 for s in speakers])
        self._order = np.argsort(azimuth, kind='stable')
        self._azimuth = azimuth[self._order]
        ends = np.concatenate([self._azimuth[1:], self._azimuth[:1] + 360])
        self._gap = np.radians(ends - self._azimuth)

    def pan(
        self, x: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return channel_a, channel_b (n,) i8 and gain_a, gain_b (n,) f4 of places (n,), m."""
        azimuth = np.degrees(elementary.arctan2(-np.asarray(x, float), np.asarray(y, float))) % 360
        left = (np.searchsorted(self._azimuth, azimuth, side='right') - 1) % len(self._azimuth)
        angle = np.radians((azimuth - self._azimuth[left]) % 360)
        gap = self._gap[left]
        # p = g1 l1 + g2 l2 in two dimensions: g1 : g2 = sin(gap - angle) : sin(angle)
        gain_a, gain_b = elementary.sin(gap - angle), elementary.sin(angle)
        wide = gap >= np.pi - 1e-9
        nearer = angle < gap / 2
        gain_a = np.where(wide, nearer, np.maximum(gain_a, 0.0))
        gain_b = np.where(wide, ~nearer, np.maximum(gain_b, 0.0))
        norm = elementary.hypot(gain_a, gain_b)
        return (
            self._order[left],
            self._order[(left + 1) % len(self._order)],
            (gain_a / norm).astype(np.float32),
            (gain_b / norm).astype(np.float32),
        )

# SPDX-License-Identifier: Apache-2.0
"""Triggers to voices that depend on the area of the cascade: source scaling, dynamics, sub.

Brune, "Tectonic stress and the spectra of seismic shear waves from earthquakes", J. Geophys. Res.
75 (1970) 4997: a source of radius r has a flat displacement spectrum up to a corner frequency that
goes as 1/r, and falls as f^-2 above it: 1 / (1 + (f / f_c)^2), after his eq. 31 and 36. A cascade
of A blocks has r ~ A^(1/2), so f_c ~ A^(-1/2): the same sound, larger, is slower by A^(1/2) and
darker. The area is the area so far (`cascade_area.py`).

What is heard is not displacement but its rate, whose spectrum rises as f below the corner: a small
cascade has no lows. So a second corner, far below the first and as A^(-1/2) too, takes them away.

A corner is a property of the area, not of the grain: grains of like areas are summed on a bus, and
a bus is filtered once (`buses.py`), so that the loop over the grains does not know of it.
"""

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import exp10
from eol_ros.core.sound.bank import Bank, numbered_rows, playable, voice_rows
from eol_ros.core.sound.cascade_area import CascadeAreas
from eol_ros.core.sound.grain_filter import tuned
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.mixer_layout import VOICE
from eol_ros.core.sound.ring import Ring, mistakes, parse
from eol_ros.core.sound.sub import pulse_bank, pulses
from eol_ros.core.sound.triggers import MAX_GAIN, MAX_RATE, MIN_RATE, TRIGGER
from eol_ros.core.table import Table
from eol_ros.errors import ConfigError
from eol_ros.settings import SoundSettings

OFF_DB = -90.0


def bus_of(area: np.ndarray) -> np.ndarray:
    """Return the bus of areas (n,) from 1 on; each is within a quarter of an octave of its area."""
    return np.rint(2 * elementary.log2(area)).astype(np.int64)


def bus_areas(table: Table) -> np.ndarray:
    """Return the area of each bus, (buses,), in steps of half an octave; the first is the mix.

    Examples
    --------
    >>> bus_areas(Table()).round(1).tolist()
    [1.0, 1.4, 2.0, 2.8, 4.0, 5.7, 8.0, 11.3, 16.0, 22.6]
    """
    return elementary.exp2(np.arange(int(bus_of(np.array(table.count))) + 1) / 2)


def corners_hz(single_hz: float, table: Table = Table()) -> np.ndarray:
    """Return the corner frequency of each bus, (buses,), Hz; that of a single slip is `single_hz`.

    Examples
    --------
    >>> corners_hz(8000.0)[[0, 4, 8]].tolist()
    [8000.0, 4000.0, 2000.0]
    """
    return single_hz / np.sqrt(bus_areas(table))


def set_room(mixer: Mixer, settings: SoundSettings, table: Table = Table()) -> None:
    """Set what share of each bus the room hears, if there is one; as often as that changes."""
    if settings.room_s:
        share = elementary.log(bus_areas(table)) / elementary.log(float(table.count))
        less_db = settings.room_range_db * (1 - share)
        mixer.set_wets(per_bus(elementary.exp10((settings.room_db - less_db) / 20), settings))


def bussed(settings: SoundSettings) -> bool:
    """Whether grains are summed on buses."""
    return bool(settings.corner_hz or settings.low_corner_hz or settings.room_s)


def first_bus(settings: SoundSettings) -> int:
    """Return the bus of area 1: the mix itself, but for a high-pass, which the mix has not."""
    return int(settings.low_corner_hz > 0)


def per_bus(values: np.ndarray, settings: SoundSettings) -> np.ndarray:
    """Return `values` (buses,) for the mix and each bus beside it."""
    return np.concatenate([values[: first_bus(settings)], values])


def new_mixer(settings: SoundSettings, epoch_s: float = 0.0, table: Table = Table()) -> Mixer:
    """Return the mixer of these settings, before its first frame; `epoch_s` is its time.

    Raises ConfigError where its outputs do not fit each other.
    """
    s = settings
    for name, what in mistakes(s):
        raise ConfigError(f'sound.{name}: {what}')
    mixer = Mixer(
        s.sample_rate, s.channels, s.polyphony, s.gain_db, s.ceiling_db,
        s.loudness_lufs, s.governor_db, epoch_s,
        len(bus_areas(table)) - 1 + first_bus(s) if bussed(s) else 0,
        s.room_s, s.room_high_s,
    )  # fmt: skip
    if s.corner_hz:
        corners = per_bus(corners_hz(s.corner_hz, table), s)
        corners[: 1 + first_bus(s)] = np.inf  # single slips pass whole
        mixer.set_corners(corners)
    if s.low_corner_hz:
        mixer.set_low_corners(per_bus(corners_hz(s.low_corner_hz, table), s))
    set_room(mixer, s, table)
    return mixer


@njit(cache=True)
def _scale(triggers, area, since_s, slower, level_db, duck_db, duck_s):
    """Scale rate and gain of `triggers` (n,) by their areas (n,) and times since the onset (n,).

    slower, level_db: factor of the rate and level by area, (areas,).
    """
    for i in range(len(triggers)):
        t, level = triggers[i], level_db[area[i]]
        if duck_db != 0.0:
            level -= duck_db * max(0.0, 1 - since_s[i] / duck_s)
        t.rate = min(max(np.float64(t.rate) * slower[area[i]], MIN_RATE), MAX_RATE)
        t.gain = min(np.float64(t.gain) * exp10(level / 20), MAX_GAIN)


class Voicing:
    """Converts triggers to voices. It tracks cascades, so triggers must come in order.

    `settings` may be replaced between two triggers.
    """

    def __init__(self, settings: SoundSettings, table: Table = Table()):
        self.settings, self._table = settings, table
        # tables by area from 1 on; index 0 is unused
        area = np.maximum(np.arange(table.cells + 1), 1)
        self._log, self._bus = elementary.log(area), bus_of(area)
        self._share = self._log / elementary.log(float(table.count))
        self._slower: tuple[float, np.ndarray] = (0.0, np.ones(table.cells + 1))
        self._cascades = CascadeAreas(settings.cascade_gap_s, table)
        self._ring = Ring(parse(settings.speakers)) if settings.speakers else None
        none = np.zeros(0)
        # compile or load it before a sound waits for it
        _scale(np.zeros(0, TRIGGER), none.astype(int), none, *2 * [self._share], 0.0, 1.0)
        self.number = np.zeros(0, int)  # (m,) the trigger of each voice that `rows` gave last

    @property
    def loudspeakers(self) -> int:
        """How many outputs hear grains."""
        return max(1, self.settings.channels - self.settings.sub_output)

    def rows(self, triggers: np.ndarray, bank: Bank) -> tuple[np.ndarray, np.ndarray]:
        """Return the voices (m,) VOICE of `triggers` (n,) TRIGGER, and which were refused (n,)."""
        s, refused = self.settings, np.ones(len(triggers), bool)
        good = np.flatnonzero(playable(triggers, len(bank)))
        t = triggers[good]
        area, since_s, grew = self._grown(t)
        sub = self._sub(t[grew], area[grew]) if s.sub_db > OFF_DB else None
        if self._slower[0] != s.rate_scaling:
            self._slower = s.rate_scaling, elementary.exp(-s.rate_scaling / 2 * self._log)
        level_db = s.dynamics_db * (self._share - 1)
        _scale(t, area, since_s, self._slower[1], level_db, s.onset_duck_db, s.onset_duck_s)
        first = None
        if bussed(s):
            # Creaks belong to no cascade: they have no high-pass.
            first = s.channels * (self._bus[area] + first_bus(s) * (t['block'] >= 0))
        rows, number = numbered_rows(t, bank, self.loudspeakers, first, self._ring)
        refused[good[number]] = False
        if s.filter != 'off':
            self._filter(rows, t['grain'][number], area[number], bank)
        if sub is not None:  # each behind its grain, as where they come one by one
            number = np.concatenate([number, np.flatnonzero(grew)])
            order = np.argsort(number, kind='stable')
            number = number[order]
            both = np.empty(len(order), VOICE)  # to concatenate compares the fields, for 70 us
            both[: len(rows)], both[len(rows) :] = rows, sub
            rows = both[order]
        self.number = good[number]
        return rows, refused

    def _filter(self, rows: np.ndarray, grain: np.ndarray, area: np.ndarray, bank: Bank) -> None:
        """Set the filter of voices `rows` (n,) from their grains (n,) and cascade areas (n,)."""
        s = self.settings
        share = np.zeros(len(rows))
        if s.filter_by == 'area':
            share = self._share[area]
        elif s.filter_by != 'nothing':
            share = bank.shares(s.filter_by)[grain]
        rows['tuning'] = tuned(
            s.filter_hz * elementary.exp2(s.filter_octaves * share), s.sample_rate
        )
        rows['damping'], rows['band'] = 1 / s.filter_q, s.filter == 'band-pass'

    def _sub(self, triggers: np.ndarray, area: np.ndarray) -> np.ndarray:
        """Return the voices of the sub voice, for grains at which a cascade grows to `area`."""
        s = self.settings
        t = pulses(triggers, area, s.sub_low_hz, s.sub_high_hz, self._table.count)
        t['gain'] *= elementary.exp10(s.sub_db / 20)
        rows = voice_rows(t, pulse_bank(s.sample_rate), self.loudspeakers, ring=self._ring)
        if s.sub_output:
            rows['channel_a'] = rows['channel_b'] = s.channels - 1
            rows['gain_a'], rows['gain_b'] = t['gain'], 0.0
        return rows

    def _grown(self, triggers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (n,) area so far, seconds since the onset, and whether the cascade grew."""
        self._cascades.gap_s = self.settings.cascade_gap_s
        found = [
            self._cascades.add(time_s, block)
            if 0 <= block < self._table.cells
            else (1, 10**6, False)
            for time_s, block in zip(
                triggers['time_s'].tolist(), triggers['block'].tolist(), strict=True
            )
        ]
        area, since_ms, grew = np.array(found, np.int64).reshape(-1, 3).T
        return np.ascontiguousarray(area), 1e-3 * since_ms, grew.astype(bool)

# SPDX-License-Identifier: Apache-2.0
"""The series of a bag that may be 1/f: grain triggers, light, kinetic energy, sound, loudness."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eol_ros.analysis import sound
from eol_ros.analysis.bag import Bag, Table
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.core.sound.loudness import k_weighted, lufs
from eol_ros.errors import EolError
from eol_ros.lab.science import one_over_f, surrogates
from eol_ros.settings import TableSettings, TwinSettings

if TYPE_CHECKING:
    from eol_ros.analysis.uncoupled import Uncoupled

RATE_HZ = 20.0  # of every series; all of their means over 1 / RATE_HZ
HIGH_HZ = 5.0
FINER = 10  # the light is looked at so often in each 1 / RATE_HZ
LOUDNESS_HIGH_HZ = 1.0  # the mean over 0.4 s of BS.1770 takes 2.4 dB there, and 11 dB at 2 Hz
MOMENTARY = 8  # values of 1 / RATE_HZ: 0.4 s
SILENCE_LUFS = -70.0  # the absolute gate of BS.1770
FASTEST_MPS = 3.0  # a block that seems faster was taken for another
REST_J = 1.25e-5  # one block at 10 mm/s; what the camera's noise makes of PAPER at rest is a tenth
PAPER = TableSettings.rows * TableSettings.columns
AT_ONCE = 20_000  # values of the light in memory with those that are finer
MOST_SOUND_S = 3600.0  # is rendered
SPARSE_S = 2 * 86400.0  # a longer bag has a message a second at least
SHORTEST_S = 1.0  # a bag with one message of each topic has no length at all
NAMES = ('triggers', 'light', 'kinetic energy', 'sound power', 'loudness')


@dataclass(frozen=True)
class Series(one_over_f.Series):
    """Values (n,) at RATE_HZ from the start of the bag, and how they are to be asked."""

    rate_hz: float = RATE_HZ
    high_hz: float = HIGH_HZ
    window_s: float = 1 / RATE_HZ
    drive_s: float = one_over_f.GESTURE_S


@dataclass(frozen=True)
class Absent:
    """A series that the bag cannot give."""

    name: str
    why: str


def of(bag: Bag, measured: TwinSettings | None = None) -> Iterator[Series | Absent]:
    """Yield every series, or why it is absent; `measured`: see Energy.series."""
    why = f'the bag is of {bag.duration_s:.1f} s' if bag.duration_s < SHORTEST_S else sparse(bag)
    if why:
        for name in NAMES:
            yield Absent(name, why)
        return
    for name, topic, make in (
        ('triggers', 'grain_triggers', triggers),
        ('light', 'led_commands', light),
        ('kinetic energy', 'blocks', lambda bag: bag.gathered(KineticEnergy).series(measured)),
    ):
        if bag.count(topic):
            yield make(bag)
        else:
            yield Absent(name, f'no {topic} in this bag')
    if not bag.count('grain_triggers'):
        for name in NAMES[3:]:
            yield Absent(name, 'no grain_triggers in this bag to render')
        return
    try:
        yield from loudness(bag)
    except EolError as error:
        for name in NAMES[3:]:
            yield Absent(name, f'its sound cannot be rendered: {error}')


def sparse(bag: Bag) -> str:
    """Return why a bag is too long for its messages to make series, or an empty string.

    It bounds memory by the size of the bag: a few messages may claim to be a year apart.
    """
    count = sum(bag.counts.values())
    if bag.duration_s <= SPARSE_S or bag.duration_s <= count:
        return ''
    return f'{count} messages in {bag.duration_s / 86400:.1f} days: too few for a series'


def ask(series: Series | Absent, control: 'Uncoupled | None' = None) -> one_over_f.Answer:
    """Return the verdict on one series, from a seed of its own: the same each time.

    control: the table without coupling, where the bag is of a twin.
    """
    if isinstance(series, Absent):
        return one_over_f.Answer(series.name, 'undecided', doubts=[series.why])
    others = {control.NAME: lambda: control.series(series.name)} if control else None
    try:
        return one_over_f.ask(series, np.random.default_rng(1), others)
    except EolError as error:
        return one_over_f.Answer(series.name, 'undecided', doubts=[str(error)])


def triggers(bag: Bag) -> Series:
    """Return how many grains were triggered in each 1 / RATE_HZ, by the stamps of their images."""
    times_s = np.sort(_since_start(bag, bag.table('grain_triggers')['stamp']))
    times_s = times_s[(times_s >= 0) & (times_s < bag.duration_s)]
    counts = surrogates.event_counts(times_s, bag.duration_s, RATE_HZ)
    return Series('triggers', counts, times_s=times_s)


def light(bag: Bag) -> Series:
    """Return the mean level of the white LEDs, 0..1, as they hold it from packet to packet."""
    table = bag.table('led_commands')
    sent_s = _since_start(bag, table['sent'])
    order = np.argsort(sent_s, kind='stable')
    mean = table['white'].sum(axis=1) / recorded_table(bag).count
    held = np.concatenate([[0.0], mean[order] / 255])  # dark at first
    sent_s = sent_s[order]
    values = np.empty(round(bag.duration_s * RATE_HZ))
    for first in range(0, len(values), AT_ONCE):
        last = min(first + AT_ONCE, len(values))
        at_s = (np.arange(first * FINER, last * FINER) + 0.5) / (RATE_HZ * FINER)
        levels = held[np.searchsorted(sent_s, at_s, side='right')]
        values[first:last] = levels.reshape(-1, FINER).mean(axis=1)
    return Series('light', values, rest=0.0)


class Energy:
    """The kinetic energy of `blocks` blocks, J: from their steps between images.

    Their rotation is left out. `add` takes the rows of `blocks` in pieces, for a day of them does
    not fit into memory. Stamps count from `start_ns`.
    """

    def __init__(
        self, duration_s: float, blocks: int, twin: TwinSettings | None = None, start_ns: int = 0
    ):
        bins = round(duration_s * RATE_HZ)
        self._start_ns, self._blocks, self._twin = start_ns, blocks, twin or TwinSettings()
        self._total, self._count = np.zeros(bins), np.zeros(bins)
        self._before: tuple[np.ndarray, np.ndarray] | None = None

    def add(self, table: Table) -> None:
        """Take the rows that follow."""
        at_s = (table['stamp'].astype('i8') - self._start_ns) * 1e-9
        place = np.stack([table['blocks']['x'], table['blocks']['y']])
        if self._before is not None:
            at_s = np.r_[self._before[0], at_s]
            place = np.concatenate([self._before[1], place], axis=1)
        self._before = at_s[-1:], place[:, -1:]
        step_s = np.diff(at_s)
        good = step_s > 0
        speed = np.hypot(*np.diff(place, axis=1)[:, good]) / step_s[good, None]
        speed[~(speed <= FASTEST_MPS)] = 0.0  # nan, too
        energy = 0.5 * (speed**2).sum(axis=1)  # of blocks of 1 kg
        where = np.floor((at_s[:-1] + step_s / 2)[good] * RATE_HZ).astype(int)
        inside = (where >= 0) & (where < len(self._total))
        np.add.at(self._total, where[inside], energy[inside])
        np.add.at(self._count, where[inside], 1)

    def series(self, measured: TwinSettings | None = None) -> Series:
        """Return it; between images it is interpolated.

        Blocks have the mass that `measured` says, or else that of the twin of the bag.
        """
        block_kg = (measured or self._twin).block_kg
        known, middle = self._count > 0, np.arange(len(self._total))
        values = np.zeros(len(middle))
        if known.any():
            values = np.interp(middle, middle[known], self._total[known] / self._count[known])
        rest_j = REST_J / TwinSettings.block_kg * max(1.0, self._blocks / PAPER)
        return Series('kinetic energy', block_kg * values, rest=block_kg * rest_j)


class KineticEnergy(Energy):
    """That of the blocks of a bag."""

    fields = {'blocks': ('stamp', 'blocks.x', 'blocks.y')}

    def __init__(self, bag: Bag):
        duration_s = 0.0 if sparse(bag) else bag.duration_s
        super().__init__(
            duration_s, recorded_table(bag).count, recorded_settings(bag, 'twin'), bag.start_ns
        )


def loudness(bag: Bag) -> Iterator[Series]:
    """Yield power (K-weighted mean square) and momentary loudness (BS.1770, LUFS) of the sound.

    Rendered by the mixer that plays live, with the settings of the bag; the first hour at most.
    """
    settings = sound.settings_of(bag)
    seconds = min(bag.duration_s, MOST_SOUND_S)
    power = mean_squares(sound.rendered(bag, settings, seconds), settings.sample_rate)
    quiet = 10 ** ((SILENCE_LUFS + 0.691) / 10)
    yield Series('sound power', power, rest=quiet)
    yield Series(
        'loudness', momentary(power), high_hz=LOUDNESS_HIGH_HZ, window_s=MOMENTARY / RATE_HZ,
        rest=SILENCE_LUFS,
    )  # fmt: skip


def momentary(power: np.ndarray) -> np.ndarray:
    """Return the momentary loudness, LUFS, of mean squares (n,) at RATE_HZ."""
    mean = np.convolve(power, np.full(MOMENTARY, 1 / MOMENTARY))[: len(power)]
    return np.maximum(lufs(mean), SILENCE_LUFS)


def mean_squares(blocks: Iterator[np.ndarray], sample_rate: int) -> np.ndarray:
    """Return the K-weighted mean square of each 1 / RATE_HZ, summed over channels."""
    step = round(sample_rate / RATE_HZ)
    state, left, made = None, np.zeros(0), []
    for block in blocks:
        weighted, state = k_weighted(block.T, sample_rate, state)
        square = np.concatenate([left, np.einsum('cn,cn->n', weighted, weighted)])
        whole = len(square) // step * step
        made.append(square[:whole].reshape(-1, step).mean(axis=1))
        left = square[whole:]
    return np.concatenate(made) if made else np.zeros(0)


def _since_start(bag: Bag, times: np.ndarray) -> np.ndarray:
    return (times.astype('i8') - bag.start_ns) * 1e-9

# SPDX-License-Identifier: Apache-2.0
"""The sound of a bag: its grain triggers as voices for the mixer that plays live."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from eol_ros.analysis.bag import Bag
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.core.sound.bank import Bank, playable
from eol_ros.core.sound.offline import play
from eol_ros.core.sound.senses import FirstSense
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.sound.voicing import Voicing, new_mixer
from eol_ros.devices.audio.bank import load_bank
from eol_ros.devices.corpus.corpus_build import of_this_machine
from eol_ros.errors import ConfigError
from eol_ros.settings import SoundSettings
from eol_ros.streams import corpus, triggers

BLOCK = 1 << 16  # frames
REFUSALS = '', 'no_such_grain', 'bad_number', 'too_short'  # why a trigger does not sound
DAY_S = 86400.0
LATE_S = 10.0  # by which a trigger may be received after it was due


class Voices(NamedTuple):
    """What plays a bag. Keep `banks`, which the voices read, until all is played.

    rows: (n,) VOICE. blocks: (n,) id of the block of each, -1 of a creak, or of a grain that a
    person played. sounds: (n,) path of the sound of each. times_s: (m,) of the triggers. refused:
    (m,) why each was refused, as a place in REFUSALS.
    """

    rows: np.ndarray
    blocks: np.ndarray
    sounds: np.ndarray
    times_s: np.ndarray
    refused: np.ndarray
    banks: list[Bank]


def settings_of(bag: Bag) -> SoundSettings:
    """Return the settings of sound that the bag was recorded with; defaults where it is silent."""
    found: SoundSettings = recorded_settings(bag, 'sound') or SoundSettings()
    return found


def voices(bag: Bag, settings: SoundSettings, until_s: float | None = None) -> Voices:
    """Return the voices of triggers received before `until_s`, None: of all.

    Times count from the start of the bag. Raises ConfigError where the bag has no corpus, or the
    sound of its corpus is not there.
    """
    played, times = bag_triggers(bag, settings, until_s)
    corpora = bag.table('corpus')
    if not len(corpora):
        raise ConfigError(f'{bag.path}: no corpus in this bag; add --corpus C.json')
    digests = [''.join(d) for d in corpora['digest']]
    news = [i for i, d in enumerate(digests) if not i or d != digests[i - 1]]
    begins = corpora['stamp'][news]
    voicing, refused = Voicing(settings, recorded_table(bag)), np.zeros(len(times), int)
    parts, banks = [], []
    for k, i in enumerate(news):  # each trigger speaks of the corpus of its time
        mine = np.ones(len(times), bool)
        if k:
            mine &= times >= begins[k]
        if k + 1 < len(news):
            mine &= times < begins[k + 1]
        row = next(corpus.RECORD.each(corpora[i : i + 1]))
        banks.append(_bank(row, settings.sample_rate))
        *part, refused[mine] = voiced(voicing, played[mine], banks[-1], *corpus.to_core(row)[:2])
        parts.append(part)
    rows, blocks, sounds = map(np.concatenate, zip(*parts, strict=True))
    return Voices(rows, blocks, sounds, played['time_s'], refused, banks)


def voiced(
    voicing: Voicing, triggers: np.ndarray, bank: Bank, files: Sequence[str], file: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, blocks, sounds and refused of `Voices` for triggers (m,) of one bank.

    files: paths of its sounds. file: (grains,) which of them each grain is of.
    """
    rows, mask = voicing.rows(triggers, bank)
    of = triggers[voicing.number]
    sounds = np.array(files, object)[np.asarray(file, int)[of['grain']]]
    return rows, of['block'], sounds, why_refused(triggers, mask, bank)


def why_refused(triggers: np.ndarray, refused: np.ndarray, bank: Bank) -> np.ndarray:
    """Return why those of `triggers` (n,) were `refused` (n,), as places in REFUSALS; 0: not."""
    unknown = (triggers['grain'] < 0) | (triggers['grain'] >= len(bank))
    return refused * np.where(unknown, 1, np.where(~playable(triggers, len(bank)), 2, 3))


def bag_triggers(
    bag: Bag, settings: SoundSettings, until_s: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the triggers that sound, (n,) TRIGGER with time from the bag's start, and their
    stamps.

    Frames are counted from whole seconds on, as where a live run has no card to follow. Time 0 of
    a trigger is its stamp, or where it was felt as much earlier as its latency is shorter.
    """
    rate = settings.sample_rate
    second_ns = bag.start_ns // 10**9 * 10**9
    begin_s = math.floor((bag.start_ns - second_ns) * 1e-9 * rate) / rate
    earlier_s = (round(settings.latency_s * rate) - round(settings.tap_latency_s * rate)) / rate
    seen = bag.table('grain_triggers', end_s=until_s)
    told = [(row, False) for row in triggers.RECORD.each(seen)]
    if bag.count('felt_triggers'):
        knocks = bag.table('felt_triggers', end_s=until_s)
        told += [(row, True) for row in triggers.RECORD.each(knocks)]
        told.sort(key=lambda one: one[0].stamp - (one[1] and round(earlier_s * 1e9)))
    first, rows, stamps = FirstSense(), [], []
    for row, felt in told:
        by_hand = row.block == triggers.NO_BLOCK
        if by_hand or first.plays(row.stamp * 1e-9, row.block, row.grain, felt):
            time_s = (row.stamp - second_ns) * 1e-9 - begin_s - (earlier_s if felt else 0.0)
            if not -DAY_S <= time_s <= bag.duration_s + LATE_S:
                continue  # of another clock
            rows.append(triggers.to_core(row, time_s))
            stamps.append(row.stamp)
    return np.array(rows, TRIGGER), np.array(stamps, 'i8').astype('M8[ns]')


def rendered(bag: Bag, settings: SoundSettings, seconds: float) -> Iterator[np.ndarray]:
    """Yield the first `seconds` of the bag's sound in blocks (n, channels) f4."""
    found = voices(bag, settings, seconds + LATE_S)
    mixer = new_mixer(settings, table=recorded_table(bag))
    yield from play(mixer, found.rows, math.ceil(seconds * settings.sample_rate), BLOCK)
    del found  # the voices read its banks to the end


def _bank(row: Any, sample_rate: int) -> Bank:
    files, file, start, duration = corpus.to_core(row)
    here = [str(of_this_machine(path)) for path in files]
    places, told = corpus.places(row), corpus.values(row)
    return load_bank(here, file, start, duration, sample_rate, places, told)

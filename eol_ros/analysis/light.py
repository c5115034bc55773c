# SPDX-License-Identifier: Apache-2.0
"""The light of a bag: who flashed when, whether that is chance, and a cascade's light in frames."""

import dataclasses
from typing import Any

import numpy as np

from eol_ros.analysis import series
from eol_ros.analysis.bag import Bag, Table
from eol_ros.core.geometry import COLS, N_BLOCKS, ROWS
from eol_ros.lab.science import patterns

MOMENT_S = 0.2  # most flashes of a cascade fall into one or two of them
FLASH = 48  # levels (of 255) that a light rises by from packet to packet when it flashes up
CHUNK_S = 600.0  # of packets in memory at a time
FRAMES = 8
BEFORE_S, AFTER_S = 0.05, 0.15  # of a cascade, in its figure
JUDGED = (
    'No person has judged patterns of 5x5 flashing blocks: the measures were compared with '
    'judgements of other black and white patterns, at rest (docs/science.md).'
)


def flashes(bag: Bag) -> np.ndarray:
    """Return which blocks flashed up in each moment of MOMENT_S of the bag, (t, 5, 5) of bool."""
    moments = np.zeros((int(bag.duration_s / MOMENT_S) + 1, N_BLOCKS), bool)
    last = np.zeros((1, N_BLOCKS), np.int16)
    for begin_s in np.arange(0.0, bag.duration_s + 1e-9, CHUNK_S):
        table = bag.table('led_commands', begin_s, begin_s + CHUNK_S)
        if not len(table):
            continue
        at_s, white = sent(bag, table)
        level = np.concatenate([last, white])
        last = level[-1:]
        packet, block = np.nonzero(np.diff(level, axis=0) >= FLASH)
        moment = np.floor(at_s[packet] / MOMENT_S).astype(int)
        inside = (moment >= 0) & (moment < len(moments))
        moments[moment[inside], block[inside]] = True
    return moments.reshape(-1, ROWS, COLS)


def sent(bag: Bag, table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Return when packets were sent, s from the start of the bag, rising; and their levels."""
    at_s = (table['sent'].astype('i8') - bag.start_ns) * 1e-9
    order = np.argsort(at_s, kind='stable')
    return at_s[order], table['white'][order].astype(np.int16)


def ask(bag: Bag) -> dict[str, Any] | None:
    """Return what is to be said of the patterns of light; None where the bag has no light."""
    if not bag.count('led_commands'):
        return None
    if why := series.sparse(bag):
        return {'sentences': [f'patterns of light: {why}']}
    try:
        found = patterns.ask(flashes(bag), 1 / MOMENT_S, np.random.default_rng(1))
    except patterns.TooFew as why:
        return {'sentences': [f'patterns of light: {why}']}
    return {
        'sentences': [*found.sentences, JUDGED],
        'random': found.random,
        'moments': found.moments,
        'asked': found.asked,
        'static': [dataclasses.asdict(c) for c in found.static],
        'follows': dataclasses.asdict(found.follows),
    }


def frames(bag: Bag, cascades: Table | None) -> dict[str, np.ndarray] | None:
    """Return the light of the greatest cascade, FRAMES times: time_s, block, level (0..1).

    The first of several of the same area. None where the bag has no cascades or no light.
    """
    if cascades is None or not len(cascades) or not bag.count('led_commands'):
        return None
    onset_s = (cascades['onset'].astype('i8') - bag.start_ns) * 1e-9
    order = np.argsort(onset_s, kind='stable')
    greatest = order[np.argmax(cascades['area'][order])]
    begin_s = onset_s[greatest]
    span_s = float(cascades['duration'][greatest]) + BEFORE_S + AFTER_S
    begin_s -= BEFORE_S
    # by when they were received, a little later than sent; a light without a packet is held
    table = bag.table('led_commands', max(0.0, begin_s - 2.0), begin_s + span_s + 2.0)
    at_s, white = sent(bag, table)
    times_s = np.linspace(begin_s, begin_s + span_s, FRAMES)
    held = np.concatenate([np.zeros((1, N_BLOCKS), np.int16), white])
    level = held[np.searchsorted(at_s, times_s, side='right')] / 255
    return {
        'time_s': np.repeat(times_s - begin_s - BEFORE_S, N_BLOCKS),
        'block': np.tile(np.arange(N_BLOCKS), FRAMES),
        'level': level.ravel(),
    }

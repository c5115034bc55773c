# SPDX-License-Identifier: Apache-2.0
"""The light of a bag: who flashed when, whether that is chance, and a cascade's light in frames.

`Measure` has the figures of a flash: how long it lasts, how many blocks are lit, contrast in space
and time, falls in a second, and how far the order of lighting is that of the onsets.
"""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from eol_ros.analysis import series
from eol_ros.analysis.bag import Bag
from eol_ros.analysis.bag import Table as Messages
from eol_ros.analysis.recorded_settings import recorded_table
from eol_ros.core.light.flash import FLASH_DEPTH
from eol_ros.core.light.local import SQUARE_FALLS, block_falls, squares
from eol_ros.core.table import Table
from eol_ros.errors import ConfigError
from eol_ros.lab.science import patterns
from eol_ros.streams.slips import START

MOMENT_S = 0.2  # most flashes of a cascade fall into one or two of them
FLASH = 48  # levels (of 255) that a light rises by from packet to packet when it flashes up
CHUNK_S = 600.0  # of packets in memory at a time
RATE_HZ = 120.0  # of the grid on which light is measured
LIT, MANY = 0.1, 0.8  # of full light; of all blocks, those that are lit
SLOW_HZ = 1.0  # changes of light below it are no flashes
WINDOW_S = 30.0  # of a spectrum
LEAST_AREA = 5  # of a cascade whose order of lighting is measured
FRAMES, FRAME_S = 3, 0.5  # of a cascade, and from one to the next, as in the paper's figure
FIRST_S = 0.05  # from the onset to the first frame: its light is lit by then
JUDGED = (
    'No person has judged patterns of flashing blocks: the measures were compared with '
    'judgements of other black and white patterns, at rest (docs/explanation/science.md).'
)


def flashes(bag: Bag) -> np.ndarray:
    """Return which blocks flashed up in each moment of MOMENT_S, (t, rows, columns) of bool."""
    table = recorded_table(bag)
    moments = np.zeros((int(bag.duration_s / MOMENT_S) + 1, table.cells), bool)
    last = np.zeros((1, table.cells), np.int16)
    for begin_s in np.arange(0.0, bag.duration_s + 1e-9, CHUNK_S):
        sent = bag.table('led_commands', begin_s, begin_s + CHUNK_S)
        if not len(sent):
            continue
        at_s, white = shown(bag, sent)
        level = np.concatenate([last, white])
        last = level[-1:]
        packet, block = np.nonzero(np.diff(level, axis=0) >= FLASH)
        moment = np.floor(at_s[packet] / MOMENT_S).astype(int)
        inside = (moment >= 0) & (moment < len(moments))
        moments[moment[inside], block[inside]] = True
    return table.grid(moments)


def shown(bag: Bag, commands: Messages) -> tuple[np.ndarray, np.ndarray]:
    """Return of when levels are, s from the start of the bag, rising; and the levels.

    Levels that a slip or tap changed are those of its stamp; the packet was sent later. Raises
    ConfigError where a packet has not one for each place of the table.
    """
    white, cells = commands['white'], recorded_table(bag).cells
    if len(white) and white.shape[1:] != (cells,):
        found = next(len(levels) for levels in white if len(levels) != cells)
        raise ConfigError(
            f'{bag.path}: led_commands: a message has {found} levels of light, the table of its '
            f'scene {cells} places: these messages are of another table'
        )
    caused, sent = commands['stamp'].astype('i8'), commands['sent'].astype('i8')
    at_s = (np.where(caused > 0, caused, sent) - bag.start_ns) * 1e-9
    # a slip that is known too late is shown with the frames of later moments
    return np.maximum.accumulate(at_s), white.astype(np.int16).reshape(-1, cells)


def levels(bag: Bag) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the light of CHUNK_S at a time: its begin, and levels at RATE_HZ, (n, cells)."""
    held = np.zeros((1, recorded_table(bag).cells), np.int16)
    for begin_s in np.arange(0.0, bag.duration_s, CHUNK_S):
        end_s = min(begin_s + CHUNK_S, bag.duration_s)
        at_s, white = shown(bag, bag.table('led_commands', begin_s, end_s))
        held = np.concatenate([held[-1:], white])
        grid_s = begin_s + np.arange(int((end_s - begin_s) * RATE_HZ)) / RATE_HZ
        yield begin_s, held[np.searchsorted(at_s, grid_s, side='right')] / 255


class Measure:
    """Figures of light at RATE_HZ that comes in chunks, (n, cells), 0..1."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._spans_s: list[np.ndarray] = []
        self._lit = self._many = self._falls = self._square_falls = 0
        self._spread: list[np.ndarray] = []
        self._power = np.zeros(2)  # below and above SLOW_HZ

    def add(self, levels: np.ndarray) -> None:
        """Take a chunk."""
        on = levels > LIT
        edges = np.diff(np.pad(on, ((1, 1), (0, 0))).astype(np.int8), axis=0).T
        for e in edges:
            self._spans_s.append((np.flatnonzero(e < 0) - np.flatnonzero(e > 0)) / RATE_HZ)
        lit = on.any(axis=1)
        self._lit += int(lit.sum())
        self._many += int((on.sum(axis=1) >= MANY * self._table.count).sum())
        shining = levels[lit].take(self._table.ids, axis=1)
        self._spread.append(shining.std(axis=1) / shining.mean(axis=1))
        fell = np.stack([_falls(row) for row in levels.T])
        within = np.cumsum(np.pad(fell, ((0, 0), (int(RATE_HZ) + 1, 0))), axis=1)
        within = within[:, int(RATE_HZ) + 1 :] - within[:, : -int(RATE_HZ) - 1]
        self._falls = max(self._falls, int(within.max(initial=0)))
        self._square_falls = max(
            self._square_falls,
            *(int(within[s].sum(axis=0).max(initial=0)) for s in squares(self._table)),
        )
        window = int(WINDOW_S * RATE_HZ)
        for begin in range(0, len(levels) - window + 1, window):
            part = levels[begin : begin + window]
            power = np.abs(np.fft.rfft(part - part.mean(axis=0), axis=0)) ** 2
            above = np.fft.rfftfreq(window, 1 / RATE_HZ) > SLOW_HZ
            self._power += power[~above].sum(), power[above].sum()

    def figures(self) -> dict[str, Any]:
        """Return them; what needs flashes, or a whole WINDOW_S, is None without."""
        spans_s = np.concatenate(self._spans_s) if self._spans_s else np.empty(0)
        spread = np.concatenate(self._spread) if self._spread else np.empty(0)
        middle, long = np.quantile(spans_s, [0.5, 0.9]) if len(spans_s) else (None, None)
        return {
            'flashes': len(spans_s),
            'flash_median_s': middle and float(middle),
            'flash_p90_s': long and float(long),
            'many_lit': self._many / self._lit if self._lit else None,
            'contrast_space': float(np.median(spread)) if len(spread) else None,
            'contrast_time': float(self._power[1] / self._power.sum())
            if self._power.sum()
            else None,
            'most_falls_of_a_block': self._falls,
            'most_falls_of_a_square': self._square_falls,
        }


def _falls(light: np.ndarray) -> np.ndarray:
    """Return where light of one block has fallen by FLASH_DEPTH from the peak before it, (n,)."""
    fell, peak, low = np.zeros(len(light), np.int32), 0.0, 0.0
    falling = True
    for k in np.flatnonzero(np.diff(light, prepend=0.0)).tolist():
        value = light[k]
        if falling:
            low = min(low, value)
            if value - low >= FLASH_DEPTH:
                falling, peak = False, value
        else:
            peak = max(peak, value)
            if peak - value >= FLASH_DEPTH:
                falling, low = True, value
                fell[k] = 1
    return fell


def order(bag: Bag) -> tuple[float | None, float | None]:
    """Return how the blocks of a cascade light up: in which order, and how many.

    Kendall's tau of lighting against onset, the median over cascades of at least LEAST_AREA blocks,
    and the share of their blocks that flash up at all; None without such cascades.
    """
    if not (bag.count('cascades') and bag.count('slips') and bag.count('led_commands')):
        return None, None
    from scipy.stats import kendalltau

    slips, cascades = bag.table('slips'), bag.table('cascades')
    slips = slips[slips['kind'] == START]
    onset_s = (slips['onset'].astype('i8') - bag.start_ns) * 1e-9
    found, began, lit = [], 0, 0
    for one in cascades[cascades['area'] >= LEAST_AREA]:
        begin_s = (int(one['onset'].astype('i8')) - bag.start_ns) * 1e-9
        end_s = begin_s + float(one['duration'])
        sent = bag.table('led_commands', max(0.0, begin_s - 1.0), end_s + 1.0)
        at_s, white = shown(bag, sent)
        rises = np.diff(white, axis=0, prepend=white[:1]) >= FLASH
        times_s = []
        blocks = np.unique(slips['block'][(onset_s >= begin_s) & (onset_s <= end_s)])
        for block in blocks:
            own_s = onset_s[(slips['block'] == block) & (onset_s >= begin_s)].min()
            lit_s = at_s[rises[:, block] & (at_s > own_s - MOMENT_S / 2)]
            if len(lit_s) and lit_s[0] < own_s + MOMENT_S:
                times_s.append((own_s, lit_s[0]))
        began, lit = began + len(blocks), lit + len(times_s)
        if len(times_s) >= LEAST_AREA:
            found.append(kendalltau(*np.array(times_s).T).statistic)
    return float(np.nanmedian(found)) if found else None, lit / began if began else None


def turnover(lit: np.ndarray) -> float | None:
    """Return the share of blocks lit in one of two successive frames that are not lit in both.

    `lit` is (frames, blocks) of bool; None without a lit block.
    """
    either = (lit[1:] | lit[:-1]).sum()
    return float((lit[1:] ^ lit[:-1]).sum() / either) if either else None


def measured(bag: Bag) -> dict[str, Any]:
    """Return the figures of the light of a bag, and sentences on them."""
    table = recorded_table(bag)
    measure = Measure(table)
    for _, part in levels(bag):
        measure.add(part)
    tau, share = order(bag)
    found = measure.figures() | {'order_tau': tau, 'cascade_lit': share}
    if not found['flashes']:
        return found | {'sentences': ['flashes: no block was lit']}
    many = f'{math.ceil(MANY * table.count)} or more of {table.count} blocks'
    said = [
        f'{found["flashes"]} flashes: above {LIT:.0%} for {found["flash_median_s"]:.2f} s in the '
        f'median, for {found["flash_p90_s"]:.2f} s at most in 90 %',
        f'{many} lit for {found["many_lit"]:.1%} of the time with light; contrast '
        f'between blocks (deviation over mean) {found["contrast_space"]:.1f}',
        f'falls in a second: {found["most_falls_of_a_block"]} of a block at most (limit of '
        f'flash_limit: field_of_view {block_falls(table)}), '
        f'{found["most_falls_of_a_square"]} of a square of four (limit {SQUARE_FALLS})',
    ]
    if found['contrast_time'] is not None:
        said[1] += f', {found["contrast_time"]:.0%} of its change faster than {SLOW_HZ:g} Hz'
    if tau is not None:
        said.append(
            f'cascades of {LEAST_AREA} blocks or more: {share:.0%} of their blocks flash up, in '
            f"the order of the onsets to Kendall's tau {tau:.2f} in the median"
        )
    return found | {'sentences': said}


def ask(bag: Bag) -> dict[str, Any] | None:
    """Return what is to be said of light and its patterns; None where the bag has no light."""
    if not bag.count('led_commands'):
        return None
    if why := series.sparse(bag):
        return {'sentences': [f'patterns of light: {why}']}
    flash = measured(bag)
    said = flash.pop('sentences')
    if drawn := frames(bag, bag.table('cascades') if bag.count('cascades') else None):
        lit = drawn['level'].reshape(FRAMES, -1) > LIT
        flash['frames_lit'] = lit.sum(axis=1).tolist()
        flash['frames_turnover'] = turnover(lit)
        said.append(
            f'greatest cascade, {FRAMES} frames {FRAME_S:g} s apart: '
            f'{", ".join(map(str, flash["frames_lit"]))} blocks lit'
            + (
                ''
                if flash['frames_turnover'] is None
                else f'; {flash["frames_turnover"]:.0%} of lit blocks change from frame to frame'
            )
        )
    table = recorded_table(bag)
    if table.rows != table.columns or table.rows < 3 or table.absent:
        why = 'their measures are of square tables of 3 rows or more, without absent blocks'
        return {'sentences': [f'patterns of light: {why}', *said], 'flash': flash}
    try:
        found = patterns.ask(flashes(bag), 1 / MOMENT_S, np.random.default_rng(1))
    except patterns.TooFew as why:
        return {'sentences': [f'patterns of light: {why}', *said], 'flash': flash}
    return {
        'sentences': [*found.sentences, JUDGED, *said],
        'flash': flash,
        'random': found.random,
        'moments': found.moments,
        'asked': found.asked,
        'static': [dataclasses.asdict(c) for c in found.static],
        'follows': dataclasses.asdict(found.follows),
    }


def frames(bag: Bag, cascades: Messages | None) -> dict[str, np.ndarray] | None:
    """Return the light of the greatest cascade, FRAMES times: time_s, block, level (0..1).

    `time_s` counts from its onset. The first of several of the same area. None where the bag has no
    cascades or no light.
    """
    if cascades is None or not len(cascades) or not bag.count('led_commands'):
        return None
    onset_s = (cascades['onset'].astype('i8') - bag.start_ns) * 1e-9
    order = np.argsort(onset_s, kind='stable')
    begin_s = onset_s[order[np.argmax(cascades['area'][order])]]
    times_s = FIRST_S + FRAME_S * np.arange(FRAMES)
    # by when they were received, a little later than sent; a light without a packet is held
    sent = bag.table('led_commands', max(0.0, begin_s - 2.0), begin_s + times_s[-1] + 2.0)
    at_s, white = shown(bag, sent)
    cells = recorded_table(bag).cells
    held = np.concatenate([np.zeros((1, cells), np.int16), white])
    level = held[np.searchsorted(at_s, begin_s + times_s, side='right')] / 255
    return {
        'time_s': np.repeat(times_s, cells),
        'block': np.tile(np.arange(cells), FRAMES),
        'level': level.ravel(),
    }

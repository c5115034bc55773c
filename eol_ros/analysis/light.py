# SPDX-License-Identifier: Apache-2.0
"""The light of a bag: how blocks flash, and the light of a cascade in frames.

`Measure` has the figures of a flash: how long it lasts, how many blocks are lit, contrast in space
and time, falls in a second and how often the limit is reached. `order` compares the order of
lighting with that of the onsets. `eol report` and `eol bench light` use the same functions.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from eol_ros.analysis import series
from eol_ros.analysis.bag import Bag
from eol_ros.analysis.bag import Table as Messages
from eol_ros.analysis.recorded_settings import recorded_table
from eol_ros.core.light.flash import FLASH_DEPTH
from eol_ros.core.light.local import SQUARE_FALLS, block_falls, squares
from eol_ros.core.table import Table
from eol_ros.errors import ConfigError
from eol_ros.streams.slips import START

MOMENT_S = 0.2  # from its onset, within which a block of a cascade lights up
FLASH = 48  # levels (of 255) that a light rises by from packet to packet when it flashes up
CHUNK_S = 600.0  # of packets in memory at a time
RATE_HZ = 120.0  # of the grid on which light is measured
LIT, MANY = 0.1, 0.8  # of full light; of all blocks, those that are lit
SLOW_HZ = 1.0  # changes of light below it are no flashes
WINDOW_S = 30.0  # of a spectrum
BANDS = 3  # of a spectrum in an octave
CURVE = 600  # points of the share lit over time, at most
LEAST_AREA = 5  # of a cascade whose order of lighting is measured
FRAMES, FRAME_S = 3, 0.5  # of a cascade, and from one to the next, as in the paper's figure
FIRST_S = 0.05  # from the onset to the first frame: its light is lit by then
FRAMES_S = FIRST_S + FRAME_S * np.arange(FRAMES)


def shown(bag: Bag, commands: Messages) -> tuple[np.ndarray, np.ndarray]:
    """Return the times of levels, in s from the start of the bag, rising, and the levels.

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
        self._lit = self._many = self._falls = self._square_falls = self._at_limit = 0
        self._spread: list[np.ndarray] = []
        self._share: list[np.ndarray] = []  # of blocks that are lit, each second
        self._frequency_hz = np.fft.rfftfreq(int(WINDOW_S * RATE_HZ), 1 / RATE_HZ)
        self._power = np.zeros(len(self._frequency_hz))
        self._windows = 0

    def add(self, levels: np.ndarray) -> None:
        """Take a chunk."""
        on = levels > LIT
        edges = np.diff(np.pad(on, ((1, 1), (0, 0))).astype(np.int8), axis=0).T
        for e in edges:
            self._spans_s.append((np.flatnonzero(e < 0) - np.flatnonzero(e > 0)) / RATE_HZ)
        lit, together = np.any(on, axis=1), on.sum(axis=1)
        self._lit += int(lit.sum())
        self._many += int((together >= MANY * self._table.count).sum())
        second = int(RATE_HZ)
        whole = together[: len(together) // second * second].reshape(-1, second)
        self._share.append(whole.mean(axis=1) / self._table.count)
        shining = levels[lit].take(self._table.ids, axis=1)
        self._spread.append(shining.std(axis=1) / shining.mean(axis=1))
        self._count_falls(levels, lit)
        window = int(WINDOW_S * RATE_HZ)
        for begin in range(0, len(levels) - window + 1, window):
            part = levels[begin : begin + window]
            power = np.abs(np.fft.rfft(part - part.mean(axis=0), axis=0)) ** 2
            self._power += power.sum(axis=1)
            self._windows += 1

    def _count_falls(self, levels: np.ndarray, lit: np.ndarray) -> None:
        fell, second = np.stack([_falls(row) for row in levels.T]), int(RATE_HZ) + 1
        within = np.cumsum(np.pad(fell, ((0, 0), (second, 0))), axis=1)
        within = within[:, second:] - within[:, :-second]
        self._falls = max(self._falls, int(within.max(initial=0)))
        full = (within >= block_falls(self._table)).any(axis=0)
        for square in squares(self._table):
            together = within[square].sum(axis=0)
            self._square_falls = max(self._square_falls, int(together.max(initial=0)))
            full |= together >= SQUARE_FALLS
        self._at_limit += int((full & lit).sum())

    def figures(self) -> dict[str, Any]:
        """Return them; what needs flashes, or a whole WINDOW_S, is None without."""
        spans_s = np.concatenate(self._spans_s) if self._spans_s else np.empty(0)
        spread = np.concatenate(self._spread) if self._spread else np.empty(0)
        middle, long = np.quantile(spans_s, [0.5, 0.9]) if len(spans_s) else (None, None)
        fast = self._power[self._frequency_hz > SLOW_HZ].sum()
        return {
            'flashes': len(spans_s),
            'flash_median_s': middle and float(middle),
            'flash_p90_s': long and float(long),
            'many_lit': self._many / self._lit if self._lit else None,
            'contrast_space': float(np.median(spread)) if len(spread) else None,
            'contrast_time': float(fast / self._power.sum()) if self._power.sum() else None,
            'most_falls_of_a_block': self._falls,
            'most_falls_of_a_square': self._square_falls,
            'at_limit': self._at_limit / self._lit if self._lit else None,
        }

    def share(self) -> dict[str, list[float]]:
        """Return the share of the blocks that are lit: time_s, share; means of at most CURVE
        spans."""
        share = np.concatenate([*self._share, np.empty(0)])
        width = max(1, math.ceil(len(share) / CURVE))
        begins = np.arange(0, len(share), width)
        found = np.add.reduceat(share, begins) if len(share) else share
        means = found / np.diff(np.append(begins, len(share)))
        return {'time_s': begins.astype(float).tolist(), 'share': means.tolist()}

    def spectrum(self) -> dict[str, list[float]] | None:
        """Return the power of the light of a block, in BANDS an octave: frequency_hz, power_per_hz.

        None without a whole WINDOW_S.
        """
        if not self._windows:
            return None
        of_block = self._power * 2 / (RATE_HZ**2 * WINDOW_S * self._windows * self._table.count)
        band = np.floor(BANDS * np.log2(self._frequency_hz[1:] * WINDOW_S) + 1e-9).astype(int)
        each = np.bincount(band)
        there = each > 0
        return {
            'frequency_hz': (
                np.bincount(band, self._frequency_hz[1:])[there] / each[there]
            ).tolist(),
            'power_per_hz': (np.bincount(band, of_block[1:])[there] / each[there]).tolist(),
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


class Onsets(NamedTuple):
    """When blocks slip, s from the start of a bag: begin and end of each cascade of LEAST_AREA
    blocks or more, (n, 2); onset and block of each slip."""

    cascades_s: np.ndarray
    onset_s: np.ndarray
    block: np.ndarray


def onsets(bag: Bag) -> Onsets | None:
    """Return when the blocks of a bag slip; None where it has no cascades or no slips."""
    if not (bag.count('cascades') and bag.count('slips')):
        return None
    slips, cascades = bag.table('slips'), bag.table('cascades')
    slips, cascades = slips[slips['kind'] == START], cascades[cascades['area'] >= LEAST_AREA]
    begin_s, onset_s = (
        (one['onset'].astype('i8') - bag.start_ns) * 1e-9 for one in (cascades, slips)
    )
    spans_s = np.stack([begin_s, begin_s + cascades['duration'].astype(float)], axis=1)
    return Onsets(spans_s, onset_s, slips['block'].astype(int))


def order(
    slipped: Onsets, rises: Callable[[float, float], tuple[np.ndarray, np.ndarray]]
) -> tuple[float | None, float | None]:
    """Return how the blocks of a cascade light up: in which order, and how many.

    Kendall's tau of lighting against onset, the median over cascades of at least LEAST_AREA blocks,
    and the share of their blocks that flash up at all; None without such cascades. `rises` returns
    time in s and block of each light that flashes up between two times.
    """
    from scipy.stats import kendalltau

    found, began, lit = [], 0, 0
    for begin_s, end_s in slipped.cascades_s.tolist():
        within = slipped.onset_s >= begin_s
        at_s, lit_block = rises(max(0.0, begin_s - 1.0), end_s + 1.0)
        times_s = []
        blocks = np.unique(slipped.block[within & (slipped.onset_s <= end_s)])
        for block in blocks:
            own_s = slipped.onset_s[(slipped.block == block) & within].min()
            lit_s = at_s[(lit_block == block) & (at_s > own_s - MOMENT_S / 2)]
            if len(lit_s) and lit_s[0] < own_s + MOMENT_S:
                times_s.append((own_s, lit_s[0]))
        began, lit = began + len(blocks), lit + len(times_s)
        if len(times_s) >= LEAST_AREA:
            found.append(kendalltau(*np.array(times_s).T).statistic)
    return float(np.nanmedian(found)) if found else None, lit / began if began else None


def recorded_order(bag: Bag) -> tuple[float | None, float | None]:
    """Return `order` of the light that a bag has."""

    def rises(begin_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
        at_s, white = shown(bag, bag.table('led_commands', begin_s, end_s))
        packet, block = np.nonzero(np.diff(white, axis=0, prepend=white[:1]) >= FLASH)
        return at_s[packet], block

    slipped = onsets(bag) if bag.count('led_commands') else None
    return order(slipped, rises) if slipped else (None, None)


def turnover(lit: np.ndarray) -> float | None:
    """Return the share of blocks lit in one of two successive frames that are not lit in both.

    `lit` is (frames, blocks) of bool; None without a lit block.
    """
    either = (lit[1:] | lit[:-1]).sum()
    return float((lit[1:] ^ lit[:-1]).sum() / either) if either else None


def of_frames(level: np.ndarray) -> dict[str, Any]:
    """Return how many blocks are lit in frames (FRAMES, cells) of 0..1, and their turnover."""
    lit = level > LIT
    return {'frames_lit': lit.sum(axis=1).tolist(), 'frames_turnover': turnover(lit)}


def measured(bag: Bag) -> dict[str, Any]:
    """Return the figures of the light of a bag, and sentences on them."""
    table = recorded_table(bag)
    measure = Measure(table)
    for _, part in levels(bag):
        measure.add(part)
    tau, share = recorded_order(bag)
    found = measure.figures() | {'order_tau': tau, 'cascade_lit': share}
    if not found['flashes']:
        return found | {'sentences': ['flashes: no block was lit']}
    found |= {'lit_over_time': measure.share(), 'spectrum': measure.spectrum()}
    many = f'{math.ceil(MANY * table.count)} or more of {table.count} blocks'
    said = [
        f'{found["flashes"]} flashes: above {LIT:.0%} for {found["flash_median_s"]:.2f} s in the '
        f'median, for {found["flash_p90_s"]:.2f} s at most in 90 %',
        f'{many} lit for {found["many_lit"]:.1%} of the time with light; contrast '
        f'between blocks (deviation over mean) {found["contrast_space"]:.1f}',
        f'falls in a second: {found["most_falls_of_a_block"]} of a block at most (limit of '
        f'flash_limit: field_of_view {block_falls(table)}), '
        f'{found["most_falls_of_a_square"]} of a square of four (limit {SQUARE_FALLS}); at that '
        f'limit for {found["at_limit"]:.1%} of the time with light',
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
    """Return what is to be said of the light of a bag; None where the bag has none."""
    if not bag.count('led_commands'):
        return None
    if why := series.sparse(bag):
        return {'sentences': [f'light: {why}']}
    flash = measured(bag)
    said = flash.pop('sentences')
    if drawn := frames(bag, bag.table('cascades') if bag.count('cascades') else None):
        flash |= (shown_frames := of_frames(drawn['level'].reshape(FRAMES, -1)))
        changed = shown_frames['frames_turnover']
        said.append(
            f'greatest cascade, {FRAMES} frames {FRAME_S:g} s apart: '
            f'{", ".join(map(str, shown_frames["frames_lit"]))} blocks lit'
            + (
                ''
                if changed is None
                else f'; {changed:.0%} of lit blocks change from frame to frame'
            )
        )
    return {'sentences': said, 'flash': flash}


def greatest(bag: Bag, cascades: Messages) -> tuple[float, int]:
    """Return onset, s from the start of the bag, and number of the greatest cascade.

    The first of several of the same area.
    """
    onset_s = (cascades['onset'].astype('i8') - bag.start_ns) * 1e-9
    order = np.argsort(onset_s, kind='stable')
    one = order[np.argmax(cascades['area'][order])]
    return float(onset_s[one]), int(cascades['cascade'][one])


def frames(bag: Bag, cascades: Messages | None) -> dict[str, np.ndarray] | None:
    """Return the light of the greatest cascade, FRAMES times: time_s, block, level (0..1).

    `time_s` counts from its onset. None where the bag has no cascades or no light.
    """
    if cascades is None or not len(cascades) or not bag.count('led_commands'):
        return None
    begin_s, times_s = greatest(bag, cascades)[0], FRAMES_S
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

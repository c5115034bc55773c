# SPDX-License-Identifier: Apache-2.0
"""The figures of a report: each an SVG, a PDF and the CSV of what is drawn."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.analysis.bag import Table as Messages
from eol_ros.analysis.bag import seconds
from eol_ros.core.science import powerlaw
from eol_ros.core.table import Table
from eol_ros.lab.science.one_over_f import Answer
from eol_ros.streams.slips import START, STOP

# Okabe and Ito's colours, told apart by everyone.
BLUE, ORANGE, GREEN, GREY = '#0072B2', '#D55E00', '#009E73', '#777777'
DRAWN = 2000  # points of a curve: a day has hundreds of thousands


@dataclass(frozen=True)
class Figure:
    """One figure: `columns` is what it shows, `paint` draws them on axes."""

    name: str
    title: str
    columns: dict[str, np.ndarray]
    paint: Callable[[Any, dict[str, np.ndarray]], None]
    note: str

    def draw(self, out: Path) -> str:
        """Write SVG, PDF and CSV into `out`; return the SVG text without its XML head."""
        import matplotlib

        matplotlib.use('Agg')
        from matplotlib import pyplot

        with open(out / f'{self.name}.csv', 'w', newline='', encoding='utf-8') as file:
            rows = csv.writer(file, lineterminator='\n')
            rows.writerow(self.columns)
            rows.writerows(zip(*(c.tolist() for c in self.columns.values()), strict=True))
        fixed: dict[Any, Any] = {'svg.hashsalt': self.name, 'svg.fonttype': 'none', 'font.size': 10}
        with matplotlib.rc_context(fixed):
            picture, axes = pyplot.subplots(figsize=(7, 4.2), layout='constrained')
            self.paint(axes, self.columns)
            picture.text(0.995, 0.005, self.note, ha='right', fontsize=6, color=GREY)
            text = io.StringIO()
            picture.savefig(text, format='svg', metadata={'Date': None})
            picture.savefig(out / f'{self.name}.pdf', metadata={'CreationDate': None})
            pyplot.close(picture)
        (out / f'{self.name}.svg').write_text(text.getvalue(), encoding='utf-8')
        return text.getvalue()[text.getvalue().index('<svg') :]


def of(
    slips: Messages | None,
    cascades: Messages | None,
    found: dict[str, Any],
    table: Table,
    answers: Sequence[Answer] = (),
    light: dict[str, np.ndarray] | None = None,
) -> list[Figure]:
    """Return the figures that the bag has data for; `found` are the numbers of the report.

    light: of the greatest cascade in frames (`light.frames`).
    """
    note = f'{Path(found["bag"]).name}, {found["duration_s"]:.0f} s'
    figures = []
    if cascades is not None:
        figures.append(_areas(cascades['area'], found['cascades'], table.count, note))
        onsets = np.sort(seconds(cascades['onset']))
        if len(onsets) > 1:
            figures.append(
                _survival('waiting', 'Time between cascades', 's', np.diff(onsets), note)
            )
    if slips is not None:
        starts, stops = slips[slips['kind'] == START], slips[slips['kind'] == STOP]
        if len(stops):
            figures.append(
                _survival('distances', 'Distance of a slip', 'mm', stops['distance'] * 1e3, note)
            )
        figures.append(_map(starts['block'], table, note))
        figures.append(_activity(seconds(starts['stamp']), note))
    if light is not None:
        figures.append(_frames(light, table, note))
    flash = found.get('light', {}).get('flash', {})
    if lit := flash.get('lit_over_time'):
        figures.append(_lit_share({k: np.array(v) for k, v in lit.items()}, note))
    if spectrum := flash.get('spectrum'):
        figures.append(_light_spectrum({k: np.array(v) for k, v in spectrum.items()}, note))
    return figures + [_spectrum(a, note) for a in answers if a.spectrum is not None]


def of_exhibition(areas: np.ndarray, found: dict[str, Any], blocks: int) -> list[Figure]:
    """Return the figures of many bags; `found` is what `exhibition.numbers` returns.

    blocks: how many the table has.
    """
    note = f'{found["bags"]} bags, {found["up_s"] / 3600:.1f} h'
    figures = [_areas(areas, found['cascades'], blocks, note), _by_hour(found['hours'], note)]
    if 'medians' in found['friction']:
        figures.append(_drift(found['friction'], note))
    return figures


def _by_hour(hours: list[dict[str, Any]], note: str) -> Figure:
    of_day = np.array([int(h['hour'][11:13]) for h in hours])
    columns: dict[str, np.ndarray] = {'hour': np.arange(24)}
    for name in ('up_s', 'active_s', 'slips', 'visits'):
        columns[name] = np.bincount(of_day, [h[name] for h in hours], 24)

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        share = np.divide(100 * c['active_s'], c['up_s'], out=np.zeros(24), where=c['up_s'] > 0)
        axes.bar(c['hour'] + 0.5, share, color=GREEN)
        axes.set(
            xlabel='hour of the day', ylabel='seconds with a slip (% of time on)', xlim=(0, 24)
        )
        axes.set_xticks(range(0, 25, 3))

    return Figure('hours', 'Visitors by hour of the day', columns, paint, note)


def _drift(friction: dict[str, Any], note: str) -> Figure:
    columns = {'at': np.array(friction['at']), 'relative_distance': np.array(friction['medians'])}

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        place = np.arange(len(c['at']))
        axes.plot(place, c['relative_distance'], 'o-', color=BLUE)
        shown = place[:: max(1, len(place) // 6)]
        axes.set_xticks(shown, labels=[c['at'][k][: 10 if friction['per'] == 'day' else 13]
                                       for k in shown])  # fmt: skip
        axes.set(ylabel=f'single slips: median distance by {friction["per"]} over that of all')

    return Figure('friction', 'Drift of friction', columns, paint, note)


def _areas(areas: np.ndarray, law: dict[str, Any], blocks: int, note: str) -> Figure:
    support = np.arange(1, blocks + 1)
    reached = np.array([(areas >= a).sum() for a in support])
    fitted = np.full(blocks, np.nan)
    fits = 'tau' in law and not law['rejected']
    if fits:
        inside = support >= law['area_min']
        weight = support[inside] ** -law['tau']
        fitted[inside] = law['fitted'] * weight[::-1].cumsum()[::-1] / weight.sum()
    columns = {'area_blocks': support, 'cascades_at_least': reached, 'fit': fitted}
    try:
        low, high = powerlaw.band(areas, np.random.default_rng(1), blocks)
        columns |= {'low': low, 'high': high}
    except powerlaw.FitError:
        pass  # too few: no band
    if 'from_rest_to_rest' in law:
        columns['from_rest_to_rest'] = np.array(law['from_rest_to_rest']['at_least'])

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        some = c['cascades_at_least'] > 0
        if 'low' in c:
            axes.fill_between(
                c['area_blocks'][some], np.maximum(c['low'][some], 0.5), c['high'][some],
                color=BLUE, alpha=0.2, linewidth=0, label='95 % of catalogues as long',
            )  # fmt: skip
        axes.loglog(
            c['area_blocks'][some],
            c['cascades_at_least'][some],
            'o',
            color=BLUE,
            label=f'{law["count"]} cascades',
        )
        if fits:
            words = f'b = {law["b_value"]:.2f} ± {law["b_error"]:.2f}, A ≥ {law["area_min"]}'
            axes.loglog(c['area_blocks'], c['fit'], color=ORANGE, label=words)
        else:
            words = law.get('why') or (
                f'not a power law: KS {law["ks"]:.2f}, p {law["p_value"]:.2g}'
            )
            if 'needed' in law:  # how many there are stands above
                words = f'too few for a power law: {law["needed"]} are needed'
            axes.plot([], [], ' ', label=words)
        if 'from_rest_to_rest' in c:
            other = c['from_rest_to_rest'] > 0
            axes.loglog(
                c['area_blocks'][other], c['from_rest_to_rest'][other], 'x', color=GREEN,
                label='from rest to rest of the table',
            )  # fmt: skip
        axes.axvline(blocks, color=GREY, linestyle=':', label=f'A ≤ {blocks}: all blocks')
        axes.set(xlabel='area A (blocks)', ylabel='cascades of area ≥ A')
        ticks = [*(tick for tick in (1, 2, 5, 10, 20, 50, 100) if 2 * tick < blocks), blocks]
        axes.set_xticks(ticks, labels=[str(tick) for tick in ticks])
        axes.legend()

    return Figure('areas', 'Cascade areas', columns, paint, note)


def _survival(name: str, title: str, unit: str, values: np.ndarray, note: str) -> Figure:
    values = np.sort(values[np.isfinite(values) & (values > 0)])
    share = 1.0 - np.arange(len(values)) / max(len(values), 1)
    count = len(values)
    if count > DRAWN:  # half of them even in share, half in its logarithm: no gap can be seen
        even = np.linspace(0, count - 1, DRAWN // 2)
        rare = count - np.geomspace(1, count, DRAWN // 2)
        some = np.unique(np.concatenate([even, rare]).round().astype(int))
        values, share = values[some], share[some]

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        x, y = c.values()
        axes.loglog(x, y, '.', color=BLUE, label=f'{count} events')
        axes.set(xlabel=f'{title.lower()} ({unit})', ylabel='share at least as large')
        axes.legend()

    return Figure(name, title, {f'{name}_{unit}': values, 'share': share}, paint, note)


def _map(blocks: np.ndarray, table: Table, note: str) -> Figure:
    counts = np.bincount(blocks, minlength=table.cells)[table.ids]
    row, column = np.divmod(table.ids, table.columns)
    columns = {'block': table.ids, 'row': row, 'column': column, 'slips': counts}

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        grid = np.full(table.cells, np.nan)
        grid[c['block']] = c['slips']
        image = axes.imshow(table.grid(grid), origin='lower', cmap='cividis', vmin=0)
        for block, count in zip(c['block'], c['slips'], strict=True):
            bright = count > 0.6 * max(counts.max(), 1)
            axes.text(
                block % table.columns,
                block // table.columns,
                f'{block}\n{count}',
                ha='center',
                va='center',
                color='black' if bright else 'white',
                fontsize=8,
            )
        axes.set(xlabel='column (right)', ylabel='row (away)')
        axes.figure.colorbar(image, label='slips')

    return Figure('blocks', 'Slips of each block (id, count)', columns, paint, note)


def _activity(times_s: np.ndarray, note: str) -> Figure:
    start = times_s.min(initial=np.inf) if len(times_s) else 0.0
    span = float(np.ptp(times_s)) if len(times_s) else 0.0
    width = max(1.0, np.ceil(span / 600))
    edges = np.arange(0, span + 2 * width, width)
    counts, _ = np.histogram(times_s - start, edges)
    columns = {'time_s': edges[:-1], 'slips_per_s': counts / width}

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        axes.step(c['time_s'], c['slips_per_s'], where='post', color=GREEN)
        axes.set(xlabel='time since the first slip (s)', ylabel='slips per second', ylim=(0, None))

    return Figure('activity', 'Slips over time', columns, paint, note)


def _frames(light: dict[str, np.ndarray], table: Table, note: str) -> Figure:
    from matplotlib import colormaps

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        rows, columns = table.rows, table.columns
        levels = table.grid(np.where(table.present, c['level'].reshape(-1, table.cells), np.nan))
        times_s = c['time_s'].reshape(len(levels), -1)[:, 0]
        wall = np.full((rows + 2, len(levels) * (columns + 1) + 1), np.nan)
        for k, (level, time_s) in enumerate(zip(levels, times_s, strict=True)):
            column = k * (columns + 1) + 1
            wall[1:-1, column : column + columns] = level
            axes.text(column + (columns - 1) / 2, rows + 1.8, f'{1e3 * time_s:.0f} ms', ha='center')
        colours = colormaps['gray'].with_extremes(bad='#c8d8e8')
        axes.imshow(wall, cmap=colours, origin='lower', vmin=0, vmax=1)
        axes.set(ylim=(-0.5, rows + 3))
        axes.set_axis_off()

    title = 'Light of the greatest cascade, time since its onset'
    return Figure('light', title, light, paint, note)


def _lit_share(columns: dict[str, np.ndarray], note: str) -> Figure:
    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        axes.step(c['time_s'], 100 * c['share'], where='post', color=ORANGE)
        axes.set(xlabel='time since the start of the bag (s)', ylabel='lit blocks (%)')
        axes.set(ylim=(0, 100))

    return Figure('light_share', 'Share of blocks that are lit', columns, paint, note)


def _light_spectrum(columns: dict[str, np.ndarray], note: str) -> Figure:
    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        axes.loglog(c['frequency_hz'], c['power_per_hz'], 'o-', markersize=4, color=BLUE)
        axes.set(xlabel='frequency (Hz)', ylabel='power per Hz (of full light squared)')

    return Figure('light_spectrum', 'Spectrum of the light of a block', columns, paint, note)


def _spectrum(answer: Answer, note: str) -> Figure:
    assert answer.spectrum is not None and answer.slope is not None
    line, bent = answer.shapes['power law'], min(answer.shapes.values(), key=lambda s: s.aic)
    relative = 1 / np.sqrt(answer.spectrum.weight)
    columns = {
        'frequency_hz': answer.spectrum.frequency_hz, 'power_per_hz': answer.spectrum.power,
        'relative_error': relative, 'power_law': line.curve, 'best_shape': bent.curve,
    }  # fmt: skip
    s = answer.slope

    def paint(axes: Any, c: dict[str, np.ndarray]) -> None:
        axes.errorbar(
            c['frequency_hz'], c['power_per_hz'], np.minimum(relative, 0.9) * c['power_per_hz'],
            fmt='o', markersize=4, color=BLUE, label=answer.name,
        )  # fmt: skip
        words = f'slope {s.beta:.2f} ({s.low:.2f} to {s.high:.2f})'
        axes.loglog(c['frequency_hz'], c['power_law'], color=ORANGE, label=words)
        if bent.name != line.name:
            axes.loglog(c['frequency_hz'], c['best_shape'], ':', color=GREEN, label=bent.name)
        axes.set(xlabel='frequency (Hz)', ylabel='power per Hz (units squared)')
        axes.set_title({'yes': '1/f', 'no': 'not 1/f', 'undecided': 'undecided'}[answer.answer])
        axes.legend()

    name = f'spectrum_{answer.name.replace(" ", "_")}'
    return Figure(name, f'Spectrum of {answer.name}', columns, paint, note)

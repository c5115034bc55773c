# SPDX-License-Identifier: Apache-2.0
"""A bag as one HTML page with its figures inside, and the figures' data as CSV."""

import html
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.analysis import figures
from eol_ros.analysis.bag import Bag, Table, seconds
from eol_ros.analysis.retrack import Retracked
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.science import powerlaw
from eol_ros.errors import DeviceMissing

START, STOP = 1, 2  # eol_msgs/Slip


def numbers(bag: Bag) -> dict[str, Any]:
    """Return the figures of a bag as plain data: counts, losses, latencies, laws."""
    found: dict[str, Any] = {
        'bag': str(bag.path),
        'duration_s': round(bag.duration_s, 3),
        'messages': {name: count for name, count in bag.counts.items() if count},
        'gaps': {name: json.loads(text) for name, text in bag.gaps.items() if text[:1] == '{'},
        'latency_ms': _latencies(bag),
    }
    slips, cascades = _table(bag, 'slips'), _table(bag, 'cascades')
    if slips is not None:
        stops = slips[slips['kind'] == STOP]
        found['slips'] = {
            'count': int((slips['kind'] == START).sum()),
            'median_distance_mm': _median(stops['distance'] * 1e3),
            'median_speed_mm_s': _median(stops['speed'] * 1e3),
            'median_duration_s': _median(stops['duration']),
            'per_block': np.bincount(
                slips['block'][slips['kind'] == START], minlength=N_BLOCKS
            ).tolist(),
        }
    if cascades is not None:
        found['cascades'] = law(cascades['area']) | {'median_size': _median(cascades['size'])}
    return found


def law(areas: np.ndarray) -> dict[str, Any]:
    """Return the power law of cascade areas, or `why` there is none."""
    found: dict[str, Any] = {'count': len(areas), 'largest': int(areas.max(initial=0))}
    try:
        fit = powerlaw.choose_x_min(powerlaw.histogram(areas), x_max=N_BLOCKS)
        error = powerlaw.block_error(areas, fit, np.random.default_rng(1))
    except powerlaw.FitError as error:
        return found | {'why': str(error)}
    return found | {
        'b_value': fit.b_value, 'b_error': max(error, fit.error), 'tau': fit.tau,
        'area_min': fit.x_min, 'area_max': N_BLOCKS, 'fitted': fit.count, 'ks': fit.ks,
    }  # fmt: skip


def write(
    bag: Bag,
    out: Path,
    retracked: Retracked | None = None,
    track: Callable[[list, str], Any] | None = None,
) -> dict[str, Any]:
    """Write report.html, and each figure as SVG, PDF and CSV, into `out`; return the numbers.

    Raises DeviceMissing when `out` cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DeviceMissing(f'{out}: {error.strerror}') from None
    found = numbers(bag)
    if retracked is not None:
        found['retracked'] = {
            'equal': retracked.equal,
            'notes': retracked.notes,
            'topics': {
                name: {'recorded': c.recorded, 'recomputed': c.recomputed,
                       'different': c.different, 'first': c.first}
                for name, c in retracked.topics.items()
            },
        }  # fmt: skip
    drawn = []
    jobs = figures.of(_table(bag, 'slips'), _table(bag, 'cascades'), found)
    for job in track(jobs, 'drawing') if track else jobs:
        drawn.append((job.title, job.draw(out)))
    (out / 'report.html').write_text(_page(bag, found, drawn), encoding='utf-8')
    (out / 'report.json').write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    return found


def _table(bag: Bag, topic: str) -> Table | None:
    name = f'/eol/{topic}'
    return bag.table(name) if bag.counts.get(name) else None


def _latencies(bag: Bag) -> dict[str, dict[str, float]]:
    """From the stamp of the picture to the recorder, where a topic carries that stamp."""
    found = {}
    for topic in ('blocks', 'slips', 'led_commands', 'grain_triggers'):
        table = _table(bag, topic)
        if table is not None:
            late = (seconds(table['log_time']) - seconds(table['stamp'])) * 1e3
            p50, p99 = np.percentile(late, [50, 99])
            found[topic] = {'p50': round(p50, 2), 'p99': round(p99, 2), 'max': round(late.max(), 2)}
    return found


def _median(values: np.ndarray) -> float | None:
    return round(float(np.median(values)), 4) if len(values) else None


def _page(bag: Bag, found: dict[str, Any], drawn: list[tuple[str, str]]) -> str:
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f'<title>{html.escape(bag.path.name)}</title><style>{_STYLE}</style></head><body>',
        f'<h1>{html.escape(bag.path.name)}</h1>',
        f'<p>{found["duration_s"]:.1f} s, {sum(found["messages"].values())} messages. '
        f'Scene {html.escape(bag.about.get("scene_name", "not known"))}; seeds '
        f'{html.escape(" ".join(bag.about.get("seeds", "not known").split()))}.</p>',
        *(f'<p class="warn">{html.escape(line)}</p>' for line in bag.cut_short),
        _verdict(found),
        _rows('Received messages', ('topic', 'messages'), found['messages'].items()),
        _rows('From the stamp of the picture to the recorder, ms', ('topic', 'p50', 'p99', 'max'),
              [(t, r['p50'], r['p99'], r['max']) for t, r in found['latency_ms'].items()]),
        _rows('Lost on the way', ('where', 'topic', 'messages'),
              [(where.replace('_', ' '), topic, count) for where, topics in found['gaps'].items()
               if where != 'received' for topic, count in topics.items() if count]),
        *(f'<h2>{html.escape(title)}</h2>{svg}' for title, svg in drawn),
        '<h2>Versions</h2><pre>', html.escape(bag.about.get('versions', 'not known')), '</pre>',
        '<h2>Scene</h2><pre>', html.escape(bag.about.get('settings', 'not known')), '</pre>',
        '</body></html>',
    ]  # fmt: skip
    return '\n'.join(parts)


def _verdict(found: dict[str, Any]) -> str:
    proof = found.get('retracked')
    if proof is None:
        return ''
    words = 'equal to the last bit' if proof['equal'] else 'NOT equal'
    rows = [(t, c['recorded'], c['recomputed'], c['different'], c['first'])
            for t, c in proof['topics'].items()]
    notes = ''.join(f'<p class="warn">{html.escape(n)}</p>' for n in proof['notes'])
    return _rows(f'Recomputed from the recorded input: {words}',
                 ('topic', 'recorded', 'recomputed', 'different', 'first'), rows) + notes


def _rows(title: str, head: tuple[str, ...], rows: Any) -> str:
    cells = [''.join(f'<td>{html.escape(str(v))}</td>' for v in row) for row in rows]
    if not cells:
        return f'<h2>{html.escape(title)}</h2><p>nothing</p>'
    heads = ''.join(f'<th>{html.escape(h)}</th>' for h in head)
    body = ''.join(f'<tr>{row}</tr>' for row in cells)
    return f'<h2>{html.escape(title)}</h2><table><tr>{heads}</tr>{body}</table>'


def summary(found: dict[str, Any]) -> str:
    """Return the numbers as a few lines for people."""
    lines = [f'{found["bag"]}: {found["duration_s"]:.1f} s']
    if 'slips' in found:
        s = found['slips']
        lines.append(f'{s["count"]} slips, median {s["median_distance_mm"]} mm')
    if 'cascades' in found:
        c = found['cascades']
        if 'why' in c:
            lines.append(f'{c["count"]} cascades, up to {c["largest"]} blocks; {c["why"]}')
        else:
            lines.append(
                f'{c["count"]} cascades, up to {c["largest"]} blocks; b = {c["b_value"]:.2f} +- '
                f'{c["b_error"]:.2f} for areas {c["area_min"]} to {c["area_max"]}'
            )
    for topic, r in found['latency_ms'].items():
        lines.append(f'{topic}: {r["p50"]:.1f} ms after the picture (p99 {r["p99"]:.1f})')
    for topic, c in found.get('retracked', {}).get('topics', {}).items():
        words = 'equal to the last bit' if not c['different'] else f'{c["different"]} differ'
        lines.append(
            f'{topic}: {c["recorded"]} recorded, {c["recomputed"]} recomputed, {words} {c["first"]}'
        )
    lines += found.get('retracked', {}).get('notes', [])
    return '\n'.join(line.rstrip() for line in lines)




_STYLE = """
body { font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse } td, th { padding: .2em .8em; border-bottom: 1px solid #ccc;
text-align: left } svg { max-width: 100%; height: auto } pre { background: #f4f4f4; padding: 1em;
overflow: auto } .warn { border-left: 4px solid #D55E00; padding-left: .6em }
"""

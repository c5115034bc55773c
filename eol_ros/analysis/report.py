# SPDX-License-Identifier: Apache-2.0
"""A bag as one HTML page with its figures inside, and the figures' data as CSV."""

import html
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.analysis import catalogue_file, figures, light, series, uncoupled
from eol_ros.analysis.bag import Bag, Table, seconds
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.analysis.retrack import Retracked
from eol_ros.core.science import powerlaw
from eol_ros.devices.files.names import shown
from eol_ros.errors import writing
from eol_ros.lab.science import alternatives, quiescent
from eol_ros.lab.science.one_over_f import Answer
from eol_ros.settings import TwinSettings
from eol_ros.streams import felt
from eol_ros.streams.graph import topic_of
from eol_ros.streams.slips import START, STOP

# Kept in memory of a bag that is read once: what the report asks for (nothing named: all).
KEPT: dict[str, tuple[str, ...]] = {
    'slips': ('stamp', 'kind', 'block', 'onset', 'speed', 'distance', 'duration'),
    'cascades': (), 'felt_slips': ('stamp', 'kind', 'onset'), 'block_taps': ('stamp',),
    'led_commands': ('stamp', 'white', 'sent'), 'grain_triggers': (), 'felt_triggers': (),
}  # fmt: skip
ASKED = 'Asked of each series against which nothing else speaks: {name}, simulated.'
NOT_ASKED = 'Not asked of any series: {name}, which needs a twin and the recorded path of its rim.'
LATE_MS = 600e3  # a longer delay is none: the stamps are of another clock, or 0
SOUNDS_WITHIN_S = 0.25  # a slip that has not sounded by then does not sound
ONSET_S = 0.02  # by which a knock may come before the onset that images tell


def numbers(
    bag: Bag, answers: list[Answer] | None = None, measured: TwinSettings | None = None
) -> dict[str, Any]:
    """Return the figures of a bag as plain data: counts, losses, latencies, laws.

    answers: what was found of its series (`spectra`). measured: see `catalogue_file.of`.
    """
    table, (packets, own) = recorded_table(bag), _first_packets(bag)
    found: dict[str, Any] = {
        'bag': shown(bag.path),
        'duration_s': round(bag.duration_s, 3),
        'messages': {name: count for name, count in bag.counts.items() if count},
        'gaps': {name: json.loads(text) for name, text in bag.gaps.items() if text[:1] == '{'},
        'latency_ms': _latencies(bag, packets),
        'onset_latency_ms': _onset_latencies(bag, packets, own),
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
                slips['block'][slips['kind'] == START], minlength=table.cells
            ).tolist(),
        }
    felt_slips, lacks = _table(bag, 'felt_slips'), _lacking(bag)
    if felt_slips is not None:
        found['felt_slips'] = _felt(felt_slips['kind'], bag.duration_s)
    if cascades is not None:
        found['cascades'] = law(cascades['area'], table.count)
        found['cascades']['median_size'] = _median(cascades['size'])
        if slips is not None:
            found['cascades']['from_rest_to_rest'] = rest_to_rest(stops, table.count)
        rows = catalogue_file.of(bag, cascades, measured)
        lacks += catalogue_file.left_out(cascades, rows)
        made = measured or recorded_settings(bag, 'twin')
        found['catalogue'] = {'energy': {'sentence': catalogue_file.energy_sentence(rows, made)}}
    flashing = light.ask(bag)
    if flashing is not None:
        found['light'] = flashing
    if lacks := lacks + _of_another_clock(found):
        found['lacking'] = lacks
    if answers is not None:
        found['one_over_f'] = {answer.name: _spectral(answer) for answer in answers}
    return found


def _of_another_clock(found: dict[str, Any]) -> list[str]:
    """Take delays that cannot be meant out of `found`; return what is to be said of them."""
    lines = []
    for kind in ('latency_ms', 'onset_latency_ms'):
        for topic, row in list(found[kind].items()):
            if odd := row.pop('of_another_clock', 0):
                lines.append(
                    f'delay of {topic}: {odd} of {odd + row["count"]} left out, beyond '
                    f'{LATE_MS / 1e3:.0f} s: times are 0 or of another clock'
                )
            if 'p50' not in row:
                if row['count']:
                    said = 'not measured, messages have the time of the image'
                    lines.append(f'delay of {topic}: {said}')
                del found[kind][topic]
    return lines


def _lacking(bag: Bag) -> list[str]:
    """Return what cannot be said of a bag that is empty, foreign, or has no cascades or light."""
    there = [name for name, count in bag.counts.items() if count]
    if not there:
        lines = ['the bag is empty: no messages, so nothing can be said of a table']
    elif not any(topic_of(name, bag.namespace) for name in there):
        few = ', '.join(sorted(there)[:3])
        lines = [f'a bag of something else: none of its {len(there)} topics ({few}) is of eol_ros']
    else:
        lines = []
    if not bag.count('cascades'):
        lines.append('cascades: no law and no energies, since the bag has no cascades')
    if not bag.count('led_commands'):
        lines.append('light: not measured, since the bag has no led_commands')
    return lines


def _felt(kinds: np.ndarray, duration_s: float) -> dict[str, Any]:
    """Return the counts of provisional slips: published, confirmed and retracted by images."""
    told, confirmed, retracted = (
        int((kinds == kind).sum()) for kind in (felt.PROVISIONAL, felt.CONFIRMED, felt.RETRACTED)
    )
    return {
        'told': told, 'confirmed': confirmed, 'retracted': retracted,
        'retracted_percent': round(100 * retracted / max(told, 1), 2),
        'retracted_per_hour': round(3600 * retracted / max(duration_s, 1e-9), 1),
    }  # fmt: skip


def spectra(bag: Bag, measured: TwinSettings | None = None) -> Iterator[Answer]:
    """Yield the verdict on each series of a bag: is it 1/f?"""
    control = uncoupled.of(bag)
    for one in series.of(bag, measured):
        yield series.ask(one, control)


def _spectral(answer: Answer) -> dict[str, Any]:
    """Return an answer as plain data."""
    found: dict[str, Any] = {'answer': answer.answer, 'sentence': answer.sentence}
    if answer.spectrum is None or answer.slope is None or answer.halves is None:
        return found
    best = min(shape.aic for shape in answer.shapes.values())
    return found | {
        'low_hz': answer.spectrum.low_hz, 'high_hz': answer.spectrum.high_hz,
        'beta': answer.slope.beta, 'beta_95': [answer.slope.low, answer.slope.high],
        'beta_lower_half': answer.halves[0].beta, 'beta_upper_half': answer.halves[1].beta,
        'scatter_p': answer.slope.p_value,
        'aic': {name: shape.aic - best for name, shape in answer.shapes.items()},
        'rhythm_hz': answer.rhythm and answer.rhythm[0],
        'controls_beta': {kind: list(both) for kind, both in answer.controls.items()},
        'stationary_p': answer.stationary_p,
    }  # fmt: skip


def law(areas: np.ndarray, blocks: int) -> dict[str, Any]:
    """Return the power law of cascade areas on a table of `blocks`, or `why` there is none."""
    found: dict[str, Any] = {'count': len(areas), 'largest': int(areas.max(initial=0))}
    try:
        law_found = powerlaw.cascade_law(areas, blocks)
    except powerlaw.FitError as error:
        return found | _why_not(error)
    fit, tested = law_found.fit, law_found.tested
    others = alternatives.compare(areas, fit)
    slope: dict[str, Any] = {'nearest_tau': fit.tau}
    if not law_found.rejected:
        slope = {
            'tau': fit.tau, 'b_value': fit.b_value, 'b_error': tested.error,
            'b_interval': [tested.low - 1, tested.high - 1],
        }  # fmt: skip
    return found | {
        'sentence': f'{law_found.sentence}; {alternatives.sentence(others)}',
        'rejected': law_found.rejected, 'p_value': tested.p_value, **slope,
        'effective': tested.effective, 'drift_p': tested.drift_p,
        'b_by_half': [tau - 1 for tau in tested.halves],
        'area_min': fit.x_min, 'area_max': blocks, 'fitted': fit.count, 'ks': fit.ks,
        'b_by_area_min': {str(f.x_min): f.b_value for f in law_found.others},
        'alternatives': {
            a.name: {'log_ratio': a.log_ratio, 'p_value': a.p_value, 'verdict': a.verdict}
            for a in others
        },
    }  # fmt: skip


def _why_not(error: powerlaw.FitError) -> dict[str, Any]:
    """Return why there is no law; `needed`: how many there must be, where there are too few."""
    found: dict[str, Any] = {'why': str(error), 'sentence': str(error)}
    return found | ({'needed': error.needed} if isinstance(error, powerlaw.TooFew) else {})


def rest_to_rest(stops: Table, blocks: int) -> dict[str, Any]:
    """Return the law of the same slips, cut where the whole table rests: another definition.

    stops: STOP rows of `slips`. `at_least`: how many cascades have areas of 1 to `blocks` at least.
    """
    begin_ns = stops['onset'].astype('i8')
    end_ns = begin_ns + (1e9 * stops['duration']).astype('i8')
    areas = quiescent.joined(begin_ns, end_ns, stops['block'])
    found = law(areas, blocks)
    at_least = [int((areas >= a).sum()) for a in range(1, blocks + 1)]
    said = found['sentence'] if 'why' in found else f'{len(areas)} cascades: {found["sentence"]}'
    said = f'the same slips from rest to rest of the whole table: {said}'
    return found | {'at_least': at_least, 'sentence': said}


def write(
    bag: Bag,
    out: Path,
    retracked: Retracked | None = None,
    track: Callable[..., Any] | None = None,
    measured: TwinSettings | None = None,
) -> dict[str, Any]:
    """Write report.html, the catalogue, each figure as SVG, PDF and CSV into `out`; return numbers.

    Raises ConfigError when `out` cannot be written.
    """
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    bag.keep(KEPT, (series.KineticEnergy, uncoupled.RimPath))
    answers = list(_tracked(spectra(bag, measured), 'testing for 1/f', track, len(series.NAMES)))
    found = numbers(bag, answers, measured)
    if retracked is not None:
        found['retracked'] = {
            'equal': retracked.equal, 'verdict': retracked.verdict, 'words': retracked.words(),
            'notes': retracked.notes, 'holes': retracked.holes, 'images': retracked.images,
            'topics': {
                name: {'recorded': c.recorded, 'proved': c.proved, 'recomputed': c.recomputed,
                       'different': c.different, 'first': c.first, 'words': c.words()}
                for name, c in retracked.topics.items()
            },
        }  # fmt: skip
    drawn = []
    slips, cascades = _table(bag, 'slips'), _table(bag, 'cascades')
    table, lit = recorded_table(bag), light.frames(bag, cascades)
    jobs = figures.of(slips, cascades, found, table, answers, lit)
    for job in _tracked(jobs, 'drawing', track):
        drawn.append((job.title, job.draw(out)))
    if cascades is not None:
        origin = {
            'bags': [shown(bag.path)],
            'recorded_with': bag.about.get('versions', 'not known'),
        }
        catalogue_file.write(out, catalogue_file.of(bag, cascades, measured), origin)
    bag.release()
    (out / 'report.html').write_text(_page(bag, found, drawn), 'utf-8', 'replace')
    (out / 'report.json').write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    return found


def _tracked(
    jobs: Iterable, words: str, track: Callable[..., Any] | None, total: int | None = None
) -> Iterable:
    return track(jobs, words, total=total) if track else jobs


def _table(bag: Bag, topic: str) -> Table | None:
    return bag.table(topic) if bag.count(topic) else None


def _latencies(bag: Bag, light: np.ndarray) -> dict[str, dict[str, float]]:
    """Return the latency from the stamp of an image to the recorder, or to the bytes of its light.

    Only the first packet of light for a stamp counts: those that follow show how a flash decays.
    """
    late = {
        topic: np.subtract(*bag.stamps(topic))  # a day of blocks is too much to decode
        for topic in ('blocks', 'slips', 'grain_triggers')
        if bag.count(topic)
    }
    late['led_commands'] = light['sent'] - light['stamp']
    order = [name for name in ('blocks', 'slips', 'led_commands', 'grain_triggers') if name in late]
    return {name: _summary(late[name].astype('i8') * 1e-6) for name in order if len(late[name])}


def _onset_latencies(bag: Bag, light: np.ndarray, own: np.ndarray) -> dict[str, dict[str, float]]:
    """Return the latency from the onset of a slip, as `slips` estimates it, to its light and sound.

    Light: to the bytes of the first packet that carries the stamp of the slip's image; or, where
    the block felt it and lit itself, from the moment of the knock (`own_light`). Sound: to
    the first sample of the first grain of the block for an image from the onset on, which is due
    `latency_s` after the stamp of that image, or as late as its trigger came; or for its knock,
    after `tap_latency_s`. `felt_slips` are told from the moment of the knock.
    """
    slips = _table(bag, 'slips')
    if slips is None:
        return {}
    starts = slips[slips['kind'] == START]
    onset_s = seconds(starts['onset'])
    found = {'slips': seconds(starts['publish_time']) - onset_s}
    if len(light):
        order = np.argsort(light['stamp'])
        at = np.searchsorted(light['stamp'][order], starts['stamp'])
        at = order[np.minimum(at, len(order) - 1)]
        lit = light['stamp'][at] == starts['stamp']
        found['led_commands'] = (seconds(light['sent'][at]) - onset_s)[lit]
    found['own_light'] = seconds(own['sent']) - seconds(own['stamp'])
    knocks = _table(bag, 'felt_slips')
    if knocks is not None:
        knocks = knocks[knocks['kind'] == felt.PROVISIONAL]
        found['felt_slips'] = seconds(knocks['publish_time']) - seconds(knocks['onset'])
    due = [
        (table['block'], seconds(table['stamp']) + early_s,
         np.maximum(seconds(table['stamp']) + latency_s, seconds(table['publish_time'])))
        for topic, setting, early_s in (
            ('grain_triggers', 'latency_s', 0.0), ('felt_triggers', 'tap_latency_s', ONSET_S),
        )
        if (table := _table(bag, topic)) is not None
        and (latency_s := getattr(recorded_settings(bag, 'sound'), setting, None)) is not None
    ]  # fmt: skip
    if due:
        blocks, stamp_s, due_s = (np.concatenate(parts) for parts in zip(*due, strict=True))
        sounded = []
        for block in recorded_table(bag).ids:
            its = np.flatnonzero(blocks == block)
            its = its[np.argsort(stamp_s[its], kind='stable')]
            begins_s = onset_s[starts['block'] == block]
            first = np.searchsorted(stamp_s[its], begins_s)
            last = np.searchsorted(stamp_s[its], begins_s + SOUNDS_WITHIN_S)
            for begin_s, i, j in zip(begins_s, first, last, strict=True):
                if i < j:
                    sounded.append(due_s[its[i:j]].min() - begin_s)
        found['first_sample'] = np.array(sounded)
    return {name: _summary(late_s * 1e3) for name, late_s in found.items() if len(late_s)}


def _first_packets(bag: Bag) -> list[np.ndarray]:
    """Return the first packets of `led_commands` for each image stamp, and for each tap stamp.

    Both have stamp and sent; the second are the flashes of the blocks themselves.
    """
    table, taps = _table(bag, 'led_commands'), _table(bag, 'block_taps')
    kind = [('stamp', 'M8[ns]'), ('sent', 'M8[ns]')]
    if table is None:
        return [np.empty(0, kind), np.empty(0, kind)]
    stamp_ns, sent = table['stamp'].astype('i8'), table['sent']  # integers sort faster than dates
    by_block = np.isin(stamp_ns, taps['stamp'].astype('i8') if taps is not None else [])
    both = []
    for some in map(np.flatnonzero, (~by_block, by_block)):
        stamps, first = np.unique(stamp_ns[some], return_index=True)
        kept = some[np.sort(first[stamps > 0])]
        found = np.empty(len(kept), kind)
        found['stamp'], found['sent'] = table['stamp'][kept], sent[kept]
        both.append(found)
    return both


def _summary(late_ms: np.ndarray) -> dict[str, Any]:
    """Return percentiles of delays. Those beyond `LATE_MS` count apart: of another clock."""
    good = late_ms[np.abs(late_ms) <= LATE_MS]
    odd = len(late_ms) - len(good)
    found: dict[str, Any] = {'count': len(good)} | ({'of_another_clock': odd} if odd else {})
    if not good.any():  # a bag that was made, not recorded, has no delays
        return found
    p50, p99 = np.percentile(good, [50, 99])
    return {
        'p50': round(p50, 2), 'p99': round(p99, 2), 'max': round(float(good.max()), 2),
    } | found  # fmt: skip


def _median(values: np.ndarray) -> float | None:
    values = values[np.isfinite(values)]
    return round(float(np.median(values)), 4) if len(values) else None


def _page(bag: Bag, found: dict[str, Any], drawn: list[tuple[str, str]]) -> str:
    return page_of(shown(bag.path.name), [
        f'<p>{found["duration_s"]:.1f} s, {sum(found["messages"].values())} messages. '
        f'Scene {html.escape(bag.about.get("scene_name", "not known"))}; seeds '
        f'{html.escape(" ".join(bag.about.get("seeds", "not known").split()))}.</p>',
        *(f'<p class="warn">{html.escape(line)}</p>' for line in bag.cut_short),
        _verdict(found),
        paragraphs('What this bag cannot say', found.get('lacking', [])),
        paragraphs('Cascades', _said_of_cascades(found)),
        paragraphs('Light', found.get('light', {}).get('sentences', [])),
        paragraphs('Is it 1/f?', _said_of_spectra(found), _control(bag)),
        *(f'<h2>{html.escape(title)}</h2>{svg}' for title, svg in drawn),
        table_of('Received messages', ('topic', 'messages'), found['messages'].items()),
        _latency_rows('From the stamp of the image to the recorder, of light to its bytes on the '
                      'line, ms', found['latency_ms']),
        _latency_rows('From the onset of a slip, as it was estimated, ms',
                      found['onset_latency_ms']),
        table_of('Lost on the way', ('where', 'topic', 'messages'),
              [(where.replace('_', ' '), topic, count) for where, topics in found['gaps'].items()
               if where != 'received' for topic, count in topics.items() if count]),
        '<h2>Versions</h2><pre>', html.escape(bag.about.get('versions', 'not known')), '</pre>',
        '<h2>Scene</h2><pre>', html.escape(bag.about.get('settings', 'not known')), '</pre>',
    ])  # fmt: skip


def page_of(title: str, parts: Iterable[str]) -> str:
    """Return an HTML page of `parts`."""
    title = html.escape(title)
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    body = '\n'.join([f'<h1>{title}</h1>', *parts])
    return f'<!doctype html><html lang="en"><head>{head}</head><body>\n{body}\n</body></html>'


def _verdict(found: dict[str, Any]) -> str:
    proof = found.get('retracked')
    if proof is None:
        return ''
    rows = [
        (t, c['recorded'], c['proved'], c['recomputed'], c['different'], c['words'])
        for t, c in proof['topics'].items()
    ]
    limits = [*proof['notes'], *_of_images(proof['images']), *proof['holes']]
    notes = ''.join(f'<p class="warn">{html.escape(n)}</p>' for n in limits)
    return (
        table_of(
            f'Recomputed from the recorded input: {proof["words"]}',
            ('topic', 'recorded', 'provable', 'recomputed', 'different', ''),
            rows,
        )
        + notes
    )


def _of_images(images: dict[str, int]) -> list[str]:
    """Return how many images the proof lacks, for people; nothing where it lacks none."""
    if not images or not images['lacking']:
        return []
    return [f'the tracker saw {images["seen"]} images, of which the bag lacks {images["lacking"]}']


def _said_of_cascades(found: dict[str, Any]) -> list[str]:
    """Return the verdicts on the catalogue of cascades, for people; none where there is none."""
    if 'cascades' not in found:
        return []
    c = found['cascades']
    if 'why' in c:
        whole = f'{c["why"]}; the largest had {c["largest"]} blocks'
    else:
        whole = f'{c["count"]} cascades, up to {c["largest"]} blocks: {c["sentence"]}'
    said = [whole]
    if (other := c.get('from_rest_to_rest')) is not None:
        few = f'not fitted, too few: {other["count"]} cascades from rest to rest of the whole table'
        few += f', {other.get("needed")} needed'
        said.append(few if 'needed' in other else other['sentence'])
    return [*said, found['catalogue']['energy']['sentence']]


def _control(bag: Bag) -> str:
    return (ASKED if uncoupled.there(bag) else NOT_ASKED).format(name=uncoupled.Uncoupled.NAME)


def _said_of_spectra(found: dict[str, Any]) -> list[str]:
    """Return the verdict on each series for people; what holds for several is said once."""
    said: dict[str, list[str]] = {}
    for name, answer in found.get('one_over_f', {}).items():
        said.setdefault(answer['sentence'].removeprefix(f'{name}: '), []).append(name)
    return [f'{", ".join(names)}: {words}' for words, names in said.items()]


def paragraphs(title: str, said: list[str], last: str = '') -> str:
    """Return sentences as HTML under a heading, nothing without any."""
    if not said:
        return ''
    lines = ''.join(f'<p>{html.escape(line)}</p>' for line in [*said, last] if line)
    return f'<h2>{html.escape(title)}</h2>{lines}'


def _latency_rows(title: str, latencies: dict[str, dict[str, float]]) -> str:
    rows = [(t, r['p50'], r['p99'], r['max'], r['count']) for t, r in latencies.items()]
    return table_of(title, ('to', 'p50', 'p99', 'max', 'count'), rows)


def table_of(title: str, head: tuple[str, ...], rows: Any) -> str:
    """Return rows as an HTML table under a heading."""
    cells = [''.join(f'<td>{html.escape(str(v))}</td>' for v in row) for row in rows]
    if not cells:
        return f'<h2>{html.escape(title)}</h2><p>nothing</p>'
    heads = ''.join(f'<th>{html.escape(h)}</th>' for h in head)
    body = ''.join(f'<tr>{row}</tr>' for row in cells)
    return f'<h2>{html.escape(title)}</h2><table><tr>{heads}</tr>{body}</table>'


def summary(found: dict[str, Any]) -> str:
    """Return the numbers as a few lines for people."""
    lines = [f'{found["bag"]}: {found["duration_s"]:.1f} s']
    lines += found.get('lacking', [])
    if 'slips' in found:
        s = found['slips']
        far_mm = s['median_distance_mm']
        far = '' if far_mm is None else f', median distance {far_mm:.3g} mm'
        lines.append(f'{s["count"]} slips{far}')
    if 'felt_slips' in found:
        f = found['felt_slips']
        lines.append(
            f'{f["told"]} provisional slips, {f["retracted"]} retracted: '
            f'{f["retracted_percent"]} %, {f["retracted_per_hour"]} an hour'
        )
    if 'cascades' in found:
        lines += _said_of_cascades(found)
    lines += found.get('light', {}).get('sentences', [])
    lines += _said_of_spectra(found)
    for begin, latencies in (
        ('the image', found['latency_ms']),
        ('the onset of the slip', found['onset_latency_ms']),
    ):
        for topic, r in latencies.items():
            ms = f'{r["p50"]:.1f} ms after {begin}'
            lines.append(f'median delay of {topic}: {ms} (99 % within {r["p99"]:.1f} ms)')
    if proof := found.get('retracked'):
        for topic, c in proof['topics'].items():
            counts = f'{c["recorded"]} recorded, {c["recomputed"]} recomputed'
            lines.append(f'{topic}: {counts}, {c["words"]}')
        lines += [*proof['notes'], *_of_images(proof['images']), *proof['holes']]
        lines.append(f'recomputed from the recorded input: {proof["words"]}')
    return '\n'.join(line.rstrip() for line in lines)


STYLE = """
body { font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse } td, th { padding: .2em .8em; border-bottom: 1px solid #ccc;
text-align: left } svg { max-width: 100%; height: auto } pre { background: #f4f4f4; padding: 1em;
overflow: auto } .warn { border-left: 4px solid #D55E00; padding-left: .6em }
"""

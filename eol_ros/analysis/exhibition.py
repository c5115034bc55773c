# SPDX-License-Identifier: Apache-2.0
"""Many bags as one: a whole exhibition, day by day and hour by hour.

Of each bag only what the nodes have told is read (slips, cascades, knocks), once; images and places
of blocks are left alone. What is kept of it is small, so that hundreds of bags fit into memory.
"""

import datetime
import html
import json
import math
import struct
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from eol_ros.analysis import catalogue_file, figures, report
from eol_ros.analysis.bag import Bag, open_bag
from eol_ros.analysis.recorded_settings import recorded_table
from eol_ros.core.science import powerlaw
from eol_ros.core.table import Table, check_same
from eol_ros.devices.bag.reader import bags_in as bags_of_folder
from eol_ros.devices.bag.writer import REPLAY_OF, SAMPLE
from eol_ros.devices.files.names import shown
from eol_ros.disk import DAMAGED
from eol_ros.errors import ConfigError, EolError, writing
from eol_ros.streams.slips import START

TOPICS = ('slips', 'cascades', 'block_taps')
HOUR_NS, S_NS = 3600 * 10**9, 10**9
VISIT_GAP_S = 20.0  # of rest: what follows is another visit
DEAD = 20.0  # slips (or knocks) that a block would have had: none by chance once in 5e8
LEAST_SHARE = 0.5  # of an equal share, of a block that has never slipped
FEWEST_SINGLES = 30  # of a day or an hour, for a median
FEWEST_SPANS = 3
WAYS = {  # in which a block can be silent, in words
    'slips': ('slips', 'slipped', 'slip no longer'),
    'taps': ('knocks', 'told of a knock', 'tell of knocks no longer'),
}
NOT_TOLD = 'not reported for many bags: energies, 1/f, light; `eol report BAG` has them'
ALL_S = 1.0  # a bag shorter than that is none of an exhibition


@dataclass
class Digest:
    """What is kept of one bag. Hours are counted from 1970 in local time."""

    path: str
    start_ns: int
    end_ns: int
    zone_ns: int  # local time less UTC, at its start
    hours: dict[int, dict[str, float]]
    slips: np.ndarray  # (k, 2) int64: ns, block
    taps: np.ndarray
    rows: np.ndarray  # of the catalogue
    table: Table
    version: str = ''
    notes: list[str] = field(default_factory=list)


def bags_in(paths: Iterable[str | Path]) -> tuple[list[Path], list[str]]:
    """Return the bags named, and of folders of bags all that are in them; and what is left out.

    Left out are files beside the bags of a folder: most are made of one of these, such as by `eol
    bag cut`, and what is in them would count twice. Raises ConfigError where a folder has none.
    """
    found: dict[Path, None] = {}
    beside: list[Path] = []
    for given in map(Path, paths):
        inner = bags_of_folder(given)
        if inner:
            beside += sorted(given.glob('*.mcap'))
        elif given.is_dir() and not any(given.glob('*.mcap*')):
            raise ConfigError(f'{given}: no bags in this folder')
        found |= dict.fromkeys(inner or [given])
    return list(found), [f'{p}: a file beside the bags, left out' for p in beside if p not in found]


def digest(path: str | Path, zone: datetime.tzinfo | None = None) -> Digest | str:
    """Return what is kept of one bag, or why it is left out; zone: None is that of the machine."""
    try:
        bag = open_bag(path)
        about = bag.about
        if REPLAY_OF in about:
            return f'{path}: a replay, left out'
        if SAMPLE in about:
            return f'{path}: the sample that ships, left out'
        if bag.duration_s < ALL_S:
            return f'{path}: {bag.duration_s:.1f} s, left out'
        return _digest(bag, zone)
    except EolError as error:
        return f'{path}: left out: {error}'
    except (*DAMAGED, ArithmeticError, struct.error) as error:  # of another program
        return f'{path}: left out: cannot be read as a bag of eol_ros ({error!r})'


def _digest(bag: Bag, zone: datetime.tzinfo | None) -> Digest:
    begin = datetime.datetime.fromtimestamp(bag.start_ns / S_NS, datetime.timezone.utc)
    offset = begin.astimezone(zone).utcoffset() or datetime.timedelta()
    zone_ns = round(offset.total_seconds()) * S_NS
    bag.keep(dict.fromkeys(TOPICS, ()))
    tables = {topic: bag.table(topic) for topic in TOPICS if bag.count(topic)}
    slips, taps = np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64)
    if 'slips' in tables:
        starts = tables['slips'][tables['slips']['kind'] == START]
        slips = _pairs(starts['stamp'], starts['block'])
    if 'block_taps' in tables:
        taps = _pairs(tables['block_taps']['stamp'], tables['block_taps']['block'])
    rows = catalogue_file.of(bag, tables.get('cascades'))
    found = Digest(
        shown(bag.path), bag.start_ns, bag.end_ns, zone_ns, {}, slips, taps, rows,
        recorded_table(bag),
        version=bag.about.get('versions', '').splitlines()[0] if bag.about.get('versions') else '',
        notes=[
            *bag.cut_short, *bag.damage, *catalogue_file.left_out(tables.get('cascades'), rows),
        ],
    )  # fmt: skip
    first, last = ((ns + zone_ns) // HOUR_NS for ns in (bag.start_ns, bag.end_ns))
    for hour in range(first, last + 1):
        begin_ns = hour * HOUR_NS - zone_ns
        up_ns = min(bag.end_ns, begin_ns + HOUR_NS) - max(bag.start_ns, begin_ns)
        found.hours[hour] = {'up_s': up_ns / S_NS} | dict.fromkeys(_COUNTED, 0.0)
    seconds = np.unique(slips[:, 0] // S_NS)
    visits = seconds[np.diff(seconds, prepend=-(10**6)) > VISIT_GAP_S]
    for name, times_ns in (
        ('slips', slips[:, 0]), ('cascades', rows['onset_ns']), ('active_s', seconds * S_NS),
        ('visits', visits * S_NS),
    ):  # fmt: skip
        hours, counts = np.unique((times_ns + zone_ns) // HOUR_NS, return_counts=True)
        for hour, count in zip(hours.tolist(), counts.tolist(), strict=True):
            if hour in found.hours:
                found.hours[hour][name] += count
    return found


_COUNTED = ('slips', 'cascades', 'active_s', 'visits')


def _pairs(times: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    pairs = np.stack([times.astype('i8'), blocks.astype(np.int64)], axis=1)
    return pairs[np.argsort(pairs[:, 0], kind='stable')]


def numbers(digests: list[Digest], left_out: list[str]) -> dict[str, Any]:
    """Return the exhibition as plain data."""
    if not digests:
        raise ConfigError('no bag that can be reported: ' + '; '.join(left_out))
    digests = sorted(digests, key=lambda d: d.start_ns)
    table = _one_table(digests)
    hours: dict[int, Counter] = {}
    for hour, counts in (item for one in digests for item in one.hours.items()):
        hours.setdefault(hour, Counter()).update(counts)
    rows = np.concatenate([d.rows for d in digests])
    days = _days(digests, hours, rows, table.count)
    return {
        'bags': len(digests), 'left_out': sorted(left_out),
        'begin': _iso(digests[0].start_ns, digests[0].zone_ns),
        'end': _iso(max(d.end_ns for d in digests), digests[-1].zone_ns),
        'up_s': sum(h['up_s'] for h in hours.values()),
        'slips': int(sum(h['slips'] for h in hours.values())),
        'active_s': int(sum(h['active_s'] for h in hours.values())),
        'visits': int(sum(h['visits'] for h in hours.values())),
        'days': days,
        'hours': [{'hour': _iso(h * HOUR_NS, 0)[:13], **hours[h]} for h in sorted(hours)],
        'friction': _friction(digests),
        'dead_blocks': _dead(digests, 'slips') + _dead(digests, 'taps'),
        'versions': sorted({d.version for d in digests if d.version}),
        'notes': [note for d in digests for note in d.notes],
        'cascades': report.law(rows['area'], table.count),
    }  # fmt: skip


def _one_table(digests: list[Digest]) -> Table:
    """Return the table of all bags; raises ConfigError where they were recorded at several."""
    first = digests[0]
    for one in digests:
        advice = 'report the bags of each table apart'
        check_same(one.table, first.table, one.path, first.path, advice)
    return first.table


def _days(
    digests: list[Digest], hours: dict[int, Counter], rows: np.ndarray, blocks: int
) -> list[dict[str, Any]]:
    zone_ns = np.concatenate([np.full(len(d.rows), d.zone_ns) for d in digests])
    day_of = (rows['onset_ns'] + zone_ns) // (24 * HOUR_NS)
    found = []
    for day in sorted({hour // 24 for hour in hours}):
        there = [(h, c) for h, c in hours.items() if h // 24 == day]
        starts = [d for d in digests if (d.start_ns + d.zone_ns) // (24 * HOUR_NS) == day]
        edges = [
            (max(d.start_ns + d.zone_ns, day * 24 * HOUR_NS),
             min(d.end_ns + d.zone_ns, (day + 1) * 24 * HOUR_NS))
            for d in digests
        ]  # fmt: skip
        edges = [(begin, end) for begin, end in edges if begin < end]
        opened_ns = max(e for _, e in edges) - min(b for b, _ in edges)
        law = report.law(rows['area'][day_of == day], blocks)
        up_s = sum(c['up_s'] for _, c in there)
        found.append({
            'day': _iso(day * 24 * HOUR_NS, 0)[:10], 'starts': len(starts), 'up_s': up_s,
            'up_share': min(1.0, up_s / (opened_ns / S_NS)),
            **{name: int(sum(c[name] for _, c in there)) for name in _COUNTED},
            'b_value': law.get('b_value'), 'b_error': law.get('b_error'),
            'p_value': law.get('p_value'), 'law': _law_of_day(law),
        })  # fmt: skip
    return found


def _law_of_day(law: dict[str, Any]) -> str:
    """Return what a day says that the law of all days does not, in a few words."""
    if 'needed' in law:
        return 'too few'
    if 'why' in law:
        return str(law['why'])
    if law['rejected']:
        return f'rejected, p {law["p_value"]:.2g}'
    return f'b = {law["b_value"]:.2f} +- {law["b_error"]:.2f}, p {law["p_value"]:.2g}'


def _friction(digests: list[Digest]) -> dict[str, Any]:
    """Whether single slips, which no neighbour helps, go further or less far as time passes.

    Their distance is proportional to the friction drop as long as the springs stay the same.
    """
    singles = [(d.rows[d.rows['size'] == 1], d.zone_ns) for d in digests]
    rows = np.concatenate([r for r, _ in singles])
    local = np.concatenate([r['onset_ns'] + zone for r, zone in singles])
    good = rows['potency_m'] > 0
    rows, local = rows[good], local[good]
    relative = np.empty(len(rows))
    for block in digests[0].table.ids.tolist():
        own = rows['nucleus'] == block
        if own.any():
            relative[own] = rows['potency_m'][own] / np.median(rows['potency_m'][own])
    spans = {'day': 24 * HOUR_NS, 'hour': HOUR_NS}
    kept = {}
    for name, span_ns in spans.items():
        every, counts = np.unique(local // span_ns, return_counts=True)
        kept[name] = every[counts >= FEWEST_SINGLES]
    words = next((name for name in spans if len(kept[name]) >= FEWEST_SPANS), None)
    if words is None:
        why = f'{len(rows)} single slips: at least {FEWEST_SINGLES} in each of {FEWEST_SPANS}'
        return {'sentence': f'drift of friction: {why} hours are needed'}
    at, span_ns = kept[words], spans[words]
    medians = np.array([np.median(relative[local // span_ns == s]) for s in at])
    slope, _, low, high = stats.theilslopes(medians, at.astype(float))
    p_value = float(stats.kendalltau(at, medians).pvalue)
    p_value = 1.0 if math.isnan(p_value) else p_value  # all medians alike
    change = f'{100 * slope:+.2g} % a {words} ({100 * low:+.2g} to {100 * high:+.2g})'
    if p_value < powerlaw.REJECTED:
        said = f'single slips become {"longer" if slope > 0 else "shorter"}: {change}'
    else:
        said = f'no trend in the distance of single slips: {change}'
    return {
        'sentence': f'drift of friction: {said}, Theil-Sen over {len(at)} {words}s, Kendall p '
        f'{p_value:.2g}, n {len(rows)}; the distance goes with mu_s - mu_k while springs stay',
        'per': words, 'slope': float(slope), 'low': float(low), 'high': float(high),
        'p_value': p_value, 'medians': medians.tolist(),
        'at': [_iso(int(s) * span_ns, 0)[:13] for s in at],
    }  # fmt: skip


def _dead(digests: list[Digest], what: str) -> list[dict[str, Any]]:
    """Return the blocks that have stopped to slip (or to report knocks) while others go on."""
    pairs = np.concatenate([getattr(d, what) for d in digests])
    pairs = pairs[np.argsort(pairs[:, 0], kind='stable')]
    table, found = digests[0].table, []
    for block in table.ids.tolist():
        own = np.flatnonzero(pairs[:, 1] == block)
        last = own[-1] + 1 if len(own) else 0
        after = len(pairs) - last
        share = max(len(own) / last if last else 0.0, LEAST_SHARE / table.count)
        if after * share < DEAD:
            continue
        found.append({
            'block': block, 'what': what, 'others': int(after), 'expected': float(after * share),
            'since': _since(digests, int(pairs[last - 1, 0])) if last else None,
        })  # fmt: skip
    return found


def _said_of_dead(blocks: list[dict[str, Any]]) -> list[str]:
    """Return which blocks are silent, for people: what holds for several is said once."""
    never: dict[tuple[str, ...], list[int]] = {}
    for number in sorted({b['block'] for b in blocks if b['since'] is None}):
        ways = tuple(b['what'] for b in blocks if b['block'] == number and b['since'] is None)
        never.setdefault(ways, []).append(number)
    said = []
    for ways, numbers in never.items():
        due = ', '.join(
            f'{min(b["expected"] for b in blocks if b["what"] == way):.0f} {WAYS[way][0]}'
            for way in ways
        )
        said.append(
            f'{_blocks(numbers)} never {" nor ".join(WAYS[way][1] for way in ways)} '
            f'(half an equal share: {due})'
        )
    for way, (events, _, no_longer) in WAYS.items():
        those = [b for b in blocks if b['what'] == way and b['since'] is not None]
        if those:
            each = ', '.join(
                f'block {b["block"]} since {b["since"]} ({b["expected"]:.0f})' for b in those
            )
            said.append(
                f'{no_longer}: {each}; in brackets: how many of the {events} after that would have '
                'been its, by its share before'
            )
    return said or ['no block has fallen silent']


def _blocks(numbers: list[int]) -> str:
    return f'block {numbers[0]}' if len(numbers) == 1 else f'blocks {", ".join(map(str, numbers))}'


def _said_of_days(days: list[dict[str, Any]]) -> list[str]:
    """Return how the law of the single days differs from that of all, for people."""
    asked = [day for day in days if day['p_value'] is not None]
    if len(days) < 2 or not asked:
        return []
    rejected = [day for day in asked if day['p_value'] < powerlaw.REJECTED]
    held = [day['b_value'] for day in asked if day not in rejected]
    said = (
        f'day by day: a power law is rejected on {len(rejected)} of {len(asked)} days that have '
        f'{powerlaw.FEWEST_CASCADES} cascades and more'
    )
    if held:
        said += f'; on the others b is {min(held):.2f} to {max(held):.2f}'
    return [said]


def _since(digests: list[Digest], ns: int) -> str:
    zone_ns = max((d for d in digests if d.start_ns <= ns), key=lambda d: d.start_ns).zone_ns
    return _iso(ns, zone_ns)[:16].replace('T', ' ')


def _iso(ns: int, zone_ns: int) -> str:
    """Return local time; `ns` with a zone of 0 is local already."""
    whole_s = (ns + zone_ns) // S_NS
    return datetime.datetime.fromtimestamp(whole_s, datetime.timezone.utc).isoformat()[:19]


def sentences(found: dict[str, Any]) -> list[str]:
    """Return the exhibition for people, a sentence a line."""
    hours = found['up_s'] / 3600
    share = found['active_s'] / found['up_s'] if found['up_s'] else 0.0
    c = found['cascades']
    return [
        f'{found["bags"]} bags, {found["begin"][:16].replace("T", " ")} to '
        f'{found["end"][:16].replace("T", " ")}: {hours:.1f} hours on {len(found["days"])} days',
        f'{found["slips"]} slips in {found["visits"]} visits (parted by {VISIT_GAP_S:g} s of '
        f'rest); something slipped in {100 * share:.0f} % of all seconds',
        f'{c["count"]} cascades, up to {c["largest"]} blocks: {c["sentence"]}',
        *_said_of_days(found['days']),
        found['friction']['sentence'],
        *_said_of_dead(found['dead_blocks']),
        NOT_TOLD,
        *found['notes'],
        *found['left_out'],
    ]


def write(
    digests: list[Digest], left_out: list[str], out: Path, track: Callable[..., Any] | None = None
) -> dict[str, Any]:
    """Write report.html, report.json, the figures and the catalogue into `out`."""
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    found = numbers(digests, left_out)
    rows = np.concatenate([d.rows for d in digests])
    catalogue_file.write(out, rows, {
        'bags': sorted(d.path for d in digests), 'recorded_with': found['versions'],
    })  # fmt: skip
    drawn = []
    jobs = figures.of_exhibition(rows['area'], found, digests[0].table.count)
    for job in track(jobs, 'drawing') if track else jobs:
        drawn.append((job.title, job.draw(out)))
    (out / 'report.html').write_text(_page(found, drawn), 'utf-8', 'replace')
    (out / 'report.json').write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    return found


def _page(found: dict[str, Any], drawn: list[tuple[str, str]]) -> str:
    days = [
        (d['day'], d['starts'], f'{d["up_s"] / 3600:.2f}', f'{100 * d["up_share"]:.1f}',
         d['visits'], f'{d["active_s"] / 60:.0f}', d['slips'], d['cascades'], d['law'])
        for d in found['days']
    ]  # fmt: skip
    hours = [
        (h['hour'].replace('T', ' ') + ':00', f'{h["up_s"] / 60:.0f}', int(h['visits']),
         f'{h["active_s"] / 60:.1f}', int(h['slips']), int(h['cascades']))
        for h in found['hours']
    ]  # fmt: skip
    return report.page_of('Exhibition', [
        report.paragraphs('In short', sentences(found)),
        report.table_of(
            'Day by day, local time',
            ('day', 'starts', 'hours on', '% of open', 'visits', 'active min', 'slips', 'cascades',
             'power law of areas'), days,
        ),
        *(f'<h2>{html.escape(title)}</h2>{svg}' for title, svg in drawn),
        report.table_of(
            'Hour by hour, local time',
            ('hour', 'min on', 'visits', 'active min', 'slips', 'cascades'), hours,
        ),
        '<h2>Recorded with</h2><pre>', html.escape('\n'.join(found['versions']) or 'not known'),
        '</pre>',
    ])  # fmt: skip

# SPDX-License-Identifier: Apache-2.0
"""eol bench soak: days of exhibition at a high rate, and hours of faults.

exhibition: a run of the twin (blocks, knocks, requests; no images) is played round and round,
as fast as its readers keep up with, through motion, light, grains, sound, walls, panel and
recorder, until so many hours of recorded time have passed. The recorder keeps to a budget of disk.

Ctrl-C ends either early. What each run showed is appended to benchmarks/soak.jsonl, whose sum is
printed and published: the hours may be done in several runs.

faults: the whole rehearsal in real time, with a board on a pty, JACK's dummy driver as sound card,
images in the bag, a browser before the panel. One process after another is killed (SIGKILL) or
stopped (SIGSTOP); between these the system clock is stepped, the disk filled, the board and the
sound card pulled, the page reloaded, and eight processes that never sleep run beside it. A fault
is over when every node is OK again, blocks are published, and what was killed is another process.
A process that reads only the wire and the disk looks for silences that no status reported.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from support.jack import Jack
from support.running import Graph, stand_in

from benchmarks import soak_faults, soak_total
from benchmarks.machine import tell
from benchmarks.soak_proof import Held, growth, held, prove
from benchmarks.soak_rate import Rate, Totals
from eol_ros import interrupts
from eol_ros.analysis import open_bag
from eol_ros.errors import EolError, UsageError
from eol_ros.verbs.progress import track

HELP = 'Run days of exhibition at a high rate and hours of faults; report losses and growth.'
EXAMPLES = [
    'eol bench soak --json > soak.json          # 72 hours as fast as it goes, 2 hours of faults',
    'eol bench soak --parts faults --faults-hours 0.2',
    'eol bench soak --parts exhibition --hours 2 --bag bags/sample   # again, until it is enough',
]
PARTS = ('exhibition', 'faults')
FIRST_RATE = 3.0  # where nothing is known of the machine
LOOK_S = 5.0  # between two looks at the graph


class Look(NamedTuple):
    """What a graph that plays a run shows at one moment, counted from its start."""

    played_s: float
    counts: dict[str, int]  # lost, restarts, underruns, late
    held: dict[str, Held]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--parts', default=','.join(PARTS), help='parts, separated by commas')
    parser.add_argument('--hours', type=float, default=72.0, help='recorded time of the exhibition')
    parser.add_argument(
        '--rate', type=float, help='speed of the exhibition, times real time (default: the highest)'
    )
    parser.add_argument(
        '--faults-hours',
        type=float,
        default=2.0,
        help='duration of the fault test, hours of real time',
    )
    parser.add_argument('--fps', type=float, default=60.0, help='image rate of the fault test, Hz')
    parser.add_argument(
        '--run-minutes',
        type=float,
        default=10.0,
        help='duration of the run that the exhibition plays',
    )
    parser.add_argument('--bag', type=Path, help='play this run instead of recording one')
    parser.add_argument('--keep', type=Path, help='folder in which logs and bags are kept')
    parser.add_argument(
        '--results', type=Path, default=soak_total.RESULTS, metavar='FILE',
        help='file to which this run is appended (default benchmarks/soak.jsonl)',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=1, help='seed of the order of the faults')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print; exit code 1 where something did not come back or was lost uncounted."""
    parts = args.parts.split(',')
    for part in parts:
        if part not in PARTS:
            raise UsageError(f'--parts {part}: there are {", ".join(PARTS)}')
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix='eol-soak-', ignore_cleanup_errors=True) as place:
        folder = args.keep or Path(place)
        folder.mkdir(parents=True, exist_ok=True)
        if 'exhibition' in parts:
            found['exhibition'] = exhibition(
                folder, args.hours, args.rate, args.run_minutes, args.bag
            )
        if 'faults' in parts:
            found['faults'] = soak_faults.measure(folder, args.faults_hours, args.seed, args.fps)
    soak_total.append(soak_total.rows(found), args.results)
    found['all_runs'] = soak_total.total(soak_total.load(args.results))
    tell(found, args.json, table)
    return int(any(found[part]['faults'] for part in PARTS if part in found))


def exhibition(
    folder: Path,
    hours: float,
    rate: float | None = None,
    run_minutes: float = 10.0,
    bag: Path | None = None,
) -> dict[str, Any]:
    """Play a run in a loop until `hours` of recorded time have passed; return the figures.

    rate: None: the highest that the readers keep up with.
    """
    # absolute, because a scene in another folder names it
    bag = bag.resolve() if bag else recorded(folder, run_minutes)
    place = Path(tempfile.mkdtemp(prefix='exhibition-', dir=folder))
    pace = None if rate else Rate(FIRST_RATE)
    changed = {
        'replay': {'rate': pace.rate if pace else rate, 'loop': True},
        'leds': {'port': 'pty'},
        'recorder': {'images': 'none', 'keep_gb': 0.5, 'split_minutes': 10.0, 'min_free_gb': 0.5},
    }
    jack = Jack('eol-soak')
    path = stand_in('playback', place, film=None, bag=bag, changed=changed)
    jack.start()
    faults: list[str] = []
    looks: list[Look] = []
    try:
        with Graph(path, place / 'bags', watched=(), environment=jack.environment) as graph:
            graph.wait_until_ok()
            begun = time.monotonic()
            steps = _play(graph, open_bag(bag).duration_s, hours * 3600, pace, looks)
            try:
                for _ in track(steps, 'exhibition', total=100):
                    pass
                rows = graph.status()['nodes']
                faults += [f'{row["node"]}: {row["text"]}' for row in rows if row['level']]
            except KeyboardInterrupt:  # it ends the graph, too
                interrupts.caught()
            took_s = time.monotonic() - begun
            code = graph.stop()
    finally:
        jack.stop()
    faults += [f'bringup ended with exit code {code}'] if code else []
    return figures(looks, took_s, prove(place / 'bags'), faults)


def figures(
    looks: list[Look], took_s: float, bags: dict[str, Any], faults: list[str]
) -> dict[str, Any]:
    """Return what an exhibition of `took_s` has shown."""
    played_s, counts, _ = looks[-1] if looks else Look(0.0, {}, {})
    rows = growth([look.held for look in looks])
    grown = [f'{row["name"]} grows: {row}' for row in rows if not row['flat']]
    return {
        'hours': round(played_s / 3600, 4),
        'took_hours': round(took_s / 3600, 3),
        'times_real_time': round(played_s / took_s, 2),
        **{name: counts.get(name, 0) for name in ('restarts', 'lost', 'underruns', 'late')},
        'growth': rows,
        'bags': bags,
        'faults': faults + grown + bags.pop('faults'),
    }


def _play(
    graph: Graph, length_s: float, until_s: float, pace: Rate | None, looks: list[Look]
) -> Iterator[int]:
    """Look at the graph until it has played `until_s`; yield once a hundredth of it."""
    totals, done = Totals(), 0
    while done < 100:
        time.sleep(LOOK_S)
        seen = _look(graph, length_s, pace, totals)
        if seen is None:
            continue
        looks.append(seen)
        percent = min(int(100 * seen.played_s / until_s), 100)
        for _ in range(percent - done):
            yield percent
        done = max(done, percent)


def _look(graph: Graph, length_s: float, pace: Rate | None, totals: Totals) -> Look | None:
    """Return what the graph shows, None where it does not answer; change the rate of its replay."""
    try:
        status = graph.status()
        processes = held(graph)
    except EolError:
        return None
    values = {row['node']: row['values'] for row in status['nodes']}
    played, sound = values['replay'], values['sound']
    played_s = played.get('rounds', 0) * length_s + played.get('position_s', 0.0)
    counts = totals.add({
        'restarts': status['restarts'],
        'lost': values['recorder'].get('lost', 0),  # of this bag; each round begins another
        'underruns': sound.get('underruns', 0),
        'late': sound.get('late', 0),
    })  # fmt: skip
    if pace and (rate := pace.look(played_s, counts['lost'])):
        words = ['-m', 'eol_ros', 'param', 'set', 'replay', 'rate', str(rate)]
        subprocess.run(
            [sys.executable, *words], check=False, stdout=subprocess.DEVNULL,
            env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
        )  # fmt: skip
    return Look(played_s, counts, processes)


def recorded(folder: Path, minutes: float) -> Path:
    """Record the rehearsal for so long, without images; return the bag."""
    folder = Path(tempfile.mkdtemp(prefix='run-', dir=folder))
    changed = {'recorder': {'images': 'none'}, 'sound': {'device': 'wav'}}
    path = stand_in('rehearsal', folder, film=None, bag=None, changed=changed)
    with Graph(path, folder / 'bags', watched=()) as graph:
        graph.wait_until_ok()
        for _ in track(range(round(minutes * 60)), 'recording a run'):
            time.sleep(1)
        if graph.stop():
            raise EolError(f'the run was not recorded: {graph.log.read_text()}')
    return next(path for path in (folder / 'bags').iterdir() if path.is_dir())


def table(found: dict[str, Any]) -> str:
    """Return the results for people."""
    lines = []
    if part := found.get('exhibition'):
        lines += [
            f'exhibition: {part["hours"]:g} h in {part["took_hours"]:g} h, '
            f'{part["times_real_time"]:g} times real time; {part["restarts"]} restarts; '
            f'recorder: {part["lost"]} lost; '
            f'sound: {part["underruns"]} underruns, {part["late"]} late',
            *_growth(part),
            _bags(part),
        ]
    if part := found.get('faults'):
        lines += [
            f'faults: {part["count"]} ({part["kills"]} kills) in {part["hours"]:g} h; '
            f'{_well(part)}',
            *(f'not done here: {words}' for words in part['left_out']),
            *_kinds(part), *_growth(part), _bags(part),
        ]  # fmt: skip
    for part in found.values():
        if isinstance(part.get('faults'), list):
            lines += [f'NOT WELL: {line}' for line in part['faults']]
    if part := found.get('all_runs'):
        lines.append(soak_total.text(part))
    return '\n'.join(lines)


def _well(part: dict[str, Any]) -> str:
    return f'within 10 s {part["within_10_s"]}, others disturbed {part["disturbed"]}'


def _kinds(part: dict[str, Any]) -> list[str]:
    lines = [f'{"fault":28} {"count":>6} {"p50 s":>7} {"p99 s":>7} {"worst":>7}']
    for row in part['kinds']:
        lines.append(
            f'{row["kind"]:28} {row["count"]:6} {row["p50_s"]:7.1f} {row["p99_s"]:7.1f} '
            f'{row["worst_s"]:7.1f}'
        )
    return lines


def _growth(part: dict[str, Any]) -> list[str]:
    head = f'{"process":28} {"open files":>15} {"threads":>13} {"PSS MB":>19}  grown by (95 %)'
    lines = [head]
    for row in part['growth']:
        pairs = [f'{a:g} -> {b:g}' for a, b in (row[n] for n in Held._fields)]
        line = f'{row["name"]:28} {pairs[0]:>15} {pairs[1]:>13} {pairs[2]:>19}'
        if row['growth_mb']:
            line += '  {:g} ({:g} to {:g})'.format(*row['growth_mb'])
        lines.append(line)
    return lines


def _bags(part: dict[str, Any]) -> str:
    bags = part['bags']
    return (
        f'bags: {bags["count"]}, proved to the last byte; {bags["unreadable"]} not readable, '
        f'{bags["cut"]} cut off by a kill and read; messages missing {bags["missing"]}, of these '
        f'not counted {bags["uncounted"]}'
    )

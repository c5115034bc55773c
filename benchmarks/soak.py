# SPDX-License-Identifier: Apache-2.0
"""eol bench soak: days of exhibition at a high rate, and hours of faults.

exhibition: a run of the twin (blocks, knocks, requests; no images) is played round and round,
several times as fast as it was, through motion, light, grains, sound, walls, panel and recorder,
until so many hours of recorded time have passed. The recorder keeps to a budget of disk meanwhile.

faults: the whole rehearsal in real time, with a board on a pty, JACK's dummy driver as sound card,
images in the bag, a browser before the panel. One process after another is killed (SIGKILL) or
stopped (SIGSTOP); between these the system clock is stepped, the disk filled, the board and the
sound card pulled, the page reloaded, and eight processes that never sleep run beside it. A fault
is over when every node is OK again, blocks are published, and what was killed is another process.
Its camera is the twin; so afterwards the museum's scene sees a film through a simulated GigE Vision
camera, which is pulled out (benchmarks/soak_camera.py).
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks import soak_camera, soak_faults
from benchmarks.jack import Jack
from benchmarks.machine import tell
from benchmarks.running import Graph, stand_in
from benchmarks.soak_proof import Held, growth, held, prove
from eol_ros.analysis import open_bag
from eol_ros.errors import EolError
from eol_ros.verbs.progress import track

HELP = 'Days of exhibition at a high rate, hours of faults in real time: what was lost, what grows.'
EXAMPLES = [
    'eol bench soak --json > soak.json          # 72 hours at eight times, 2 hours of faults',
    'eol bench soak --parts faults --faults-hours 0.2',
    'eol bench soak --parts exhibition --hours 3',
]
PARTS = ('exhibition', 'faults')
LOOK_S = 5.0  # between two looks at memory, open files and threads


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--parts', default=','.join(PARTS), help='which, parted by commas')
    parser.add_argument('--hours', type=float, default=72.0, help='of exhibition, recorded time')
    parser.add_argument('--rate', type=float, default=8.0, help='of exhibition, times real time')
    parser.add_argument('--faults-hours', type=float, default=2.0, help='of faults, real time')
    parser.add_argument(
        '--run-minutes', type=float, default=10.0, help='how long a run is recorded to be played'
    )
    parser.add_argument('--bag', type=Path, help='play this run instead of recording one')
    parser.add_argument('--keep', type=Path, help='a folder for logs and bags, which stay there')
    parser.add_argument('--seed', type=int, default=1, help='of the order of the faults')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print; exit code 1 where something did not come back or was lost uncounted."""
    parts = args.parts.split(',')
    for part in parts:
        if part not in PARTS:
            raise EolError(f'--parts {part}: there are {", ".join(PARTS)}')
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix='eol-soak-', ignore_cleanup_errors=True) as place:
        folder = args.keep or Path(place)
        folder.mkdir(parents=True, exist_ok=True)
        if 'exhibition' in parts:
            found['exhibition'] = exhibition(
                folder, args.hours, args.rate, args.run_minutes, args.bag
            )
        if 'faults' in parts:
            found['faults'] = soak_faults.measure(folder, args.faults_hours, args.seed)
            found['camera'] = soak_camera.measure(folder, args.faults_hours)
    tell(found, args.json, table)
    return int(any(part['faults'] for part in found.values()))


def exhibition(
    folder: Path,
    hours: float,
    rate: float = 8.0,
    run_minutes: float = 10.0,
    bag: Path | None = None,
) -> dict[str, Any]:
    """Play a run in a loop until `hours` of recorded time have passed; return the figures."""
    bag = bag or recorded(folder, run_minutes)
    length_s = open_bag(bag).duration_s
    folder = folder / 'exhibition'
    folder.mkdir()
    changed = {
        'replay': {'rate': rate, 'loop': True},
        'leds': {'port': 'pty'},
        'recorder': {'images': 'none', 'keep_gb': 0.5, 'split_minutes': 10.0, 'min_free_gb': 0.5},
    }
    jack = Jack('eol-soak')
    path = stand_in('playback', folder, film=None, bag=bag, changed=changed)
    jack.start()
    looks: list[dict[str, Held]] = []
    try:
        with Graph(path, folder / 'bags', watched=(), environment=jack.environment) as graph:
            graph.wait_until_ok()
            begun_s = time.monotonic()
            for _ in track(_steps(graph, length_s, hours, looks), 'exhibition', total=100):
                pass
            took_s, played_s = time.monotonic() - begun_s, _played_s(graph, length_s)
            status = graph.status()
            code = graph.stop()
    finally:
        jack.stop()
    bags = prove(folder / 'bags')
    grown = growth(looks)
    values = {row['node']: row['values'] for row in status['nodes']}
    faults = [f'{row["node"]}: {row["text"]}' for row in status['nodes'] if row['level']]
    faults += [f'bringup ended with exit code {code}'] if code else []
    faults += [f'{status["restarts"]} restarts'] if status['restarts'] else []
    faults += [f'{row["name"]} grows: {row}' for row in grown if not row['flat']]
    faults += bags['faults']
    return {
        'hours': round(played_s / 3600, 2),
        'run_s': round(length_s, 1),
        'took_hours': round(took_s / 3600, 3),
        'times_real_time': round(played_s / took_s, 2),
        'restarts': status['restarts'],
        'lost': values['recorder']['lost'],
        'sound': {name: values['sound'][name] for name in ('underruns', 'late')},
        'growth': grown,
        'bags': bags,
        'faults': faults,
    }


def _played_s(graph: Graph, length_s: float) -> float:
    return graph.node('replay')['values'].get('rounds', 0) * length_s


def _steps(
    graph: Graph, length_s: float, hours: float, looks: list[dict[str, Held]]
) -> Iterator[int]:
    """Yield once a hundredth of the hours; look at the processes meanwhile."""
    done = 0
    while done < 100:
        time.sleep(LOOK_S)
        looks.append(held(graph))
        now = min(int(100 * _played_s(graph, length_s) / (3600 * hours)), 100)
        for _ in range(now - done):
            yield now
        done = max(done, now)


def recorded(folder: Path, minutes: float) -> Path:
    """Record the rehearsal for so long, without images; return the bag."""
    folder = folder / 'run'
    folder.mkdir()
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
            f'exhibition: {part["hours"]:g} h in {part["took_hours"]:g} h '
            f'({part["times_real_time"]:g} times real time); {part["restarts"]} restarts; '
            f'recorder: {part["lost"]} lost; sound {part["sound"]}',
            *_growth(part),
            _bags(part),
        ]
    if part := found.get('faults'):
        lines += [
            f'faults: {part["count"]} in {part["hours"]:g} h; {_well(part)}',
            *(f'not done here: {words}' for words in part['left_out']),
            *_kinds(part), *_growth(part), _bags(part),
        ]  # fmt: skip
    if part := found.get('camera'):
        told = ', '.join('never' if s is None else f'{s:g}' for s in part['said_s'])
        lines += [
            f'camera pulled out: {part["count"]} times; {_well(part)}; told after {told} s',
            *_kinds(part), _bags(part),
        ]  # fmt: skip
    for part in found.values():
        if isinstance(part, dict) and part.get('faults'):
            lines += [f'NOT WELL: {line}' for line in part['faults']]
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
    head = f'{"process":28} {"open files":>15} {"threads":>13} {"PSS MB":>19}'
    lines = [head]
    for row in part['growth']:
        pairs = [f'{a:g} -> {b:g}' for a, b in (row[n] for n in Held._fields)]
        lines.append(f'{row["name"]:28} {pairs[0]:>15} {pairs[1]:>13} {pairs[2]:>19}')
    return lines


def _bags(part: dict[str, Any]) -> str:
    bags = part['bags']
    return (
        f'bags: {bags["count"]}, proved to the last byte; {bags["unreadable"]} not readable, '
        f'{bags["cut"]} cut off by a kill and read; messages missing {bags["missing"]}, of these '
        f'not counted {bags["uncounted"]}'
    )

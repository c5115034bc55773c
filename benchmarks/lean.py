# SPDX-License-Identifier: Apache-2.0
"""eol bench lean: what each scene and verb loads, and whether any of it is not needed there.

Of every scene that ships: processes, memory (PSS: a shared page counts by its share), modules,
threads and DDS writers and readers. Of single verbs the same but for DDS. It fails where a module
is loaded that the list of test/support/lean.py forbids.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from support.lean import (
    BRINGUP,
    OF_A_BAG,
    VERBS,
    node_faults,
    other_faults,
    probed,
    verb_row,
)
from support.running import Film, Graph, stand_in

from benchmarks.machine import tell
from eol_ros.errors import EolError, UsageError

HELP = 'Count processes, memory, modules, threads and DDS entities of each scene and verb.'
EXAMPLES = [
    'eol bench lean',
    'eol bench lean --scenes rehearsal,lights --no-verbs',
    'eol bench lean --scenes "" --json',
]
SCENES = ('rehearsal', 'museum', 'lights', 'instrument', 'playback', 'soft')
SETTLE_S = 4.0  # from all OK: the probe of each process waits a second
INTRODUCTION = """
# What a scene does not need

Made by `eol bench lean --markdown` on the machine named above. Memory is PSS: a page that
processes share counts by its share. DDS entities: writers and readers; a service or client counts
two. `test/support/lean.py` lists what must not be loaded; `test/nodes/test_lean.py` and this
benchmark check it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--scenes', default=','.join(SCENES), help='scenes, separated by commas')
    parser.add_argument('--no-verbs', action='store_true', help='leave the verbs out')
    parser.add_argument('--markdown', action='store_true', help='print the tables of lean.md')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def scene_row(name: str, folder: Path, film: Film, bag: Path | None) -> dict[str, Any]:
    """Return what a running scene has loaded, process by process."""
    told_in = folder / f'lean-{name}'
    told_in.mkdir()
    scene = stand_in(name, folder, film, bag)
    with Graph(scene, folder / f'bags-{name}', environment=probed(told_in)) as graph:
        start_s = graph.wait_until_ok()
        graph.mark()
        time.sleep(SETTLE_S)
        figures, pids = graph.figures(), graph.pids()
        entities = graph.watch.entities()
    processes = []
    for pid, nodes in pids.items():
        file = told_in / f'{pid}.json'
        if not file.exists():
            raise EolError(f'{name}: {"+".join(nodes)} has not told what it loaded')
        told = json.loads(file.read_text())
        if nodes == ['bringup']:
            allowed = BRINGUP | (OF_A_BAG if ['replay'] in pids.values() else set())
            faults = other_faults(allowed, told['modules'])
        else:
            faults = node_faults(nodes, told['modules'], told['files'])
        processes.append(
            {
                'nodes': '+'.join(nodes),
                'pss_mb': figures['nodes']['+'.join(nodes)]['pss_mb'],
                'modules': len(told['modules']),
                'threads': told['threads'],
                'dds': sum(entities.get(node, 0) for node in nodes),
                'faults': faults,
            }
        )
    return {
        'scene': name,
        'processes': len(processes),
        'pss_mb': round(sum(p['pss_mb'] for p in processes), 1),
        'modules': sum(p['modules'] for p in processes),
        'threads': sum(p['threads'] for p in processes),
        'dds': sum(p['dds'] for p in processes),
        'start_s': round(start_s, 1),
        'of': processes,
    }


def run(args: argparse.Namespace) -> int:
    """Measure, print; 1 where something is loaded that must not be."""
    names = [name for name in args.scenes.split(',') if name]
    for name in names:
        if name not in SCENES:
            raise UsageError(f'--scenes {name}: not one of {", ".join(SCENES)}')
    if 'playback' in names and 'rehearsal' not in names:
        raise UsageError('--scenes playback needs a bag: name rehearsal too')
    result: dict[str, Any] = {'scenes': [], 'verbs': []}
    with tempfile.TemporaryDirectory(prefix='eol-bench-') as place:
        folder = Path(place)
        film = Film(folder)
        for name in sorted(names, key=SCENES.index):
            print(name, file=sys.stderr, flush=True)
            result['scenes'].append(scene_row(name, folder, film, folder / 'bags-rehearsal'))
    if not args.no_verbs:
        result['verbs'] = [verb_row(words) for words in VERBS]
    tell(result, args.json, markdown if args.markdown else table)
    faults = [
        f'{row["scene"]}, {process["nodes"]}: {", ".join(process["faults"])}'
        for row in result['scenes']
        for process in row['of']
        if process['faults']
    ] + [f'eol {r["verb"]}: {", ".join(r["faults"])}' for r in result['verbs'] if r['faults']]
    for line in faults:
        print(f'loaded and not needed: {line}', file=sys.stderr)
    return 1 if faults else 0


def table(result: dict[str, Any]) -> str:
    """Return the rows for a terminal."""
    lines = []
    for row in result['scenes']:
        lines.append('  '.join(f'{k} {v}' for k, v in row.items() if k != 'of'))
        lines += ['    ' + '  '.join(f'{k} {v}' for k, v in p.items() if v) for p in row['of']]
    lines += ['  '.join(f'{k} {v}' for k, v in row.items() if v != []) for row in result['verbs']]
    return '\n'.join(lines)


def markdown(result: dict[str, Any]) -> str:
    """Return the page docs/explanation/lean.md."""
    lines = [
        INTRODUCTION,
        '\n| scene | processes | PSS, MB | modules | threads | DDS entities | largest |',
        '| --- | --- | --- | --- | --- | --- | --- |',
    ]
    for row in result['scenes']:
        largest = sorted(row['of'], key=lambda p: -p['pss_mb'])[:3]
        words = ', '.join(f'{p["nodes"]} {p["pss_mb"]:.0f}' for p in largest)
        lines.append(
            f'| {row["scene"]} | {row["processes"]} | {row["pss_mb"]:.0f} | {row["modules"]} |'
            f' {row["threads"]} | {row["dds"]} | {words} |'
        )
    lines += [
        '\n| verb | PSS, MB | modules | threads | s |',
        '| --- | --- | --- | --- | --- |',
        *(
            f'| `eol {r["verb"]}` | {r["pss_mb"]} | {r["modules"]} | {r["threads"]} |'
            f' {r["seconds"]} |'
            for r in result['verbs']
        ),
    ]
    return '\n'.join(lines)

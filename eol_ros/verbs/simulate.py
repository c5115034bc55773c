# SPDX-License-Identifier: Apache-2.0
"""`eol simulate`: run a spring-block scene and write what happened."""

import argparse
import dataclasses
import json
import os
import sys
import time
from math import isfinite

from eol_ros.cli import within

HELP = 'Simulate a spring-block scene: exact, or event-driven.'
EXAMPLES = [
    'eol simulate S3L --json',
    'eol simulate scene.json --output result.npz --sample 0.1',
    'eol simulate S4G --path event --tol 1e-11 --json',
    'eol simulate S3G --write-scene s3g.json',
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('scene', metavar='SCENE', help='JSON file, or a named scene (S1 ... S6b)')
    parser.add_argument(
        '-o', '--output', metavar='FILE.npz', help='file for t, u, v and the events'
    )
    parser.add_argument(
        '--sample',
        type=within(1e-9, 1e9),
        default=0.1,
        metavar='S',
        help='time between samples (0.1 s)',
    )
    parser.add_argument('--path', default='auto', choices=('auto', 'exact', 'event'), help='solver')
    parser.add_argument(
        '--tol',
        type=within(1e-15, 1e-3),
        metavar='T',
        help='tolerance of the event solver (1e-9 geometric, 1e-12 linear)',
    )
    most = within(1, 1e9, int)
    parser.add_argument('--max-steps', type=most, default=20_000_000, metavar='N',
                        help='steps after which the run ends')  # fmt: skip
    parser.add_argument('--max-events', type=most, default=4_000_000, metavar='N',
                        help='events after which the run ends')  # fmt: skip
    parser.add_argument('--write-scene', metavar='FILE.json', help='save the scene and stop')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def run(args: argparse.Namespace) -> int:
    from eol_ros import folders
    from eol_ros.core.physics.result import Limits
    from eol_ros.devices.files import physics_file
    from eol_ros.errors import UsageError
    from eol_ros.lab import choose
    from eol_ros.verbs import compile
    from eol_ros.verbs.progress import Progress

    scene = _scene(args.scene)
    if args.write_scene:
        physics_file.save_scene(args.write_scene, scene.source)
        return 0
    if scene.duration_s / args.sample > 5e6 / scene.n:
        raise UsageError(f'--sample {args.sample:g}: too many samples of {scene.duration_s:g} s')
    if args.output is not None:
        folders.check_writable(args.output, '--output')
    compile.ensure(['simulate'])
    limits = Limits(args.max_events, args.max_steps)
    with Progress('simulating'):
        still = dataclasses.replace(scene, duration_s=0.0)
        choose.simulate(still, args.sample, args.path, args.tol)  # loads the kernels
        begin_s = time.perf_counter()
        result = choose.simulate(scene, args.sample, args.path, args.tol, limits)
        solve_s = time.perf_counter() - begin_s
    if args.output is not None:
        physics_file.save_run(args.output, result)
    energy = result.energy
    assert energy is not None  # ledger=True
    report = {
        'path': result.path,
        'status': result.status,
        'events': len(result.event_t),
        'steps': result.steps,
        'solve_s': solve_s,
        't_reached': result.t_reached,
        'energy': {
            name: joules if isfinite(joules) else None  # JSON has no NaN
            for name, joules in {**vars(energy), 'residual_J': energy.residual_J}.items()
        },
        'notes': result.notes,
    }
    if args.json:
        print(json.dumps(report))
    else:
        print(
            f'{result.path} path, {result.status}: {len(result.event_t)} events in '
            f'{result.steps} steps, {solve_s * 1e3:.3g} ms for {result.t_reached:g} s; '
            f'energy residual {energy.residual_J:.2g} J of {energy.work_J:.3g} J work'
        )
    for note in result.notes:
        print(note, file=sys.stderr)
    return 0 if result.status == 'ok' else 1


def _scene(given: str):
    from eol_ros.core.physics.scene import from_mapping
    from eol_ros.devices.files.physics_file import load_scene
    from eol_ros.errors import DeviceMissing, nearest
    from eol_ros.lab.presets import NAMED, scene

    if given in NAMED:
        return from_mapping(scene(given))
    if not os.path.exists(given):
        raise DeviceMissing(
            f'{given}: no such scene; give a JSON file or a name. {nearest(given, NAMED)}'
        )
    return load_scene(given)

# SPDX-License-Identifier: Apache-2.0
"""eol check: is this scene right?"""

import dataclasses
import json
import sys

from eol_ros import scene as scenes
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.ros import installed

HELP = (
    'Check a scene and say every mistake at once, with file, line and column; and whether ROS and '
    'the messages that it needs are installed here.'
)
EXAMPLES = ['eol check museum', 'eol check config/museum.yaml --json']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('scene', nargs='?', default='rehearsal', help='file, or one that ships')
    parser.add_argument('--json', action='store_true', help='the checked scene, or the mistakes')


def run(args):
    """Print what would run, or raise with all mistakes."""
    try:
        scene = scenes.load(args.scene)
        _check_calibrations(scene)
    except scenes.SceneError as error:
        if not args.json:
            raise
        mistakes = [dataclasses.asdict(m) for m in error.mistakes]
        print(json.dumps({'ok': False, 'mistakes': mistakes}))
        return error.exit_code
    for warning in scene.warnings:
        print(f'eol check: {warning}', file=sys.stderr)
    missing = installed.missing()
    if args.json:
        answer = {'ok': not missing, **scenes.plain(scene)}
        if missing:
            answer |= {'missing': missing, 'install': installed.command()}
        print(json.dumps(answer, indent=2))
        return DeviceMissing.exit_code if missing else 0
    print(f'{scene.path}: {scene.name}, {len(scene.nodes)} nodes, network {scene.network}')
    for name, settings in scene.nodes.items():
        changed = [
            f'{f.name}={getattr(settings, f.name)!r}'
            for f in dataclasses.fields(settings)
            if getattr(settings, f.name) != f.default
        ]
        print(f'  {name:9} {", ".join(changed) or "as it ships"}')
    installed.require()
    print('no mistakes', file=sys.stderr)
    return 0


def _check_calibrations(scene):
    """Read the calibration files as the nodes will; raise SceneError with what is wrong in them."""
    named = {
        name: settings for name, settings in scene.nodes.items()
        if getattr(settings, 'calibration', '')
    }  # fmt: skip
    if not named:
        return
    from eol_ros.devices.files import calibration_file

    mistakes = []
    for name, settings in named.items():
        path, where = settings.calibration, f'{name}.calibration'
        try:
            calibration_file.load(path, getattr(settings, 'mirror', False))
        except EolError as error:
            what = str(error).removeprefix(f'{path}: ')
            mistakes.append(scenes.Mistake(path, 1, 1, where, what))
    if mistakes:
        raise scenes.SceneError(mistakes)

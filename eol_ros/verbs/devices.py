# SPDX-License-Identifier: Apache-2.0
"""eol devices: what is plugged in, and how a scene names it."""

import dataclasses
import json
import sys

from eol_ros.core.verdict import Verdict
from eol_ros.errors import printable

HELP = 'List cameras, boards, sound cards and screens, each with its line for a scene.'
EXAMPLES = ['eol devices', 'eol devices --json']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--json', action='store_true', help='print JSON')


def run(args):
    """Print the devices; what is missing is said, and is no error."""
    from eol_ros.devices.inventory import KINDS, find_all

    found, remarks = find_all()
    if args.json:
        rows = [dataclasses.asdict(f) for f in found]
        verdict = _verdict({f.kind for f in found})._asdict()
        print(json.dumps({'devices': rows, 'remarks': remarks, 'verdict': verdict}, indent=2))
        return 0
    for kind in KINDS:
        of_kind = [f for f in found if f.kind == kind]
        print(f'{kind}s' if of_kind else f'{kind}s: none found')
        for device in of_kind:
            print(printable(f'  {device.name}  {device.description}'.rstrip()))
            if device.scene_line:
                print(f'      {printable(device.scene_line)}')
    for remark in remarks:
        print(remark, file=sys.stderr)
    print(_verdict({f.kind for f in found}))
    return 0


def _verdict(kinds: set[str]) -> Verdict:
    """Return which scenes the kinds of devices that are plugged in are enough for."""
    from eol_ros.devices.inventory import KINDS

    missing = [kind for kind in KINDS if kind not in kinds]
    if not missing:
        return Verdict('good', 'all that the scene museum needs is plugged in')
    absent = ' and '.join(f'no {kind}' for kind in missing)
    if 'camera' in missing:
        return Verdict('poor', f'{absent}: only rehearsal and playback run', 'plug in a camera')
    return Verdict(
        'usable', f'{absent}: the scene runs without it', f'plug in a {", a ".join(missing)}'
    )

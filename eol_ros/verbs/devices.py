# SPDX-License-Identifier: Apache-2.0
"""eol devices: what is plugged in, and how a scene names it."""

import dataclasses
import json
import sys

HELP = 'List cameras, boards, sound cards and screens, with the line that a scene wants.'
EXAMPLES = ['eol devices', 'eol devices --json']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--json', action='store_true', help='for programs')


def run(args):
    """Print the devices; what is missing is said, and is no error."""
    from eol_ros.devices.inventory import KINDS, find_all

    found, remarks = find_all()
    if args.json:
        rows = [dataclasses.asdict(f) for f in found]
        print(json.dumps({'devices': rows, 'remarks': remarks}, indent=2))
        return 0
    for kind in KINDS:
        of_kind = [f for f in found if f.kind == kind]
        print(f'{kind}s' if of_kind else f'{kind}s: none found')
        for device in of_kind:
            print(f'  {device.name}  {device.description}'.rstrip())
            if device.scene_line:
                print(f'      {device.scene_line}')
    for remark in remarks:
        print(remark, file=sys.stderr)
    return 0

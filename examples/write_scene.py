# SPDX-License-Identifier: Apache-2.0
"""A scene of your own, written by a program and checked before anything is started.

`python examples/write_scene.py FILE.yaml` writes it: the twin, with flashes that fade slowly.
`eol run FILE.yaml` runs it.
"""

import argparse
import sys
from pathlib import Path

import yaml

from eol_ros import folders, scene
from eol_ros.errors import EolError


def main() -> None:
    parser = argparse.ArgumentParser(description='Write a scene and check it.')
    parser.add_argument('file', type=Path)
    parser.add_argument('--stop', type=float, default=0.002, help='at rest below, m/s')
    args = parser.parse_args()
    nodes = {
        'twin': {'noise': 'L1', 'seed': 7},
        'tracker': {},
        'motion': {'stop_mps': args.stop},
        'leds': {'port': 'twin', 'decay_s': 1.5},
    }
    folders.check_writable(args.file, 'FILE')
    args.file.write_text(yaml.safe_dump({'scene': 'long light', 'nodes': nodes}, sort_keys=False))
    loaded = scene.load(args.file)  # raises all mistakes, each with its place in the file
    print(f'{loaded.name}: {", ".join(loaded.nodes)}')


if __name__ == '__main__':
    try:
        main()
    except EolError as error:  # what a user can cause or meet, in one line
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)

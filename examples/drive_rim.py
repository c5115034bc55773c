# SPDX-License-Identifier: Apache-2.0
"""A drive of your own: the rim is pulled, held, and turned; the table answers in slips.

    python examples/drive_rim.py SCENE.json

`eol simulate SCENE.json` solves the file that it writes again, with any other solver.
"""

import argparse
import sys

import numpy as np

from eol_ros.core.physics import builders
from eol_ros.core.physics.scene import from_mapping
from eol_ros.devices.files import physics_file
from eol_ros.errors import EolError
from eol_ros.lab.choose import simulate

POSES = [  # s, m, m, rad; a smooth curve goes through them
    [0.0, 0.00, 0.00, 0.0],
    [2.0, 0.10, 0.00, 0.0],
    [3.0, 0.10, 0.00, 0.0],
    [5.0, 0.10, 0.05, 0.3],
]


def main() -> None:
    parser = argparse.ArgumentParser(description='Write a physics scene and solve it.')
    parser.add_argument('file')
    drive = {'kind': 'poses', 'par': POSES}
    mapping = builders.table(drive, POSES[-1][0], u0=builders.offsets(25, 0.005, seed=1))
    physics_file.save_scene(parser.parse_args().file, mapping)
    run = simulate(from_mapping(mapping), sample_s=0.5)
    print(f'{run.path} path, {run.status}: {int(run.event_start.sum())} slips')
    for t, u in zip(run.t, run.u, strict=True):
        print(f'{t:4.1f} s: blocks moved {np.hypot(*u.T).mean() * 1e3:6.1f} mm on average')


if __name__ == '__main__':
    try:
        main()
    except EolError as error:  # what a user can cause or meet, in one line
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)

# SPDX-License-Identifier: Apache-2.0
"""An analysis of your own: which blocks slipped most, and do long slips go further? Needs no ROS.

python examples/analyse_bag.py [BAG]        the bag that ships where none is named
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from eol_ros.analysis import open_bag
from eol_ros.analysis.recorded_settings import recorded_table
from eol_ros.errors import EolError
from eol_ros.streams.slips import STOP

SAMPLE = Path(__file__).parents[1] / 'bags' / 'sample'


def main() -> None:
    parser = argparse.ArgumentParser(description='Count the slips of a bag.')
    parser.add_argument('bag', nargs='?', default=SAMPLE)
    bag = open_bag(parser.parse_args().bag)
    slips = bag.table('slips')
    slips = slips[slips['kind'] == STOP]  # each is told when it starts and when it has stopped
    table = recorded_table(bag)
    counts = table.grid(np.bincount(slips['block'], minlength=table.cells))
    print(f'{len(slips)} slips in {bag.duration_s:.1f} s; of each block, as seen from above:')
    for row in counts[::-1]:  # row 0 is nearest to the viewer
        print(' '.join(f'{count:4d}' for count in row))
    if len(slips) > 1:
        together = np.corrcoef(slips['duration'], slips['distance'])[0, 1]
        print(f'correlation of duration and distance: {together:.2f}')
    areas = bag.table('cascades')['area']
    widest = f'{max(areas, default=0)} of {table.count}'
    print(f'{len(areas)} cascades; the widest moved {widest} blocks')


if __name__ == '__main__':
    try:
        main()
    except EolError as error:  # what a user can cause or meet, in one line
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)

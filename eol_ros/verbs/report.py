# SPDX-License-Identifier: Apache-2.0
"""eol report: figures and numbers from a bag, without ROS."""

import json
import sys
from pathlib import Path

from eol_ros import folders
from eol_ros.errors import DeviceMissing

HELP = 'Figures, numbers and tables from a bag: one HTML page, SVG, PDF and CSV. No ROS needed.'
EXAMPLES = [
    'eol report bags                                # the newest run in bags/',
    'eol report run_0.mcap --out analysis',
    'eol report bags --csv slips,blocks --out analysis',
    'eol report bags --retrack --json               # do the images give the results again?',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('bag', help='bag folder, .mcap file, or a folder of bags: its newest run')
    parser.add_argument('--out', metavar='DIR', help='where it goes (default: report-NAME here)')
    parser.add_argument('--csv', metavar='TOPICS', help='write these topics as CSV, no report')
    parser.add_argument(
        '--retrack',
        action='store_true',
        help='recompute blocks, slips, cascades and triggers and compare them',
    )
    parser.add_argument('--json', action='store_true', help='the numbers to stdout as JSON')


def run(args):
    """Analyse; return 1 when --retrack finds a difference or a hole."""
    from eol_ros.analysis.bag import open_bag, topic_names
    from eol_ros.streams.graph import relative_name
    from eol_ros.verbs.progress import track

    bag = open_bag(args.bag)
    for line in bag.cut_short:
        print(line, file=sys.stderr)
    out = Path(args.out or f'report-{bag.path.stem}')
    if args.csv:
        names = topic_names(bag, args.csv)
        folders.made(out, '--out')
        for name in track(names, 'writing'):
            file = out / f'{relative_name(name, bag.namespace).strip("/").replace("/", "_")}.csv'
            bag.table(name).to_csv(file)
            print(file)
        return 0
    retracked = None
    if args.retrack:
        from eol_ros.analysis.retrack import retrack

        retracked = retrack(bag, track)
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise DeviceMissing(
            'matplotlib is not installed: pip install matplotlib; eol report --csv works without'
        ) from None
    from eol_ros.analysis.report import summary, write

    found = write(bag, out, retracked, track)
    print(json.dumps(found, indent=2) if args.json else summary(found))
    print(out / 'report.html', file=sys.stderr)
    whole = retracked is None or (retracked.verdict != 'different' and not retracked.holes)
    return 0 if whole else 1

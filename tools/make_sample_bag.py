# SPDX-License-Identifier: Apache-2.0
"""Makes bags/sample, the recording that ships: a rehearsal without images, packed tightly.

    python tools/make_sample_bag.py                 run the rehearsal for 38 s and pack its bag
    python tools/make_sample_bag.py --bag DIR       pack this bag of a rehearsal

Needed again whenever the definition of a recorded message changes, or what is computed from its
blocks (test/devices/test_sample_bag.py tells). Physics and visitors of the twin follow from the
seed; the times are those of the run.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml

from eol_ros import folders
from eol_ros.devices.bag.mcap_file import BagFile
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recover import rewrite_metadata
from eol_ros.devices.bag.retention import KEPT
from eol_ros.devices.bag.writer import GAPS_METADATA, RUN_METADATA, SAMPLE
from eol_ros.errors import EolError

FOLDER = Path(__file__).parents[1] / 'bags' / 'sample'
LEVEL = 19  # of zstd: made once, cloned often
NO_IMAGES = {'images': 'none', 'display_period_s': 10.0}


def rehearse(place: Path, seconds: float, recorder: dict) -> Path:
    """Run the rehearsal with these settings of the recorder; return the bag."""
    scene = {
        'include': str(Path(__file__).parents[1] / 'config' / 'rehearsal.yaml'),
        'scene': 'rehearsal',
        'nodes': {
            'panel': {'port': 0},
            'sound': {'device': 'wav', 'wav': str(place / 'sound.wav')},
            'recorder': recorder,
        },
    }
    cache = place / 'cache'  # what was made before, by a path that tells nothing of this machine
    shutil.copytree(folders.cache('.'), cache)
    file = place / 'rehearsal.yaml'
    file.write_text(yaml.safe_dump(scene, sort_keys=False))
    subprocess.run(
        [sys.executable, '-m', 'eol_ros.bringup', file, '--for', str(seconds),
         '--bag', place / 'bags'],
        env={**os.environ, 'EOL_CACHE': str(cache)}, check=True,
    )  # fmt: skip
    return place / 'bags'


def pack(bag: BagReader, folder: Path) -> Path:
    """Write a copy of `bag` into `folder`, as small as may be; return the file."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    topics = list(bag.topics.values())
    channel = {topic.name: i for i, topic in enumerate(topics, 1)}
    versions = yaml.safe_load(bag.about['versions'])
    versions.pop('kernel', None)  # of the machine, not of the work
    about = {**bag.about, 'versions': yaml.safe_dump(versions), SAMPLE: 'true'}
    file = BagFile(folder / f'{folder.name}_0.mcap', topics, LEVEL)
    file.add_metadata(RUN_METADATA, about)
    for m in bag.messages():
        file.write(channel[m.topic], m.data, m.log_ns, m.publish_ns, m.sequence)
    file.add_metadata(GAPS_METADATA, bag.gaps)
    file.close()
    rewrite_metadata(folder)
    (folder / KEPT).write_text('Ships with the project: never removed by the recorder.\n')
    return file.path


def incomplete(bag: BagReader) -> str:
    """Say what the recording lacks because the machine was busy; empty when nothing."""
    for name in ('lost_before_recorder', 'dropped_in_recorder', 'stamp_gaps'):
        count = sum(json.loads(bag.gaps.get(name, '{}')).values())
        if count:
            return f'{name}: {count}'
    return ''


def main() -> int:
    """Rehearse, pack, say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=37.5, help='length of the rehearsal')
    parser.add_argument('--bag', metavar='DIR', help='pack this bag, run nothing')
    parser.add_argument(
        '-o',
        '--output',
        metavar='DIR',
        type=Path,
        default=FOLDER,
        help='where it goes (default: bags/sample)',
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='eol-sample-') as place:
        try:
            bag = BagReader(args.bag or rehearse(Path(place), args.seconds, NO_IMAGES))
        except (EolError, subprocess.CalledProcessError) as error:
            print(f'no bag to pack: {error}', file=sys.stderr)
            return 1
        missing = incomplete(bag)
        if missing:
            print(
                f'the machine was too busy ({missing}): run it again when it is quiet',
                file=sys.stderr,
            )
            return 1
        file = pack(bag, args.output)
    print(
        f'{file}: {file.stat().st_size / 1e6:.2f} MB, {bag.duration_s:.1f} s, '
        f'{sum(bag.counts.values())} messages'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Makes the recordings that ship in bags/: rehearsals without images, packed tightly.

    python tools/make_sample_bag.py                 run the rehearsal for 38 s and pack its bag
    python tools/make_sample_bag.py --bag DIR       pack this bag of a rehearsal
    python tools/make_sample_bag.py --again         compute slips and cascades of bags/sample again
    python tools/make_sample_bag.py --long          step 15 minutes in one; makes bags/sample_long

test/devices/test_sample_bag.py fails when results computed from the blocks of `bags/sample`
change; then `--again` and `--long` make both bags again. Physics and visitors of the twin
follow from the seed; the times are those of the run. `bags/sample_long` goes on from the settings
of `bags/sample` without camera and clock: places have the noise of the tracker (NOISE_M), and
messages are received at their stamps.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from eol_msgs.msg import Cascade, GrainTrigger, Slip
from rclpy.serialization import serialize_message

from eol_ros import folders
from eol_ros.analysis.bag import Bag, open_bag
from eol_ros.analysis.recorded_settings import recorded_settings
from eol_ros.analysis.retrack import recompute_motion
from eol_ros.core.motion.motion import Motion
from eol_ros.core.physics.twin.live import Coupling
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.select import Selector
from eol_ros.devices.bag.mcap_file import BagFile, BagMessage, BagTopic
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recover import rewrite_metadata
from eol_ros.devices.bag.requests import heeded
from eol_ros.devices.bag.retention import KEPT
from eol_ros.devices.bag.writer import GAPS_METADATA, RUN_METADATA, SAMPLE
from eol_ros.errors import EolError
from eol_ros.streams import cascades, slips, triggers
from eol_ros.streams.blocks import each
from eol_ros.streams.record import Record

FOLDER = Path(__file__).parents[1] / 'bags' / 'sample'
LONG, LONG_S = FOLDER.with_name('sample_long'), 900.0
NOISE_M = 9e-6  # of places that the tracker finds in the twin's images (benchmarks/twin_slips.py)
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


def stepped(bag: Bag, seconds: float) -> Iterator[BagMessage]:
    """Yield cascades and grain triggers of the twin with the settings of `bag`, and its corpus."""
    twin, grains = recorded_settings(bag, 'twin'), recorded_settings(bag, 'grains')
    play, random = Play(twin.seed, 0, Coupling.of(twin)), np.random.default_rng(twin.seed)
    motion, selector = Motion(recorded_settings(bag, 'motion')), Selector(grains)
    corpus = next(bag.messages([bag.name('corpus')]))
    yield corpus
    row = bag.table('corpus')[0]
    places = np.zeros(len(row['x']), GRAIN)
    places['x'], places['y'], places['duration_s'] = row['x'], row['y'], row['duration']
    selector.load(Corpus((Source('ice.wav', int(row['sample_rate']), 0.0),), places))
    seen, sigma = np.ones(play.table.table.cells, bool), np.full(play.table.table.cells, NOISE_M)
    sent: Counter = Counter()

    def message(name: str, record: Record, kind: type, row: Any) -> BagMessage:
        data = bytes(serialize_message(record.fill(kind(), row)))
        sent[name] += 1
        return BagMessage(bag.name(name), data, stamp_ns, stamp_ns, sent[name])

    for image in range(round(seconds * twin.fps)):
        play.advance(1 / twin.fps)
        stamp_ns = corpus.log_ns + round((image + 1) * 1e9 / twin.fps)
        at = np.stack([play.table.x, play.table.y]) + random.normal(0, NOISE_M, (2, len(seen)))
        motion.starts(stamp_ns * 1e-9, *at, seen, sigma)
        for cascade in motion.stops(stamp_ns * 1e-9)[1]:
            yield message('cascades', cascades.RECORD, Cascade, cascades.of(stamp_ns, cascade))
        for found in selector.update(stamp_ns * 1e-9, *at, seen, sigma):
            of = triggers.of(stamp_ns, sent['grain_triggers'], found)
            yield message('grain_triggers', triggers.RECORD, GrainTrigger, of)


def again(bag: Bag) -> Iterator[BagMessage]:
    """Yield the messages of `bag`, with slips and cascades computed again from its blocks."""
    rows, _, over = recompute_motion(bag, heeded(bag), list(each(bag.table('blocks'))))
    made = {
        bag.name('slips'): (iter(rows), slips.RECORD, Slip),
        bag.name('cascades'): (iter(over), cascades.RECORD, Cascade),
    }
    for message in bag.messages():
        if message.topic in made:
            found, record, kind = made[message.topic]
            row = next(found, None)
            if row is None:
                raise EolError('fewer slips or cascades than were recorded: record it again')
            data = bytes(serialize_message(record.fill(kind(), row)))
            message = message._replace(data=data)
        yield message
    if any(True for found, _, _ in made.values() for _ in found):
        raise EolError('more slips or cascades than were recorded: record it again')


def pack(
    bag: BagReader, folder: Path, messages: Iterable[BagMessage], topics: list[BagTopic],
    gaps: dict[str, str] | None = None,
) -> Path:  # fmt: skip
    """Write `messages` with what `bag` says of itself, as small as may be; return the file.

    gaps: what was received and lost; None: as in `bag`.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    channel = {topic.name: i for i, topic in enumerate(topics, 1)}
    versions = yaml.safe_load(bag.about['versions'])
    versions.pop('kernel', None)  # of the machine, not of the work
    about = {**bag.about, 'versions': yaml.safe_dump(versions), SAMPLE: 'true'}
    file = BagFile(folder / f'{folder.name}_0.mcap', topics, LEVEL)
    file.add_metadata(RUN_METADATA, about)
    for m in messages:
        file.write(channel[m.topic], m.data, m.log_ns, m.publish_ns, m.sequence)
    file.add_metadata(GAPS_METADATA, bag.gaps if gaps is None else gaps)
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
    which = parser.add_mutually_exclusive_group()
    which.add_argument('--again', action='store_true', help='compute slips and cascades again')
    which.add_argument('--long', action='store_true', help='step the twin for 15 minutes')
    which.add_argument('--bag', metavar='DIR', help='pack this bag, run nothing')
    parser.add_argument('-o', '--output', metavar='DIR', type=Path, help='where it goes')
    args = parser.parse_args()
    bag: BagReader
    if args.again:
        bag = open_bag(FOLDER)
        try:
            messages = list(again(bag))
        except EolError as error:
            print(error, file=sys.stderr)
            return 1
        return said(pack(bag, args.output or FOLDER, messages, [*bag.topics.values()]))
    if args.long:
        bag = open_bag(FOLDER)
        topics = [bag.topics[bag.name(name)] for name in ('corpus', 'cascades', 'grain_triggers')]
        return said(pack(bag, args.output or LONG, stepped(bag, LONG_S), topics, {}))
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
        return said(pack(bag, args.output or FOLDER, bag.messages(), [*bag.topics.values()]))


def said(file: Path) -> int:
    """Say what was made; return the exit code."""
    bag = BagReader(file)
    size_mb, count = file.stat().st_size / 1e6, sum(bag.counts.values())
    print(f'{file}: {size_mb:.2f} MB, {bag.duration_s:.1f} s, {count} messages')
    return 0


if __name__ == '__main__':
    sys.exit(main())

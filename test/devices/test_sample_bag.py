# SPDX-License-Identifier: Apache-2.0
"""The bag that ships: of today's messages, small, enough to begin with."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile
from support.bag_samples import write_bag

from eol_ros.analysis import open_bag, report, series
from eol_ros.analysis.retrack import EQUAL, retrack
from eol_ros.analysis.retrack import _calibration as calibration_of_bag
from eol_ros.devices.bag.reader import BagReader
from eol_ros.ros.definitions import describe
from eol_ros.streams.graph import FORMER_TYPES, TOPICS

SAMPLE = Path(__file__).parents[2] / 'bags' / 'sample'
LONG = SAMPLE.with_name('sample_long')
MAKE = 'run `python tools/make_sample_bag.py --again`, then `--long`'


# Their arrays of 25 have become sequences. The sample keeps the definitions of before: bags that
# were recorded with these must stay readable.
GROWN = {'eol_msgs/msg/Truth', 'eol_msgs/msg/LedCommand'}


def meant(definition):
    """Return the fields without constants and without what the comments say."""
    lines = (line.split('#')[0] for line in definition.splitlines())
    return [line.split() for line in lines if line.strip() and '=' not in line.strip('=')]


@pytest.fixture(scope='module')
def bag():
    return BagReader(SAMPLE)


@pytest.mark.parametrize('path', [SAMPLE, LONG], ids=lambda path: path.name)
def test_its_messages_are_those_of_today(path):
    bag = BagReader(path)
    by_type = {row.type_name: name for name, row in TOPICS.items()}
    recorded = {topic.type: topic for topic in bag.topics.values()}
    for kind, topic in recorded.items():
        if kind in FORMER_TYPES.values():
            continue
        assert kind in by_type, f'bags/sample holds {kind}, which is no more: {MAKE}'
        today = describe(by_type[kind])
        stale = f'bags/sample was recorded with another definition of {kind}: {MAKE}'
        if kind in GROWN:
            before = topic.definition.replace('[25]', '[<=225]')
            assert meant(before) == meant(today['definition']), stale
            continue
        assert topic.type_hash == today['type_hash'], stale
        assert meant(topic.definition) == meant(today['definition']), stale


def test_a_calibration_of_before_is_read_from_its_yaml():
    bag = open_bag(SAMPLE)
    (text,) = bag.table('calibration')['data']
    assert f'digest: {calibration_of_bag(bag, None).digest}' in text


def test_it_is_small_and_whole_and_shows_something(bag):
    assert sum(f.stat().st_size for f in SAMPLE.iterdir()) <= 2.1e6
    assert 40 <= bag.duration_s <= 70
    assert bag.cut_short == [] and 'sample' in bag.about
    for name in ('lost_before_recorder', 'dropped_in_recorder', 'stamp_gaps'):
        assert sum(json.loads(bag.gaps[name]).values()) == 0, name
    assert not bag.counts.get('/eol/camera/image_raw')
    assert bag.counts['/eol/blocks'] >= 37 * 60
    assert bag.counts['/eol/grain_triggers'] >= 300
    assert bag.counts['/eol/slips'] >= 400
    assert open_bag(SAMPLE).table('cascades')['area'].max() >= 10


@pytest.mark.slow
def test_the_long_one_is_small_and_enough_for_laws_and_spectra():
    assert sum(f.stat().st_size for f in LONG.iterdir()) <= 2.6e6
    bag = open_bag(LONG)
    assert bag.duration_s > 895 and 'sample' in bag.about
    cascades = bag.table('cascades')
    assert len(cascades) >= 800 and cascades['area'].max() == 25
    found = report.numbers(bag)
    assert 'why' not in found['cascades']
    answer = series.ask(series.triggers(bag))
    assert answer.spectrum is not None and answer.spectrum.low_hz < 0.01


@pytest.mark.slow
def test_what_it_holds_is_what_today_makes_of_its_blocks():
    again = retrack(open_bag(SAMPLE))

    unequal = {name: check for name, check in again.topics.items() if check.verdict != EQUAL}
    said = '; '.join(f'{name}: {check.words()}' for name, check in unequal.items())
    if any(not check.rounding for check in unequal.values()):
        pytest.fail(f'bags/sample is older than what is computed from its blocks: {MAKE}. {said}')
    assert not unequal, (
        f'this processor or Python rounds otherwise than those that recorded it. {said}'
    )
    assert set(again.topics) == {
        'slips', 'felt_slips', 'cascades', 'grain_triggers', 'felt_triggers'
    }  # fmt: skip
    assert again.holes == []


def test_a_folder_stands_for_it_only_until_something_is_recorded(tmp_path):
    replay = write_bag(tmp_path / 'playback', 3, about={'replay_of': str(tmp_path)})
    replay.close()
    shutil.copytree(SAMPLE, tmp_path / 'sample')
    shutil.copytree(LONG, tmp_path / 'sample_long')
    os.utime(tmp_path / 'sample', (1e9, 1e9))
    assert BagReader(tmp_path).path.name == 'sample'
    os.utime(tmp_path / 'sample_long', (0, 0))  # whichever was unpacked last
    assert BagReader(tmp_path).path.name == 'sample'

    write_bag(tmp_path / 'rehearsal', 3).close()
    os.utime(tmp_path / 'rehearsal', (0, 0))  # a pull may bring a newer sample
    assert BagReader(tmp_path).path.name == 'rehearsal'


@pytest.mark.slow
def test_it_is_rendered_where_nothing_has_run_yet(tmp_path):
    """Not even the recording of ice is there. `eol report` of it: test_byte_names."""
    out = tmp_path / 'sample.wav'
    done = subprocess.run(
        [sys.executable, '-m', 'eol_ros', 'render', str(SAMPLE), '--output', str(out)],
        env={**os.environ, 'EOL_CACHE': str(tmp_path / 'cache')},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    samples, rate = soundfile.read(out)
    assert len(samples) > 40 * rate and abs(samples).max() > 0.1
    assert list((tmp_path / 'cache' / 'ice').glob('ice-*.wav'))

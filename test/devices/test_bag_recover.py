# SPDX-License-Identifier: Apache-2.0
"""A killed writer leaves a readable bag, and the next start makes it whole."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from bag_samples import POINT, write_bag

from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recover import leftovers, repair_all
from eol_ros.devices.bag.writer import BagWriter

WRITER = """
import sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from bag_samples import POINT, T0, point
from eol_ros.devices.bag.writer import BagWriter
bag = BagWriter(Path(sys.argv[1]), [POINT], {'scene': 'killed'}, split_s=3.0)
for i in range(10**9):
    bag.write('/eol/point', point(i), T0 + i * 1_000_000, T0, i + 1)
    if i % 100 == 99:
        bag.flush()
        print(i + 1, flush=True)
"""


def test_kill_leaves_what_was_flushed_and_repair_makes_it_whole(tmp_path):
    child = subprocess.Popen(
        [sys.executable, '-c', WRITER, str(tmp_path / 'run'), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        text=True,
    )
    flushed = 0
    while flushed < 4000:  # past a split, into the second file
        flushed = int(child.stdout.readline())
    child.send_signal(signal.SIGKILL)
    rest = child.stdout.read().split()
    child.wait()
    child.stdout.close()
    flushed = int(rest[-1]) if rest else flushed
    before = [m.sequence for m in BagReader(tmp_path / 'run').messages()]
    assert before == list(range(1, len(before) + 1))
    assert len(before) >= flushed
    done = repair_all(tmp_path)
    assert len(done) == 1
    bag = BagReader(tmp_path / 'run')
    assert bag.cut_short == []
    assert [m.sequence for m in bag.messages()] == before
    info = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())
    info = info['rosbag2_bagfile_information']
    assert info['message_count'] == len(before)
    assert info['custom_data']['scene'] == 'killed'
    assert info['custom_data']['recovered'].startswith('from run_')
    assert sorted(info['relative_file_paths']) == [p.path.name for p in bag.files]


def test_rosbags_reads_a_repaired_bag(tmp_path):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    bag.abandon()
    repair_all(tmp_path)
    with rosbag2.Reader(tmp_path / 'run') as reader:
        assert reader.message_count == 110


def test_a_bag_that_is_being_written_is_left_alone(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    assert leftovers(tmp_path) == []
    assert repair_all(tmp_path) == []
    bag.close()


def test_a_repair_that_was_cut_off_is_done_again(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    bag.abandon()
    (tmp_path / 'run' / 'run_0.mcap.repair').write_bytes(b'half')
    assert [r.message_count for r in repair_all(tmp_path)] == [110]
    assert not list((tmp_path / 'run').glob('*.repair'))


def test_a_repair_that_was_cut_off_at_its_last_step_is_finished(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    bag.abandon()
    part = tmp_path / 'run' / 'run_0.mcap.part'
    before = part.read_bytes()
    repair_all(tmp_path)
    part.write_bytes(before)
    assert BagReader(tmp_path / 'run').counts['/eol/point'] == 100
    assert [r.message_count for r in repair_all(tmp_path)] == [110]
    assert not part.exists()


def test_nothing_readable_leaves_no_rubbish(tmp_path):
    BagWriter(tmp_path / 'run', [POINT], {}).abandon()
    [done] = repair_all(tmp_path)
    assert done.file is None
    assert not (tmp_path / 'run').exists()


def test_a_root_that_is_not_there_needs_no_repair(tmp_path):
    assert repair_all(tmp_path / 'absent') == []

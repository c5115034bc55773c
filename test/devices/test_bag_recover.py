# SPDX-License-Identifier: Apache-2.0
"""A killed writer leaves a readable bag, and the next start makes it whole."""

import shutil
import signal
import subprocess
import sys
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from support.bag_samples import POINT, T0, TEXT, point, write_bag

from eol_ros.devices.bag import recover
from eol_ros.devices.bag.housekeeping import Breather, Stopped
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recover import NoRoom, leftovers, repair, repair_all
from eol_ros.devices.bag.verify import verify
from eol_ros.devices.bag.writer import BagWriter

WRITER = """
import sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from support.bag_samples import POINT, T0, point
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
        [sys.executable, '-c', WRITER, str(tmp_path / 'run'), str(Path(__file__).parents[1])],
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
    done = list(repair_all(tmp_path))
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


def test_a_bag_that_is_being_written_is_left_alone(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    assert leftovers(tmp_path) == []
    assert list(repair_all(tmp_path)) == []
    bag.close()


def cut_bag(folder, count=200, every=10):
    """Return the left-over file of a killed run: `count` points, a chunk of each `every`."""
    bag = BagWriter(folder, [POINT, TEXT], {'scene': 'x'})
    for i in range(count):
        bag.write('/eol/point', point(i), T0 + i * 1_000_000, T0, i + 1)
        if i % every == every - 1:
            bag.flush()
    bag.abandon()
    return folder / f'{folder.name}_0.mcap.part'


class Interrupted(Exception):
    pass


def stop_after(count):
    left = [count]

    def breathe():
        left[0] -= 1
        if left[0] < 0:
            raise Interrupted

    return breathe


def test_a_repair_that_is_stopped_leaves_the_file_as_it_was(tmp_path):
    part = cut_bag(tmp_path / 'run')
    before, stops = part.read_bytes(), 0
    (tmp_path / 'run' / 'run_0.mcap.recovering').write_bytes(b'of a repair that was killed')
    while True:
        try:
            done = repair(part, stop_after(10 * stops))
            break
        except Interrupted:
            stops += 1
        assert [p for p in part.parent.iterdir() if p.suffix != '.recovering'] == [part]
        assert part.read_bytes() == before
    assert stops > 5  # while it was proved, while it was copied, while it was read back
    assert done.message_count == 200
    assert [m.sequence for m in BagReader(done.file).messages()] == list(range(1, 201))
    assert sorted(p.name for p in part.parent.iterdir()) == ['metadata.yaml', 'run_0.mcap']


def test_a_file_that_was_cut_off_while_its_index_was_written_is_repaired(tmp_path):
    part = cut_bag(tmp_path / 'run')
    before = part.read_bytes()
    whole = repair(part).file.read_bytes()
    for share in (0.2, 0.5, 0.9):
        part.write_bytes(whole[: len(before) + int(share * (len(whole) - len(before)))])
        part.with_suffix('').unlink()
        assert repair(part).message_count == 200
        assert verify(tmp_path / 'run')[1] == []


@pytest.mark.slow
def test_a_repair_needs_little_memory(tmp_path):
    part = cut_bag(tmp_path / 'run', 15_000, 10)
    tracemalloc.start()
    done = repair(part)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3_000_000  # of 1500 chunks: 2 kB each
    assert done.message_count == 15_000


def test_a_repair_leaves_the_room_that_the_recorder_must_leave(tmp_path, monkeypatch):
    part = cut_bag(tmp_path / 'run')
    free = [1e9]
    monkeypatch.setattr(recover.shutil, 'disk_usage', lambda path: SimpleNamespace(free=free[0]))
    size = part.stat().st_size
    with pytest.raises(NoRoom, match='needs 0.00 GB beside it to be recovered, 1.00 GB are free'):
        repair(part, min_free_gb=1.0)
    assert part.stat().st_size == size
    free[0] = 1.1e9
    assert repair(part, min_free_gb=1.0).message_count == 200


def test_a_repair_rests_three_quarters_of_the_time_and_stops_when_told():
    now, waits = [0.0], []

    class Stop:
        def wait(self, seconds):
            waits.append(seconds)
            now[0] += seconds
            return self.is_set()

        def is_set(self):
            return len(waits) == 6

    breathe = Breather(Stop(), lambda: now[0], busy=lambda: len(waits) in (3, 4))
    for worked_s in (0.5, 0.1, 0.1):
        now[0] += worked_s
        breathe()
    assert waits == pytest.approx([1.5, 0.3, 0.3, 0.25, 0.25])  # the recording was busy
    with pytest.raises(Stopped):
        breathe()


def test_a_repair_that_was_cut_off_at_its_last_step_is_finished(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    bag.abandon()
    part = tmp_path / 'run' / 'run_0.mcap.part'
    before = part.read_bytes()
    list(repair_all(tmp_path))
    part.write_bytes(before)
    assert BagReader(tmp_path / 'run').counts['/eol/point'] == 100
    assert [r.message_count for r in repair_all(tmp_path)] == [110]
    assert not part.exists()


def test_a_left_over_file_beside_another_file_of_its_name_is_kept(tmp_path):
    part = cut_bag(tmp_path / 'run')
    write_bag(tmp_path / 'other', 7).close()
    target = part.with_suffix('')
    shutil.copy(tmp_path / 'other' / 'other_0.mcap', target)
    kept, complete = part.read_bytes(), target.read_bytes()
    done = repair(part)
    assert done.aside.read_bytes() == kept
    assert target.read_bytes() == complete
    assert not part.exists()


@pytest.mark.parametrize('ruin', [None, bytes, lambda n: b'x' * n])
def test_a_file_of_which_nothing_can_be_read_is_renamed_and_not_changed(tmp_path, ruin):
    BagWriter(tmp_path / 'run', [POINT], {}).abandon()
    [part] = (tmp_path / 'run').iterdir()
    if ruin:
        part.write_bytes(ruin(5000))
    before = part.read_bytes()
    [done] = repair_all(tmp_path)
    assert done.file is None and done.aside == tmp_path / 'run' / 'run_0.mcap.damaged'
    assert [p for p in (tmp_path / 'run').iterdir()] == [done.aside]
    assert done.aside.read_bytes() == before
    assert list(repair_all(tmp_path)) == []
    part.write_bytes(b'again')
    [done] = repair_all(tmp_path)
    assert done.aside.name == 'run_0.mcap.2.damaged' and done.aside.read_bytes() == b'again'


def test_a_root_that_is_not_there_needs_no_repair(tmp_path):
    assert list(repair_all(tmp_path / 'absent')) == []

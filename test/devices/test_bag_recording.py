# SPDX-License-Identifier: Apache-2.0
"""Recording through the queue and the thread: nothing lost, full and read-only disks said."""

import errno
import json
import os
import struct
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader
from support.bag_samples import POINT, T0, TEXT, point, text, write_bag
from support.waiting import GENEROUS_S, wait_until

from eol_ros.devices.bag import recording as bag_recording
from eol_ros.devices.bag.mcap_file import BagMessage
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recording import Machine, Recording, Roles
from eol_ros.devices.bag.selection import MOST_REQUESTS, Slipping
from eol_ros.disk import Disk
from eol_ros.errors import ConfigError
from eol_ros.settings import RecorderSettings

SETTINGS = RecorderSettings(images='all', min_free_gb=0.0)


def start(root, settings=SETTINGS, images='', rhythm=(), requests='', **machine) -> Recording:
    return Recording(
        root, 'my scene', [POINT, TEXT], {'scene': 'x'}, settings,
        Roles(images, rhythm=rhythm, requests=requests), Machine(**machine),
    )  # fmt: skip


def feed(recording, count, first=0, step_ns=1_000_000):
    for i in range(first, first + count):
        recording.take(BagMessage('/eol/point', point(i), T0 + i * step_ns, T0, i + 1))


def test_recorders_that_begin_in_the_same_second_have_a_bag_each(tmp_path, monkeypatch):
    monkeypatch.setattr(time, 'strftime', lambda _format: '1970-01-01_00-01-00')
    monkeypatch.setattr(Path, 'exists', lambda _path: False)  # as right before another makes it
    recordings = [start(tmp_path, threaded=False) for _ in range(3)]
    for number, recording in enumerate(recordings):
        feed(recording, 5, first=10 * number)
        recording.close()
    monkeypatch.undo()
    assert len({recording.folder for recording in recordings}) == 3
    for number, recording in enumerate(recordings):
        found = [m.data for m in BagReader(recording.folder).messages()]
        assert found == [point(10 * number + k) for k in range(5)]


def test_all_that_is_taken_is_in_the_bag_and_what_was_lost_in_its_metadata(tmp_path):
    recording = start(tmp_path)
    feed(recording, 2000)
    feed(recording, 3000, first=2003)
    recording.close()
    bag = BagReader(recording.folder)
    assert [m.sequence for m in bag.messages()] == [*range(1, 2001), *range(2004, 5004)]
    assert json.loads(bag.gaps['lost_before_recorder']) == {'/eol/point': 3}
    assert json.loads(bag.gaps['received']) == {'/eol/point': 5000}
    assert bag.about == {'scene': 'x'}
    assert (recording.lost, recording.message_count) == (3, 5000)
    assert recording.folder.name.startswith('my-scene_2')


def test_a_request_whose_answer_alone_came_is_named_in_the_bag(tmp_path):
    recording = start(tmp_path, requests='/eol/requests', threaded=False)
    for id_, is_request in (
        ('a', True), ('a', False), ('a', False),  # two nodes answered
        ('b', False), ('b', True),  # overtaken by its answer
        ('c', False), ('c', False),  # sent before its sender discovered the recorder
        ('', False), ('d', True),
    ):  # fmt: skip
        recording.request(id_, is_request)
    assert recording.lost == 1
    later = start(tmp_path / 'later', requests='/eol/requests', threaded=False)
    later.go_on(recording)
    for id_ in ('d', 'd', 'e', 'e' * 500):  # 'd' was asked while the first was recorded
        later.request(id_, False)
    assert later.lost == 1
    later.close()
    for k in range(MOST_REQUESTS):  # a bag of months
        recording.request(str(k), True)
    assert recording.lost == 1
    recording.close()
    gaps = BagReader(recording.folder).gaps
    assert json.loads(gaps['lost_before_recorder']) == {'/eol/requests': 1}


def test_a_disk_that_does_not_answer_for_long_drops_and_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_recording, 'MOST_BYTES', 2000)
    recording = start(tmp_path)
    with recording._ready:  # the writing thread stands still
        for i in range(100):
            recording.take(BagMessage('/eol/point', point(i), T0 + i, T0, i + 1))
    wait_until(lambda: not recording._queue)
    feed(recording, 1, first=100)
    recording.close()
    kept = recording.message_count
    assert 1 < kept < 100
    assert recording.dropped['/eol/point'] == recording.lost == 101 - kept
    gaps = BagReader(recording.folder).gaps
    assert json.loads(gaps['dropped_in_recorder']) == {'/eol/point': 101 - kept}
    assert json.loads(gaps['lost_before_recorder']) == {}
    assert recording.drop_cause == 'the disk does not answer'


class SlowDisk(Disk):
    """Synchronises nothing of a file that is being written until it is `let`."""

    def __init__(self):
        self.begun, self.let, self.error = threading.Event(), threading.Event(), None

    def sync(self, file):
        if file.mode == 'ab':
            self.begun.set()
            assert self.let.wait(GENEROUS_S)
            if self.error:
                raise self.error
        super().sync(file)


def test_messages_are_written_while_the_disk_synchronises(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_recording, 'QUEUE_BYTES', 300_000)
    settings = RecorderSettings(images='all', min_free_gb=0.0, sync_s=0.05)
    disk, picture = SlowDisk(), text('x' * 100_000)
    recording = start(tmp_path, settings, images='/eol/text', disk=disk)
    feed(recording, 1)
    assert disk.begun.wait(GENEROUS_S)
    for i in range(20):
        recording.take(BagMessage('/eol/text', picture, T0 + i, T0, i + 1))
        wait_until(lambda n=i + 2: recording.message_count == n)
    disk.let.set()
    recording.close()
    assert recording.lost == 0 and BagReader(recording.folder).counts['/eol/text'] == 20


def test_a_disk_that_refuses_to_synchronise_pauses_the_recording(tmp_path):
    settings = RecorderSettings(images='all', min_free_gb=0.0, sync_s=0.05)
    disk = SlowDisk()
    disk.error = OSError(errno.EIO, os.strerror(errno.EIO))
    disk.let.set()
    recording = start(tmp_path, settings, disk=disk)
    feed(recording, 1)
    wait_until(lambda: 'Input/output error' in recording.trouble)
    recording.close()


def test_in_a_hurry_pictures_are_stored_uncompressed(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_recording, 'HURRY_BYTES', 300_000)
    recording = start(tmp_path, images='/eol/text')
    picture = text('x' * 100_000)
    with recording._ready:  # ten wait at once; the last few are no longer in a hurry
        for i in range(10):
            recording.take(BagMessage('/eol/text', picture, T0 + i, T0, i + 1))
    recording.close()
    path = next(recording.folder.glob('*.mcap'))
    with open(path, 'rb') as file:
        chunks = make_reader(file).get_summary().chunk_indexes
        kinds = [c.compression for c in chunks if c.message_index_offsets]
    assert kinds[:6] == [''] * 6
    assert kinds[-2:] == ['zstd'] * 2
    assert [m.data for m in BagReader(path).messages()] == [picture] * 10


def stamped(ns, size=0):
    return b'\0\1\0\0' + struct.pack('<iI', *divmod(ns, 10**9)) + bytes(size)


def test_images_lost_between_camera_and_recorder_are_counted_once(tmp_path):
    recording = start(tmp_path, images='/eol/text', rhythm=['/eol/text'], threaded=False)
    for i in range(700):
        now = T0 + i * 16_666_667
        if i not in (7, 8, 300, 599):
            recording.take(BagMessage('/eol/text', stamped(now), now, now, i + 1))
    recording.close()
    gaps = BagReader(recording.folder).gaps
    assert json.loads(gaps['lost_before_recorder']) == {'/eol/text': 4}
    assert json.loads(gaps['stamp_gaps']) == {'/eol/text': 0}
    assert recording.lost == 4


def test_slips_outlast_pictures_when_the_disk_is_too_slow(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_recording, 'QUEUE_BYTES', 10_000)
    recording = start(tmp_path, images='/eol/text', rhythm=['/eol/text'], threaded=False)
    for i in range(100):
        now = T0 + i * 16_666_667
        recording.take(BagMessage('/eol/text', stamped(now, 1000), now, now, 0))
        recording.take(BagMessage('/eol/point', point(i), now, now, i + 1))
    recording.close()
    bag = BagReader(recording.folder)
    assert bag.counts['/eol/point'] == 100
    dropped = json.loads(bag.gaps['dropped_in_recorder'])
    assert dropped == {'/eol/text': 100 - bag.counts['/eol/text']} and dropped['/eol/text'] > 80
    assert json.loads(bag.gaps['stamp_gaps']) == {'/eol/text': 0}
    assert recording.drop_cause == 'disk or processor too slow'


def test_pictures_around_slips(tmp_path):
    settings = RecorderSettings(images='around_slips', before_s=0.1, after_s=0.1, min_free_gb=0.0)
    recording = start(tmp_path, settings, images='/eol/text')
    for i in range(300):
        now = T0 + i * 10_000_000
        if i == 100:
            recording.slip(Slipping(1, True, now))
        if i == 150:
            recording.slip(Slipping(1, False, now))
        recording.take(BagMessage('/eol/text', text('picture'), now, now, i))
        recording.take(BagMessage('/eol/point', point(i), now, now, i))
    recording.close()
    bag = BagReader(recording.folder)
    assert [m.sequence for m in bag.messages(['/eol/text'])] == list(range(90, 161))
    assert bag.counts['/eol/point'] == 300


def test_the_budget_of_pictures_is_one_of_the_day_not_of_the_run(tmp_path):
    picture = text('x' * 1000)
    settings = RecorderSettings(
        images='all', images_max_gb=10.5 * len(picture) / 1e9, min_free_gb=0.0
    )
    day = ['2026-11-21']

    def run():
        recording = start(
            tmp_path, settings, images='/eol/text', threaded=False, today=lambda: day[0]
        )
        for i in range(6):
            recording.take(BagMessage('/eol/text', picture, T0 + i, T0, i))
            recording.take(BagMessage('/eol/point', point(i), T0 + i, T0, i))
        recording.close()
        return recording

    assert [run().message_count for _ in range(3)] == [12, 10, 6]  # points go on
    day[0] = '2026-11-22'
    last = run()
    assert last.message_count == 12 and not last.budget.spent


def test_what_is_too_old_goes_while_the_recorder_runs(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    write_bag(tmp_path / 'old').close()
    write_bag(tmp_path / 'marked').close()
    (tmp_path / 'marked' / 'kept.txt').touch()
    write_bag(tmp_path / 'yesterday').close()
    for name, days in (('old', 9), ('marked', 9), ('yesterday', 1)):
        then = time.time() - days * 86400
        os.utime(tmp_path / name / f'{name}_0.mcap', (then, then))
    settings = RecorderSettings(images='all', min_free_gb=0.0, keep_days=2.0)
    recording = start(tmp_path, settings)
    wait_until(lambda: recording.repaired)
    assert recording.repaired == ['old: removed: older than 2 days']
    recording.close()
    left = {p.name for p in tmp_path.iterdir() if p.is_dir() and p.name != 'state'}
    assert left == {'marked', 'yesterday', recording.folder.name}


def test_recording_stops_before_the_disk_is_full_and_goes_on_when_there_is_room(
    tmp_path, monkeypatch
):
    free = [10e9]
    monkeypatch.setattr(
        bag_recording.shutil, 'disk_usage', lambda path: SimpleNamespace(free=free[0])
    )
    monkeypatch.setattr(bag_recording, 'FLUSH_S', 0.02)
    monkeypatch.setattr(bag_recording, 'RETRY_S', 0.02)
    recording = start(tmp_path, RecorderSettings(images='all', min_free_gb=5.0))
    feed(recording, 100)
    wait_until(lambda: recording.message_count == 100)
    free[0] = 1e9
    wait_until(lambda: recording.trouble)
    assert '1.00 GB free' in recording.trouble
    assert 'recorder.min_free_gb' in recording.trouble
    first = recording.folder
    assert sorted(p.suffix for p in first.iterdir()) == ['.mcap', '.yaml']
    free[0] = 5.2e9  # room for one image: it would stop again at once
    wait_until(lambda: '5.20 GB free' in recording.trouble)
    assert 'goes on above 5.5 GB' in recording.trouble
    free[0] = 10e9
    wait_until(lambda: not recording.trouble)
    feed(recording, 50)
    recording.close()
    assert recording.folder != first
    assert BagReader(recording.folder).counts['/eol/point'] == 50
    assert recording.message_count == 150


def test_a_disk_that_is_full_at_the_start_is_waited_for(tmp_path):
    recording = start(tmp_path, RecorderSettings(min_free_gb=1e9))
    assert 'recording stops below 1e+09 GB' in recording.trouble
    recording.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('flush_s, sync_s', [(0.02, 0.0), (60.0, 0.2)], ids=['flush', 'sync'])
def test_a_disk_that_refuses_a_write_pauses_the_recording(tmp_path, monkeypatch, flush_s, sync_s):
    monkeypatch.setattr(bag_recording, 'FLUSH_S', flush_s)
    recording = start(tmp_path, RecorderSettings(min_free_gb=0.0, sync_s=sync_s))
    os.dup2(os.open('/dev/full', os.O_WRONLY), recording._writer._file.file.fileno())
    feed(recording, 100)
    wait_until(lambda: recording.trouble)
    assert f'the disk of {tmp_path} is full (No space left on device)' in recording.trouble
    feed(recording, 10, first=100)
    wait_until(lambda: recording.lost >= 10)
    assert 'is full' in recording.drop_cause  # and not called too slow
    recording.close()


def test_a_root_that_cannot_be_written_is_said(tmp_path):
    (tmp_path / 'file').write_text('')
    for root in (tmp_path / 'file' / 'bags', Path('/proc/bags')):  # the second refuses root, too
        with pytest.raises(ConfigError, match='cannot be written.*--bag DIR'):
            start(root)


def test_an_earlier_bag_is_repaired_at_the_start(tmp_path):
    bag = write_bag(tmp_path / 'old')
    bag.flush()
    bag.abandon()
    recording = start(tmp_path)
    wait_until(lambda: recording.repaired)
    assert recording.repaired == ['old_0.mcap.part: 110 messages saved']
    recording.close()
    assert (tmp_path / 'old' / 'old_0.mcap').exists()


def test_a_message_too_short_for_a_stamp_is_recorded_as_it_came_and_counted(tmp_path):
    recording = start(tmp_path, rhythm=['/eol/point'])
    short = [b'', b'\0\1\0\0', b'\0\1\0\0' + b'x' * 7]
    for k, data in enumerate(short):
        recording.take(BagMessage('/eol/point', data, T0 + k, T0, k + 1))
    feed(recording, 10, first=3)
    wait_until(lambda: recording.message_count == 13)  # the thread lives
    recording.close()
    bag = BagReader(recording.folder)
    assert [m.data for m in bag.messages()][:3] == short and bag.counts['/eol/point'] == 13
    assert json.loads(bag.gaps['without_stamp']) == {'/eol/point': 3}
    assert not recording.dropped and not recording.lost


def test_a_fault_of_the_writing_thread_ends_the_bag_and_counts_what_it_leaves(
    tmp_path, monkeypatch
):
    import threading

    ended, begin = [], threading.Event()
    monkeypatch.setattr(threading, 'excepthook', lambda what: ended.append(what.exc_value))

    def broken(recording, entry=None):
        begin.wait()
        if entry is not None and recording.message_count == 5:
            raise RuntimeError('broken')
        step(recording, entry)

    step = Recording._step
    monkeypatch.setattr(Recording, '_step', broken)
    recording = start(tmp_path)
    feed(recording, 20)
    begin.set()
    recording._thread.join(20.0)
    recording.close()
    assert [str(error) for error in ended] == ['broken']
    bag = BagReader(recording.folder)
    assert bag.counts['/eol/point'] == 5 and not bag.cut_short
    assert json.loads(bag.gaps['dropped_in_recorder']) == {'/eol/point': 15}

# SPDX-License-Identifier: Apache-2.0
"""Damage costs what it hit, and is said: hundreds of flipped bits and cuts."""

import os
import re
import warnings

import numpy as np
import pytest
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from support.bag_samples import POINT, T0, TEXT, point, rows_of, text

from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recover import repair
from eol_ros.devices.bag.verify import verify
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import BagDamaged

ABOUT = {'scene': 'scene: test', 'seeds': '{twin: 7}'}
GAPS = {'lost_before_recorder': '{"/eol/point": 3}'}


def write(folder, whole=True):
    """Write 120 points, 12 texts and 4 images in some ten chunks; return the file."""
    rng = np.random.default_rng(1)
    bag = BagWriter(folder, [POINT, TEXT], ABOUT)
    for i in range(120):
        now = T0 + i * 10_000_000
        bag.write('/eol/point', point(i, -i), now, now - 500, i + 1)
        if i % 10 == 0:
            bag.write('/eol/text', text(f'word {i}'), now + 1, T0, i // 10 + 1)
        if i % 30 == 7:
            noise = rng.integers(0, 256, 500, dtype=np.uint8).tobytes()
            bag.write('/eol/text', b'\0\1\0\0' + noise + bytes(70_000), now + 2, T0, i)
        if i % 20 == 19:
            bag.flush()
    bag.gaps = GAPS
    bag.close() if whole else bag.abandon()
    [path] = folder.glob('*.mcap*')
    return path


class Truth:
    """The messages of a file, by chunk, as an independent reader has them."""

    def __init__(self, path):
        self.data = path.read_bytes()
        self.chunks = []  # (offset, end, messages)
        with open(path, 'rb') as file:
            reader = StreamReader(file, emit_chunks=True)
            records = reader.records
            while True:
                begin = file.tell() or 8
                try:
                    record = next(records)
                except Exception:  # a file that has no end
                    break
                if isinstance(record, Chunk):
                    messages = [m for m in breakup_chunk(record) if isinstance(m, Message)]
                    rows = {(m.log_time, m.sequence, m.data) for m in messages}
                    self.chunks.append((begin, file.tell(), rows))
        self.all = set().union(*(rows for _, _, rows in self.chunks))


def by_topic(messages):
    found = {}
    for m in messages:
        found.setdefault(m.topic, []).append((m.log_ns, m.publish_ns, m.data))
    return found


def in_batches(bag):
    """What `batches` gives, which does not take messages apart one by one."""
    found = {}
    for topic, batch in bag.batches(list(bag.topics)):
        found.setdefault(topic, []).extend(rows_of(batch))
    return found


def read(path):
    """Return the bag, its messages, and the times of what it calls damaged."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', BagDamaged)
        bag = BagReader(path)
        messages = list(bag.messages())
        rows = [(m.log_ns, m.sequence, m.data) for m in messages]
        assert in_batches(bag) == by_topic(messages)
    assert rows == sorted(rows, key=lambda row: row[0]) and len(rows) == len(set(rows))
    spans = [(d.start_ns, d.end_ns) for f in bag.files for d in f.damage]
    return bag, set(rows), spans


@pytest.mark.slow
@pytest.mark.parametrize('whole', [True, False])
def test_a_flipped_bit_costs_its_chunk_at_most_and_is_said(tmp_path, whole):
    path = write(tmp_path / 'run', whole)
    truth, (clean, _, _) = Truth(path), read(path)
    assert len(truth.chunks) >= 11 and len(truth.all) == 136
    about = clean.about
    rng = np.random.default_rng(3 if whole else 4)
    hit = 0
    for bit in rng.integers(0, 8 * len(truth.data), 250):
        at = int(bit) // 8
        data = bytearray(truth.data)
        data[at] ^= 1 << (int(bit) % 8)
        path.write_bytes(data)
        bag, got, spans = read(path)
        here = next((rows for begin, end, rows in truth.chunks if begin <= at < end), set())
        missing = truth.all - got
        assert not got - truth.all, at
        assert missing <= here, at
        cut = bag.files[0].cut_at is not None and bag.files[0].cut_at <= at
        for log_ns, _, _ in missing:
            assert cut or any(start <= log_ns <= end for start, end in spans), at
        hit += bool(missing)
        assert bag.topics == clean.topics, at
        assert bag.about == about or (bag.damage and not whole), at
        assert bag.gaps == clean.gaps or bag.damage, at
        if missing or bag.about != about:
            assert verify(path)[1], at
    assert hit > 15


@pytest.mark.slow
def test_a_cut_costs_what_is_behind_it_at_most_and_is_said(tmp_path):
    """A file without its end is one of these cuts, so only whole files are cut."""
    path = write(tmp_path / 'run')
    truth = Truth(path)
    path.unlink()
    path = path.with_name('run_0.mcap.part')
    rng = np.random.default_rng(5)
    for size in rng.integers(0, len(truth.data), 200):
        path.write_bytes(truth.data[:size])
        bag, got, spans = read(path)
        assert got == set().union(*(r for _, end, r in truth.chunks if end <= size)), size
        assert bag.cut_short and not spans, size
        if size % 10 == 0:
            assert verify(path)[1] == bag.cut_short, size


@pytest.mark.slow
def test_a_repair_loses_nothing_that_could_be_read(tmp_path, monkeypatch):
    for name in ('fsync', 'fdatasync'):  # not what this is about, and slow
        monkeypatch.setattr(os, name, lambda handle: None)
    clean = write(tmp_path / 'run', whole=False).read_bytes()
    part = tmp_path / 'run' / 'run_0.mcap.part'
    rng = np.random.default_rng(8)
    for bit in rng.integers(0, 8 * len(clean), 30):
        data = bytearray(clean)
        data[int(bit) // 8] ^= 1 << (int(bit) % 8)
        part.write_bytes(data)
        _, before, _ = read(part)
        done = repair(part)
        _, after, _ = read(done.file)
        assert after == before and done.message_count == len(before), int(bit) // 8
        assert verify(tmp_path / 'run')[1] == [], int(bit) // 8
        done.file.unlink()


def test_what_is_missing_is_said_in_times_of_the_bag(tmp_path):
    path = write(tmp_path / 'run')
    truth = Truth(path)
    data = bytearray(truth.data)
    begin, end, rows = truth.chunks[3]
    data[(begin + end) // 2] ^= 1
    path.write_bytes(data)
    with pytest.warns(BagDamaged, match='may be missing'):
        messages = list(BagReader(tmp_path / 'run').messages())
    assert len(messages) == len(truth.all) - len(rows)
    line = verify(tmp_path / 'run')[1][0]
    first, last = (f(row[0] for row in rows) for f in (min, max))
    said = re.search(r'messages from ([\d.]+) s to ([\d.]+) s', line)
    assert [float(g) for g in said.groups()] == pytest.approx(
        [(first - T0) * 1e-9, (last - T0) * 1e-9], abs=1e-3
    )


def test_a_schema_of_the_index_is_only_taken_with_its_checksum(tmp_path):
    """A column that a flipped bit renames or drops must not be dropped in silence."""
    path = write(tmp_path / 'run')
    data = path.read_bytes()
    at = data.rindex(b'float64 y')
    path.write_bytes(data[:at] + b'float64 z' + data[at + 9 :])
    bag, got, _ = read(path)
    assert bag.topics['/eol/point'] == POINT
    assert len(got) == 136
    assert 'the index' in bag.damage[0]


def test_what_the_index_knows_of_a_chunk_holds_against_its_head(tmp_path):
    path = write(tmp_path / 'run')
    truth = Truth(path)
    begin = truth.chunks[3][0]
    for at in (0, 3, 12, 37, 42, 46):  # opcode, length, time, length of the name, name, length
        data = bytearray(truth.data)
        data[begin + at] ^= 4
        path.write_bytes(data)
        bag, got, _ = read(path)
        assert got == truth.all and not bag.damage, at
        assert verify(path)[1], at


def test_a_repair_of_a_damaged_index_loses_nothing(tmp_path):
    path = write(tmp_path / 'run')
    data = bytearray(path.read_bytes())
    data[-20] ^= 1
    path.write_bytes(data)
    with pytest.warns(BagDamaged, match='the index'):
        BagReader(path)
    done = repair(path)
    assert (done.damage, done.aside, done.message_count) == ((), None, 136)
    assert verify(tmp_path / 'run')[1] == []


def test_metadata_yaml_may_be_damaged_too(tmp_path):
    write(tmp_path / 'run')
    (tmp_path / 'run' / 'metadata.yaml').write_bytes(b'rosbag2_bagfile_inf\xffrmation: {')
    bag, got, _ = read(tmp_path / 'run')
    assert len(got) == 136 and bag.about == ABOUT
    assert 'not the metadata of a rosbag2 folder' in verify(tmp_path / 'run')[1][0]


def test_settings_and_losses_survive_damage_to_their_record(tmp_path):
    path = write(tmp_path / 'run')
    clean = path.read_bytes()
    for word in (b'scene: test', b'"/eol/point": 3'):
        data = bytearray(clean)
        data[data.index(word)] ^= 1
        path.write_bytes(data)
        bag, _, _ = read(path)
        assert bag.about == ABOUT and bag.gaps == GAPS
        assert 'metadata eol_ros' in bag.damage[0]

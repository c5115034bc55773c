# SPDX-License-Identifier: Apache-2.0
"""Reading whole bags, cut ones, and things that are not bags."""

import struct

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from support.bag_samples import POINT, T0, TEXT, point, rows_of, text, write_bag

from eol_ros.devices.bag.reader import BagReader, bags_in
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import BagDamaged, ConfigError, DeviceMissing


@pytest.fixture
def run(tmp_path):
    write_bag(tmp_path / 'run', split_s=0.25).close()
    return tmp_path / 'run'


def test_what_is_not_a_bag(tmp_path):
    with pytest.raises(DeviceMissing, match='no such bag'):
        BagReader(tmp_path / 'absent')
    (tmp_path / 'notes.txt').write_text('hello there, not a bag')
    with pytest.raises(ConfigError, match="not a bag: begins with b'hello th'"):
        BagReader(tmp_path / 'notes.txt')
    (tmp_path / 'empty.mcap').write_bytes(b'')
    with pytest.raises(ConfigError, match='not a bag: the file is empty'):
        BagReader(tmp_path / 'empty.mcap')
    (tmp_path / 'folder').mkdir()
    with pytest.raises(ConfigError, match='without .mcap files'):
        BagReader(tmp_path / 'folder')
    (tmp_path / 'folder' / 'metadata.yaml').write_text('scene: x')
    with pytest.raises(ConfigError, match='not the metadata of a rosbag2 folder'):
        BagReader(tmp_path / 'folder')


@pytest.mark.parametrize('files', [1, 3])
def test_batches_are_in_order_although_chunks_and_files_overlap(tmp_path, files):
    """As messages are, ties apart: images stand in chunks of their own between the others."""
    rng = np.random.default_rng(1)
    for k in range(files):
        bag = BagWriter(tmp_path / 'run' if files == 1 else tmp_path / f'b{k}', [POINT, TEXT], {})
        for i in range(300):
            now = T0 + 1_000_000 * i + int(rng.integers(-40, 40)) * 500_000 + k
            bag.write('/eol/point', point(i), now, i, i + 1)
            if i % 7 == 0:
                bag.write('/eol/text', text('x' * (70_000 if i % 2 else 3)), now + 3, i, i + 1)
            if i % 20 == 0:
                bag.flush()
        bag.close()
        if files > 1:
            (tmp_path / 'run').mkdir(exist_ok=True)
            (tmp_path / f'b{k}' / f'b{k}_0.mcap').rename(tmp_path / 'run' / f'run_{k}.mcap')
    bag = BagReader(tmp_path / 'run')
    for span in ((0, None), (T0 + 50_000_000, T0 + 120_000_000)):
        for topic in bag.topics:
            expected = [(m.log_ns, m.publish_ns, m.data) for m in bag.messages([topic], *span)]
            batches = [batch for _, batch in bag.batches([topic], *span)]
            got = [row for batch in batches for row in rows_of(batch)]
            assert [row[0] for row in got] == sorted(row[0] for row in got)
            assert sorted(got) == sorted(expected) and len(got) > 9
    assert len(list(bag.batches(['/eol/point']))) > 3 or files > 1


def test_a_file_beside_them_does_not_make_a_folder_of_bags_a_bag(tmp_path):
    write_bag(tmp_path / 'run', 7).close()
    (tmp_path / 'cut.mcap').write_bytes(next((tmp_path / 'run').glob('*.mcap')).read_bytes())
    (tmp_path / 'broken.mcap').write_bytes(b'hello')

    assert BagReader(tmp_path).path == tmp_path / 'run'
    assert bags_in(tmp_path) == [tmp_path / 'run'] and bags_in(tmp_path / 'run') == []


def test_a_folder_of_bags_does_not_stand_for_the_replay_that_plays_from_it(tmp_path):
    replay_of = {'replay_of': str(tmp_path)}
    playing = write_bag(tmp_path / 'only', 0, about=replay_of)  # as a playback begins
    with pytest.raises(ConfigError, match='only recordings of replays in it; name the one'):
        BagReader(tmp_path)

    write_bag(tmp_path / 'run', 7).close()
    write_bag(tmp_path / 'replay', 3, about=replay_of).close()
    playing.write('/eol/point', point(0), T0, T0)
    playing.flush()
    (tmp_path / 'begins').mkdir()
    (tmp_path / 'begins' / 'begins_0.mcap.part').write_bytes(b'')  # a recorder begins this moment
    assert BagReader(tmp_path).path.name == 'run'
    assert BagReader(tmp_path / 'replay').counts['/eol/point'] == 3  # named, it is read

    running = write_bag(tmp_path / 'running', 9)
    running.flush()
    assert BagReader(tmp_path).path.name == 'running'  # a run in the making is one
    playing.close()
    running.close()


def test_a_file_that_the_metadata_names_and_that_is_gone(run):
    (run / 'run_1.mcap').unlink()
    with pytest.raises(DeviceMissing, match='run_1.mcap is named in metadata.yaml'):
        BagReader(run)


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize(
    'options',
    [
        {},
        {'use_chunking': False},
        {'use_summary_offsets': False, 'index_types': IndexType.NONE, 'use_statistics': False},
        {'chunk_size': 300, 'enable_crcs': False},
    ],
    ids=['usual', 'unchunked', 'without-index', 'without-checksums'],
)
def test_bags_of_other_programs_are_read(tmp_path, compression, options):
    """Their clocks may begin at 0, and their files have attachments."""
    path, sent = tmp_path / 'other.mcap', []
    with open(path, 'wb') as file:
        writer = Writer(file, compression=compression, **options)
        writer.start('ros2')
        schema = writer.register_schema(POINT.type, 'ros2msg', POINT.definition.encode())
        channel = writer.register_channel('/eol/point', 'cdr', schema)
        writer.add_attachment(0, 0, 'photo', 'image/png', b'x' * 1000)
        writer.add_metadata('notes', {'by': 'them'})
        for i in range(100):
            writer.add_message(channel, i * 1000, point(i), i * 1000, i)
            sent.append((i * 1000, i, point(i)))
        writer.finish()
    bag = BagReader(path)
    assert [(m.log_ns, m.sequence, m.data) for m in bag.messages()] == sent
    assert bag.counts == {'/eol/point': 100} and bag.damage == []
    assert bag.topics['/eol/point'].definition == POINT.definition
    assert bag.files[0].metadata['notes'] == {'by': 'them'}
    got = [row for _, batch in bag.batches(['/eol/point']) for row in rows_of(batch)]
    assert got == [(log_ns, log_ns, data) for log_ns, _, data in sent]


@pytest.mark.parametrize(
    ('offset', 'length', 'why'),
    [(2**64 - 1, 70, 'the file ends within it'), (1 << 40, 70, 'the file ends within it'),
     (8, 9, 'the file ends within it'), (8, 70, 'no metadata there')],
)  # fmt: skip
def test_an_index_of_metadata_that_points_elsewhere_is_told(tmp_path, offset, length, why):
    path = tmp_path / 'foreign.mcap'
    with path.open('wb') as file:
        writer = Writer(file, enable_crcs=False)
        writer.start('', 'somebody else')
        channel = writer.register_channel('/words', 'json', 0)
        writer.add_message(channel, T0, b'{}', T0, 1)
        writer.add_metadata('theirs', {'a': 'b'})
        writer.finish()
    data = path.read_bytes()
    at = data.rindex(b'theirs') - 4 - 16  # of offset and length, which stand before the name
    path.write_bytes(data[:at] + struct.pack('<QQ', offset, length) + data[at + 16 :])
    with pytest.warns(BagDamaged, match=why):
        bag = BagReader(path)
    assert bag.counts == {'/words': 1}
    assert [m.data for m in bag.messages()] == [b'{}']

# SPDX-License-Identifier: Apache-2.0
"""What BagWriter writes is read by three independent programs: mcap, mcap-ros2-support, rosbags."""

import pytest
import yaml
from mcap.reader import make_reader
from support.bag_samples import HASH, POINT, QOS, T0, TEXT, point, text, write_bag

from eol_ros.devices.bag.mcap_file import CHUNK_BYTES, BagFile
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import ConfigError


def test_a_bag_is_a_rosbag2_folder(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.gaps = {'lost': '{"/eol/point": 3}'}
    bag.close()
    assert sorted(p.name for p in (tmp_path / 'run').iterdir()) == ['metadata.yaml', 'run_0.mcap']
    info = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())
    info = info['rosbag2_bagfile_information']
    assert info['version'] == 9
    assert info['message_count'] == 110
    assert info['duration'] == {'nanoseconds': 99 * 10_000_000}
    assert info['custom_data']['scene'] == 'scene: test'
    assert info['custom_data']['lost'] == '{"/eol/point": 3}'
    first = info['topics_with_message_count'][0]['topic_metadata']
    assert first['type_description_hash'] == HASH
    assert first['offered_qos_profiles'][0]['reliability'] == 'reliable'


def test_mcap_alone_reads_it(tmp_path):
    write_bag(tmp_path / 'run').close()
    with open(tmp_path / 'run' / 'run_0.mcap', 'rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        channel = next(c for c in summary.channels.values() if c.topic == '/eol/point')
        assert channel.message_encoding == 'cdr'
        assert channel.metadata == {'offered_qos_profiles': QOS, 'topic_type_hash': HASH}
        schema = summary.schemas[channel.schema_id]
        assert (schema.name, schema.encoding) == ('geometry_msgs/msg/Point', 'ros2msg')
        got = [
            (m.log_time, m.publish_time, m.sequence, m.data)
            for _, _, m in reader.iter_messages('/eol/point')
        ]
        assert got == [
            (T0 + i * 10_000_000, T0 + i * 10_000_000 - 500, i + 1, point(i, -i))
            for i in range(100)
        ]
        names = {m.name: m.metadata for m in reader.iter_metadata()}
    assert names['eol_ros']['seeds'] == '{twin: 7}'
    assert 'rosbag2' in names


def test_rosbags_reads_the_folder(tmp_path):
    highlevel = pytest.importorskip('rosbags.highlevel')
    write_bag(tmp_path / 'run', split_s=0.5).close()
    with highlevel.AnyReader([tmp_path / 'run']) as reader:
        assert reader.message_count == 110
        xs = [
            reader.deserialize(raw, c.msgtype).x
            for c, _, raw in reader.messages()
            if c.topic == '/eol/point'
        ]
        words = [
            reader.deserialize(raw, c.msgtype).data
            for c, _, raw in reader.messages()
            if c.topic == '/eol/text'
        ]
    assert xs == list(range(100))
    assert words == [f'word {i}' for i in range(0, 100, 10)]


@pytest.mark.parametrize('options, files', [({'split_s': 0.25}, 4), ({'split_bytes': 4000}, 3)])
def test_a_bag_splits_by_time_and_by_size(tmp_path, options, files):
    write_bag(tmp_path / 'run', **options).close()
    names = sorted(p.name for p in (tmp_path / 'run').glob('*.mcap'))
    assert len(names) >= files
    assert names[:2] == ['run_0.mcap', 'run_1.mcap']
    bag = BagReader(tmp_path / 'run')
    assert [m.sequence for m in bag.messages(['/eol/point'])] == list(range(1, 101))
    info = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())
    info = info['rosbag2_bagfile_information']
    assert len(info['relative_file_paths']) == len(names)
    assert sum(f['message_count'] for f in info['files']) == 110


def test_chunks_stay_small(tmp_path):
    file = BagFile(tmp_path / 'a.mcap', [TEXT])
    for i in range(3000):
        file.write(1, text('x' * 1000), T0 + i, T0 + i)
    file.close()
    with open(tmp_path / 'a.mcap', 'rb') as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert len(chunks) >= 3
    assert max(c.uncompressed_size for c in chunks) < CHUNK_BYTES + 2000


def test_an_empty_run_is_a_bag_too(tmp_path):
    BagWriter(tmp_path / 'run', [POINT], {}).close()
    bag = BagReader(tmp_path / 'run')
    assert (bag.counts, bag.duration_s, list(bag.messages())) == ({'/eol/point': 0}, 0.0, [])
    assert bag.topics['/eol/point'] == POINT


def test_a_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / 'file').write_text('')
    (tmp_path / 'unplugged').symlink_to(tmp_path / 'nothing' / 'bags')
    (tmp_path / 'nothing').write_text('')
    for folder in ('file', 'unplugged'):
        with pytest.raises(ConfigError, match=f'{folder} cannot be written'):
            BagWriter(tmp_path / folder / 'run', [POINT], {})
    (tmp_path / 'nothing').unlink()
    (tmp_path / 'run').mkdir()
    with pytest.raises(ConfigError, match='run is there already'):
        BagWriter(tmp_path / 'run', [POINT], {})


def test_pictures_lie_apart_from_the_small_messages(tmp_path):
    file = BagFile(tmp_path / 'a.mcap', [POINT, TEXT])
    for i in range(20):
        file.write(2, text('x' * 200_000), T0 + 2 * i, T0)
        file.write(1, point(i), T0 + 2 * i + 1, T0)
    file.close()
    with open(tmp_path / 'a.mcap', 'rb') as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert [list(c.message_index_offsets) for c in chunks] == [[]] + [[2]] * 20 + [[1]]
    assert [m.log_ns - T0 for m in BagReader(tmp_path / 'a.mcap').messages()] == list(range(40))


def test_a_chunk_spans_less_than_a_second_whoever_writes_it(tmp_path):
    bag = BagWriter(tmp_path / 'run', [POINT], {})
    for i in range(600):  # one minute, and nobody flushes
        bag.write('/eol/point', point(i), T0 + i * 100_000_000, T0, i + 1)
    bag.close()
    places = BagReader(tmp_path / 'run').files[0].places
    assert len(places) == 60
    assert all(place.end_ns - place.start_ns < 1_000_000_000 for place in places)

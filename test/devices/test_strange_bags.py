# SPDX-License-Identifier: Apache-2.0
"""Bags of other programs: their encodings, definitions, clocks and folders."""

import json
import shutil
import struct

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from support.bag_samples import T0, write_bag

from eol_ros import cli
from eol_ros.analysis import report
from eol_ros.analysis.bag import open_bag
from eol_ros.devices.bag import edit
from eol_ros.devices.bag.reader import BagReader

KINDS = {  # topic: message encoding, schema encoding, type, schema, message
    '/json': ('json', 'jsonschema', 'Point', b'{"type": "object"}', b'{"x": 1}'),
    '/bare': ('json', '', '', b'', b'{"x": 1}'),
    '/ros1': ('ros1', 'ros1msg', 'std_msgs/String', b'string data', b'\2\0\0\0hi'),
    '/proto': ('protobuf', 'protobuf', 'p.P', b'\n\xff\xfe\x00', b'\x08\x01'),
    '/idl': ('cdr', 'ros2idl', 'p/msg/P', b'module p {};', b'\0\1\0\0\1'),
}


def write(path, kinds=KINDS, times=(T0, T0 + 1_000_000_000), attach=False):
    """Write a foreign file with a message of each kind at each time."""
    with open(path, 'wb') as file:
        writer = Writer(file)
        writer.start('ros1', 'of somebody else')
        channels = []
        for topic, (encoding, schema_encoding, name, schema, data) in kinds.items():
            number = writer.register_schema(name, schema_encoding, schema) if name else 0
            topic = topic.rstrip('2')
            channels.append((writer.register_channel(topic, encoding, number, {'a': 'b'}), data))
        for time_ns in times:
            for channel, data in channels:
                writer.add_message(channel, time_ns, data, time_ns)
        if attach:
            writer.add_attachment(T0, T0, 'photo.jpg', 'image/jpeg', b'bytes')
        writer.finish()
    return path


def contents(path):
    """Return what an independent reader finds: encodings, schema bytes and messages."""
    with open(path, 'rb') as file:
        return sorted(
            (c.topic, c.message_encoding, c.metadata.get('a'), m.log_time, m.data,
             *((s.encoding, s.name, s.data) if s else ()))
            for s, c, m in make_reader(file).iter_messages()
        )  # fmt: skip


@pytest.mark.parametrize('verb', ['cut', 'recover'])
def test_encodings_and_definitions_stay(tmp_path, verb):
    path = write(tmp_path / 'foreign.mcap')
    out = tmp_path / 'out.mcap'
    assert cli.main(['bag', verb, str(path), '--output', str(out)]) == 0
    assert contents(out) == contents(path)


def test_a_cut_foreign_file_is_repaired_as_it_was(tmp_path):
    path = write(tmp_path / 'foreign.mcap')
    before = contents(path)
    path.write_bytes(path.read_bytes()[:-200])
    cli.main(['bag', 'recover', str(path)])
    assert contents(path) == before


LAST_NS = (1 << 64) - 1
SECOND = 1_000_000_000
CDR = 'cdr', 'ros2msg'
TWO = {  # of one topic: `write` leaves out the 2
    '/t': (*CDR, 'p/msg/T', b'int32 a\nint32 b', b'\0\1\0\0\1\0\0\0\2\0\0\0'),
    '/t2': (*CDR, 'p/msg/T', b'int32 b\nint32 a', b'\0\1\0\0\2\0\0\0\1\0\0\0'),
}


def test_each_message_is_decoded_by_its_own_definition(tmp_path):
    path, out = write(tmp_path / 'two.mcap', TWO), tmp_path / 'out'
    assert cli.main(['bag', 'cut', str(path), '--output', str(out)]) == 0
    for bag in (path, out):
        table = open_bag(bag).table('/t')
        assert table['a'].tolist() == [1] * 4 and table['b'].tolist() == [2] * 4


def test_what_cannot_be_decoded_is_one_line(tmp_path, capsys):
    path = write(tmp_path / 'foreign.mcap', attach=True)
    assert cli.main(['report', str(path), '--csv', '/json', '-o', str(tmp_path)]) == 78
    error = capsys.readouterr().err.splitlines()
    assert 'json/jsonschema' in error[-1] and 'attachments (1)' in error[0]
    assert cli.main(['bag', 'info', str(path), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['topics']['/ros1']['encoding'] == 'ros1/ros1msg'


@pytest.mark.parametrize('metadata', [True, False])
def test_copies_count_once_and_are_told(tmp_path, capsys, metadata):
    folder = tmp_path / 'bag'
    write_bag(folder).close()
    [file] = folder.glob('*.mcap')
    shutil.copy(file, folder / 'bag_0 (1).mcap')
    (folder / '._bag_0.mcap').write_bytes(b'\0\5\x16\7')
    if not metadata:
        (folder / 'metadata.yaml').unlink()
    for words in (['info'], ['recover'], ['info']):
        cli.main(['bag', *words, str(folder)])
        assert 'bag_0 (1).mcap: ' in capsys.readouterr().err
        assert sum(BagReader(folder).counts.values()) == 110


@pytest.mark.parametrize(
    ('name', 'head', 'told'),
    [
        ('bag_0.mcap.zstd', b'\x28\xb5\x2f\xfd', 'is there, compressed as a whole'),
        ('bag_0.mcap.gz', b'\x1f\x8b', 'is there, compressed as a whole'),
        ('bag_0.db3', b'SQLite format 3\0', 'ros2 bag convert'),
    ],
)
def test_files_of_other_kinds_are_named(tmp_path, capsys, name, head, told):
    folder = tmp_path / 'bag'
    write_bag(folder).close()
    (folder / 'bag_0.mcap').unlink()
    (folder / name).write_bytes(head)
    if name.endswith('db3'):
        (folder / 'metadata.yaml').unlink()
    for path in (folder, folder / name):
        assert cli.main(['bag', 'info', str(path)]) == 78
        error = capsys.readouterr().err
        assert error.count('\n') == 1
        assert told.split(', ')[-1].split(' first')[0] in error


@pytest.mark.parametrize('odd', [0, 1, 3_000_000_000_000_000_000, LAST_NS])
def test_messages_of_two_ages_are_no_bag(tmp_path, odd, capsys):
    path = write(tmp_path / 'odd.mcap', {'/t': TWO['/t']}, [odd, T0, T0 + SECOND])
    assert cli.main(['bag', 'info', str(path)]) == 78
    assert 'more than a year apart' in capsys.readouterr().err


def test_one_strange_bag_of_many_is_left_out(tmp_path, capsys):
    sample = BagReader('bags/sample')
    about = {k: v for k, v in sample.about.items() if k != 'sample'}
    (tmp_path / 'bags').mkdir()
    topics, messages = list(sample.topics.values()), sample.messages()
    edit.copy(tmp_path / 'bags' / 'good', topics, messages, about, {}, list)
    text = b'\0\1\0\0' + struct.pack('<I', 2) + b'x\0'
    odd = {
        '/eol/slips': ('cdr', 'ros2msg', 'std_msgs/msg/String', b'string data\n', text),
        '/eol/cascades': ('cdr', 'ros2msg', 'eol_msgs/msg/Cascade', b'string data\n', text),
        '/eol/block_taps': ('json', '', '', b'', b'{}'),
    }
    for k, topic in enumerate(odd):
        (tmp_path / 'bags' / f'odd{k}').mkdir()
        times = [0, *(T0 + n * 10**9 for n in range(9))]
        write(tmp_path / 'bags' / f'odd{k}' / 'x.mcap', {topic: odd[topic]}, times)
    args = ['report', '--all', str(tmp_path / 'bags'), '--output', str(tmp_path / 'out'), '--json']
    assert cli.main(args) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['slips'] > 0 and found['bags'] >= 1
    assert any('odd1' in line for line in found['left_out'])


def test_times_that_cannot_be_meant_make_no_figures(tmp_path):
    sample = BagReader('bags/sample')
    messages = [m._replace(publish_ns=0) for m in sample.messages(['/eol/slips'], 0)]
    far = messages[-1]._replace(log_ns=messages[-1].log_ns + 300 * 86400 * 10**9)
    out = tmp_path / 'bag'
    topics = [sample.topics['/eol/slips']]
    edit.copy(out, topics, iter([*messages, far]), sample.about, {}, list)
    found = report.write(open_bag(out), tmp_path / 'report')
    assert 'slips' not in found['onset_latency_ms']
    assert any('times are 0 or of another clock' in line for line in found['lacking'])
    assert 'too few for a series' in found['one_over_f']['triggers']['sentence']


@pytest.mark.parametrize('left', [b'', bytes(5000), b'not a bag'])
def test_one_bad_file_of_a_bag_is_left_out(tmp_path, capsys, left):
    write_bag(tmp_path / 'bag', split_s=0.3).close()
    files = sorted((tmp_path / 'bag').glob('*.mcap'))
    files[1].write_bytes(left)
    assert cli.main(['bag', 'info', str(tmp_path / 'bag')]) == 0
    captured = capsys.readouterr()
    assert len(files) > 2 and f'{files[1].name}: not a bag' in captured.err
    for file in files:
        file.write_bytes(left)
    assert cli.main(['bag', 'info', str(tmp_path / 'bag')]) == 78


@pytest.mark.parametrize(
    'times',
    [
        [LAST_NS],
        [LAST_NS - 3 * SECOND, LAST_NS - SECOND, LAST_NS],
        [(1 << 63) - SECOND, (1 << 63) - 1, 1 << 63, (1 << 63) + SECOND],
        [T0, T0 + 2 * SECOND, T0 + SECOND],
    ],
)
@pytest.mark.parametrize('verb', ['cut', 'recover'])
def test_no_message_is_lost_for_its_time(tmp_path, verb, times, capsys):
    path, out = write(tmp_path / 'a.mcap', {'/t': TWO['/t']}, times), tmp_path / 'out.mcap'
    assert cli.main(['bag', verb, str(path), '--output', str(out)]) == 0
    assert contents(out) == contents(path)
    code = cli.main(['report', str(path), '--csv', '/t', '-o', str(tmp_path / 'csv')])
    assert code == (78 if LAST_NS in times or 1 << 63 in times else 0)
    assert 'Traceback' not in capsys.readouterr().err


@pytest.mark.parametrize(
    'data', [b'', b'\0\1', b'\0\1\0\0\xff\xff\xff\x7fx\0', b'\0\0\0\0' + bytes(9)]
)
def test_bytes_that_are_no_message_are_told_with_their_topic(tmp_path, capsys, data):
    path = write(tmp_path / 'a.mcap', {'/t': (*CDR, 'p/msg/T', b'string a\nint8 b', data)})
    assert cli.main(['report', str(path), '--csv', '/t', '-o', str(tmp_path / 'csv')]) == 78
    assert f'{path}: /t: p/msg/T: ' in capsys.readouterr().err.splitlines()[-1]


def test_two_files_in_one_are_told(tmp_path, capsys):
    whole = write(tmp_path / 'a.mcap').read_bytes()
    (tmp_path / 'a.mcap').write_bytes(2 * whole)
    assert cli.main(['bag', 'info', str(tmp_path / 'a.mcap')]) == 1
    error = capsys.readouterr().err
    assert f'a second file: `tail -c +{len(whole) + 1}` takes it out' in error
    assert 'messages from 1.000 s to the end may be missing' in error


@pytest.mark.parametrize(
    ('topic', 'kind', 'told'),
    [
        ('/eol/slips', 'eol_msgs/msg/Cascade', 'has the type eol_msgs/msg/Cascade, not eol_msgs/m'),
        ('/eol/slips', 'eol_msgs/msg/Slip', 'eol_msgs/msg/Slip: has no header.stamp, but a, b'),
        ('/eol/camera/image_raw', 'p/msg/T', 'has the type p/msg/T, not sensor_msgs/msg/Image'),
    ],
)
@pytest.mark.parametrize('verb', ['report', 'track'])
def test_a_topic_of_another_type_is_named_with_it(tmp_path, capsys, verb, topic, kind, told):
    path = write(tmp_path / 'a.mcap', {topic: (*CDR, kind, *TWO['/t'][3:])})
    code = cli.main([verb, str(path), '-o', str(tmp_path / 'out')])
    error = capsys.readouterr().err
    ours = kind.startswith('eol_msgs/msg/Slip') and topic == '/eol/slips'
    if verb == 'report':
        assert code == (78 if ours else 0)
        assert f'{topic}{": " if ours else " "}{told}' in error
    else:
        words = topic if 'image' in topic else 'has no raw images'
        assert code == 78 and error.count('\n') == 1 and words in error


def test_names_of_topics_break_no_line(tmp_path, capsys):
    odd = '/a\n\x1b[31mb\u202e\t' + 'c' * 5000
    path = write(tmp_path / 'a.mcap', {odd: TWO['/t'], odd.replace('\n', '\\n'): TWO['/t']})
    for words in (['bag', 'info'], ['track']):
        cli.main([words[0], *words[1:], str(path)])
        said = capsys.readouterr()
        for line in (said.out + said.err).splitlines():
            assert line.isprintable() and len(line) < 9000
    out = tmp_path / 'out.mcap'
    assert cli.main(['bag', 'cut', str(path), '--output', str(out)]) == 0
    assert contents(out) == contents(path) and len(contents(out)) == 4


@pytest.mark.parametrize('verb', ['cut', 'recover'])
def test_attachments_that_are_left_out_are_told(tmp_path, capsys, verb):
    path = write(tmp_path / 'a.mcap', attach=True)
    cli.main(['bag', verb, str(path), '--output', str(tmp_path / 'out.mcap')])
    assert 'a.mcap: its attachments (1) are left out' in capsys.readouterr().err

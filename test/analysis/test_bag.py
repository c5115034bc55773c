# SPDX-License-Identifier: Apache-2.0
"""A bag as tables and CSV, without ROS."""

import csv
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eol_ros import cli
from eol_ros.analysis.bag import open_bag, seconds, topic_names
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import ConfigError, UsageError

T0 = 1_700_000_000_000_000_000
SAMPLE = Path(__file__).parents[2] / 'bags' / 'sample'
DEFINITION = """\
# Things seen.
std_msgs/Header header   # stamp: mid-exposure
uint8 state              # one of many
made_msgs/Thing[] things
float32[] wave
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: made_msgs/Thing
float64 x       # m
uint8 id        # 0..2
"""
THINGS = BagTopic('/eol/things', 'made_msgs/msg/Things', DEFINITION)


def things(i, count=3, wave=2):
    head = struct.pack('<iII6s', T0 // 10**9 + i, 5, 6, b'table\0')
    body = head + struct.pack('<B', i % 4)
    body += bytes(-len(body) % 4) + struct.pack('<I', count)
    for k in range(count):
        body += bytes(-len(body) % 8) + struct.pack('<dB', i + k / 10, k)
    body += bytes(-len(body) % 4) + struct.pack(f'<I{wave}f', wave, *range(wave))
    return b'\0\1\0\0' + body


def made(folder, rows):
    bag = BagWriter(folder, [THINGS], {'scene': 'x'})
    for i, row in enumerate(rows):
        bag.write('/eol/things', row, T0 + i * 10**9, T0 + i * 10**9 - 7, i)
    bag.close()
    return open_bag(folder)


def test_a_bag_says_what_is_in_it():
    told = repr(open_bag(SAMPLE)).splitlines()
    assert told[0].startswith(f'<Bag {SAMPLE}: scene rehearsal, 40.') and 'UTC, ' in told[0]
    assert len(told) - 1 == len(open_bag(SAMPLE).topics)
    assert any(line.split() == ['/eol/blocks', '2255'] for line in told)


def test_a_table_has_a_row_a_message(tmp_path):
    table = made(tmp_path / 'run', [things(i) for i in range(10)]).table('things')
    assert table.dtype.names == (
        'log_time',
        'publish_time',
        'stamp',
        'frame_id',
        'state',
        'things',
        'wave',
    )
    assert table['things']['x'].shape == (10, 3)
    assert table['things']['x'][7].tolist() == [7.0, 7.1, 7.2]
    assert table['wave'].shape == (10, 2)
    assert table['stamp'][3] - table['stamp'][2] == np.timedelta64(1, 's')
    assert seconds(table['log_time'])[0] == pytest.approx(1.7e9)
    assert (table['log_time'] - table['publish_time']).astype(int).tolist() == [7] * 10
    assert set(table['frame_id']) == {'table'}


def test_meaning_and_unit_come_along(tmp_path):
    table = made(tmp_path / 'run', [things(0)]).table('things')[:1]
    assert table.comments['things.x'] == 'm'
    assert table.comments['stamp'] == 'stamp: mid-exposure'
    assert table.topic == '/eol/things'


def test_spans(tmp_path):
    bag = made(tmp_path / 'run', [things(i) for i in range(10)])
    assert bag.table('things', 2.0, 5.0)['things']['x'][:, 0].tolist() == [2.0, 3.0, 4.0]
    assert len(bag.table('things', 100.0)) == 0
    assert bag.table('things', 100.0).dtype.names[2:5] == ('stamp', 'frame_id', 'state')


def test_messages_of_many_shapes_keep_their_order(tmp_path):
    rows = [things(i, count=i % 3, wave=i % 2) for i in range(12)]
    table = made(tmp_path / 'run', rows).table('things')
    assert [len(t) for t in table['things']] == [i % 3 for i in range(12)]
    assert [len(w) for w in table['wave']] == [i % 2 for i in range(12)]
    assert [t['x'].tolist() for t in table['things']] == [
        [i + k / 10 for k in range(i % 3)] for i in range(12)
    ]


def test_more_messages_than_one_batch(tmp_path, monkeypatch):
    monkeypatch.setattr('eol_ros.analysis.bag.BATCH', 7)
    rows = [things(i, wave=2 if i < 30 else 3) for i in range(50)]
    table = made(tmp_path / 'run', rows).table('things')
    assert table['things']['x'][:, 0].tolist() == list(range(50))
    assert [len(w) for w in table['wave']] == [2] * 30 + [3] * 20


def test_csv_has_a_row_for_each_of_an_array(tmp_path):
    table = made(tmp_path / 'run', [things(i) for i in range(4)]).table('things')
    table.to_csv(tmp_path / 'things.csv')
    with open(tmp_path / 'things.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert rows[4]['things.x'] == '1.1'
    assert rows[4]['things.id'] == '1'
    assert rows[4]['stamp'] == '1700000001.000000005'
    assert rows[4]['wave[1]'] == '1.0'


def test_csv_has_one_cell_for_arrays_of_many_lengths(tmp_path):
    table = made(tmp_path / 'run', [things(i, wave=i % 3) for i in range(6)]).table('things')
    table.to_csv(tmp_path / 'things.csv')
    with open(tmp_path / 'things.csv', newline='') as file:
        header, *rows = csv.reader(file)
    assert {len(row) for row in rows} == {len(header)}
    waves = [row[header.index('wave')] for row in rows]
    assert sorted({len(wave.split()) for wave in waves}) == [0, 1, 2]


def test_topic_names(tmp_path):
    bag = made(tmp_path / 'run', [things(0)])
    assert topic_names(bag, None) == ['/eol/things']
    assert topic_names(bag, 'things, /eol/things') == ['/eol/things'] * 2
    with pytest.raises(ConfigError, match='no topic thing'):
        topic_names(bag, 'thing')
    with pytest.raises(UsageError):
        topic_names(bag, ' ,')


def same(one, other):
    assert one.dtype.names == other.dtype.names and len(one) == len(other)
    assert list(one.rows()) == list(other.rows())


def test_what_is_kept_is_what_is_read():
    bag, kept = open_bag(SAMPLE), open_bag(SAMPLE)
    kept.keep({'slips': (), 'cascades': (), 'felt_slips': ()})

    for span in ((), (10.0, 20.0), (50.0, None), (1000.0, None)):
        for topic in ('slips', 'cascades', 'wall'):
            same(kept.table(topic, *span), bag.table(topic, *span))
    for one, other in zip(kept.stamps('slips'), bag.stamps('slips'), strict=True):
        np.testing.assert_array_equal(one, other)


def test_fields_are_kept_and_rows_shown_in_the_only_pass(monkeypatch):
    whole, bag, seen = open_bag(SAMPLE), open_bag(SAMPLE), []

    class Gatherer:
        fields = {'blocks': ('stamp', 'blocks.x'), 'no_such_topic': ()}

        def __init__(self, bag):
            self.add = seen.append

    kept = {'slips': ('stamp', 'distance'), 'led_commands': ('white',), 'no_such_topic': ()}
    bag.keep(kept, (Gatherer,))
    monkeypatch.setattr(bag, 'batches', None)  # the bag is not read again

    for topic, fields in (('slips', ('stamp', 'distance')), ('led_commands', ('white',))):
        table = bag.table(topic)
        assert table.dtype.names == ('log_time', 'publish_time', *fields)
        for field in table.dtype.names:
            np.testing.assert_array_equal(table[field], whole.table(topic)[field])
    blocks = whole.table('blocks')
    assert seen[0].dtype.names == ('log_time', 'publish_time', 'stamp', 'blocks')
    assert seen[0]['blocks'].dtype.names == ('x',)
    x = np.concatenate([table['blocks']['x'] for table in seen])
    np.testing.assert_array_equal(x, blocks['blocks']['x'])
    for times, field in zip(bag.stamps('blocks'), ('log_time', 'stamp'), strict=True):
        np.testing.assert_array_equal(times, blocks[field])


def test_numbers_that_are_strings_leave_a_topic_out_by_name(tmp_path):
    slips = BagTopic('/eol/slips', 'eol_msgs/msg/Slip', 'uint8 block\nstring x\nfloat64 speed\n')
    bag = BagWriter(tmp_path / 'bag', [slips], {'scene': 'x'})
    bag.write('/eol/slips', b'\0\1\0\0\3\0\0\0\2\0\0\0' + b'1\0' + bytes(10), T0, T0, 0)
    bag.close()
    opened = open_bag(tmp_path / 'bag')
    assert opened.count('slips') == 0
    assert opened.notes == [
        '/eol/slips has another definition of eol_msgs/msg/Slip: x is string, not a number; '
        'left out'
    ]


def test_topics_whose_names_become_one_are_two_files(tmp_path, capsys):
    topics = [replace(THINGS, name=name) for name in ('/a/b', '/a_b')]
    bag = BagWriter(tmp_path / 'bag', topics, {'scene': 'x'})
    for i, topic in enumerate(topics):
        bag.write(topic.name, things(i), T0 + i, T0 + i, i)
    bag.close()
    out = tmp_path / 'csv'
    assert (
        cli.main(['report', str(tmp_path / 'bag'), '--output', str(out), '--csv', '/a/b,/a_b']) == 0
    )
    found = {file.name: file.read_text() for file in out.iterdir()}
    assert set(found) == {'a_b.csv', 'a_b-2.csv'}
    assert found['a_b.csv'] != found['a_b-2.csv']

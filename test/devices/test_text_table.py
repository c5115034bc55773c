# SPDX-License-Identifier: Apache-2.0
"""Tables of people and spreadsheets are read alike by all who read tables."""

import codecs
import re

import numpy as np
import pytest

from eol_ros import cli
from eol_ros.devices.camera.image_sequence import read_stamps
from eol_ros.devices.corpus.corpus_file import load_labels, load_moved
from eol_ros.devices.files import text_table
from eol_ros.devices.files.media_folder import _listed
from eol_ros.devices.files.trigger_file import load_triggers
from eol_ros.errors import EolError

BOMS = {
    'utf-8': codecs.BOM_UTF8,
    'utf-16-le': codecs.BOM_UTF16_LE,
    'utf-16-be': codecs.BOM_UTF16_BE,
}


def encodings(text):
    """Yield the bytes of a text in every form that a table may have."""
    yield text.encode()
    yield text.replace('\n', '\r\n').encode()
    yield text.replace('\n', '\r').encode()
    for name, mark in BOMS.items():
        yield mark + text.encode(name)


def moved(path):
    return load_moved(path.with_name('a.wav')).tolist()


def points(path):
    ranges = [text_table.rows(path, 'uvxy', 'uvxy')]
    return [[row.number(name) for name in 'uvxy'] for row in ranges[0]]


READERS = {  # of a file name: what reads it, and what it gives
    'pairs.csv': (lambda p: [(q.left, q.caption) for q in _listed(p.parent)], [('ä.jpg', 'x; y')]),
    't.csv': (lambda p: load_triggers(p)[['time_s', 'grain']].tolist(), [(0.5, 3), (1.5, 4)]),
    'a.moved.csv': (moved, [[0.5, 0.25, 1.0]]),
    'l.txt': (lambda p: load_labels(p).tolist(), [[0.5, 1.5]]),
    's.txt': (lambda p: read_stamps(str(p)).tolist(), [0.5, 1.5]),
    'p.csv': (points, [[1.5, 2.0, 0.25, -0.5]]),
}
TEXTS = [
    ('pairs.csv', 'ä.jpg,b.png,x; y\n'),
    ('pairs.csv', 'sep=;\nä.jpg;b.png;"x; y"\n'),
    ('pairs.csv', '"sep=;"\r\nä.jpg;b.png;"x; y"\r\n'),
    ('pairs.csv', 'ä.jpg\tb.png\tx; y\n'),
    ('pairs.csv', 'Caption,Right,Left\n"x; y",b.png,ä.jpg\n'),
    ('t.csv', 'time_s,grain\n0.5,3\n1.5,4\n'),
    ('t.csv', '\ufefftime_s,grain\n0.5,3\n#N/A: no comment\n1.5,4\n'),
    ('t.csv', 'grain;time_s [s];gain\n3;0,5;1,0\n4;1,5;\n'),
    ('t.csv', '# mine\n\ntime_s\tgrain\n0,5\t3\n1,5\t4\n'),
    ('a.moved.csv', 'time_s,x,y\n0.5,0.25,1\n'),
    ('a.moved.csv', 'y;x;time_s\n1;0,25;0,5\n'),
    ('a.moved.csv', '0,5;0,25;1\n'),
    ('l.txt', '0.5\t1.5\tcrack "of dawn\n'),
    ('l.txt', '0,5\t1,5\tcrack; hum, x\n\\\t100,0\t200,0\n'),
    ('l.txt', 'text;end;start\ncrack;1,5;0,5\n'),
    ('s.txt', '0.5 # first\n1.5\n'),
    ('s.txt', '0,5\n1,5\n'),
    ('s.txt', 'image;stamp\n0;0,5\n1;1,5\n'),
    ('p.csv', '1.5,2,0.25,-0.5\n'),
    ('p.csv', '1,5;2;0,25;-0,5\n'),
    ('p.csv', '1.5 2  0.25 \N{MINUS SIGN}0.5\n'),
    ('p.csv', 'x [m];y [m];u;v\n0,25;-0,5;1,5;2\n'),
]


@pytest.mark.parametrize(('name', 'text'), TEXTS)
def test_every_reader_takes_every_form(tmp_path, name, text):
    read, expected = READERS[name]
    for data in encodings(text):
        (tmp_path / name).write_bytes(data)
        assert read(tmp_path / name) == expected, data


@pytest.mark.parametrize('name', READERS)
@pytest.mark.parametrize(
    ('data', 'told'),
    [
        (bytes(64), ':1:1: a zero byte'),
        ('1,2'.encode('utf-16-le'), 'UTF-16 without a byte order mark'),
        (b'PK\3\4\x14\0\6\0' + bytes(400), ': a workbook, not text'),
        (b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1' + bytes(600), ': a workbook, not text'),
        (b'1,2,3,4\n\n5,6,\xe4,8\n', ':3:5: byte 0xE4 is not UTF-8'),
        (codecs.BOM_UTF16_LE + 'a,b'.encode('utf-16-le')[:-1], ':1:1: not text in utf-16'),
    ],
)
def test_what_is_no_text_is_one_line_with_its_place(tmp_path, name, data, told):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(EolError) as caught:
        READERS[name][0](tmp_path / name)
    assert told in str(caught.value) and str(caught.value).count('\n') == 0


@pytest.mark.parametrize(
    ('name', 'text', 'told'),
    [
        ('t.csv', 'time_s,grain\n0,1\n1700000000,2\n', ':3:1: .*an epoch time'),
        ('t.csv', 'time_s,grain\n0,1\n40000,2\n', 'milliseconds'),
        ('t.csv', 'time_s,grain\n0,1\n#DIV/0!,1\n', ':3:1: time_s #DIV/0! is an error'),
        ('t.csv', 'time_s;grain\n0;#WERT!\n', ':2:2: grain #WERT! is an error'),
        ('t.csv', 'time_s,grain\n0,1\n1,soon\n', ":3:2: grain 'soon' is not a number"),
        ('t.csv', 'time,grain\n0,1\n', ':1:1: no column time_s'),
        ('l.txt', '0.5\t1700000000\tx\n', ':1:2: end .* must lie in'),
        ('a.moved.csv', '0.5,25,1\n', ':1:2: x .* must lie in 0..1'),
        ('s.txt', '0x10\n', ':1:1: 0x10 is not a time'),
        ('s.txt', '1,2.png\n', ':1:1: 1,2.png is not a time'),
        ('t.csv', 'time_s,grain\n0,1e300\n', ":2:2: grain '1e300' must lie in"),
        ('t.csv', 'time_s,grain\n0,9223372036854775808\n', ':2:2: grain .* must lie in'),
        ('t.csv', 'time_s,grain,block\n0,1,40000\n', ':2:3: block .* must lie in'),
        ('t.csv', 'time_s,grain\n0,1.5\n', ':2:2: grain 1.5 is not a whole number'),
        ('t.csv', 'time_s,grain\n1,000.5,1\n', ':2:2: grain 0.5 is not a whole number'),
        ('t.csv', 'time_s,grain,grain\n0,1,2\n', ':1:1: 2 columns are named grain'),
        ('t.csv', '\n# x\ntime_s,time_s,grain\n0,1,2\n', ':3:1: 2 columns are named time_s'),
    ],
)
def test_numbers_that_cannot_be_meant_are_named(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(EolError, match=told):
        READERS[name][0](tmp_path / name)


@pytest.mark.parametrize(
    ('pixels', 'shift', 'metres', 'told'),
    [
        (1, 0, 1000, ':1:.*in metres from the middle of the table, not mm or cm'),
        (1, 0, 100, ':1:.*in metres from the middle of the table, not mm or cm'),
        (1, 9000, 1, ':1:.*outside the image'),
        (0.02, 0, 4.8, 'are x and y in metres'),  # the blocks in the middle, in cm
    ],
)
def test_points_in_other_units_are_refused(tmp_path, capsys, pixels, shift, metres, told):
    xy = np.array([[-0.7, -0.7], [0.7, -0.7], [0.7, 0.7], [-0.7, 0.7]]) * metres
    px = np.array([[200, 700], [900, 700], [900, 50], [200, 50]]) * pixels + shift
    np.savetxt(tmp_path / 'p.csv', np.hstack([px, xy]), delimiter=';')
    args = ['calibrate', 'points', str(tmp_path / 'p.csv'), '--size', '1280x800']
    assert cli.main(args) == 78
    error = capsys.readouterr().err
    assert re.search(told, error) and error.count('\n') == 1


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('a' * 300_000, 1),
        ('time_s,grain' + ',x' * 200_000 + '\n0,1\n', 1),
        ('time_s,grain\n0,1' + ',2' * 200_000 + '\n', 2),
        ('0.5,"' + '1' * 300_000, 1),
        ('0.5\n' * 50 + '1' * 300_000, 51),
    ],
)
@pytest.mark.parametrize('name', READERS)
def test_lines_without_end_are_refused_before_they_fill_the_memory(tmp_path, name, text, line):
    (tmp_path / name).write_text(text)
    with pytest.raises(EolError) as caught:
        READERS[name][0](tmp_path / name)
    told = str(caught.value)
    assert f':{line}:1: not a table: a line of more than' in told or line == 51

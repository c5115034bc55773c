# SPDX-License-Identifier: Apache-2.0
"""Grains as SDIF and as a FluCoMa DataSet, there and back, and what is neither."""

import json
import shutil
import struct

import numpy as np
import pytest

from eol_ros import cli
from eol_ros.core.sound.corpus import Corpus, Source, grain_dtype
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_file, flucoma_file, sdif_file
from eol_ros.errors import ConfigError

RATE = 8000


@pytest.fixture
def corpus(tmp_path):
    random = np.random.default_rng(1)
    sources = []
    for name in 'ab':
        file = tmp_path / f'{name}.wav'
        audio_file.write(file, 0.1 * random.standard_normal(RATE), RATE, 'PCM_16')
        sources.append(Source(str(file), RATE, 1.0, corpus_file.sha256(file)))
    grains = np.zeros(8, grain_dtype(['mfcc_1']))
    for name in grains.dtype.names[3:]:
        grains[name] = random.random(8)
    grains['file'] = np.arange(8) % 2
    grains['start_s'], grains['duration_s'] = np.arange(8) // 2 / 5, 0.2
    grains['pitch_hz'][0] = np.nan
    grains['x'][3] = grains['y'][3] = np.nan  # a silent one
    made = Corpus(tuple(sources), grains)
    corpus_file.save(made, tmp_path / 'a.json')
    return made


def frames(data):
    """Signature, time, stream and matrices of each frame, read as the specification says."""
    assert data[:16] == bytes.fromhex('53444946 00000008 00000003 00000001')
    at, found = 16, []
    while at < len(data):
        assert at % 8 == 0
        kind, size, time_s, stream, count = struct.unpack('>4sidii', data[at : at + 24])
        here, matrices = at + 24, []
        for _ in range(count):
            name, form, rows, cols = struct.unpack('>4siii', data[here : here + 16])
            length = rows * cols * (form & 0xFF)
            matrices.append((name, form, rows, cols, data[here + 16 : here + 16 + length]))
            here += 16 + length + -length % 8
        assert here == at + 8 + size  # nothing is left over
        found.append((kind, time_s, stream, matrices))
        at = here
    return found


def test_the_bytes_are_those_of_the_specification(corpus, tmp_path):
    names = sdif_file.save(corpus, tmp_path / 'a.sdif')
    table, types, *grains = frames((tmp_path / 'a.sdif').read_bytes())
    for frame, kind in ((table, b'1NVT'), (types, b'1TYP')):
        assert frame[0] == kind and frame[1] == -np.finfo('f8').max
        assert frame[3][0][:2] == (kind, 0x301) and frame[3][0][3] == 1
    assert f'stream2\t{tmp_path}/b.wav\n' in table[3][0][4].decode()
    text = types[3][0][4].decode()
    assert f'1MTD XGRN {{{", ".join(names)}}}' in text and '1FTD XGRN { XGRN grain; }' in text
    assert [kind for kind, *_ in grains] == [b'XGRN'] * 7
    times = [time_s for _, time_s, *_ in grains]
    assert times == sorted(times)
    for _, time_s, stream, ((name, form, rows, cols, body),) in grains:
        assert (name, form, rows, cols) == (b'XGRN', 8, 1, len(names))
        values = dict(zip(names, struct.unpack(f'>{cols}d', body), strict=True))
        grain = round(time_s * 5) * 2 + stream - 1
        assert values['start_s'] == time_s == corpus.grains['start_s'][grain]
        assert values['mfcc_1'] == corpus.grains['mfcc_1'][grain]
        assert values['pitch_hz'] == (corpus.grains['pitch_hz'][grain] if grain else 0.0)


def test_a_dataset_has_a_row_of_numbers_for_each_grain_that_sounds(corpus, tmp_path):
    names = flucoma_file.save(corpus, tmp_path / 'set.json')
    found = json.loads((tmp_path / 'set.json').read_text())
    assert set(found) == {'cols', 'data'} and found['cols'] == len(names)
    assert list(found['data']) == [str(n) for n in range(8) if n != 3]
    for grain, row in found['data'].items():
        assert len(row) == found['cols'] and all(isinstance(v, float) for v in row)
        values = dict(zip(names, row, strict=True))
        pitch = corpus.grains['pitch_hz'][int(grain)]
        assert values.pop('pitch_hz') == (0 if np.isnan(pitch) else pitch)
        for name, value in values.items():
            assert value == corpus.grains[name][int(grain)], name


@pytest.mark.parametrize('name', ['set.sdif', 'set.json'])
def test_there_and_back_is_the_same(corpus, tmp_path, capsys, name):
    there, path, out = (str(tmp_path / file) for file in ('a.json', name, 'new.json'))
    assert cli.main(['corpus', 'export', there, path]) == 0
    said = capsys.readouterr().out
    assert said.startswith('7 points of 12 columns: start_s duration_s') and 'mfcc_1 x y' in said
    assert cli.main(['corpus', 'import', there, path, '--output', out]) == 0
    before, after = corpus_file.load(tmp_path / 'a.json'), corpus_file.load(tmp_path / 'new.json')
    for column in before.grains.dtype.names:
        expected = before.grains[column].copy()
        if column == 'pitch_hz':
            expected[0] = 0  # a pitch that there is none
        np.testing.assert_array_equal(after.grains[column], expected, err_msg=column)
    assert after.digest != before.digest


def test_places_of_another_program_are_taken_by_number_and_scaled(corpus, tmp_path):
    places = {'4': [3, 0.25], '0': [-1, 0.5], '2': [1, 1]}
    (tmp_path / 'grid.json').write_text(json.dumps({'cols': 2, 'data': places}))
    out = tmp_path / 'new.json'
    words = [str(tmp_path / 'a.json'), str(tmp_path / 'grid.json'), '--output', str(out)]
    assert cli.main(['corpus', 'import', *words]) == 0
    grains = corpus_file.load(out).grains
    assert grains['x'][[0, 2, 4]].tolist() == [0, 0.5, 1]
    assert grains['y'][[0, 2, 4]].tolist() == [0.5, 1, 0.25]
    assert grains['x'][1] == pytest.approx(corpus.grains['x'][1]) and np.isnan(grains['x'][3])


def test_a_dataset_without_names_of_columns_is_refused(corpus, tmp_path):
    flucoma_file.save(corpus, tmp_path / 'set.json')
    shutil.move(tmp_path / 'set.json', tmp_path / 'other.json')  # its columns do not go with it
    with pytest.raises(ConfigError, match='has 12 columns; name them with --columns'):
        flucoma_file.apply(corpus, tmp_path / 'other.json', [])


@pytest.mark.parametrize(
    ('text', 'names', 'said'),
    [
        ('{', [], 'not a FluCoMa DataSet'),
        ('[1]', [], 'not a FluCoMa DataSet'),
        ('{"cols": 2, "data": {}}', [], 'not a FluCoMa DataSet'),
        ('{"cols": 2, "data": {"9": [0, 0]}}', [], "point '9' is no grain: there are 0 to 7"),
        ('{"cols": 2, "data": {"a": [0, 0]}}', [], "point 'a' is no grain"),
        ('{"cols": 2, "data": {"1": [0]}}', [], "point '1' has not 2 numbers"),
        ('{"cols": 2, "data": {"1": [0, NaN]}}', [], "point '1' has not 2 numbers"),
        ('{"cols": 2, "data": {"1": [0, "b"]}}', [], "point '1' has not 2 numbers"),
        ('{"cols": 2, "data": {"1": [0, 1]}}', ['x'], '2 columns; 1 are named'),
        ('{"cols": 2, "data": {"1": [0, 1]}}', ['x', 'z'], 'z: no such column'),
    ],
)
def test_what_is_no_dataset_is_refused(corpus, tmp_path, text, names, said):
    path = tmp_path / 'bad.json'
    path.write_text(text)
    with pytest.raises(ConfigError, match=said):
        flucoma_file.apply(corpus, path, names)


def test_places_of_another_program_are_taken_by_stream_and_start(corpus, tmp_path):
    row = struct.pack('>4siii', b'XGRN', 4, 1, 2) + struct.pack('>2f', -3.0, 0.25)
    other = struct.pack('>4siii', b'XGRN', 4, 1, 2) + struct.pack('>2f', 5.0, 0.75)
    data = sdif_file.OPENING
    for time_s, stream, body in ((0.2, 1, row), (0.4003, 2, other)):
        data += struct.pack('>4sidii', b'XGRN', 16 + len(body), time_s, stream, 1) + body
    (tmp_path / 'other.sdif').write_bytes(data)
    back = sdif_file.apply(corpus, tmp_path / 'other.sdif', ['x', 'y'])
    assert back.grains[['x', 'y']][[2, 5]].tolist() == [(0.0, 0.25), (1.0, 0.75)]
    with pytest.raises(ConfigError, match='names no columns'):
        sdif_file.apply(corpus, tmp_path / 'other.sdif', [])
    with pytest.raises(ConfigError, match='has not 1 numbers'):
        sdif_file.apply(corpus, tmp_path / 'other.sdif', ['x'])


@pytest.mark.parametrize('cut', [3, 12, 30, 60, 200, -1, -8])
def test_what_is_cut_short_or_no_sdif_is_refused(corpus, tmp_path, cut):
    sdif_file.save(corpus, tmp_path / 'a.sdif')
    whole = (tmp_path / 'a.sdif').read_bytes()
    (tmp_path / 'b.sdif').write_bytes(whole[:cut])
    with pytest.raises(ConfigError, match='SDIF'):
        sdif_file.apply(corpus, tmp_path / 'b.sdif', [])


def test_a_frame_where_no_grain_begins_is_refused(corpus, tmp_path):
    sdif_file.save(corpus, tmp_path / 'a.sdif')
    corpus.grains['start_s'] += 0.01
    with pytest.raises(ConfigError, match='no grain of stream 1 begins at 0 s'):
        sdif_file.apply(corpus, tmp_path / 'a.sdif', [])

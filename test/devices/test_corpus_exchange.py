# SPDX-License-Identifier: Apache-2.0
"""Grains as a FluCoMa DataSet, there and back, and what is none."""

import json
import shutil

import numpy as np
import pytest

from eol_ros import cli
from eol_ros.core.sound.corpus import Corpus, Source, grain_dtype
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_file, flucoma_file
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


def test_there_and_back_is_the_same(corpus, tmp_path, capsys):
    there, path, out = (str(tmp_path / file) for file in ('a.json', 'set.json', 'new.json'))
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

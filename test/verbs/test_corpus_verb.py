# SPDX-License-Identifier: Apache-2.0
import json
import shutil

import numpy as np
import pytest

from assets.ice import ice
from eol_ros import cli
from eol_ros.core.sound.corpus import GRAIN
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_file


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))


@pytest.fixture(scope='session')
def _floe(tmp_path_factory):
    path = tmp_path_factory.mktemp('sound') / 'floe.wav'
    audio_file.write(path, ice(3.0, 16000, seed=5), 16000, 'PCM_16')
    return path


@pytest.fixture
def floe(_floe, tmp_path):
    return shutil.copy(_floe, tmp_path / 'floe.wav')


def eol(capsys, *words):
    code = cli.main(['corpus', *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def test_makes_json_csv_and_labels(capsys, floe, tmp_path):
    code, out, err = eol(
        capsys, floe, '--grain', 0.2, '--overlap', 0.5, '--output', tmp_path / 'c.json',
        '--csv', tmp_path / 'c.csv', '--labels-out', tmp_path / 'c.txt',
    )  # fmt: skip
    assert code == 0
    corpus = corpus_file.load(tmp_path / 'c.json')
    assert len(corpus) == 29 and f'{len(corpus)} grains' in out
    assert np.diff(corpus.grains['start_s'])[0] == pytest.approx(0.1)
    assert len((tmp_path / 'c.csv').read_text().splitlines()) == 30
    assert len(corpus_file.load_labels(tmp_path / 'c.txt')) == 29
    assert '3.0 s of sound in' in err
    assert all(name in out for name in GRAIN.names[3:-2])


def test_json_on_stdout_is_the_corpus(capsys, floe, tmp_path):
    code, out, _ = eol(
        capsys, floe, '--json', '--x', 'rms_db', '--y', 'flatness', '--layout', 'raw'
    )
    data = json.loads(out)
    assert code == 0 and (data['x_name'], data['y_name']) == ('rms_db', 'flatness')
    rms = np.array([g['rms_db'] for g in data['grains']])
    x = np.array([g['x'] for g in data['grains']])
    np.testing.assert_allclose(x, (rms - rms.min()) / np.ptp(rms), atol=1e-8)


def test_overlap_without_a_number_is_a_half(capsys, floe):
    code, out, _ = eol(capsys, floe, '--json', '--overlap')
    starts = [g['start_s'] for g in json.loads(out)['grains'][:3]]
    assert code == 0 and starts == [0, 0.125, 0.25]


def test_move_keeps_the_place_beside_the_sound(capsys, floe, tmp_path):
    eol(capsys, floe, '--output', tmp_path / 'c.json')
    before = corpus_file.load(tmp_path / 'c.json').digest
    code, out, _ = eol(capsys, 'move', tmp_path / 'c.json', 4, 0.25, 0.75)
    assert code == 0 and json.loads(out)['kept_in'] == str(tmp_path / 'floe.moved.csv')
    moved = corpus_file.load(tmp_path / 'c.json')
    assert tuple(moved.grains[4][['x', 'y']]) == (0.25, 0.75) and moved.digest != before
    eol(capsys, floe, '--output', tmp_path / 'd.json')  # analysed again: it is still there
    again = corpus_file.load(tmp_path / 'd.json')
    assert tuple(again.grains[4][['x', 'y']]) == (0.25, 0.75)


@pytest.mark.slow
def test_no_sound_means_the_ice(capsys):
    code, out, err = eol(capsys)
    assert code == 0 and '480 grains' in out and 'nothing written' in err


@pytest.mark.parametrize(
    ('words', 'exit_code', 'said'),
    [
        (['no.wav'], 69, 'no such sound file'),
        (['{dir}/bad.wav'], 78, 'not a sound'),
        (['{dir}/silent.wav'], 78, 'silent'),
        (['{dir}/short.wav'], 78, 'too short'),
        (['{dir}/empty'], 78, 'no sound file in this folder'),
        (['{floe}', '--grain', '0'], 2, '--grain: 0 is outside 0.02 to 60'),
        (['{floe}', '--grain', 'nan'], 2, '--grain: nan is'),
        (['{floe}', '--overlap', '1'], 2, '--overlap: 1 is'),
        (['{floe}', '--blend', '-1'], 2, '--blend'),
        (['{floe}', '--gate-on', '-60'], 2, '--gate-off'),
        (['{floe}', '--segment', 'labels'], 69, 'no such label file'),
        (['{floe}', '--labels', 'x'], 2, 'only with --segment labels'),
        (['{floe}', '--output', '{dir}/no/c.json'], 78, 'cannot be written'),
        (['{floe}', '{floe}', '--labels-out', 'x'], 2, 'is for one sound'),
        (['move', 'no.json', '1', '0', '0'], 69, 'no such corpus'),
        (['move', 'c.json', '1'], 2, 'move takes'),
    ],
)
def test_mistakes_are_one_line(capsys, floe, tmp_path, words, exit_code, said):
    (tmp_path / 'bad.wav').write_text('no sound')
    (tmp_path / 'empty').mkdir()
    audio_file.write(tmp_path / 'silent.wav', np.zeros(16000), 16000)
    audio_file.write(tmp_path / 'short.wav', np.zeros(1), 16000)
    words = [w.format(dir=tmp_path, floe=floe) for w in words]
    code, out, err = eol(capsys, *words)
    assert code == exit_code and said in err and out == ''
    assert len(err.strip().splitlines()) == 1

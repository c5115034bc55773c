# SPDX-License-Identifier: Apache-2.0
"""A sound recorded piece by piece into a folder, which becomes part of a corpus as it fills."""

import numpy as np
import pytest

from eol_ros.cli import main
from eol_ros.core.sound.ice import ice
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.devices.corpus.corpus_file import Options

RATE = 8000


@pytest.fixture
def walk(tmp_path):
    """A recording of three bursts between silences."""
    random, parts = np.random.default_rng(2), []
    for seconds in (0.3, 0.5, 0.8):
        parts += [np.zeros(RATE), 0.2 * random.standard_normal(round(seconds * RATE))]
    path = tmp_path / 'walk.wav'
    audio_file.write(path, np.concatenate([*parts, np.zeros(RATE)]), RATE, 'PCM_16')
    return path


def test_each_sound_becomes_a_file_and_the_oldest_go(walk, tmp_path, capsys):
    folder = tmp_path / 'takes'
    assert main(['listen', '--into', str(folder), '--from', str(walk), '--keep', '2']) == 0
    said = capsys.readouterr().out.splitlines()
    assert [float(line.split()[-2]) for line in said] == pytest.approx([0.65, 0.85, 1.15], abs=0.03)
    kept = corpus_file.sounds_of(folder)
    assert [str(path) for path in kept] == [line.rsplit(' ', 2)[0] for line in said[1:]]
    assert audio_file.read_mono(kept[0]).rate == RATE


@pytest.mark.slow
def test_new_takes_are_in_the_corpus_and_the_others_are_not_described_again(
    walk, tmp_path, monkeypatch
):
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))
    audio_file.write(tmp_path / 'floe.wav', ice(2.0, 16000, 1), 16000, 'PCM_16')
    folder = tmp_path / 'takes'
    folder.mkdir()
    options, floe = Options(more_sounds=(str(folder),)), str(tmp_path / 'floe.wav')

    def made():
        sounds = corpus_file.all_sounds(floe, options, 0)
        return corpus_build.build_cached(sounds, options)

    before, times = made(), corpus_file.times(floe, options, 0)
    assert [source.name for source in before.sources] == ['floe']
    assert main(['listen', '--into', str(folder), '--from', str(walk)]) == 0
    assert corpus_file.times(floe, options, 0) != times  # by which a running node sees it
    described = []
    analysed = corpus_build._cut

    def cut(heard, *words):
        described.append(heard.path)
        return analysed(heard, *words)

    monkeypatch.setattr(corpus_build, '_cut', cut)
    after = made()
    assert len(after.sources) == 4 and len(after) > len(before)
    assert len(described) == 3 and floe not in described
    floe_now = after.grains[after.grains['file'] == 0]
    for name in ('start_s', 'centroid_mean_hz', 'rms_db'):
        np.testing.assert_array_equal(floe_now[name], before.grains[name])


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        ([], 2, '--into: name the folder'),
        (['--into', 'x', '--on', '3'], 2, '--on: 3 is outside -120 to 0'),
        (['--into', 'x', '--off', '-30'], 2, '--off -30: must not lie above'),
        (['--into', 'x', '--from', 'none.wav'], 69, 'no such sound file'),
        (['--into', 'x', '--device', 'no such input'], 69, ''),
    ],
)
def test_what_cannot_be_is_one_line(words, code, said, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert main(['listen', *words]) == code
    err = [line for line in capfd.readouterr().err.splitlines() if line.startswith('eol')]
    assert said in err[0] and len(err) == 1


def test_no_input_is_said(capsys, monkeypatch):
    monkeypatch.setattr('eol_ros.devices.audio.microphone.inputs', list)

    assert main(['listen', '--list']) == 0
    assert capsys.readouterr() == ('', 'no sound inputs\n')

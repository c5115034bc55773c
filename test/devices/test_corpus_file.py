# SPDX-License-Identifier: Apache-2.0
"""A corpus made, kept, moved by hand, found again, and refused when it is spoilt."""

import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from support.waiting import wait_until

from assets.ice import ice
from eol_ros.core.sound.corpus import GRAIN
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.devices.corpus.corpus_build import build, build_cached
from eol_ros.devices.corpus.corpus_file import Options
from eol_ros.devices.corpus.loader import CorpusLoader
from eol_ros.errors import ConfigError, DeviceMissing, EolError

RATE = 16000


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))


@pytest.fixture(scope='session')
def _ice(tmp_path_factory):
    path = tmp_path_factory.mktemp('sound') / 'floe.wav'
    audio_file.write(path, ice(4.0, RATE, seed=5), RATE, 'PCM_16')
    return path


@pytest.fixture
def sound(_ice, tmp_path):
    return Path(shutil.copy(_ice, tmp_path / 'floe.wav'))


def same(a, b):
    assert a.sources == b.sources
    assert (a.x_name, a.y_name, a.digest, a.notes) == (b.x_name, b.y_name, b.digest, b.notes)
    for name in GRAIN.names:
        np.testing.assert_allclose(a.grains[name], b.grains[name], rtol=1e-8, err_msg=name)


def test_json_there_and_back(sound, tmp_path):
    corpus = build([sound], Options())
    assert len(corpus) == 16 and corpus.placed.all() and corpus.sample_rate == RATE
    corpus_file.save(corpus, tmp_path / 'c.json')
    same(corpus, corpus_file.load(tmp_path / 'c.json', trusted=True))
    data = json.loads((tmp_path / 'c.json').read_text())
    assert data['sample_rate'] == RATE
    assert data['grains'][3]['file'] == 'floe.wav' and data['grains'][3]['start_s'] == 0.75
    assert set(data['grains'][3]) == {
        'file', 'start_s', 'duration_s', 'centroid_mean_hz', 'periodicity_mean', 'pitch_hz',
        'flatness', 'rolloff95_hz', 'rms_db', 'loudness_lufs', 'x', 'y',
    }  # fmt: skip


def test_csv_has_the_numbers_of_the_json(sound, tmp_path):
    sound = sound.rename(tmp_path / 'a, "b".wav')
    corpus = build([sound], Options())
    corpus_file.save_csv(corpus, tmp_path / 'c.csv')
    with open(tmp_path / 'c.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(corpus)
    for row, grain in zip(rows, corpus.grains, strict=True):
        assert row['file'] == str(sound)
        for name in corpus.grains.dtype.names[1:]:
            value = float(row[name]) if row[name] else np.nan
            np.testing.assert_allclose(value, grain[name], rtol=1e-8)


def test_labels_out_and_in_give_the_same_grains(sound, tmp_path):
    corpus = build([sound], Options(grain_s=0.3))
    corpus_file.save_labels(corpus, corpus_file.beside(sound, 'labels.txt'))
    again = build([sound], Options(segment='labels'))
    for name in set(GRAIN.names) - {'x', 'y'}:
        np.testing.assert_allclose(again.grains[name], corpus.grains[name], atol=1e-6, err_msg=name)
    elsewhere = tmp_path / 'hand.txt'
    elsewhere.write_text('0.5\t0.75\tcrack\n\\\t100.0\t2000.0\n1,5\t2\tgroan\n')  # as Audacity can
    by_hand = build([sound], Options(segment='labels', labels=str(elsewhere)))
    assert by_hand.grains['start_s'].tolist() == [0.5, 1.5]
    assert by_hand.grains['duration_s'].tolist() == [0.25, 0.5]


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('0.5 hum\n', r'hand\.txt:1:2: end .hum. is not a number'),
        ('0\t1\tok\n2\t1\tback\n', r'hand\.txt:2:2: a label must end after'),
        ('0\tnan\tx\n', r'hand\.txt:1'),
        ('\n', 'no labels'),
    ],
)
def test_bad_labels(sound, tmp_path, text, said):
    path = tmp_path / 'hand.txt'
    path.write_text(text)
    with pytest.raises(ConfigError, match=said):
        build([sound], Options(segment='labels', labels=str(path)))


def test_silent_grains_have_no_place(tmp_path):
    path = tmp_path / 'half.wav'
    wave = np.concatenate([ice(1.0, RATE, 3), np.zeros(RATE, np.float32)])
    audio_file.write(path, wave, RATE, 'FLOAT')
    corpus = build([path], Options())
    assert corpus.placed.tolist() == [True] * 4 + [False] * 4
    corpus_file.save(corpus, tmp_path / 'c.json')
    assert corpus_file.load(tmp_path / 'c.json').placed.sum() == 4


def test_a_silent_sound_is_refused(tmp_path):
    audio_file.write(tmp_path / 'a.wav', np.zeros(RATE), RATE)
    with pytest.raises(ConfigError, match='all 4 grains are silent'):
        build([tmp_path / 'a.wav'], Options())
    with pytest.raises(ConfigError, match='cutting it by gate leaves no grain'):
        build([tmp_path / 'a.wav'], Options(segment='gate'))


def test_moved_by_hand_survives_another_analysis(sound, tmp_path):
    corpus = build([sound], Options())
    kept = corpus_file.move(corpus, 5, 0.9, 0.1)
    assert kept == tmp_path / 'floe.moved.csv'
    corpus_file.move(corpus, 9, 0.2, 0.3)
    corpus_file.move(corpus, 5, 0.8, 0.2)  # moved again: the last place counts
    again = build([sound], Options())
    assert tuple(again.grains[5][['x', 'y']]) == (0.8, 0.2)
    assert tuple(again.grains[9][['x', 'y']]) == (0.2, 0.3)
    others = np.setdiff1d(np.arange(16), [5, 9])
    for name in ('x', 'y'):
        np.testing.assert_array_equal(again.grains[name][others], corpus.grains[name][others])
    assert again.digest != corpus.digest
    shorter = build([sound], Options(grain_s=0.1))  # another cut: the grain at that moment
    moved = np.nonzero((shorter.grains['x'] == 0.8) & (shorter.grains['y'] == 0.2))[0]
    start = shorter.grains['start_s'][moved]
    assert len(moved) == 1 and start <= 5.5 * 0.25 <= start + 0.1


@pytest.mark.parametrize(
    ('text', 'said'),
    [('1,1\n', ':1:3: y is missing'), ('t\n', ':1:1'), ('1,2,0.5\n', '1:2: .* 0..1')],
)
def test_bad_moves(sound, text, said):
    corpus_file.beside(sound, 'moved.csv').write_text(text)
    with pytest.raises(ConfigError, match=said):
        corpus_file.load_moved(sound)
    assert 'moved.csv:1' in build([sound], Options()).notes[0]


def count_analyses(monkeypatch):
    from eol_ros.core.sound import descriptors

    calls, real = [], descriptors.analyse
    monkeypatch.setattr(descriptors, 'analyse', lambda *a, **k: calls.append(1) or real(*a, **k))
    return calls


def test_the_cache_goes_by_content(sound, tmp_path, monkeypatch):
    calls = count_analyses(monkeypatch)
    first = build_cached([sound], Options())
    os.utime(sound, (1, 1))
    same(first, build_cached([sound], Options()))
    copy = Path(shutil.copy(sound, tmp_path / 'copy.wav'))
    assert build_cached([copy], Options()).sources[0].path == str(copy)
    build_cached([sound], Options(layout='raw'))  # laid out again, not analysed again
    assert len(calls) == 1
    build_cached([sound], Options(grain_s=0.2))
    assert len(calls) == 2
    wave = audio_file.read_mono(sound)
    audio_file.write(sound, wave.samples[::-1], RATE, 'PCM_16')
    other = build_cached([sound], Options())
    assert len(calls) == 3 and other.digest != first.digest


def test_a_spoilt_cache_is_made_again(sound, tmp_path, monkeypatch):
    calls = count_analyses(monkeypatch)
    first = build_cached([sound], Options())
    for path in (tmp_path / 'cache').rglob('*.*'):
        path.write_bytes(path.read_bytes()[:50])
    same(first, build_cached([sound], Options()))
    assert len(calls) == 2


def spoil(sound, tmp_path, change):
    path = tmp_path / 'c.json'
    corpus_file.save(build([sound], Options()), path)
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    return path


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (lambda d: d.update(version=99), 'version 99, this program reads 1'),
        (lambda d: d.pop('grains'), 'not a corpus'),
        (lambda d: d.update(grains=[]), 'empty'),
        (lambda d: d['grains'][2].update(file='no.wav'), 'not as it should be'),
        (lambda d: d['grains'][2].update(start_s='soon'), 'not as it should be'),
        (lambda d: d['grains'][2].update(start_s=3.9), 'grain 2 lies outside'),
        (lambda d: d['grains'][2].update(start_s=None), 'grain 2 lies outside'),
        (lambda d: d['grains'][2].update(duration_s=0), 'grain 2 lies outside'),
        (lambda d: d['grains'][2].update(x=1.5), 'grain 2 lies outside'),
        (lambda d: [g.update(x=None) for g in d['grains']], 'no grain has a place'),
        (lambda d: d['files'][0].update(sample_rate=None, extra=1), 'not as it should'),
        (lambda d: d.update(x_name='colour'), "'colour' is no descriptor"),
    ],
)
def test_a_spoilt_corpus_is_refused(sound, tmp_path, change, said):
    with pytest.raises(ConfigError, match=said):
        corpus_file.load(spoil(sound, tmp_path, change))


def test_a_corpus_of_another_program_needs_the_least(sound, tmp_path):
    least = {
        'version': 1,
        'files': [{'path': 'floe.wav', 'sample_rate': RATE, 'duration_s': 4.0}],
        'grains': [{'file': 'floe.wav', 'start_s': 1, 'duration_s': 0.5, 'x': 0.5, 'y': 1}],
    }
    (tmp_path / 'c.json').write_text(json.dumps(least))
    corpus = corpus_file.load(tmp_path / 'c.json')
    assert corpus.placed.all() and np.isnan(corpus.grains['rms_db'][0])
    assert corpus.x_name == 'centroid_mean_hz' and len(corpus.digest) == 64 and not corpus.notes
    least['grains'][0]['y'] = 0.25
    (tmp_path / 'c.json').write_text(json.dumps(least))
    assert corpus_file.load(tmp_path / 'c.json').digest != corpus.digest


def test_a_corpus_whose_sound_has_changed_says_so(sound, tmp_path):
    path = spoil(sound, tmp_path, lambda d: None)
    assert not corpus_file.load(path).notes
    audio_file.write(sound, audio_file.read_mono(sound).samples[::-1], RATE, 'PCM_16')
    assert 'has changed since' in corpus_file.load(path).notes[0]


def test_a_corpus_whose_sound_is_gone(sound, tmp_path):
    path = spoil(sound, tmp_path, lambda d: None)
    sound.unlink()
    with pytest.raises(DeviceMissing, match=r'floe\.wav is gone'):
        corpus_file.load(path)


@pytest.mark.slow
def test_made_apart_is_the_same_and_leaves_no_weight(sound):
    code = (
        'import sys, numpy as np\n'
        'from eol_ros.devices.corpus import corpus_build\n'
        'from eol_ros.devices.corpus.corpus_file import Options\n'
        f'c = corpus_build.apart({str(sound)!r}, Options())\n'
        'heavy = {"scipy", "soundfile", "numba", "matplotlib"} & set(sys.modules)\n'
        'print(len(c), sorted(heavy), float(c.grains["x"].sum()))\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    x = float(build_cached([sound], Options()).grains['x'].sum())
    assert done.stdout.split() == ['16', '[]', str(x)]


@pytest.mark.slow
def test_the_ice_recording_is_unpacked_on_first_use():
    path = corpus_build.make_ice()
    before = path.stat().st_mtime_ns
    assert corpus_build.make_ice() == path == corpus_file.ice_file()
    assert path.stat().st_mtime_ns == before
    # corpora of bags and moved grains are known by it
    digest = '538e7332e9c224222999465ba47063167339941e486c5e258487d1f23ab1774e'
    assert hashlib.sha256(path.read_bytes()).hexdigest() == digest


def test_a_damaged_ice_recording_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(corpus_build, '__file__', str(tmp_path / 'corpus_build.py'))
    monkeypatch.setattr(corpus_build, '_is_ice', lambda path: False)
    flac = tmp_path / 'ice.flac'
    soundfile.write(flac, np.zeros(4800, np.int16), 48000)
    with pytest.raises(ConfigError, match='ice.flac: is cut off; install eol_ros again'):
        corpus_build.make_ice()
    flac.write_bytes(b'no sound')
    with pytest.raises(ConfigError, match='install eol_ros again'):
        corpus_build.make_ice()


def wait(loader):
    outcomes = []
    wait_until(lambda: outcomes.append(loader.take()) or outcomes[-1] is not None)
    return outcomes[-1]


@pytest.mark.slow
def test_the_newest_wish_wins(sound, tmp_path):
    loader = CorpusLoader()
    specs = [(str(sound), Options(grain_s=g)) for g in (0.1, 0.2, 0.4)]
    for spec in specs:
        assert loader.at_once(spec) is None
        loader.ask(spec)
    assert len(wait(loader)) == 10
    assert loader.take() is None
    assert len(loader.at_once(specs[2])) == 10
    loader.ask(specs[1])
    loader.ask(specs[1])  # the very same again
    assert len(wait(loader)) == 20
    loader.ask((str(tmp_path / 'no.wav'), Options()))
    assert isinstance(wait(loader), DeviceMissing)
    (tmp_path / 'bad.wav').write_text('no sound')
    loader.ask((str(tmp_path / 'bad.wav'), Options()))
    outcome = wait(loader)
    assert isinstance(outcome, EolError) and 'bad.wav: not a sound' in str(outcome)
    loader.ask((str(sound), replace(Options(), grain_s=0.05)))
    loader.close()
    assert not [t for t in threading.enumerate() if t.name == 'corpus']


def test_a_full_cache_is_one_line(sound, monkeypatch):
    def full(*_args, **_kwargs):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(np, 'savez', full)
    with pytest.raises(ConfigError, match='cannot be written .No space left on device.'):
        build([sound], Options())


def test_a_sound_that_goes_away_is_noticed_without_a_fault(sound):
    loader = CorpusLoader()
    spec = (str(sound), Options())
    assert [loader.changed(spec) for _ in range(2)] == [False, False]
    corpus_file.beside(sound, 'moved.csv').write_text('time_s,x,y\n')
    assert [loader.changed(spec) for _ in range(2)] == [True, False]
    sound.unlink()
    assert [loader.changed(spec) for _ in range(2)] == [True, False]
    with pytest.raises(DeviceMissing):
        corpus_file.sha256(sound)


@pytest.fixture
def two(sound, tmp_path):
    audio_file.write(tmp_path / 'shelf.wav', ice(3.0, RATE, seed=6), RATE, 'PCM_16')
    return [sound, tmp_path / 'shelf.wav']


def test_further_options_at_their_defaults_leave_digests_as_they_were(sound):
    words = {
        'segment': 'chop', 'grain_s': 0.25, 'overlap': 0.0, 'x_axis': 'centroid_mean_hz',
        'y_axis': 'periodicity_mean', 'layout': 'even', 'blend': 1.0, 'onset_db': 4.0,
        'gate_on_db': -40.0, 'gate_off_db': -50.0, 'silence_db': -70.0, 'labels': '',
    }  # fmt: skip
    parts = [1, 3, words, corpus_file.sha256(sound)]  # as in every bag since the third analysis
    expected = hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
    assert corpus_file.digest([sound], Options()) == expected
    assert corpus_file.digest([sound], Options(overlap=0.5)) != expected


def test_each_sound_in_its_region(two):
    options = Options(regions=('floe left', 'shelf .5,.5,1,1'))
    corpus = build(two, options)
    grains = corpus.grains
    floe, shelf = grains[grains['file'] == 0], grains[grains['file'] == 1]
    assert len(floe) == 16 and len(shelf) == 12
    assert floe['x'].max() < 0.5 and floe['y'].min() < 0.2 and floe['y'].max() > 0.8
    assert shelf['x'].min() > 0.5 and shelf['y'].min() > 0.5
    alone = build(two[:1], Options())
    np.testing.assert_allclose(floe['x'], alone.grains['x'] / 2)
    np.testing.assert_allclose(floe['y'], alone.grains['y'])
    assert corpus_file.digest(two, options) != corpus_file.digest(two, Options())
    with pytest.raises(ConfigError, match='no sound of this name; there are floe, shelf'):
        build(two, Options(regions=('gone left',)))


def test_all_sounds_of_the_settings_are_in_one_corpus(two):
    options = Options(more_sounds=(str(two[1]),))
    corpus = corpus_build.apart(str(two[0]), options)
    assert [source.name for source in corpus.sources] == ['floe', 'shelf']
    assert corpus_build.ready(str(two[0]), options).same_as(corpus)
    assert len(corpus_file.times(str(two[0]), options)) == 2
    corpus_file.save(corpus, two[0].with_name('c.json'))
    with pytest.raises(ConfigError, match='has its sounds and places already'):
        corpus_build.ready(str(two[0].with_name('c.json')), options)


def test_a_sound_added_to_a_folder_is_described_alone(two, tmp_path, monkeypatch):
    folder = tmp_path / 'voices'
    folder.mkdir()
    options, floe = Options(more_sounds=(str(folder),)), str(two[0])
    before = build_cached(corpus_file.all_sounds(floe, options), options)
    times = corpus_file.times(floe, options)
    voice = two[1].rename(folder / 'voice.wav')
    assert corpus_file.times(floe, options) != times  # by which a running node sees it
    described, cut = [], corpus_build._cut

    def counted(heard, *words):
        described.append(heard.path)
        return cut(heard, *words)

    monkeypatch.setattr(corpus_build, '_cut', counted)
    after = build_cached(corpus_file.all_sounds(floe, options), options)
    assert described == [str(voice)] and len(after) > len(before)
    floe_now = after.grains[after.grains['file'] == 0]
    for name in ('start_s', 'centroid_mean_hz', 'rms_db'):
        np.testing.assert_array_equal(floe_now[name], before.grains[name])


def test_a_grain_put_back_lies_where_the_layout_has_it(sound):
    corpus = build([sound], Options())
    corpus_file.move(corpus, 3, 0.25, 0.75)
    path = corpus_file.move(corpus, 7, 0.5, 0.5)
    moved = build([sound], Options())
    assert corpus_file.moved(moved) == [3, 7] and corpus_file.moved(corpus) == [3, 7]
    assert tuple(moved.grains[['x', 'y']][3]) == (0.25, 0.75)
    assert corpus_file.restore(moved, 3) == path
    again = build([sound], Options())
    assert corpus_file.moved(again) == [7]
    assert again.grains[['x', 'y']][3] == corpus.grains[['x', 'y']][3]
    with pytest.raises(ConfigError, match='grain 3 was not moved'):
        corpus_file.restore(again, 3)
    with pytest.raises(ConfigError, match='grain 99: the corpus has grains 0 to 15'):
        corpus_file.restore(again, 99)

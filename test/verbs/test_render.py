# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
import soundfile
from eol_msgs.msg import Corpus as CorpusMessage
from eol_msgs.msg import GrainTrigger
from rclpy.serialization import serialize_message

from eol_ros import cli
from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.triggers import COLUMNS
from eol_ros.core.sound.voicing import Voicing, new_mixer
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.devices.files.trigger_file import load_triggers
from eol_ros.ros.definitions import definition, type_hash
from eol_ros.ros.stamps import to_msg
from eol_ros.settings import SoundSettings
from eol_ros.streams.triggers import NO_BLOCK
from eol_ros.verbs import render

FS = 48000
T0 = 1_700_000_000_000_000_000


@pytest.fixture
def sound(tmp_path):
    noise = np.random.default_rng(1).uniform(-0.5, 0.5, 2 * FS).astype('f4')
    soundfile.write(tmp_path / 'sea.wav', noise, FS, subtype='FLOAT')
    return tmp_path / 'sea.wav', noise


@pytest.fixture
def corpus(tmp_path, sound):
    code = cli.main(
        ['corpus', str(sound[0]), '--grain', '0.2', '--output', str(tmp_path / 'c.json')]
    )
    assert code == 0
    return tmp_path / 'c.json'


@pytest.fixture
def triggers(tmp_path):
    rng = np.random.default_rng(2)
    lines = [','.join(COLUMNS)]
    for t in np.sort(rng.uniform(0, 1, 30)):
        values = rng.uniform([0.1, 0.5, -1, 0, 0], [0.3, 2, 1, 0.05, 0.1])
        numbers = [float(t), int(rng.integers(0, 10)), *map(float, values)]
        lines.append(','.join(map(repr, numbers)))
    (tmp_path / 't.csv').write_text('\n'.join(lines) + '\n')
    return tmp_path / 't.csv'


def eol(capsys, *words):
    capsys.readouterr()
    code = cli.main(['render', *map(str, words)])
    return code, *capsys.readouterr()


@pytest.mark.parametrize('ending', ['wav', 'flac', 'ogg'])
def test_a_full_disk_is_one_line(capsys, tmp_path, corpus, triggers, ending):
    out = tmp_path / f'x.{ending}'
    out.symlink_to('/dev/full')
    code, _, err = eol(capsys, triggers, '--corpus', corpus, '--output', out)

    assert code == 78
    assert err.splitlines()[-1].startswith(f'eol render: {out}: cannot be written (')
    assert 'is its disk full?' in err


def test_a_fault_that_has_nothing_to_do_with_the_file_is_not_told_of_it(tmp_path):
    with (
        pytest.raises(ConnectionResetError),
        render.writer(str(tmp_path / 'x.wav'), 48000, 2) as file,
    ):
        file.write(np.zeros((10, 2)))
        raise ConnectionResetError(104, 'reset')


@pytest.mark.slow
def test_a_csv_gives_the_samples_of_a_live_run(capsys, tmp_path, sound, corpus, triggers):
    """Live: a mixer fed as time goes by, in the blocks of a sound card, with latency."""
    words = ('--corpus', corpus, '--output', tmp_path / 'x.wav', '--json')
    code, out, err = eol(capsys, triggers, *words)
    assert code == 0, err
    figures = json.loads(out)
    assert (figures['triggers'], figures['dropped'], figures['stolen']) == (30, 0, 0)
    file, rate = soundfile.read(tmp_path / 'x.wav', dtype='float32')
    assert rate == FS
    assert figures['seconds'] == pytest.approx(len(file) / FS)
    assert 20 * np.log10(np.abs(file).max()) == pytest.approx(figures['peak_dbfs'], abs=0.01)

    starts = np.round(np.arange(10) * 0.2, 9)
    bank = Bank([sound[1]], np.zeros(10, int), starts, np.full(10, 0.2), FS)
    mixer, latency = new_mixer(SoundSettings()), FS // 10
    rows, _ = Voicing(SoundSettings()).rows(load_triggers(triggers), bank)
    rows = rows[np.argsort(rows['time_s'], kind='stable')]
    stamps = rows['time_s'].copy()
    rows['time_s'] += latency / FS
    heard, given = [], 0
    while len(heard) * 256 < len(file) + latency + 256:
        known = np.searchsorted(stamps, len(heard) * 256 / FS)
        mixer.push(rows[given:known])
        given = known
        heard.append(mixer.render(256))
    assert mixer.state['late'][0] == 0
    live = np.concatenate(heard)[latency:][: len(file)]
    assert np.array_equal(live, file)


def record(path, sound, wanted, *more):
    """Write a bag of a corpus of sounds, in turn, and of the triggers `wanted` (n,) TRIGGER."""
    topics = [
        BagTopic(f'/eol/{name}', kind, definition(kind), type_hash(kind), '')
        for name, kind in (
            ('corpus', 'eol_msgs/msg/Corpus'), ('grain_triggers', 'eol_msgs/msg/GrainTrigger'),
        )
    ]  # fmt: skip
    bag = BagWriter(path, topics, {})
    grains = CorpusMessage(
        name='sea', digest='1', sample_rate=FS, files=[str(sound), *map(str, more)],
        file=[k % (1 + len(more)) for k in range(10)],
        start=[0.2 * k for k in range(10)], duration=[0.2] * 10,
    )  # fmt: skip
    bag.write('/eol/corpus', serialize_message(grains), T0, T0, 1)
    for k, row in enumerate(wanted):
        ns = T0 + round(float(row['time_s']) * 1e9)
        message = GrainTrigger(
            sequence=k, grain=int(row['grain']), gain=float(row['gain']), rate=float(row['rate']),
            pan=float(row['pan']), attack=float(row['attack_s']), release=float(row['release_s']),
            block=int(row['block']) % (NO_BLOCK + 1),
        )  # fmt: skip
        message.header.stamp = to_msg(ns)
        bag.write('/eol/grain_triggers', serialize_message(message), ns + 20_000_000, ns, k + 1)
    bag.close()


@pytest.mark.slow
def test_a_bag_brings_its_own_corpus(capsys, tmp_path, sound, triggers, corpus):
    record(tmp_path / 'bag', sound[0], load_triggers(triggers))
    assert eol(capsys, tmp_path / 'bag', '--output', tmp_path / 'bag.wav')[0] == 0
    assert eol(capsys, triggers, '--corpus', corpus, '--output', tmp_path / 'csv.wav')[0] == 0
    ours, csv = (soundfile.read(tmp_path / f'{n}.wav', dtype='float32')[0] for n in ('bag', 'csv'))
    size = min(len(ours), len(csv))
    assert ours[:size].any()
    # the bag's times are nanoseconds, those of the CSV doubles; gains follow them
    np.testing.assert_allclose(ours[:size], csv[:size], rtol=0, atol=1e-6)


@pytest.mark.parametrize('rate', [FS, 96000])
def test_stems_add_up_to_the_mix(capsys, tmp_path, sound, triggers, rate):
    """Each block, or sound, is heard in its own file alone, as spectra show."""
    tone = 0.2 * np.sin(2 * np.pi * 6000 * np.arange(2 * FS) / FS)
    soundfile.write(tmp_path / 'tone.wav', tone, FS, subtype='FLOAT')
    rows = load_triggers(triggers)
    rows['rate'], rows['gain'] = 1.0, 0.05  # the limiter rests
    rows['block'] = np.resize([3, 12, -1], len(rows))
    record(tmp_path / 'bag', sound[0], rows, tmp_path / 'tone.wav')
    for by, names in {
        'blocks': ['other', 'block03', 'block12'], 'sounds': ['sound00-sea', 'sound01-tone'],
    }.items():  # fmt: skip
        words = ('--rate', rate, '--stems', by, '--output', tmp_path / 'x.wav', '--json')
        code, out, err = eol(capsys, tmp_path / 'bag', *words)
        assert code == 0, err
        figures = json.loads(out)
        assert figures['stems'] == [str(tmp_path / f'x-{name}.wav') for name in names]
        assert (figures['sample_rate'], figures['limiter_least_db']) == (rate, 0.0)
        whole, found = soundfile.read(tmp_path / 'x.wav')
        stems = [soundfile.read(path)[0] for path in figures['stems']]
        assert found == rate and all(stem.any() for stem in stems)
        np.testing.assert_allclose(sum(stems), whole, rtol=0, atol=1e-6)
    spectra = [np.abs(np.fft.rfft(stem[:, 0])) ** 2 for stem in stems]
    near = np.abs(np.fft.rfftfreq(len(whole), 1 / rate) - 6000) < 500
    sea, tone = (spectrum[near].sum() / spectrum.sum() for spectrum in spectra)
    assert sea < 0.1 and tone > 0.95
    if rate == 96000:  # next to nothing above the Nyquist frequency of its sounds
        high = np.fft.rfftfreq(len(whole), 1 / rate) > 25000
        above = [spectrum[high].sum() / spectrum.sum() for spectrum in spectra]
        assert above[0] < 0.003 and above[1] < 1e-6  # noise up to 24 kHz; a tone


@pytest.mark.slow
def test_what_a_user_may_get_wrong_is_one_line(capsys, tmp_path, corpus, triggers):
    out = tmp_path / 'x.wav'
    bad = tmp_path / 'bad.csv'
    cases = [
        ((triggers, '--output', out), 2, 'add --corpus'),
        ((triggers, '--corpus', corpus, '--output', tmp_path / 'x.xyz'), 2, 'names the format'),
        ((triggers, '--corpus', corpus, '--output', tmp_path / 'no' / 'x.wav'), 78, 'No such file'),
        ((triggers, '--stems', 'blocks', '--output', tmp_path / 'x.flac'), 2, 'would clip them'),
        (
            (bad, '--corpus', corpus, '--output', out),
            78,
            "bad.csv:3:3: gain 'loud' is not a number",
        ),
    ]
    bad.write_text('time_s,grain,gain\n0,1,1\n1,2,loud\n')
    for words, code, text in cases:
        found = eol(capsys, *words)
        assert found[0] == code, found
        assert text in found[2]
        assert found[2].count('\n') == 1


@pytest.mark.slow
def test_refused_triggers_are_counted_and_nothing_is_silence(capsys, tmp_path, corpus):
    odd = tmp_path / 'odd.csv'
    odd.write_text('time_s,grain,gain\n0,999,1\n0.1,1,nan\n0.2,1,-3\n')
    code, out, _ = eol(capsys, odd, '--corpus', corpus, '--output', tmp_path / 'x.wav', '--json')
    assert code == 0
    assert json.loads(out)['dropped'] == 3
    why = {'no_such_grain': 1, 'bad_number': 2, 'too_short': 0, 'too_many': 0}
    assert json.loads(out)['dropped_why'] == why
    _, _, err = eol(capsys, odd, '--corpus', corpus, '--output', tmp_path / 'x.wav')
    *_, first, second = err.splitlines()
    assert first == (
        f'dropped: 1 name no grain of {corpus}, which has 0 to 9: give the corpus that they were '
        'made with'
    )
    assert second.startswith('dropped: 2 have a number out of range: gain 0 to 16, rate 0.0625 to')
    told = json.loads(corpus.read_text())
    told['grains'][1]['duration_s'] = 3 / told['sample_rate']  # too short to sound, as live
    corpus.write_text(json.dumps(told))
    odd.write_text('time_s,grain,gain\n0,999,1\n0.1,1,1\n')
    code, out, _ = eol(capsys, odd, '--corpus', corpus, '--output', tmp_path / 'x.wav', '--json')
    assert (code, json.loads(out)['dropped']) == (0, 2)
    assert json.loads(out)['dropped_why']['too_short'] == 1
    assert not soundfile.read(tmp_path / 'x.wav')[0].any()


@pytest.mark.slow
def test_of_the_first_seconds_no_other_trigger_is_counted(capsys, tmp_path, sound, corpus):
    odd = tmp_path / 'odd.csv'
    odd.write_text('time_s,grain,gain\n0,1,1\n0.2,999,1\n0.4,2,1\n0.5,3,1\n0.8,999,1\n0.9,3,1\n')
    record(tmp_path / 'bag', sound[0], load_triggers(odd))
    own, other = (tmp_path / 'bag',), ('--corpus', corpus)
    for source in ((odd, *other), (*own, *other), own):
        for seconds, told in (((), (6, 2)), (('--seconds', '0.5'), (3, 1))):
            code, out, _ = eol(capsys, *source, '--output', tmp_path / 'x.wav', '--json', *seconds)
            figures = json.loads(out)
            assert code == 0 and (figures['triggers'], figures['dropped']) == told


def test_columns_may_be_left_out(tmp_path):
    (tmp_path / 't.csv').write_text('time_s,grain,note\n0.5,3,hello\n\n1.5,4,x\n')
    rows = load_triggers(tmp_path / 't.csv')
    assert rows['grain'].tolist() == [3, 4]
    assert (rows['gain'] == 1).all()
    assert (rows['block'] == -1).all()


def test_two_renders_are_the_same_file_whenever_they_are_made(tmp_path, corpus, triggers, capsys):
    """libsndfile writes the time of day into files of floats, in seconds."""
    files = []
    for name in ('a.wav', 'b.wav'):
        words = (triggers, '--corpus', corpus, '--output', tmp_path / name)
        code, _, err = eol(capsys, *words)
        assert code == 0, err
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1] and b'PEAK' not in files[0]

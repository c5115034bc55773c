# SPDX-License-Identifier: Apache-2.0
"""Every example runs as a user starts it, and what it prints is true."""

import itertools
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from eol_msgs.msg import Slip
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from support.waiting import wait_until

from eol_ros import cli, scene
from eol_ros.devices.corpus import corpus_file
from eol_ros.devices.files import physics_file

ROOT = Path(__file__).parents[1]
NO_FOLDER = 'cannot be written (No such file or directory)'
EXAMPLES = ROOT / 'examples'
ENVIRONMENT = os.environ | {
    'PYTHONPATH': os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')]))
}


def run(name, *words):
    return subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, words)],
        capture_output=True, text=True, env=ENVIRONMENT,
    )  # fmt: skip


def said(name, *words):
    result = run(name, *words)
    assert result.returncode == 0, result.stderr
    return result.stdout


def numbers(text):
    return [float(number) for number in re.findall(r'-?\d+(?:\.\d+)?', text)]


@pytest.mark.parametrize('path', sorted(EXAMPLES.glob('*.py')), ids=lambda path: path.name)
def test_an_example_is_short_and_says_what_it_shows(path):
    text = path.read_text()
    assert len(text.splitlines()) <= 45  # REUSE-IgnoreStart
    assert re.match(r'# SPDX-License-Identifier: Apache-2.0\n"""[A-Z]', text)  # REUSE-IgnoreEnd
    assert not re.search(r'eol_ros\S* import .*\b_|\._[a-z]', text)  # public names only
    assert path.name in Path(__file__).read_text()


def test_print_slips(ros):
    stock = {k: v for k, v in os.environ.items() if not k.startswith(('FASTRTPS', 'FASTDDS'))}
    node = ros.create_node('slipping')
    publisher = node.create_publisher(Slip, '/eol/slips', 60)
    words = [sys.executable, '-u', EXAMPLES / 'print_slips.py']
    with subprocess.Popen(words, env=stock, stdout=subprocess.PIPE, text=True) as child:
        try:
            wait_until(
                publisher.get_subscription_count,
                turn=lambda: ros.spin_once(node, timeout_sec=0.05),
            )
            assert publisher.get_subscription_count() == 1
            publisher.publish(Slip(kind=Slip.KIND_START, block=3))
            publisher.publish(Slip(kind=Slip.KIND_STOP, block=7, distance=0.0042, duration=0.25))
            lines = [child.stdout.readline(), child.stdout.readline()]
            child.send_signal(signal.SIGINT)
            rest = child.stdout.read()
            assert child.wait(30) == 0
        finally:
            child.kill()
            node.destroy_node()
    assert lines == ['waiting for slips\n', 'row 1 column 2: 4.2 mm in 250 ms\n']
    assert rest == ''


def test_analyse_bag():
    first, *rows, correlation, widest = said('analyse_bag.py').splitlines()
    stops, areas, factory = [], [], DecoderFactory()
    for path in sorted((ROOT / 'bags' / 'sample').glob('*.mcap')):
        with path.open('rb') as file:
            reader = make_reader(file, decoder_factories=[factory])
            for _, channel, _, message in reader.iter_decoded_messages():
                if channel.topic == '/eol/slips' and message.kind == 2:
                    stops.append((message.block, message.duration, message.distance))
                elif channel.topic == '/eol/cascades':
                    areas.append(message.area)
    blocks, durations, distances = np.array(stops).T
    counts = [[int(np.sum(blocks == row * 5 + column)) for column in range(5)] for row in range(5)]

    assert numbers(first)[0] == len(stops) > 100
    assert [numbers(row) for row in reversed(rows)] == counts
    centred = durations - durations.mean(), distances - distances.mean()
    expected = np.sum(centred[0] * centred[1]) / np.sqrt(np.prod([np.sum(c**2) for c in centred]))
    assert numbers(correlation) == [pytest.approx(expected, abs=0.0051)]
    assert numbers(widest)[:2] == [len(areas), max(areas)]


def test_make_corpus(tmp_path):
    rows = [numbers(line) for line in said('make_corpus.py', tmp_path / 'new').splitlines()[1:]]
    tones = 110 * 2 ** (4 * np.arange(16) / 15)
    info = soundfile.info(tmp_path / 'new' / 'tones.wav')
    loaded = corpus_file.load(tmp_path / 'new' / 'tones.json')

    assert (info.frames, info.samplerate) == (16 * 12000, 48000)
    assert [row[0] for row in rows] == list(np.arange(16) * 0.25)
    assert np.abs(np.array(rows)[:, 1] - tones).max() < 48000 / 1024  # one bin of the spectrum
    assert np.all(np.diff(loaded.grains['x']) > 0)
    assert loaded.grains['x'] == pytest.approx(np.array(rows)[:, 2], abs=0.0051)


def test_write_scene(tmp_path):
    path = tmp_path / 'long.yaml'
    assert said('write_scene.py', path) == 'long light: twin, tracker, motion, leds, recorder\n'
    loaded = scene.load(path)
    assert (loaded.settings('motion').stop_mps, loaded.settings('leds').decay_s) == (0.002, 1.5)

    refused = run('write_scene.py', path, '--stop', 7)
    place = path.read_text().splitlines()[7].index('7') + 1
    assert (refused.returncode, refused.stdout) == (78, '')
    assert f'{path}:8:{place} error motion.stop_mps: 7' in refused.stderr
    assert 'Traceback' not in refused.stderr


@pytest.mark.parametrize(
    'name, words, code, line',
    [
        ('analyse_bag.py', ['no-bag'], 69, 'no-bag: no such bag'),
        ('write_scene.py', ['no/one.yaml'], 78, f'FILE no/one.yaml: {NO_FOLDER}'),
        ('drive_rim.py', ['no/one.json'], 78, f'no/one.json: {NO_FOLDER}'),
        ('make_corpus.py', ['a-file'], 78, 'FOLDER a-file: cannot be written (File exists)'),
    ],
)
def test_a_mistake_of_the_user_is_one_line(name, words, code, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('a-file').touch()

    result = run(name, *words)

    assert (result.returncode, result.stdout, result.stderr) == (code, '', f'{line}\n')


def test_a_bag_without_a_slip_can_be_analysed(tmp_path):
    quiet = tmp_path / 'quiet.mcap'
    sample = str(ROOT / 'bags' / 'sample')
    assert cli.main(['bag', 'cut', sample, '--end', '0.2', '--output', str(quiet)]) == 0
    result = run('analyse_bag.py', quiet)

    assert (result.returncode, result.stderr) == (0, '')
    assert '0 cascades; the widest moved 0 of 25 blocks' in result.stdout


@pytest.mark.slow
@pytest.mark.timeout(300)  # compiles the event solver where that has not been done
def test_drive_rim(tmp_path):
    path = tmp_path / 'pull.json'
    first, *rows = said('drive_rim.py', path).splitlines()
    moved_mm = dict(numbers(row) for row in rows)
    start = np.random.default_rng(1).uniform(-5, 5, (25, 2))

    assert first.startswith('event path, ok: ') and numbers(first)[0] > 25
    assert moved_mm[0.0] == pytest.approx(np.hypot(*start.T).mean(), abs=0.051)
    assert moved_mm[2.5] == moved_mm[3.0]  # the rim is held, and friction holds the blocks
    assert all(a <= b + 0.1 for a, b in itertools.pairwise(moved_mm.values()))
    assert 10 < moved_mm[2.0] < 100  # behind the rim: the springs stretch before anything slips
    assert physics_file.load_scene(path).drive.pose(5.0) == pytest.approx([0.10, 0.05, 0.3])

# SPDX-License-Identifier: Apache-2.0
import errno
import subprocess
import sys
import textwrap
import threading
import time
import wave
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.jack import FS, PERIOD
from support.plugged import plugged
from support.waiting import wait_until

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.devices.audio import wav_sink
from eol_ros.devices.audio.outputs import cards, find
from eol_ros.devices.audio.soundcard import Card, Player
from eol_ros.devices.audio.wav_sink import WavSink
from eol_ros.errors import DeviceMissing

pytestmark = pytest.mark.live
HERE = Path(__file__).parent


@pytest.fixture
def card(monkeypatch):
    yield from plugged(monkeypatch)


@pytest.fixture
def wide_card(monkeypatch):
    yield from plugged(monkeypatch, channels=8)


@pytest.fixture
def card_for_others(monkeypatch):
    yield from plugged(monkeypatch, here=False)


def bank():
    sine = 0.5 * np.sin(2 * np.pi * 440 * np.arange(FS) / FS)
    return Bank([sine.astype('f4')], [0], [0.0], [0.2], FS)


def triggers(times):
    t = np.zeros(len(times), TRIGGER)
    t['time_s'], t['gain'], t['rate'] = times, 0.3, 1
    return t


def new_mixer(**options):
    return Mixer(FS, epoch_s=int(time.time()), gain_db=0, **options)


def paced(mixer):
    """Return whether the mixer plays half a second of frames in half a second."""
    before, frame = time.monotonic(), int(mixer.state['frame'][0])
    time.sleep(0.5)
    frames = int(mixer.state['frame'][0]) - frame
    return frames / (time.monotonic() - before) == pytest.approx(FS, rel=0.02)


def now(mixer):
    return time.time() - mixer.state['epoch'][0]


@pytest.mark.slow
def test_plays_on_a_real_stream_at_the_time_that_was_asked(card):
    mixer, sound = new_mixer(), bank()
    stream = Card(mixer, 'auto', PERIOD)
    stream.play()
    try:
        assert stream.name == 'system'
        assert wait_until(lambda: mixer.state['frame'][0] > FS // 2, 5)
        begin_s = now(mixer) + 0.2
        mixer.push(voice_rows(triggers([begin_s]), sound, 2))
        assert wait_until(lambda: now(mixer) > begin_s + 0.1, 2)
        frame = int(mixer.state['frame'][0])
        heard = mixer.recent(FS, frame)
        first = frame - len(heard) + int(np.flatnonzero(heard[:, 0])[0])
        assert abs(mixer.time_of(first) - begin_s) < 3e-3  # what the clock says of a busy machine
        s = mixer.state[0]
        assert (s['triggers'], s['late'], s['dropped']) == (1, 0, 0)
        assert abs(s['frame'] / FS - s['callbacks'] * PERIOD / FS) < 1e-9
    finally:
        assert stream.close()


@pytest.mark.slow
def test_eight_loudspeakers_in_a_row(wide_card):
    assert [c['channels'] for c in cards()] == [8]
    mixer, sound = new_mixer(channels=8), bank()
    stream = Card(mixer, 'system', PERIOD)
    stream.play()
    try:
        assert wait_until(lambda: mixer.state['frame'][0] > FS // 4, 20)
        t = triggers(now(mixer) + 0.3 + np.array([0.0, 0.0]))
        t['pan'] = [1.0, -1 + 2 * 2.5 / 7]  # the last one; between the third and the fourth
        mixer.play(t, sound)
        assert wait_until(lambda: mixer.recent(FS // 2).any(), 20)
        assert wait_until(lambda: mixer.state['voices'][0] == 0, 20)
        loud = np.abs(mixer.recent(FS // 2)).max(axis=0)
        assert loud[7] > 0.1 and loud[2] == pytest.approx(loud[3], rel=1e-3)
        assert loud[2] == pytest.approx(loud[7] * 0.5**0.5, rel=1e-3)
        assert not loud[[0, 1, 4, 5, 6]].any()
    finally:
        assert stream.close()


@pytest.mark.slow
def test_a_busy_python_thread_does_not_starve_the_compiled_callback(card):
    """Python's lock is held all the time; the frames must flow at the pace of the card."""
    mixer = new_mixer()
    stream = Card(mixer, 'auto', PERIOD)
    stream.play()
    stop = threading.Event()

    def busy():
        x = 0
        while not stop.is_set():
            x += 1

    worker = threading.Thread(target=busy)
    try:
        worker.start()
        assert any(paced(mixer) for _ in range(3))  # the machine may stall once or twice
    finally:
        stop.set()
        worker.join()
        stream.close()


@pytest.mark.slow
def test_a_forgotten_card_plays_on(card):
    """Its driver looks at a mixer that nobody else holds; in a process of its own: it may die."""
    code = f"""
    import sys, time
    sys.path[:0] = [{str(HERE)!r}, {str(HERE.parent)!r}, {str(HERE.parents[1])!r}]
    from test_soundcard import PERIOD, Card, np, new_mixer, wait_until
    def forget():
        mixer = new_mixer()
        Card(mixer, 'auto', PERIOD).play()
        assert wait_until(lambda: mixer.state['frame'][0] > PERIOD, 5)
    forget()
    for _ in range(100):  # what was freed is written over
        np.full(1 << 18, -1, np.int64)
        time.sleep(0.01)
    print('alive', flush=True)
    """
    child = subprocess.run(
        [sys.executable, '-c', textwrap.dedent(code)], capture_output=True, text=True, timeout=60
    )
    assert (child.returncode, child.stdout) == (0, 'alive\n'), child.stderr


@pytest.mark.slow
def test_a_lost_card_is_noticed_and_taken_again(card_for_others, tmp_path):
    """In a process of its own: a driver that hangs cannot be got rid of in this one."""
    card = card_for_others
    code = f"""
    import sys, time
    sys.path[:0] = [{str(HERE)!r}, {str(HERE.parent)!r}, {str(HERE.parents[1])!r}]
    from test_soundcard import new_mixer, wait_until
    from eol_ros.devices.audio.soundcard import Player
    mixer = new_mixer()
    player = Player(mixer, 'auto', 256, {str(tmp_path / 'x.wav')!r}, fade_in_s=0.1)
    print(player.level, player.on_card, flush=True)
    sys.stdin.readline()  # the card is pulled out
    assert wait_until(lambda: not player.on_card, 30)
    frame = int(mixer.state['frame'][0])
    flows = wait_until(lambda: int(mixer.state['frame'][0]) > frame + 10000, 30)
    print('lost', flows, player.level != 'ok', flush=True)
    sys.stdin.readline()  # and put in again
    assert wait_until(lambda: player.on_card or player.stuck, 30)
    print('back', player.on_card or player.stuck, player.text, flush=True)
    player.close(0.1)
    """
    child = subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(code)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout.readline().split() == ['ok', 'True']
        card.stop()
        child.stdin.write('\n')
        child.stdin.flush()
        assert child.stdout.readline().split() == ['lost', 'True', 'True']
        card.start()
        child.stdin.write('\n')
        child.stdin.flush()
        # On the card, or the node must start a new process for it: `eol bench sound` says how soon.
        assert child.stdout.readline().split()[:2] == ['back', 'True']
    finally:
        child.kill()
        child.communicate()


@pytest.mark.slow
@pytest.mark.parametrize('needed, level', [(True, 'warn'), (False, 'ok')])
def test_without_a_card_the_sound_goes_to_a_file_and_says_so(monkeypatch, tmp_path, needed, level):
    def nothing(*_):
        raise DeviceMissing('there is no sound card')

    # not the search for a card: that needs PortAudio, which this machine may not have
    monkeypatch.setattr(Card, '__init__', nothing)
    mixer, sound = new_mixer(), bank()
    wav = tmp_path / 'out.wav'
    player = Player(mixer, 'auto', PERIOD, wav, fade_in_s=0, card_needed=needed)
    assert (player.level, player.on_card) == (level, False)
    assert 'no sound card' in player.text
    assert str(wav) in player.text
    mixer.push(voice_rows(triggers([now(mixer) + 0.1]), sound, 2))
    assert wait_until(lambda: mixer.state['frame'][0] > FS // 2, 5)
    player.close(0.05)
    with wave.open(str(wav)) as file:
        assert (file.getframerate(), file.getnchannels(), file.getsampwidth()) == (FS, 2, 2)
        pcm = np.frombuffer(file.readframes(file.getnframes()), '<i2')
    assert file.getnframes() >= FS // 2
    assert np.abs(pcm).max() / 32767 == pytest.approx(0.5 * 0.3 * 0.5**0.5, rel=0.02)


@pytest.mark.slow
def test_file_keeps_real_time_stops_at_its_limit_and_never_overwrites(tmp_path):
    path = tmp_path / 'a.wav'
    path.write_bytes(b'of another run')
    mixer = new_mixer()
    sink = WavSink(mixer, path, PERIOD, limit_s=0.5)
    begun = time.monotonic()
    wait_until(lambda: sink.full, 10)
    taken_s = lambda: time.monotonic() - begun  # noqa: E731
    wait_until(lambda: abs(mixer.state['frame'][0] / FS - taken_s()) < 0.1, 10)
    assert sink.close()
    assert path.read_bytes() == b'of another run'
    with wave.open(str(tmp_path / 'a-1.wav')) as file:
        assert file.getnframes() / FS == pytest.approx(0.5, abs=0.01)


@pytest.mark.slow
def test_the_file_holds_what_its_triggers_are_rendered_to(tmp_path):
    """Bit for bit, though it was written as time went by: its clock is exact."""
    mixer, noise = new_mixer(governor_db=0), np.random.default_rng(1)
    noisy = noise.uniform(-0.5, 0.5, FS).astype('f4')
    sound = Bank([noisy], [0, 0], [0.0, 0.5], [0.2, 0.2], FS)
    sink = WavSink(mixer, tmp_path / 'x.wav', PERIOD, limit_s=60)
    begin_ns = time.time_ns() + 500_000_000
    stamps = begin_ns + np.sort(noise.integers(0, 10**9, 40))
    t = triggers((stamps - int(mixer.state['epoch'][0]) * 10**9) * 1e-9)
    t['grain'], t['rate'] = noise.integers(0, 2, 40), noise.uniform(0.5, 2, 40)
    mixer.play(t, sound)
    assert wait_until(lambda: mixer.state['frame'][0] > 2.2 * FS, 20)
    assert sink.close()
    assert (mixer.state['triggers'][0], mixer.state['late'][0]) == (40, 0)
    with wave.open(str(tmp_path / 'x.wav')) as file:
        pcm = np.frombuffer(file.readframes(file.getnframes()), '<i2').reshape(-1, 2)
    t['time_s'] = (stamps - begin_ns // 10**9 * 10**9) * 1e-9  # from a whole second on
    offline = render_all(Mixer(FS, gain_db=0, governor_db=0), t, sound, 3 * FS)
    wanted = np.round(offline * 32767).astype('<i2')
    live, offline = (np.flatnonzero(x.any(axis=1))[0] for x in (pcm, wanted))
    size = min(len(pcm) - live, len(wanted) - offline)
    assert size > FS
    assert np.array_equal(pcm[live : live + size], wanted[offline : offline + size])


@pytest.mark.slow
def test_names_of_cards(card):
    assert [c['name'] for c in cards()] == ['system']
    assert find('SYS') == find('system') == find('auto')
    with pytest.raises(DeviceMissing, match='there are: system'):
        find('Scarlett')
    with pytest.raises(DeviceMissing, match='has 2 channels, the scene asks for 8'):
        find('system', 8)
    with pytest.raises(DeviceMissing, match='44100'):
        Card(Mixer(44100), 'system', PERIOD)


@pytest.mark.parametrize('needed, level', [(True, 'warn'), (False, 'ok')])
def test_without_a_card_nothing_is_written_that_nobody_asked_for(
    tmp_path, monkeypatch, needed, level
):
    monkeypatch.chdir(tmp_path)
    mixer = new_mixer()
    player = Player(mixer, 'no such card', PERIOD, '', card_needed=needed)
    try:
        assert wait_until(lambda: mixer.state['frame'][0] > FS // 10, 20)  # its clock goes on
        assert player.level == level and 'set sound.wav' in player.text
    finally:
        player.close(0.0)
    assert not list(tmp_path.iterdir())


def test_a_disk_that_was_full_gets_another_file_when_it_has_room(tmp_path, monkeypatch):
    monkeypatch.setattr(wav_sink, 'RETRY_S', 0.05)
    full, free = [True], [0]
    write = wave.Wave_write.writeframesraw

    def refuse(file, data):
        if full[0]:
            raise OSError(errno.ENOSPC, 'No space left on device')
        write(file, data)

    def close(file):
        was_open = file._file
        done(file)
        if was_open and full[0]:
            raise OSError(errno.ENOSPC, 'No space left on device')

    done = wave.Wave_write.close
    monkeypatch.setattr(wave.Wave_write, 'close', close)
    monkeypatch.setattr(wave.Wave_write, 'writeframesraw', refuse)
    monkeypatch.setattr(wav_sink.shutil, 'disk_usage', lambda _: SimpleNamespace(free=free[0]))
    mixer = new_mixer()
    sink = WavSink(mixer, tmp_path / 'x.wav', PERIOD, 3600.0)
    assert wait_until(lambda: 'No space left' in sink.name, 20)
    frame = int(mixer.state['frame'][0])  # it goes on, and without room begins no file
    assert wait_until(lambda: mixer.state['frame'][0] > frame + FS // 4, 20)
    assert [p.name for p in tmp_path.iterdir()] == ['x.wav']
    full[0], free[0] = False, 1 << 30
    wait_until(lambda: sink.name == str(tmp_path / 'x-1.wav'), 20)
    size = sink._written
    wait_until(lambda: sink._written > size + FS // 10, 20)
    assert sink.close()
    with wave.open(str(tmp_path / 'x-1.wav')) as file:
        assert file.getnframes() > FS // 10


PRIORITY = """
import os, sys, threading, time
from pathlib import Path
try:
    os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(2))
except PermissionError:
    sys.exit(3)
from eol_ros.core.sound.mixer import Mixer
from eol_ros.devices.audio.soundcard import Player
from eol_ros.devices.carrier_thread import aside, carrier_thread

def policies():
    tasks = [(t, (t / 'comm').read_text().strip()) for t in Path('/proc/self/task').iterdir()]
    return {
        name: os.sched_getscheduler(int(task.name)) & ~os.SCHED_RESET_ON_FORK
        for task, name in tasks if name.startswith('eol.') or name == 'aside'
    }

player = Player(Mixer(48000), 'wav', 256, sys.argv[1], fade_in_s=0.0)
seen = threading.Event()
carrier_thread('carries', lambda: aside(seen.wait)).start()
time.sleep(0.3)
found = policies()
seen.set()
player.close(0.0)
ahead = {name for name, policy in found.items() if policy == os.SCHED_RR}
assert ahead == {'eol.wav sink', 'eol.sound watch', 'eol.carries'}, found
assert found['aside'] == os.SCHED_OTHER, found
"""


def test_what_plays_beside_the_triggers_is_not_put_aside_with_pythons_lock(tmp_path):
    """A thread without priority that waits for a processor holds up one with it by the lock."""
    words = [sys.executable, '-c', PRIORITY, str(tmp_path / 'a.wav')]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    if done.returncode == 3:
        pytest.skip('no real-time priority here')
    assert done.returncode == 0, done.stderr

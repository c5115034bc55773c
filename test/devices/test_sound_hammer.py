# SPDX-License-Identifier: Apache-2.0
"""Again and again: open a card, play, swap the sound away, lose the card, take it again, close."""

import json
import subprocess
import sys
import textwrap

import pytest
from support.plugged import plugged

CODE = """
    import gc, json, sys, tempfile, time
    from pathlib import Path
    import numpy as np
    from eol_ros.core.sound.bank import Bank
    from eol_ros.core.sound.mixer import Mixer
    from eol_ros.core.sound.triggers import TRIGGER
    from eol_ros.devices.audio import soundcard

    soundcard.WATCH_S = 1e9  # the card is lost and found by hand here
    random = np.random.default_rng(1)
    counts = {'card': 0, 'file': 0, 'lost': 0, 'again': 0, 'voices': 0, 'peak': 0.0}

    def press(player):
        '''Swap the sound away under sounding grains, again and again.'''
        for _ in range(3):
            seconds = float(random.uniform(0.5, 4))
            noise = random.uniform(-1, 1, int(48000 * seconds)).astype('f4')
            begins = np.linspace(0, seconds / 2, 8)
            bank = Bank([noise], np.zeros(8, int), begins, np.full(8, 2.0), 48000)
            t = np.zeros(40, TRIGGER)
            now = time.time() - player.mixer.state['epoch'][0]
            t['time_s'] = now + random.uniform(-0.01, 0.05, 40)
            t['grain'], t['gain'] = random.integers(0, 8, 40), 0.2
            t['rate'], t['pan'] = random.uniform(0.5, 2, 40), random.uniform(-1, 1, 40)
            player.mixer.play(t, bank)
            del bank, noise
            gc.collect()
            time.sleep(0.02)
        counts['voices'] = max(counts['voices'], int(player.mixer.state['voices'][0]))
        counts['peak'] = max(counts['peak'], float(np.abs(player.mixer.recent(4800)).max()))

    with tempfile.TemporaryDirectory() as folder:
        for k in range(ROUNDS):
            mixer = Mixer(48000, epoch_s=int(time.time()), max_voices=64)
            player = soundcard.Player(mixer, 'system', 256, Path(folder) / 'x.wav', fade_in_s=0.0)
            counts['card'] += player.on_card
            press(player)
            if k % 2:
                player._lost()
                counts['lost'] += not player.on_card
                press(player)
                if k % 4 == 3:
                    player._look()
                    counts['again'] += player.on_card
                    press(player)
            if k % 10:
                player.close(0.0)
                counts['file'] += not player.stuck
            else:  # dropped as it is
                player.output.close()
            del player, mixer
            gc.collect()
    print(json.dumps(counts), flush=True)
"""


@pytest.fixture
def card(monkeypatch):
    yield from plugged(monkeypatch, here=False)


@pytest.mark.slow
@pytest.mark.live
@pytest.mark.parametrize(
    'rounds', [4, pytest.param(400, marks=(pytest.mark.soak, pytest.mark.timeout(1200)))]
)
def test_every_round_ends_well(card, rounds):
    code = textwrap.dedent(CODE).replace('ROUNDS', str(rounds))
    done = subprocess.run(
        [sys.executable, '-X', 'faulthandler', '-c', code],
        capture_output=True, text=True, timeout=100 if rounds < 100 else 1100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert (found['card'], found['lost'], found['again']) == (rounds, rounds // 2, rounds // 4)
    assert found['voices'] > 20
    assert 0.1 < found['peak'] <= 10 ** (-1 / 20)

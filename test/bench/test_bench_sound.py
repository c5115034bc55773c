# SPDX-License-Identifier: Apache-2.0

import pytest
from support import needs
from support.sound_reference import snr_db

from benchmarks import sound_live
from benchmarks.sound_engine import FS, make_score, ours, source, speed, truth


@pytest.mark.live
@pytest.mark.slow
def test_the_mixer_is_measured_and_exact():
    sound = source()
    score = make_score(20, 1.0, True)
    figures = speed(sound, score, 256, repeats=1)
    assert figures['voices_per_core'] * figures['ns_per_voice_sample'] == pytest.approx(
        1e9 / FS, rel=1e-6
    )
    frames = FS // 2
    assert snr_db(ours(sound, score, frames, 256), truth(sound, score, frames)) > 120


@pytest.mark.soak
@pytest.mark.timeout(900)
@pytest.mark.parametrize('seconds', [60, 600])
def test_no_underrun_with_a_busy_python_thread(seconds):
    needs.system('jackd2', 'libportaudio2')
    figures = sound_live.measure(sound_live.CASES[0], seconds)
    assert figures['unexplained_underruns'] == 0 and figures['load_worst'] < 0.5, figures
    if not figures['underruns']:  # each shifts the stream
        assert figures['stamp_to_sample_sd'] <= 2
        assert figures['stamp_to_sample_worst'] <= 8

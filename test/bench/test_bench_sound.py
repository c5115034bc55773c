# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.bench import sound_live
from eol_ros.bench.sound_engine import FS, error_db, make_score, ours, source, speed, truth
from eol_ros.bench.sound_peers import PEERS


def test_score_has_the_overlap_that_it_says():
    for varied in (False, True):
        score = make_score(50, 4.0, varied)
        assert score.grain_seconds / 4.0 == pytest.approx(50, rel=0.05)


def test_error_finds_gain_and_lag_and_nothing_else():
    rng = np.random.default_rng(1)
    wanted = rng.standard_normal((4000, 2))
    late = 0.3 * np.concatenate([np.zeros((3, 2)), wanted[:-3]])
    assert error_db(late, wanted, 5) > 250
    assert error_db(late, wanted, 2) < 1
    assert error_db(wanted * 1.001, wanted) == pytest.approx(60, abs=0.1)


@pytest.mark.slow
def test_the_mixer_is_measured_and_exact():
    sound = source()
    score = make_score(20, 1.0, True)
    figures = speed(sound, score, 256, cubic=True, repeats=1)
    assert figures['voices_per_core'] * figures['ns_per_voice_sample'] == pytest.approx(
        1e9 / FS, rel=1e-6
    )
    frames = FS // 2
    assert error_db(ours(sound, score, True, frames, 256), truth(sound, score, True, frames)) > 120


@pytest.mark.slow
@pytest.mark.parametrize('name', [name for name, peer in PEERS.items() if peer[3]()])
def test_the_other_engines_play_our_score(name, tmp_path):
    import soundfile

    play, exact, cubic, _ = PEERS[name]
    sound = source()
    soundfile.write(tmp_path / 'source.wav', sound, FS, subtype='FLOAT')
    score = make_score(2, 1.0, True)
    spent, out = play(tmp_path, score, 64)
    assert out[:FS].any()
    assert np.isfinite(spent)
    if exact:
        wanted = truth(sound, score, cubic, FS, dc=False)
        assert error_db(out[:FS, :2], wanted, 70) > 5


@pytest.mark.soak
def test_no_underrun_in_a_minute_with_a_busy_python_thread():
    figures = sound_live.measure(sound_live.CASES[0], 60)
    if 'skipped' in figures:
        pytest.skip(figures['skipped'])
    assert figures['underruns'] == 0
    assert figures['stamp_to_sample_sd'] <= 2
    assert figures['stamp_to_sample_worst'] <= 8

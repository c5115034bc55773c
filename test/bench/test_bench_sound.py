# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np
import pytest
from support import needs
from support.sound_reference import snr_db

from benchmarks import sound_live, sound_rehearsal
from benchmarks.sound_engine import FS, make_score, ours, source, speed, truth
from eol_ros.core.physics.twin.play import Play
from eol_ros.errors import EolError
from eol_ros.settings import GrainsSettings, SoundSettings, TwinSettings

NS = 10**9


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


def test_a_slip_is_followed_to_its_first_sample():
    """Two slips of a table that is simulated twice, one trigger in time and one late."""
    twin, sound = TwinSettings(), SoundSettings()
    truths, begun = truth_of(twin, 12.0)
    assert len(begun) > 10
    found = sound_rehearsal.onsets(truths, twin)
    assert [b for _, b in found] == [b for _, b in sorted(begun)]
    assert np.abs(np.subtract(found, sorted(begun))).max() < 1000  # a microsecond
    # an image that was skipped: the table had moved to it
    assert sound_rehearsal.onsets(truths[:30] + truths[31:], twin) == found
    truths[30].x[7] += 1e-12
    with pytest.raises(EolError, match='image 31'):
        sound_rehearsal.onsets(truths, twin)
    truths[30].x[7] -= 1e-12
    (first, a), (second, b) = found[0], next(one for one in found if one[1] != found[0][1])
    stamps, waits = [first + 20_000_000, second + 25_000_000], [10_000_000, 40_000_000]
    watch = SimpleNamespace(
        seen={
            'grain_triggers': [(s, s + wait) for s, wait in zip(stamps, waits, strict=True)],
            'block_taps': [], 'felt_slips': [], 'felt_triggers': [],
        },
        messages=lambda topic: {
            'truth': truths, 'block_taps': [], 'sound_samples': [], 'felt_triggers': [],
            'felt_slips': [],
            'grain_triggers': [SimpleNamespace(block=k, grain=k) for k in (a, b)],
        }[topic],
    )  # fmt: skip
    scene = SimpleNamespace(settings={'twin': twin, 'sound': sound, 'grains': GrainsSettings()}.get)
    figures = sound_rehearsal.figures(watch, 0, scene)
    latency = sorted(figures['latency_ms'][key] for key in ('least', 'most'))
    in_time = 20 + 1e3 * sound.latency_s + 1e3 / FS
    too_late = 25 + 40 + 3 + 1e3 * sound.block_size / FS + 1e3 / FS
    assert latency == pytest.approx([in_time, too_late], abs=0.01)
    assert figures['late_at_most'] == 1 and figures['seen_alone'] == 0
    assert 'felt_ms' not in figures


def truth_of(settings, seconds):
    """Return what the twin would publish, and (time in ns, block) of each slip's beginning."""
    play = Play(settings.seed)
    table, truths, begun = play.table, [], []
    for k in range(1 + round(seconds * 60)):
        stamp, before = (10**18 + round(i * NS / settings.fps) for i in (k, k - 1))
        span_s = (stamp - before) / NS if k > 1 else (1 / settings.fps if k else 1e-4)
        table._ledger.log.start[:] = -1
        play.advance(span_s)
        if not k:
            continue
        at = SimpleNamespace(sec=stamp // NS, nanosec=stamp % NS)
        truths.append(
            SimpleNamespace(header=SimpleNamespace(stamp=at), x=table.x.copy(), y=table.y.copy())
        )
        begun += [
            (stamp - round((span_s - table._ledger.log.t[i]) * NS), int(table._ledger.log.block[i]))
            for i in np.flatnonzero(table._ledger.log.start == 1)
        ]
    return truths, begun


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

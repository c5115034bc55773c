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
from eol_ros.streams.felt import CONFIRMED, PROVISIONAL

NS = 10**9


@pytest.mark.slow
def test_the_mixer_is_measured_and_exact():
    sound = source()
    score = make_score(20, 1.0, True)
    figures = speed(sound, score, 256, cubic=True, repeats=1)
    assert figures['voices_per_core'] * figures['ns_per_voice_sample'] == pytest.approx(
        1e9 / FS, rel=1e-6
    )
    frames = FS // 2
    assert snr_db(ours(sound, score, True, frames, 256), truth(sound, score, True, frames)) > 120


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
    too_late = 25 + 40 + 3 + 1e3 * 256 / FS + 1e3 / FS
    assert latency == pytest.approx([in_time, too_late], abs=0.01)
    assert figures['late_at_most'] == 1 and figures['seen_alone'] == 0
    assert 'felt_ms' not in figures

    # The first of them is felt, and its knock sounds it before its image asks for the same grain.
    knock = first + 100_000
    at = SimpleNamespace(stamp=SimpleNamespace(sec=knock // NS, nanosec=knock % NS))
    messages, seen = watch.messages, watch.seen
    seen['felt_triggers'] = [(knock, knock + 4_000_000)]
    seen['felt_slips'] = [(knock, knock + 3_000_000), (knock, knock + 90_000_000)]
    felt = {
        'block_taps': [SimpleNamespace(block=a, header=at)],
        'felt_triggers': [SimpleNamespace(block=a, grain=a)],
        'felt_slips': [SimpleNamespace(kind=PROVISIONAL), SimpleNamespace(kind=CONFIRMED)],
    }
    watch = SimpleNamespace(seen=seen, messages=lambda topic: felt.get(topic) or messages(topic))
    figures = sound_rehearsal.figures(watch, 0, scene)
    (by_knock,), (by_image,) = figures['ms']['felt'], figures['ms']['seen']
    assert by_knock == pytest.approx(0.1 + 1e3 * sound.tap_latency_s + 1e3 / FS, abs=0.01)
    assert by_image == pytest.approx(too_late, abs=0.01)
    assert (figures['late_at_most'], figures['felt_ms']['count']) == (1, 1)
    assert figures['felt_not_barred_ms']['count'] == 1
    hops = {topic: (one['count'], one['most']) for topic, one in figures['knock_to_ms'].items()}
    assert hops == {'felt_slips': (1, 3.0), 'felt_triggers': (1, 4.0)}

    # The second was felt too, soon after a knock whose grains may not sound again yet.
    before, knock = second - 100_000_000, second + 100_000
    at = SimpleNamespace(stamp=SimpleNamespace(sec=knock // NS, nanosec=knock % NS))
    seen['felt_triggers'].insert(0, (before, before + 4_000_000))
    felt['felt_triggers'].insert(0, SimpleNamespace(block=b, grain=999))
    felt['block_taps'].append(SimpleNamespace(block=b, header=at))
    figures = sound_rehearsal.figures(watch, 0, scene)
    assert figures['felt_ms']['count'] == 2 and 'seen_ms' not in figures
    assert figures['felt_ms']['most'] == pytest.approx(too_late, abs=0.01)
    rested = figures['felt_not_barred_ms']
    assert (rested['count'], rested['most']) == (1, pytest.approx(by_knock, abs=0.01))


def truth_of(settings, seconds):
    """Return what the twin would publish, and (time in ns, block) of each slip's beginning."""
    play = Play(settings.seed)
    table, truths, begun = play.table, [], []
    for k in range(1 + round(seconds * 60)):
        stamp, before = (10**18 + round(i * NS / settings.fps) for i in (k, k - 1))
        span_s = (stamp - before) / NS if k > 1 else (1 / settings.fps if k else 1e-4)
        table._log.start[:] = -1
        play.advance(span_s)
        if not k:
            continue
        at = SimpleNamespace(sec=stamp // NS, nanosec=stamp % NS)
        truths.append(
            SimpleNamespace(header=SimpleNamespace(stamp=at), x=table.x.copy(), y=table.y.copy())
        )
        begun += [
            (stamp - round((span_s - table._log.t[i]) * NS), int(table._log.block[i]))
            for i in np.flatnonzero(table._log.start == 1)
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

# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.core.sound import segments

RATE = 8000


@given(
    st.integers(1, 200_000),
    st.sampled_from([8000, 44100, 192000]),
    st.floats(0.02, 2.0),
    st.floats(0.0, 0.9),
)
def test_chop_covers_the_sound(n, rate, grain_s, overlap):
    cuts = segments.chop(n, rate, grain_s, overlap)
    length = round(grain_s * rate)
    assert cuts[0, 0] == 0
    sizes = cuts[:, 1] - cuts[:, 0]
    assert (sizes > 0).all() and cuts[:, 1].max() <= n
    assert (sizes[:-1] >= length // 2).all() and sizes.max() <= length
    steps = np.diff(cuts[:, 0])
    assert (steps == steps[:1]).all() if len(steps) else True
    if not overlap:
        np.testing.assert_array_equal(cuts[1:, 0], cuts[:-1, 1])  # no gap, no repetition
    assert n - cuts[-1, 1] <= length  # at most a rest is left out


def bursts(*spans, level=0.5, seconds=3.0, floor=1e-4):
    random = np.random.default_rng(3)
    sound = floor * random.standard_normal(round(seconds * RATE))
    for start, end in spans:
        a, b = round(start * RATE), round(end * RATE)
        sound[a:b] += level * random.standard_normal(b - a)
    return sound.astype(np.float32)


def test_gate_bridges_short_pauses_and_drops_clicks():
    cuts = segments.gate(bursts((0.5, 0.7), (0.73, 1.0), (2.0, 2.01)), RATE) / RATE
    np.testing.assert_allclose(cuts, [[0.5, 1.0]], atol=0.0101)


def test_gate_of_silence_is_empty_and_of_noise_is_one():
    assert len(segments.gate(np.zeros(RATE, np.float32), RATE)) == 0
    cuts = segments.gate(bursts((0.0, 3.0)), RATE)
    assert cuts.tolist() == [[0, 3 * RATE]]


@pytest.mark.parametrize('rate', [8000, 48000])
def test_onsets_are_where_something_begins(rate):
    random = np.random.default_rng(5)
    at_s = np.array([0.25, 0.61, 0.9, 1.4, 1.52, 2.3])
    sound = 1e-3 * random.standard_normal(3 * rate)
    for start in at_s:
        tail = np.arange(round(0.3 * rate))
        a = round(start * rate)
        hit = random.standard_normal(len(tail)) * np.exp(-tail / (0.05 * rate))
        sound[a : a + len(tail)] += 0.4 * hit[: len(sound) - a]
    found = segments.onsets(sound.astype(np.float32), rate) / rate
    found = found[found > 0]  # the noise of the tape begins, too
    assert len(found) == len(at_s)
    np.testing.assert_allclose(found, at_s, atol=0.004)


def test_onset_cut_goes_from_onset_to_onset():
    sound = bursts((0.5, 0.6), (1.0, 1.1), (2.5, 2.6))
    cuts = segments.onset_cut(sound, RATE, grain_s=0.7) / RATE
    np.testing.assert_allclose(cuts[:3, 0], [0.5, 1.0, 2.5], atol=0.004)
    assert cuts[0, 1] == cuts[1, 0]
    assert (cuts[:, 1] - cuts[:, 0] <= 0.7).all()

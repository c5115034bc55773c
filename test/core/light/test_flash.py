# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.flashes import count_flashes, most_flashes_in_a_second, render

from eol_ros.core.light.flash import FLASHES_PER_S, MIN_PERIOD_S, FlashField


def test_counter_counts():
    t = np.arange(250) / 250

    assert count_flashes(0.5 + 0.5 * np.sin(2 * math.pi * 5 * t)) == 5
    assert count_flashes(0.5 + 0.04 * np.sin(2 * math.pi * 5 * t)) == 0
    assert count_flashes(np.linspace(0, 1, 250)) == 0


def test_a_slip_lights_its_block_at_once_and_dies_exponentially():
    field = FlashField(decay_s=0.4, peak=0.8)
    field.slip(10.0, 7)

    assert field.levels(10.0)[7] == 0.8
    assert field.levels(10.3)[7] == pytest.approx(0.8 * math.exp(-0.3 / 0.4))
    assert np.count_nonzero(field.levels(10.3)) == 1


def test_levels_do_not_depend_on_how_often_one_asks():
    slips = [(0.0, 1), (0.11, 2), (0.15, 2), (0.5, 24), (1.3, 1)]
    seldom, often = FlashField(0.35), FlashField(0.35)
    often_levels = render(often, slips, 2.0, rate_hz=1000.0)[-1]
    for slip in slips:
        seldom.slip(*slip)

    np.testing.assert_allclose(seldom.levels(1.999), often_levels, atol=0.5 / 255)


def test_a_second_slip_is_lit_at_once_and_the_decay_waits():
    field = FlashField(decay_s=0.2)
    field.slip(0.0, 0)
    field.slip(0.1, 1)
    before = field.levels(0.1)

    assert before[1] == 1.0
    assert field.levels(0.1 + 0.9 * MIN_PERIOD_S)[1] > 0.9
    assert field.levels(0.1 + MIN_PERIOD_S + 0.2)[1] < 0.4
    assert field.lengthened == 1


def test_without_the_limit_a_strobe_stays_a_strobe():
    slips = [(k * 0.1, 12) for k in range(30)]
    free = render(FlashField(0.02, limited=False), slips, 3.0)[:, 12]
    held = render(FlashField(0.02), slips, 3.0)[:, 12]

    assert most_flashes_in_a_second(free, 250) >= 9
    assert most_flashes_in_a_second(held, 250) <= FLASHES_PER_S


def test_the_worst_known_timing_keeps_the_limit():
    """Falls interrupted just after they began, after one long fall: the densest falls there are."""
    field, slips, t = FlashField(0.35), [(0.0, 0)], 0.333
    for _ in range(12):
        slips.append((t, 0))
        t += 0.04 if len(slips) % 2 else MIN_PERIOD_S + 0.04
    levels = render(field, slips, 4.0)

    assert most_flashes_in_a_second(levels[:, 0], 250) <= FLASHES_PER_S


FAINT = [(0.0, 3), (0.0, 4), (0.25, 0), (0.5, 1), (0.375, 2), (0.3125, 0), (0.1875, 0)]


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@example(gaps=FAINT, decay=0.35)  # many faint blocks, and a light that is dazzled by three
@given(
    gaps=st.lists(st.tuples(st.floats(0, 0.6), st.integers(0, 24)), min_size=5, max_size=25),
    decay=st.sampled_from([0.01, 0.1, 0.35, 1.5]),
)
def test_no_slips_make_the_field_or_a_block_flash_four_times_a_second(gaps, decay):
    slips, t = [], 0.0
    for gap, block in gaps:
        t += gap
        slips.append((t, block % 3 if decay < 0.2 else block))
    levels = render(FlashField(decay), slips, min(t + 0.5, 5.0), rate_hz=125.0)

    for light in (levels.mean(axis=1) * 8, levels.mean(axis=1), levels[:, 0], levels[:, 1]):
        assert most_flashes_in_a_second(light.clip(0, 1), 125) <= FLASHES_PER_S


def test_time_that_runs_backwards_is_no_time():
    field = FlashField(0.3)
    field.slip(5.0, 0)
    field.slip(4.0, 1)

    assert field.levels(4.5)[0] == field.levels(4.5)[1] == 1.0


@pytest.mark.parametrize('arguments', [{'decay_s': 0}, {'decay_s': 1, 'peak': 1.5}])
def test_impossible_settings_are_refused(arguments):
    with pytest.raises(ValueError, match='it must'):
        FlashField(**arguments)

# SPDX-License-Identifier: Apache-2.0
"""The system clock is set in mid-run, back and forth: all that rests on stamps goes on."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.flashes import changes
from support.paper import rest_lattice
from support.set_clock import SetClock

from eol_ros.core.motion.felt import Knock
from eol_ros.core.motion.motion import Motion
from eol_ros.core.motion.slips import START, STOP
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.select import Selector
from eol_ros.devices.audio.bank import BankLoader
from eol_ros.devices.board import lights as lights_module
from eol_ros.devices.board.lights import Lights
from eol_ros.settings import GrainsSettings, LedsSettings, MotionSettings

T0_S, FPS, SPAN_S = 1_700_000_000.0, 60, 1.0
YEARS = 30 * 365.25 * 86400
JUMPS = st.lists(
    st.one_of(
        st.sampled_from([-3600.0, 3600.0, -YEARS, YEARS]), st.floats(-1e5, 1e5), st.floats(-3, 3)
    ),
    min_size=1,
    max_size=4,
)
JITTER_S = st.floats(0, 0.004)
SEEN = np.ones(25, bool)
SIGMA = np.full(25, 1e-5)


def run(jumps, jitter_s):
    """Images of one block that slips once a second, 0.3 s after each time that the clock was set.

    Yields (stretch, time since it began, stamp, x, y).
    """
    rng, clock_s, steady_s, path = np.random.default_rng(1), T0_S, 0.0, 0.0
    for stretch, jump_s in enumerate([0.0, *jumps]):
        clock_s += jump_s
        for k in range(round(SPAN_S * FPS)):
            t = k / FPS
            steady_s += 1 / FPS
            place = rest_lattice() + rng.normal(0, 1e-5, (25, 2))
            place[12, 1] += path + 1.25 * min(max(t - 0.3, 0), 0.12) ** 2
            stamp_s = clock_s + steady_s + rng.uniform(-jitter_s, jitter_s)
            yield stretch, t, stamp_s, place[:, 0], place[:, 1]
        path += 0.018


@given(JUMPS, JITTER_S)
@settings(max_examples=15)
@example([-3600.0], 0.0)
@example([3600.0, -3600.0], 0.002)
def test_slips_and_cascades_go_on(jumps, jitter_s):
    motion, starts, stops, cascades = Motion(MotionSettings()), [], [], []
    for stretch, _, stamp_s, x, y in run(jumps, jitter_s):
        motion.tap(Knock(round(stamp_s * 1e9), 12, 1e-3))
        slips, closed = motion.update(stamp_s, x, y, SEEN, SIGMA)
        for slip in slips:
            (starts if slip.event.kind == START else stops).append((stretch, slip.event.slip))
        cascades += [(stretch, c.cascade) for c in closed]
    assert {stretch for stretch, _ in starts} == set(range(len(jumps) + 1))
    numbers = [number for _, number in starts]
    assert numbers == sorted(set(numbers))  # no number twice, whatever the stamps do
    ended = [number for _, number in stops]
    assert len(ended) == len(set(ended)) and set(ended) <= set(numbers)
    assert len(motion.cascades.open) <= 1  # those of the times before are closed
    assert len(motion.taps) < FPS


def test_a_slip_that_the_jump_cuts_short_is_stopped_and_its_cascade_closed():
    motion, found = Motion(MotionSettings()), []
    for stretch, t, stamp_s, x, y in run([-3600.0], 0.0):
        if stretch or t < 0.4:  # the clock is set in the middle of the slip
            slips, closed = motion.update(stamp_s, x, y, SEEN, SIGMA)
            found += [(stretch, s.event.kind, s.event.slip) for s in slips]
            found += [(stretch, 'cascade', c.cascade) for c in closed]
    assert found[:3] == [(0, START, 1), (1, STOP, 1), (1, 'cascade', 1)]
    assert (1, START, 2) in found


@given(JUMPS, JITTER_S)
@settings(max_examples=15)
@example([-3600.0], 0.0)
def test_grains_go_on(jumps, jitter_s):
    grains = np.zeros(1, GRAIN)
    at = rest_lattice()[12] + [0.0, 0.0]
    half = GrainsSettings().space_m / 2
    grains['x'], grains['y'] = (at + half) / (2 * half)
    grains['duration_s'] = 0.25
    corpus = Corpus((Source('a.wav', 48000, 99.0, ''),), grains)
    selector, heard = Selector(GrainsSettings(radius=0.3), corpus), set()
    for stretch, _, stamp_s, x, y in run(jumps, jitter_s):
        if len(selector.update(stamp_s, x, y, SEEN, SIGMA)):
            heard.add(stretch)
    assert heard == set(range(len(jumps) + 1))


def test_a_stamp_that_is_a_little_older_changes_nothing_in_the_selector():
    selector = Selector(GrainsSettings())
    x, y = rest_lattice().T
    selector.update(T0_S, x, y, SEEN, SIGMA)
    selector.moving[3] = True
    selector.update(T0_S - 0.1, x, y, SEEN, SIGMA)
    assert selector.moving[3]


@pytest.mark.parametrize('limit', ['field_of_view', 'field'])
@given(jumps=JUMPS, gap=st.integers(3, 60), late_ms=st.integers(5, 35), span=st.integers(20, 100))
@settings(max_examples=15)
@example(jumps=[3600.0], gap=6, late_ms=10, span=60)
@example(jumps=[-3600.0], gap=35, late_ms=5, span=20)
@example(jumps=[-3600.0], gap=40, late_ms=5, span=20)
@example(jumps=[0.3, -0.3, 0.3], gap=6, late_ms=20, span=60)
def test_light_goes_on_and_flashes_no_more_than_three_times_a_second(
    limit, jumps, gap, late_ms, span
):
    """A slip every `gap` ticks of 10 ms; the clock is set every `span` ticks.

    It is what is told of the board's light.
    """
    clock, real = SetClock(T0_S), lights_module.time
    lights_module.time = clock
    lights = Lights(LedsSettings(port='twin', decay_s=0.182, flash_limit=limit))
    lights.board.light = lambda mask, stamp_us, share: 0
    try:
        times, shown, waiting = [], [], []
        for tick in range(span * (len(jumps) + 1) + 200):
            if tick and tick % span == 0 and tick // span <= len(jumps):
                clock.offset_ns += round(jumps[tick // span - 1] * 1e9)
            if tick % gap == 0:
                waiting.append((clock.steady_ns + late_ms * 10**6, clock.time_ns()))
            while waiting and waiting[0][0] <= clock.steady_ns:  # its stamp is of before
                stamp_ns = waiting.pop(0)[1]
                lights.slip(12, stamp_ns, stamp_ns - 15_000_000)
            lights.frame()
            times.append(clock.steady_ns * 1e-9)
            shown.append(lights._white[12] / 255)
            clock.steady_ns += 10_000_000
    finally:
        lights_module.time = real
        lights.close()
    assert max(shown) >= 0.74
    found = changes(times, shown)
    assert max(((found >= t) & (found <= t + 1)).sum() // 2 for t in found) <= 3
    # light dies away, but for the limit's sake
    assert gap < 40 or min(shown[-100:]) < 0.75 * max(shown)


def test_triggers_after_a_jump_are_of_the_corpus_before_it(monkeypatch):
    loader, hour_ns = BankLoader(48000), 3600 * 10**9
    monkeypatch.setattr(loader, '_read', lambda entry: setattr(entry, 'bank', entry.digest))
    now_ns = round(T0_S * 1e9)
    loader.ask('first', now_ns)
    loader.ask('second', now_ns + 10**9)
    for _ in range(1000):
        if all(entry.bank for entry in loader._entries):
            break
    after_ns = now_ns + 2 * 10**9 - hour_ns
    loader.time_jumped(-hour_ns)
    assert loader.at(after_ns) == 'second'
    loader.close()

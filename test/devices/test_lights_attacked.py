# SPDX-License-Identifier: Apache-2.0
"""Orders, settings, sleep and restarts at the edge of what is allowed: what the blocks show."""

import itertools

import numpy as np
import pytest
from support.fields_of_view import RATE_HZ, fields, most_in_a_second
from support.flashes import most_flashes_in_a_second
from support.paper import rest_lattice
from support.set_clock import SetClock

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.light.bridge import Bridge
from eol_ros.devices.board.board import State
from eol_ros.devices.board.fake import obey
from eol_ros.devices.board.lights import Lights
from eol_ros.settings import LedsSettings

EYES = (0.0, 0.0, 0.4), (0.0, 0.0, 0.8), (0.0, -0.9, 0.6), (0.0, -1.0, 1.1), (0.0, -2.0, 1.5)
SECONDS = 12
KNOWN = {n: protocol.BlockStatus(n, 0, 0, *protocol.FIRMWARE, 1) for n in (protocol.BRIDGE, 7)}


class Attacked:
    """Lights that are killed now and then, and blocks and a bridge that live on; one clock."""

    def __init__(self, monkeypatch, limit):
        self.clock, self.bridge, self.shown = SetClock(1.7e9), Bridge(), []
        self.settings = {'port': 'none', 'flash_limit': limit}
        self.number = itertools.count()
        monkeypatch.setattr('eol_ros.devices.board.lights.time', self.clock)
        self.begin(asleep=False)

    @property
    def now_s(self):
        return self.clock.steady_ns * 1e-9

    def begin(self, asleep):
        """Start a process: it knows whether the work sleeps, and then finds the board."""
        self.lights = lights = Lights(LedsSettings(**self.settings))
        board = lights.board
        lights.asleep, told = asleep, list(board._configuration)
        board.configure = self.configure
        board.light = self.light
        board.count, board.blocks, board.state = 25, KNOWN, State('ready', '')
        self.configure(*told)

    def configure(self, *messages):
        for message in messages:
            obey(self.bridge, self.now_s, message)

    def light(self, mask, stamp_us, share=1.0):
        self.bridge.light(self.now_s, mask, share)
        return 1

    def set(self, **more):
        self.settings |= more
        self.lights.set(LedsSettings(**self.settings))

    def knock(self, block):
        if self.bridge.felt(self.now_s, block):
            number, at_ns = next(self.number), self.clock.time_ns()
            self.lights._shone[block, number] = at_ns
            self.lights.tap(block, at_ns, number)

    def see(self, block):
        at_ns = self.clock.time_ns()
        self.lights.slip(block, at_ns, at_ns - 15_000_000)

    def wait(self, seconds, alive=True):
        """Show images; what happens next comes just after the last one."""
        for _ in range(max(1, round(seconds * RATE_HZ))):
            self.clock.steady_ns += round(1e9 / RATE_HZ)
            if alive:
                self.lights.frame()
            self.shown.append(self.bridge.levels(self.now_s))


def some_settings(random):
    """Settings that are allowed, the extremes more often than others."""
    one = lambda *values: values[random.integers(len(values))]  # noqa: E731
    return {
        'sleep_fade_s': one(0.0, 1e-9, 0.01, 0.3, 2.0, 60.0),
        'idle_period_s': one(0.0, 1e-9, 1.0, 600.0),
        'peak': one(0.0, 1e-3, 0.1, 0.6, 1.0, 1.0, 1.0),
        'decay_s': one(0.02, 0.1, 0.4, 10.0),
        'look': one('paper', 'paper', 'lightning', 'wildfire', 'embers'),
        'spread_blocks': one(0, 1, 8),
        'spread_share': one(0.2, 0.6, 1.0),
        'spread_delay_s': one(0.01, 0.05, 1.0),
        'afterglow_s': one(0.0, 1.0, 1.5),
    }


def attack(one, random):
    """Random knocks, slips, settings, sleep and kills; then sleep."""
    some = random.permutation(25)[: random.integers(1, 26)]
    rate_hz = 10 ** random.uniform(0, 2)
    turns, sets = random.choice([0, 0.5, 10]), random.choice([0, 1, 20])
    kills = random.choice([0, 1])
    end_s = one.now_s + SECONDS
    while one.now_s < end_s:
        step_s = 1 / RATE_HZ
        for block in random.choice(some, random.poisson(rate_hz * step_s)).tolist():
            (one.knock if random.uniform() < 0.5 else one.see)(block)
        if random.uniform() < turns * step_s:
            one.lights.asleep = bool(random.integers(2))
        if random.uniform() < sets * step_s:
            one.set(**some_settings(random))
        if random.uniform() < kills * step_s:
            one.wait(random.uniform(0, 0.5), alive=False)
            one.begin(one.lights.asleep)
        one.wait(step_s)
    one.lights.asleep = True
    one.set(sleep_fade_s=0.5, decay_s=0.1, look='paper')


@pytest.mark.parametrize('limit', ['field_of_view', 'field'])
@pytest.mark.parametrize('attacks', [4, pytest.param(1000, marks=pytest.mark.soak)])
def test_nothing_asked_of_it_breaks_the_limit_and_asleep_it_gets_dark(monkeypatch, attacks, limit):
    areas_sr = np.concatenate([fields(rest_lattice(), eye) for eye in EYES])
    most = []
    for seed in range(attacks):
        one = Attacked(monkeypatch, limit)
        attack(one, np.random.default_rng(seed))
        one.wait(6.0)
        assert one.lights.dark and not one.lights.glows and not one.shown[-1].any(), seed
        for block in range(25):
            one.knock(block)
            one.see(block)
        one.wait(0.1)
        assert not one.shown[-1].any(), seed
        shown = np.array(one.shown)
        if limit == 'field_of_view':
            most.append(most_in_a_second(shown, areas_sr))
        else:
            eyes = shown.mean(axis=1), shown.max(axis=1), *shown.T
            most.append(max(most_flashes_in_a_second(eye, RATE_HZ) for eye in eyes))
        assert most[-1] <= 3, seed
    assert max(most) == 3

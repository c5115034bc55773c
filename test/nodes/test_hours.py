# SPDX-License-Identifier: Apache-2.0
"""The hours node over real DDS: a day of a museum in seconds, and people who want it otherwise."""

import datetime
import json
import zoneinfo

import pytest
from support.spinning import Nodes, states_of

from eol_ros.errors import ConfigError
from eol_ros.nodes.hours import HoursNode
from eol_ros.nodes.montage import MontageNode
from eol_ros.ros.node import EolNode
from eol_ros.scene import Scene
from eol_ros.settings import HoursSettings, MontageSettings, MotionSettings
from eol_ros.streams.requests import Asked

HOURS = HoursSettings('Europe/Vienna', ('Tue-Sun 10:00-18:00', '2026-12-24 closed'))


class Around(EolNode):
    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.walls, self.asked, self.results = [], [], []
        self.subscribe('wall', self.walls.append)
        self.subscribe('requests', lambda m: self.asked.append((m.source, m.kind, m.node)))
        self.subscribe('request_results', self.results.append)
        self.states = states_of(self, 'hours')


class Rig(Nodes):
    def __init__(self, when):
        super().__init__()
        self.set(when)
        self.scene = Scene('test', {'montage': MontageSettings(), 'hours': HOURS})
        self.around, self.hours = self.add(Around()), self.new_hours()
        self.meet()

    def set(self, when):
        zone = zoneinfo.ZoneInfo('Europe/Vienna')
        self.now_s = datetime.datetime.fromisoformat(when).replace(tzinfo=zone).timestamp()

    def new_hours(self):
        return self.add(HoursNode(HOURS, clock=lambda: self.now_s, scene=self.scene))

    def start_montage(self):
        self.montage = self.add(MontageNode(MontageSettings(), scene=self.scene))
        self.meet()

    def until_text(self, text):
        self.until(lambda: self.hours.health.text == text)

    @property
    def black(self):
        return bool(self.around.walls) and not self.around.walls[-1].left


@pytest.fixture
def rig(ros):
    with Rig('2026-11-27 17:59:59') as made:
        yield made


def test_a_day_ends_and_the_next_begins(rig, monkeypatch):
    rig.start_montage()
    rig.until_text('open until Fri 18:00')
    rig.until(lambda: not rig.hours.waits)
    rig.set('2026-11-27 18:00:00')
    rig.until(lambda: rig.black)
    rig.until(lambda: rig.hours.kind == '')
    assert rig.hours.health.text == 'asleep until Sat 10:00'
    assert [kind for source, kind, _ in rig.around.asked if source == 'hours'][-1] == 'sleep'

    rig.around.requests.ask(Asked('wake'))  # somebody cleans
    rig.until(lambda: not rig.black)
    rig.until_text('closed until Sat 10:00, woken by hand')
    rig.until(lambda: any(result.node == 'hours' for result in rig.around.results))
    words = [result.reason for result in rig.around.results if result.node == 'hours']
    assert words == ['closed until Sat 10:00, woken by hand']

    count = len(rig.around.asked)  # the node dies, and comes back as bringup starts it
    monkeypatch.setenv('EOL_KEPT', json.dumps({'hours': rig.hours.health.kept}))
    rig.end(rig.hours)
    rig.hours = rig.new_hours()
    rig.meet()
    told = len(rig.around.states)
    rig.until(lambda: len(rig.around.states) > told + 2)
    assert rig.hours.health.text == 'closed until Sat 10:00, woken by hand'
    assert len(rig.around.asked) == count and not rig.black

    rig.set('2026-11-28 18:00:00')
    rig.until(lambda: rig.black)


def test_who_starts_late_is_asked_again(rig):
    rig.set('2026-11-27 22:00:00')
    rig.until_text('asleep until Sat 10:00')
    rig.until(lambda: ('hours', 'sleep', 'montage') in rig.around.asked)
    assert rig.hours.waits == {'montage'}
    rig.start_montage()
    rig.until(lambda: rig.black and not rig.hours.waits)


def test_a_clock_that_was_never_set_is_told(rig):
    rig.now_s = 180.0
    rig.until(
        lambda: (
            (1, 'the clock says 1970-01-01 00:03: it is not trusted, and the work stays open')
            in rig.around.states
        )
    )


def test_a_zone_that_does_not_exist(ros):
    with pytest.raises(ConfigError, match="'Europe/Wien': no such time zone. Did you mean"):
        HoursNode(HoursSettings('Europe/Wien', HOURS.open))

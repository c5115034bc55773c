# SPDX-License-Identifier: Apache-2.0
"""The hours node over real DDS: a day of a museum in seconds, and people who want it otherwise."""

import dataclasses
import datetime
import json
import zoneinfo

import pytest
from support.spinning import Nodes, states_of

from eol_ros.errors import EolError
from eol_ros.nodes.hours import HoursNode
from eol_ros.nodes.montage import MontageNode
from eol_ros.ros.node import EolNode
from eol_ros.scene import Scene
from eol_ros.settings import (
    GrainsSettings,
    HoursSettings,
    MontageSettings,
    MotionSettings,
    SoundSettings,
)
from eol_ros.streams.requests import KINDS, Asked

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
            (1, 'the clock says 1970-01-01 00:03, which cannot be right: the work stays open')
            in rig.around.states
        )
    )


class Asks(EolNode):
    """Answers what cues ask of it; refuses what `refuses` says."""

    def __init__(self, name, settings, refuses=''):
        self.NAME = name
        super().__init__(settings)
        self.refuses = refuses
        self.done = []
        self.requests.serve(set=self.take, sleep=self.take, wake=self.take)

    def take(self, asked):
        if self.refuses:
            raise EolError(self.refuses)
        if asked.kind != 'wake':  # the doors are open
            self.done.append((asked.kind, asked.values))


class CueRig(Rig):
    def __init__(self, when, cues, times):
        Nodes.__init__(self)
        self.set(when)
        self.settings = HoursSettings('Europe/Vienna', HOURS.open, cues, times)
        kinds = {'grains': GrainsSettings(), 'sound': SoundSettings(), 'hours': self.settings}
        self.scene = Scene('test', kinds)
        self.around, self.hours = self.add(Around()), self.new_hours()

    def new_hours(self):
        return self.add(HoursNode(self.settings, clock=lambda: self.now_s, scene=self.scene))

    def asked(self, source='hours'):
        return [(kind, node) for who, kind, node in self.around.asked if who == source]

    def result(self, kind='cue'):
        found = [(r.accepted, r.reason) for r in self.around.results if r.kind == kind]
        return found[-1] if found else None


@pytest.fixture
def cue_rig(ros):
    made = []

    def make(when, cues, times=()):
        made.append(CueRig(when, cues, times))
        return made[-1]

    yield make
    for rig in made:
        rig.close()


EVENING = ('evening set grains radius=0.2 mode=chain', 'evening set sound gain_db=-12')
DAY = ('day set grains radius=0.05',)
TIMES = ('Tue-Sun 10:00 day', 'Fri 17:00 evening')


def test_a_cue_at_its_time_is_recorded_requests(cue_rig):
    rig = cue_rig('2026-11-27 16:59:59', DAY + EVENING, TIMES)
    grains = rig.add(Asks('grains', GrainsSettings()))
    sound = rig.add(Asks('sound', SoundSettings()))
    rig.until(lambda: len(grains.done) == 1)  # as if it had run since the opening
    assert grains.done == [('set', {'radius': 0.05})]
    rig.until_text('open until Fri 18:00; next cue evening Fri 17:00')
    rig.set('2026-11-27 17:00:00')
    rig.until(lambda: rig.hours.health.text == 'open until Fri 18:00; next cue day Sat 10:00')
    rig.until(lambda: sound.done and len(grains.done) > 1)
    assert grains.done[1:] == [('set', {'radius': 0.2, 'mode': 'chain'})]
    assert sound.done == [('set', {'gain_db': -12.0})]
    rig.until(lambda: not rig.hours.parts and len(rig.around.results) >= 5)
    cues = [(kind, node) for kind, node in rig.asked() if kind in ('cue', 'set')]
    assert cues == [
        ('cue', 'hours'), ('set', 'grains'),
        ('cue', 'hours'), ('set', 'grains'), ('set', 'sound'),
    ]  # fmt: skip
    assert rig.result() == (True, '')
    assert rig.hours.health.values['cues'] == ['day', 'evening']


def test_a_restart_gives_no_cue_again(cue_rig, monkeypatch):
    rig = cue_rig('2026-11-27 17:30:00', EVENING, TIMES[1:])
    grains = rig.add(Asks('grains', GrainsSettings()))
    rig.add(Asks('sound', SoundSettings()))
    rig.until(lambda: rig.result() == (True, ''))
    monkeypatch.setenv('EOL_KEPT', json.dumps({'hours': rig.hours.health.kept}))
    rig.end(rig.hours)
    rig.hours = rig.new_hours()
    rig.until(rig.hours.met)
    rig.until_text('open until Fri 18:00; next cue evening Fri 2026-12-04 17:00')
    assert len(grains.done) == 1


def test_a_cue_by_hand_says_which_request_was_refused(cue_rig):
    rig = cue_rig('2026-11-27 12:00:00', EVENING)
    rig.add(Asks('grains', GrainsSettings()))
    sound = rig.add(Asks('sound', SoundSettings(), refuses='no sound card'))
    rig.meet()
    rig.around.requests.ask(Asked('cue', values={'name': 'evening'}))
    rig.until(lambda: rig.result() is not None)
    why = 'set sound gain_db=-12.0: sound: no sound card'
    assert rig.result() == (False, why)
    rig.until_text(f'open until Fri 18:00; {why}')
    assert rig.hours.health.level == 1

    sound.refuses = ''
    rig.around.requests.ask(Asked('cue', values={'name': 'evening'}))
    rig.until_text('open until Fri 18:00')
    rig.around.requests.ask(Asked('cue', values={'name': 'evning'}))
    why = 'evning: no such cue. Did you mean evening?'
    rig.until(lambda: rig.result() == (False, why))


def test_a_cue_tells_who_does_not_answer(cue_rig, monkeypatch):
    monkeypatch.setattr('eol_ros.nodes.hours.PATIENCE_S', 0.5)
    monkeypatch.setitem(KINDS, 'set', dataclasses.replace(KINDS['set'], within_s=1.0))
    rig = cue_rig('2026-11-27 17:30:00', EVENING, TIMES[1:])
    rig.add(Asks('grains', GrainsSettings()))
    rig.until(lambda: rig.result() is not None)
    assert rig.result() == (False, 'set sound gain_db=-12.0: sound does not answer')


def test_a_cue_can_put_the_work_to_sleep(cue_rig):
    rig = cue_rig('2026-11-27 12:00:00', ('night sleep',))
    sound = rig.add(Asks('sound', SoundSettings()))
    rig.meet()
    rig.around.requests.ask(Asked('cue', values={'name': 'night'}))
    rig.until(lambda: rig.result() == (True, ''))
    assert ('sleep', {}) in sound.done
    rig.until_text('open until Fri 18:00, put to sleep by hand')

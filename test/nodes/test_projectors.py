# SPDX-License-Identifier: Apache-2.0
"""The projectors node over real DDS and real TCP: on, and off when the work has slept a while."""

import pytest
from support.fake_projector import FakeProjector
from support.spinning import Nodes

from eol_ros.errors import ConfigError
from eol_ros.nodes.projectors import ProjectorsNode
from eol_ros.ros.node import EolNode
from eol_ros.scene import Scene
from eol_ros.settings import HoursSettings, MotionSettings, ProjectorsSettings
from eol_ros.streams.requests import Asked


class Around(EolNode):
    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.results = []
        self.subscribe('request_results', self.results.append)


@pytest.fixture
def rig(ros):
    fakes = [FakeProjector('one'), FakeProjector('one')]
    for fake in fakes:
        fake.WARM_S = fake.COOL_S = 0.0

    def start(*others, **settings):
        addresses = tuple(fake.address for fake in fakes)
        settings = ProjectorsSettings(addresses, 'one', poll_s=1.0, **settings)
        scene = Scene('test', {'projectors': settings, **dict(others)})
        made = nodes.add(ProjectorsNode(settings, scene=scene)), nodes.add(Around())
        nodes.meet()
        return made

    with Nodes() as nodes:
        yield start, fakes, nodes.until
    for fake in fakes:
        fake.unplug()


def test_they_follow_sleep_after_a_while_and_wake_at_once(rig):
    start, fakes, turn = rig
    node, around = start(off_after_s=2.0)
    turn(lambda: [fake.power for fake in fakes] == [1, 1])
    turn(lambda: node.health.text.count(' on, lamp 1200 h') == 2)
    assert node.health.level == 0 and node.health.values['lamp_1_h'] == 1200
    around.requests.ask(Asked('sleep'))
    turn(lambda: around.results)
    assert around.results[0].reason.startswith('projectors off in ')
    assert [fake.power for fake in fakes] == [1, 1]
    turn(lambda: [fake.power for fake in fakes] == [0, 0])
    around.requests.ask(Asked('wake'))
    turn(lambda: [fake.power for fake in fakes] == [1, 1])
    assert node.health.kept['asleep'] is False
    fakes[1].password = 'another'
    turn(lambda: 'refuses the password' in node.health.text)
    assert node.health.level == 2 and ' on, lamp' in node.health.text


def test_started_at_night_they_stay_off(rig):
    start, fakes, turn = rig
    node, around = start(('hours', HoursSettings()))
    around.requests.ask(Asked('sleep'))  # as the node `hours` does
    turn(lambda: around.results)
    turn(lambda: node.health.text.count(' off, lamp') == 2)
    assert not any('POWR 1' in fake.log for fake in fakes)


def test_no_projector_and_no_address(ros):
    with pytest.raises(ConfigError, match='no projector is named'):
        ProjectorsNode(ProjectorsSettings())
    with pytest.raises(ConfigError, match="'a b' is not HOST or HOST:PORT"):
        ProjectorsNode(ProjectorsSettings(('a b',)))

# SPDX-License-Identifier: Apache-2.0
"""The offset from the clock of the stamps, in a node on another machine than their source."""

import pytest
from eol_msgs.msg import NodeState

from eol_ros.ros.main_clock import KEEP_S, MainClock
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import parameter_messages
from eol_ros.scene import Machine, Scene
from eol_ros.settings import CameraSettings, SoundSettings

SCENE = Scene(
    'test',
    {'camera': CameraSettings(), 'sound': SoundSettings()},
    network='lan',
    machines={'show': Machine('10.0.0.1', ('camera',)), 'audio': Machine('10.0.0.2', ('sound',))},
)
STAMP_NS = 1_700_000_000_000_000_000


class Probe(EolNode):
    NAME = 'sound'


@pytest.fixture
def made(ros):
    """A node, its steady clock, and how it hears an offset."""
    now, node = [0.0], Probe(SoundSettings(), scene=SCENE)
    node.main_clock = MainClock(node, clock=lambda: now[0])

    def hear(name='machine_audio', **values):
        node.main_clock.take(NodeState(node=name, values=parameter_messages(values)))

    yield node, now, hear
    node.destroy_node()


def test_stamps_are_mapped_by_the_offset_that_the_machine_here_has_measured(made):
    node, _, hear = made
    assert node.wall_ns(STAMP_NS) == STAMP_NS
    hear('machine_show', offset_ms=80.0, offset_error_ms=1.0)
    assert node.wall_ns(STAMP_NS) == STAMP_NS
    hear(offset_ms=-300.0, offset_error_ms=1.0)
    assert node.wall_ns(STAMP_NS) == STAMP_NS - 300_000_000
    assert node.main_clock.report() == '-300.0 ms of clock offset subtracted'
    assert node.health.values['clock_ahead_ms'] == -300.0
    hear(offset_ms=1.5, offset_error_ms=0.5)
    assert node.wall_ns(STAMP_NS) == STAMP_NS + 1_500_000 and node.main_clock.report() == ''
    hear(offset_ms=1.5, offset_error_ms=2.0)  # within its error
    assert node.wall_ns(STAMP_NS) == STAMP_NS


def test_an_offset_that_nobody_tells_any_more_is_dropped(made):
    node, now, hear = made
    hear(offset_ms=300.0, offset_error_ms=1.0)
    now[0] = KEEP_S - 1.0
    hear(scene_digest='d1')  # it is there, but does not hear the main machine
    assert node.main_clock.ahead_ns == 300_000_000
    now[0] = KEEP_S
    assert node.main_clock.ahead_ns == 0 and node.main_clock.report() == ''
    assert node.health.values['clock_ahead_ms'] == 0

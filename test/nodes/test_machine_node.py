# SPDX-License-Identifier: Apache-2.0
"""The node `machine` of the machine audio, which hears of show; walls has never been started."""

from dataclasses import replace
from unittest.mock import Mock

import pytest
from eol_msgs.msg import NodeState
from rclpy.serialization import serialize_message

from eol_ros.errors import EolError
from eol_ros.nodes import machine
from eol_ros.nodes.machine import MachineNode
from eol_ros.ros.requests import parameter_messages
from eol_ros.scene import Machine, Scene
from eol_ros.settings import CameraSettings, MachineSettings, MontageSettings, SoundSettings
from eol_ros.streams.requests import KINDS, Asked
from eol_ros.streams.work_state import ERROR, OK, STARTING, WARN

MS = 1_000_000
SCENE = Scene(
    'test',
    {'camera': CameraSettings(), 'sound': SoundSettings(), 'montage': MontageSettings()},
    network='lan',
    machines={
        'audio': Machine('10.0.0.2', ('sound',)),
        'show': Machine('10.0.0.1', ('camera',)),
        'walls': Machine('10.0.0.3', ('montage',)),
    },
)


@pytest.fixture
def audio(ros, monkeypatch):
    """The node, its clock, what it gives bringup, and how it hears a state of a node."""
    now, rows = [0.0], {}
    node = MachineNode(MachineSettings('audio', 'd1'), clock=lambda: now[0], scene=SCENE)
    monkeypatch.setattr(node.health, 'relay', lambda row: rows.update({row['node']: row}))

    def hear(name, ahead_ms=0.0, level=0, **values):
        """As sent 1 ms before it arrives, by the clock of a machine that this one is ahead of."""
        state = NodeState(node=name, level=level, text='all well')
        state.values = parameter_messages(values)
        sent_ns = 10**18
        node.on_state(
            bytes(serialize_message(state)), sent_ns + round((1 + ahead_ms) * MS), sent_ns, 1
        )

    yield node, now, rows, hear
    node.destroy_node()


def about(node, **others):
    ours = node.health.values
    return {'scene_digest': 'd1', 'version': ours['version'], **others}


def test_who_is_not_heard_is_an_error_by_name(audio):
    node, now, rows, hear = audio
    node.look()
    assert {row['level'] for row in rows.values()} == {STARTING}
    assert set(rows) == {'show/machine', 'show/camera', 'walls/machine', 'walls/montage'}
    for name in ('machine_show', 'camera', 'machine_walls', 'montage'):
        hear(name, **about(node))
    node.look()
    assert (node.health.level, node.health.text) == (OK, '2 other machines heard')
    assert rows['show/camera']['text'] == 'all well'

    now[0] = 3.5
    for name in ('machine_show', 'machine_walls'):
        hear(name, **about(node))
    hear('montage', level=WARN)
    node.look()
    assert node.health.level == ERROR
    assert node.health.text == 'show/camera: not heard for 4 s'
    assert rows['show/camera']['level'] == ERROR and rows['walls/montage']['level'] == WARN

    now[0] = 20.0
    node.look()
    assert node.health.text == 'show: not heard for 16 s; walls: not heard for 16 s'


def test_a_machine_that_never_came_is_an_error_after_the_start(audio):
    node, now, rows, hear = audio
    now[0] = 15.5
    hear('machine_show', **about(node))
    hear('camera')
    node.look()
    assert node.health.text == 'walls: not heard for 16 s'
    assert rows['walls/montage']['level'] == ERROR and rows['show/camera']['level'] == OK


@pytest.mark.parametrize(
    ('other', 'text'),
    [
        ({'scene_digest': 'd2'}, 'show runs another version of the scene file'),
        ({'version': '9'}, 'show runs eol_ros 9, this machine'),
    ],
)
def test_another_scene_or_version_is_an_error_by_name(audio, other, text):
    node, _, _, hear = audio
    hear('machine_show', **about(node, **other))
    node.look()
    assert node.health.level == ERROR and node.health.text.startswith(text)


@pytest.mark.parametrize(('ahead_ms', 'level'), [(0.5, OK), (8.0, WARN), (-300.0, ERROR)])
def test_the_offset_of_its_clock_from_the_main_one(audio, ahead_ms, level):
    node, _, _, hear = audio
    for name in ('machine_walls', 'montage', 'camera'):
        hear(name, **about(node))
    hear('machine_show', ahead_ms, **about(node, from_audio_ms=1 - ahead_ms))
    node.look()
    assert node.health.level == level
    assert node.health.values['offset_ms'] == pytest.approx(ahead_ms)
    assert node.health.values['offset_error_ms'] == pytest.approx(1.0)
    if level != OK:
        assert f'clock is {ahead_ms:.1f} ms ahead of that of show' in node.health.text


def test_only_in_a_closed_network_all_are_restarted_or_stopped(audio, monkeypatch):
    node, *_ = audio
    with pytest.raises(EolError, match='restart needs `network: secure`'):
        node.on_order(Asked('restart'))
    monkeypatch.setattr(node, 'scene', replace(SCENE, network='secure'))
    with pytest.raises(EolError, match='no bringup runs this node'):
        node.on_order(Asked('stop'))
    monkeypatch.setattr(type(node.health), 'supervised', True)
    timers, orders = [], []
    once = Mock()

    def create_timer(*timer):
        timers.append(timer)
        return once

    monkeypatch.setattr(node, 'create_timer', create_timer)
    monkeypatch.setattr(node.health, 'order', orders.append)
    assert node.on_order(Asked('stop')) == 'audio: stop in 6 s'
    assert not orders  # the others answer first
    assert node.answers_as == 'machine_audio'
    timers[0][1]()
    assert orders == ['stop']
    once.cancel.assert_called_once_with()
    assert KINDS['stop'].within_s < machine.ORDER_S  # the node that serves the call ends last


def test_no_offset_is_told_while_the_main_machine_is_silent(audio):
    node, now, _, hear = audio
    hear('machine_show', 300.0, **about(node, from_audio_ms=-299.0))
    node.look()
    assert node.health.values['offset_ms'] == pytest.approx(300.0)
    now[0] = 3.5
    node.look()
    assert 'offset_ms' not in node.health.values
    hear('machine_show', 2.0, **about(node, from_audio_ms=-1.0))
    node.look()
    assert 'offset_ms' in node.health.values

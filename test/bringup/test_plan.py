# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from eol_ros import scene as scenes
from eol_ros.bringup import plan
from eol_ros.errors import UsageError


def names(scene):
    return [process.name for process in plan.processes(scene, Path('s.yaml'))]


def test_only_the_nodes_of_the_scene_are_started():
    assert names(scenes.load('lights')) == ['recorder', 'camera', 'tracker', 'motion+leds']


def test_the_recorder_begins_first():
    assert names(scenes.load('rehearsal'))[:3] == ['recorder', 'twin', 'tracker']


def test_grouped_nodes_share_a_process(tmp_path):
    path = tmp_path / 's.yaml'
    path.write_text('nodes: {twin: {}, tracker: {}, motion: {}}\ntogether: [[motion, tracker]]')

    assert names(scenes.load(path)) == ['recorder', 'twin', 'motion+tracker']


def test_what_hurries_and_what_waits(tmp_path):
    found = {p.name: p for p in plan.processes(scenes.load('rehearsal'), Path('s.yaml'))}

    hurry = {name for name, process in found.items() if process.real_time}
    assert hurry == {'tracker', 'motion', 'leds', 'grains', 'sound'}
    assert {name for name, process in found.items() if process.nice} == {
        'recorder', 'panel', 'montage'
    }

    path = tmp_path / 's.yaml'
    path.write_text('nodes: {twin: {}, tracker: {}}\nreal_time: false')
    assert not any(p.real_time for p in plan.processes(scenes.load(path), path))


def test_only_names_that_the_scene_has():
    scene = scenes.load('museum')

    assert list(plan.only(scene, ['tracker', 'camera']).nodes) == ['camera', 'tracker']
    assert list(plan.only(scene, ['tracker', 'recorder']).nodes) == ['tracker', 'recorder']
    with pytest.raises(UsageError, match='Did you mean tracker'):
        plan.only(scene, ['trakcer'])


def test_big_shared_memory_only_where_images_are_given():
    big = {
        process.name
        for process in plan.processes(scenes.load('rehearsal'), Path('s.yaml'))
        if 'images' in process.environment['FASTRTPS_DEFAULT_PROFILES_FILE']
    }

    assert big == {'twin'}


def test_domain(monkeypatch):
    scene = scenes.load('lights')
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')

    assert plan.domain(scene) == 7

    monkeypatch.setenv('ROS_DOMAIN_ID', 'seven')
    with pytest.raises(UsageError, match='seven'):
        plan.domain(scene)

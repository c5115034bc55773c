# SPDX-License-Identifier: Apache-2.0
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from eol_ros import scene as scenes
from eol_ros.bringup import plan, playback, status
from eol_ros.bringup import run as bringup
from eol_ros.bringup.ros_args import read
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import ConfigError, DeviceMissing, UsageError
from eol_ros.ros import wireguard


def names(scene):
    return [process.name for process in plan.processes(scene, Path('s.yaml'))]


def test_only_the_nodes_of_the_scene_are_started():
    """The recorder begins first; grouped nodes share a process."""
    assert names(scenes.load('lights')) == ['recorder', 'camera', 'tracker', 'motion+leds']


def test_what_hurries_and_what_waits():
    found = {p.name: p for p in plan.processes(scenes.load('museum'), Path('s.yaml'))}

    hurry = {name for name, process in found.items() if process.real_time}
    assert hurry == {'camera', 'tracker', 'motion', 'leds', 'grains', 'sound'}
    assert {name for name, process in found.items() if process.nice} == {
        'recorder',
        'panel',
        'montage',
    }

    for name in set(scenes.shipped()) - {'museum', 'instrument'}:
        assert not any(p.real_time for p in plan.processes(scenes.load(name), Path('s.yaml')))


def test_only_names_that_the_scene_has():
    scene = scenes.load('museum')

    assert list(plan.only(scene, ['tracker', 'camera']).nodes) == ['camera', 'tracker']
    assert list(plan.only(scene, ['tracker', 'recorder']).nodes) == ['tracker', 'recorder']
    with pytest.raises(UsageError, match='Did you mean tracker'):
        plan.only(scene, ['trakcer'])


def test_a_machine_runs_its_nodes_and_tells_them_of_all(tmp_path, monkeypatch):
    path = tmp_path / 's.yaml'
    path.write_text(
        'network: lan\nnodes: {twin: {}, tracker: {}, sound: {}, grains: {}, recorder: off}\n'
        'machines:\n  show: {address: 10.0.0.1, nodes: [twin, tracker, grains]}\n'
        '  audio: {address: 10.0.0.2, nodes: [sound]}\n'
    )
    scene = scenes.load(path)
    monkeypatch.setattr(plan.network, 'addresses', lambda: {'127.0.0.1', '10.0.0.2'})
    by_address, by_name = plan.on_machine(scene, None), plan.on_machine(scene, 'audio')
    assert by_address == by_name and set(by_name.nodes) == set(scene.nodes)
    mine = plan.only(by_name, (*by_name.machines['audio'].nodes, 'machine'))
    sound, machine = plan.processes(mine, path)
    for process in (sound, machine):  # what a cable loses is soon sent again
        assert '-asks.xml' in process.environment['FASTRTPS_DEFAULT_PROFILES_FILE']
    assert sound.nodes == ('sound',)
    assert machine.command[-2:] == ('-r', 'machine:__node:=machine_audio')
    assert by_name.nodes['machine'].name == 'audio'
    there = plan.on_machine(scene, 'show').nodes['machine']
    assert there.digest == by_name.nodes['machine'].digest  # one file

    path.write_text(path.read_text() + '# changed\n')
    changed = plan.on_machine(scenes.load(path), 'show').nodes['machine']
    assert changed.digest != there.digest
    with pytest.raises(UsageError, match='--machine adio: no such machine in scene s: show'):
        plan.on_machine(scene, 'adio')
    monkeypatch.setattr(plan.network, 'addresses', lambda: {'127.0.0.1'})
    with pytest.raises(UsageError, match='no address of this machine is in scene s'):
        plan.on_machine(scene, None)
    with pytest.raises(UsageError, match='scene museum names no machines'):
        plan.on_machine(scenes.load('museum'), 'audio')


def test_in_a_closed_network_the_keys_lead_to_all_machines(tmp_path, monkeypatch):
    path = tmp_path / 's.yaml'
    path.write_text(
        'network: secure\nnodes: {twin: {}, tracker: {}, sound: {}, grains: {}, recorder: off}\n'
        'machines:\n  show: {address: 10.77.0.1, nodes: [twin, tracker, grains]}\n'
        '  audio: {address: 10.77.0.2, nodes: [sound]}\n'
    )
    scene = scenes.load(path)
    peer, keys = wireguard.Peer('show', '10.77.0.1', 'k'), wireguard.Keys
    monkeypatch.setattr(
        wireguard, 'read', lambda: keys(Path('k'), '10.77.0.2', '10.77.0.0/24', (peer,))
    )
    assert plan.on_machine(scene, 'audio').nodes['machine'].name == 'audio'
    with pytest.raises(ConfigError, match='k: the address is 10.77.0.2, that of machine show in'):
        plan.on_machine(scene, 'show')
    monkeypatch.setattr(wireguard, 'read', lambda: keys(Path('k'), '10.77.0.2', '10.77.0.0/24', ()))
    with pytest.raises(ConfigError, match='k: no peer has the address 10.77.0.1 of machine show'):
        plan.on_machine(scene, 'audio')


def test_own_programs_run_on_the_main_machine_in_the_folder_of_the_scene(tmp_path):
    path, mine = tmp_path / 's.yaml', tmp_path / 'mine'
    path.write_text(
        'network: lan\ndomain: 7\n'
        'nodes: {twin: {}, tracker: {}, grains: {}, sound: {}, recorder: off}\n'
        'machines:\n  audio: {address: 10.0.0.2, nodes: [sound]}\n'
        '  show: {address: 10.0.0.1, nodes: [twin, tracker, grains]}\n'
        'programs: {counter: [python, count.py, --fast], mine: [./mine]}\n'
    )
    mine.write_text('#!/bin/sh\n')
    mine.chmod(0o755)
    scene = scenes.load(path)
    parts = [plan.own_part(plan.on_machine(scene, name)) for name in ('show', 'audio')]
    counter, own = plan.processes(parts[0], path)[-2:]
    assert counter.command == (sys.executable, 'count.py', '--fast')
    assert own.command == (str(mine),)
    assert counter.own and counter.folder == tmp_path
    assert counter.environment['ROS_DOMAIN_ID'] == '7'
    assert not any(p.own for p in plan.processes(parts[1], path))
    assert not plan.only(scene, ['twin']).programs
    above = tmp_path / 'above' / 'a.yaml'
    above.parent.mkdir()
    above.write_text('include: ../s.yaml\nprograms: {counter: off}\n')
    (kept,) = [p for p in plan.processes(scenes.load(above), above) if p.own]
    assert (kept.name, kept.folder, kept.command) == ('mine', tmp_path, (str(mine),))
    mine.unlink()  # it may come later, as from a stick: only `eol check` refuses it
    assert plan.processes(parts[0], path)[-1].command == ('./mine',)


def test_big_shared_memory_only_where_images_are_given():
    big = {
        process.name
        for process in plan.processes(scenes.load('rehearsal'), Path('s.yaml'))
        if 'images' in process.environment['FASTRTPS_DEFAULT_PROFILES_FILE']
    }

    assert big == {'twin'}


@pytest.mark.parametrize('rule', [('-r', '__ns:=/north'), ('--remap', '__ns:=north')])
def test_the_remapping_rule_of_ros_names_the_namespace(rule):
    scene = scenes.load('lights')
    assert scene.namespace == 'eol'
    assert read(scene, ('-r', '__ns:=/south', '--', *rule)).scene.namespace == 'north'
    assert read(scene, ()).scene == scene


PARAMETERS = """
/**: {ros__parameters: {radius: 0.07, seed: 5, mine: 1, nested: {deep: [1, 2]}}}
/north/*: {ros__parameters: {blink_period_s: 3}}
grains: {ros__parameters: {radius: 0.08}}
north: {motion: {ros__parameters: {qos_overrides: {/north/slips: {publisher: {depth: 9}}}}}}
usb_cam: {ros__parameters: {framerate: 30.0}}
/eol/sound: {ros__parameters: {gain_db: -9.0}}
"""


def test_parameters_become_settings_of_the_scene_or_reach_the_nodes(tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text(PARAMETERS)
    words = '--params-file', str(path), '-r', '__ns:=/north', '-p', 'tracker:preview_hz:=5'
    others = '-r', 'slips:=slip_events', '-p', 'use_sim_time:=true', '--log-level', 'debug'
    base = scenes.load('rehearsal')
    given = read(base, (*words, *others))
    nodes = given.scene.nodes
    assert (nodes['grains'].radius, nodes['tracker'].blink_period_s) == (0.08, 3.0)
    assert (nodes['tracker'].preview_hz, nodes['sound']) == (5.0, base.nodes['sound'])
    assert nodes['twin'].seed == 5
    for process in plan.processes(given.scene, Path('s.yaml'), ros_args=given):
        said = process.command[process.command.index('--ros-args') :]
        assert said[1:5] == ('-r', 'slips:=slip_events', '--log-level', 'debug')
        assert 'use_sim_time:=true' in said and 'mine:=1' in said
        assert 'nested.deep:=[1, 2]' in said
        depth = 'qos_overrides./north/slips.publisher.depth:=9' in said
        assert depth == ('motion' in process.nodes)
        assert not any('radius' in word or 'framerate' in word for word in said)


@pytest.mark.parametrize(
    ('words', 'why'),
    [
        (('-r',), '-r: a value must follow'),
        (('__ns:=/a',), 'expected -r RULE'),
        (('-r', '__ns:=/2nd'), '2nd. is not a namespace'),
        (('-r', '__node:=a'), 'nodes of a scene keep their names'),
        (('-r', 'slips'), 'not a rule'),
        (('-p', 'radius=3'), 'NAME:=VALUE'),
        (('-p', 'a:=[1'), 'not YAML'),
        (('-p', 'grans:radius:=3'), 'no node grans'),
        (('--params-file', 'absent.yaml'), 'no such file'),
    ],
)
def test_arguments_that_ros_has_not_are_refused(words, why):
    with pytest.raises(UsageError, match=f'^--ros-args .*{why}'):
        read(scenes.load('lights'), words)


def test_values_that_cannot_be_are_refused(tmp_path):
    with pytest.raises(ConfigError, match='^--ros-args: twin: fps: 1000 is out of range'):
        read(scenes.load('rehearsal'), ('-p', 'twin:fps:=1000'))
    path = tmp_path / 'p.yaml'
    for text, why in (('a: [', 'cannot be read'), ('a: {b: 1}', 'no parameters; NODE')):
        path.write_text(text)
        with pytest.raises(ConfigError, match=why):
            read(scenes.load('rehearsal'), ('--params-file', str(path)))


def test_two_replays_on_a_domain_keep_their_times_apart():
    scene = replace(scenes.load('playback'), namespace='north')
    for process in plan.processes(scene, Path('s.yaml'), sim_time=True):
        assert process.command[-2:] == ('-r', '/clock:=/north/clock')
    for process in plan.processes(scenes.load('playback'), Path('s.yaml'), sim_time=True):
        assert not any('clock' in word for word in process.command)


def test_the_namespace_of_the_only_graph_here_is_meant(monkeypatch):
    domain = 5000 + os.getpid() * 10
    assert status.namespaces(domain) == []
    assert status.namespace_of(None, domain) == 'eol'
    with status.listen(domain, 'museum/north'):
        assert status.namespaces(domain) == ['museum/north']
        assert status.namespace_of(None, domain) == 'museum/north'
        assert status.namespace_of('/south', domain) == 'south'
        with pytest.raises(UsageError, match="^--namespace '2nd' is not a namespace"):
            status.namespace_of('2nd', domain)
        with pytest.raises(DeviceMissing, match=f'domain {domain}: --namespace museum/north'):
            status.ask(domain)
        with status.listen(domain, 'south'):
            with pytest.raises(UsageError, match='--namespace museum/north or south'):
                status.namespace_of(None, domain)
            with status.listen(domain):
                assert status.namespace_of(None, domain) == 'eol'
    assert status.namespaces(domain) == []


def test_domain(monkeypatch):
    scene = scenes.load('lights')
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')

    assert plan.domain(scene) == 7

    for wrong in ('seven', '-1', '300', '²'):
        monkeypatch.setenv('ROS_DOMAIN_ID', wrong)
        with pytest.raises(UsageError, match=f"ROS_DOMAIN_ID is '{wrong}', not a whole number"):
            plan.domain(scene)


def bag_of(folder, settings='', **counts):
    """Write a bag with so many images and blocks, of a run with `settings` as YAML."""
    names = {'images': '/eol/camera/image_raw', 'blocks': '/eol/blocks'}
    types = {'images': 'sensor_msgs/msg/Image', 'blocks': 'eol_msgs/msg/Blocks'}
    writer = BagWriter(
        folder,
        [BagTopic(name, types[kind], '', '') for kind, name in names.items()],
        {'settings': settings},
    )
    for kind, count in counts.items():
        for k in range(count):
            writer.write(names[kind], bytes(12), 10**18 + k, 10**18 + k)
    writer.close()


def scene_with(folder, replay):
    path = folder / 's.yaml'
    others = 'tracker: {}, motion: {}, leds: {}, grains: {}'
    path.write_text(f'nodes: {{replay: {{{replay}}}, {others}}}')
    return scenes.load(path)


@pytest.mark.parametrize(
    ('images', 'replay', 'tracker'),
    [
        (100, '', True),
        (60, '', False),
        (0, '', False),
        (60, ', topics: [camera/image_raw]', True),
    ],
)
def test_a_tracker_runs_behind_a_replay_only_where_there_are_all_images(
    tmp_path, images, replay, tracker
):
    bag_of(tmp_path / 'bags' / 'run', images=images, blocks=100)
    scene, notes = playback.settle(scene_with(tmp_path, f'bag: bags{replay}'))

    assert ('tracker' in scene.nodes) is tracker and {'motion', 'leds'} < set(scene.nodes)
    assert scene.nodes['replay'].bag == str(tmp_path / 'bags' / 'run')
    assert len(notes) == (not tracker)
    assert tracker or 'not all images of its run: its blocks are played' in notes[0]


def test_settings_that_make_another_run_of_it_are_told(tmp_path):
    was = (
        'nodes: {tracker: {blink_period_s: 3.0, preview_hz: 5.0, know_covers: false}, leds: off,'
        ' motion: {stop_s: 0.1}, grains: {match: [], weights: []}}'  # as a bag has lists
    )
    bag_of(tmp_path / 'bags' / 'run', was, images=9, blocks=9)
    _, notes = playback.settle(scene_with(tmp_path, 'bag: bags'))

    assert notes == ['tracker.blink_period_s is 2.0 here and was 3.0 in the run: it will differ']


@pytest.mark.parametrize(
    ('table', 'rows'), [('{rows: 3, columns: 6}', 3), ('{}', 5), ('{rows: 3.5}', 0)]
)
def test_a_replay_is_of_the_table_of_its_bag(tmp_path, table, rows):
    bag_of(tmp_path / 'bags' / 'run', f'nodes: {{}}\ntable: {table}', images=9, blocks=9)
    scene = scene_with(tmp_path, 'bag: bags')
    if not rows:
        with pytest.raises(ConfigError, match='rows: 3.5 is not a whole number'):
            playback.settle(scene)
        return
    scene, notes = playback.settle(scene)
    assert scene.table.rows == rows
    assert len(notes) == (rows == 3) and all('3 x 6 places' in note for note in notes)


def test_a_replay_without_its_bag_does_not_start(tmp_path):
    (tmp_path / 'bags').mkdir()
    scene = scene_with(tmp_path, 'bag: bags')
    (tmp_path / 'bags').rmdir()
    with pytest.raises(DeviceMissing, match='no such bag'):
        playback.settle(scene)


def test_nodes_behind_a_replay_follow_its_time():
    scene = scenes.load('playback')
    commands = {p.name: p.command for p in plan.processes(scene, Path('s.yaml'), sim_time=True)}

    following = {name for name, words in commands.items() if 'use_sim_time:=true' in words}
    assert following == set(commands) - {'replay'}
    assert not any('use_sim_time:=true' in p.command for p in plan.processes(scene, Path('s.yaml')))


def test_an_inherited_scene_has_its_name_and_is_open_to_every_process(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bags').mkdir()  # a name in the scene means this only to the node that makes it
    scene = scenes.load('rehearsal')
    with bringup._scene_file(scene) as file:
        path = scenes.inherited(file.fileno())
        read = scenes.load(path)
        found = plan.processes(scene, path, inherit=(file.fileno(),))

    assert scenes.plain(read) == scenes.plain(scene)
    assert read.text.startswith('# rehearsal.yaml\n')
    assert {process.files for process in found} == {(int(path.name),)}


@pytest.mark.parametrize('name', ['twin', 'tracker', 'motion', 'leds', 'montage', 'panel', 'sound'])
def test_any_part_of_a_scene_can_be_read_again_by_its_nodes(tmp_path, name):
    """What `--only` cuts out needs publishers that run elsewhere."""
    part = plan.only(scenes.load('rehearsal'), [name])
    file = tmp_path / 'part.yaml'
    file.write_text(yaml.safe_dump(scenes.plain(part)))
    again = scenes.load(file)
    assert (list(again.nodes), set(again.elsewhere)) == ([name], set(part.elsewhere))
    assert name not in again.elsewhere and 'recorder' in again.elsewhere

# SPDX-License-Identifier: Apache-2.0
"""One table run by three machines: network namespaces on one cable, each with its own bringup."""

import contextlib
import functools
import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from eol_msgs.msg import Slip
from support import needs
from support.fake_clock import FakeClock
from support.machines import Machines, answer, ip
from support.running import busy
from support.waiting import wait_until

from eol_ros.analysis.bag import open_bag
from eol_ros.analysis.retrack import DIFFERENT, retrack
from eol_ros.nodes.machine import SILENT_S
from eol_ros.nodes.sound import OLD_S

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
SCENE = """
network: lan
nodes:
  twin: {{fps: 20}}
  tracker:
  motion:
  grains:
  sound: {{device: wav, wav: {folder}/out.wav, latency_s: 1.0}}
  montage:
  panel: {{port: 0}}
  recorder: {{folder: {folder}/bags}}
machines:
  show: {{address: {net}.1, nodes: [twin, tracker, motion, grains, recorder]}}
  audio: {{address: {net}.2, nodes: [sound]}}
  walls: {{address: {net}.3, nodes: [montage, panel]}}
"""
# Stock rclpy: calls a service and prints what it answers.
CALL = """
import sys
from eol_ros.ros import network
network.configure('secure')
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node('caller')
client = node.create_client(Trigger, f'/eol/{sys.argv[1]}')
assert client.wait_for_service(20)
called = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, called, timeout_sec=90)
assert called.result().success, called.result().message
print(called.result().message, end='')
"""


@pytest.fixture(scope='module')
def machines(tmp_path_factory):
    """Three machines, each with a state folder of its own; `audio` has its own ice recording."""
    needs.system('iproute2')
    # else the first of them compiles for minutes while the others wait for it
    subprocess.run([sys.executable, '-m', 'eol_ros', 'compile'], check=True)
    with Machines('show', 'audio', 'walls') as found:
        for name in found.names:
            found.variables[name] = {'EOL_STATE': str(tmp_path_factory.mktemp(name))}
        found.own_cache('audio', 'ice', tmp_path_factory.mktemp('audio') / 'cache')
        yield found


@contextlib.contextmanager
def running(machines, scene, *names):
    """Run the scene on these machines; yield what returns the rows of one by node."""
    ups = [
        machines.run(name, sys.executable, '-m', 'eol_ros.bringup', str(scene)) for name in names
    ]

    try:
        yield machines.status
    finally:
        for up in ups:
            up.send_signal(signal.SIGINT)
        for name, up in zip(names, ups, strict=True):
            _, said = up.communicate(timeout=60)
            print(f'--- {name}\n{said}')


def test_each_machine_lists_all_of_them_and_names_one_that_is_pulled(machines, tmp_path):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(SCENE.format(folder=tmp_path, net=machines.net))
    with running(machines, scene, *machines.names) as rows:
        wait_until(lambda: _well(rows('show'), 11), 120)
        wait_until(lambda: _well(rows('audio'), 11) and _well(rows('walls'), 11), 60)
        found = rows('show')
        assert set(found) == {
            'twin', 'tracker', 'motion', 'grains', 'recorder', 'machine', 'audio/sound',
            'audio/machine', 'walls/montage', 'walls/panel', 'walls/machine',
        }  # fmt: skip
        assert found['machine']['text'] == '2 other machines heard'
        wait_until(lambda: rows('audio')['sound']['rate'] > 0, 60)  # triggers cross the cable
        values = rows('audio')['machine']['values']
        assert abs(values['offset_ms']) < 2 + values['offset_error_ms']  # one clock for all here

        port = ('-n', machines.names['show'], 'link', 'set', machines.port('audio'))
        pulled_s = time.time()
        ip(*port, 'down')
        lost = 'audio: not heard for '
        for name in ('show', 'walls'):
            wait_until(lambda name=name: rows(name)['audio/sound']['level'] == 2, 60)
            wait_until(lambda name=name: rows(name)['machine']['text'].startswith(lost), 60)
            assert 'walls' not in rows(name)['machine']['text']
        for name in ('show', 'walls'):
            others = f'{name}: not heard for '
            wait_until(lambda others=others: others in rows('audio')['machine']['text'], 60)
        time.sleep(max(0.0, pulled_s + 12 - time.time()))
        back_s = time.time()
        ip(*port, 'up')
        for name in machines.names:
            wait_until(lambda name=name: _well(rows(name), 11), 60)
    bag = open_bag(tmp_path / 'bags')
    states = bag.table('node_states')
    at_s = states['stamp'].astype('i8') * 1e-9
    for name in ('show', 'walls'):  # its nodes are heard once a second, and looked at as often
        tells = (states['node'] == f'machine_{name}') & np.char.startswith(states['text'], lost)
        assert pulled_s < at_s[tells].min() < pulled_s + SILENT_S + 2
    meter = bag.table('sound_meter')
    meter_s = meter['stamp'].astype('i8') * 1e-9
    print('meter after the cable is back, s:', meter_s[meter_s > back_s][:3] - back_s)
    before, after = meter[meter_s < pulled_s][-1], meter[meter_s > back_s][:3]
    assert before['late'] <= 0.01 * before['triggers']
    assert meter_s[meter_s > back_s][0] < back_s + 3  # of which the recorder's thinning is 1 s
    stamp_s = bag.table('grain_triggers')['stamp'].astype('i8') * 1e-9
    away = (stamp_s > pulled_s + 1) & (stamp_s < back_s - OLD_S - 1)
    asked = stamp_s > meter_s[meter_s < pulled_s][-1] - 1
    asked &= stamp_s < meter_s[meter_s > back_s][0]
    took = after['triggers'][0] - before['triggers']
    assert took <= (asked & ~away).sum(), 'a grain of the 12 s without cable sounded'
    for topic, number in (('blocks', 'image'), ('grain_triggers', 'sequence')):
        assert set(np.diff(bag.table(topic)[number].astype(int))) == {1}
    assert set(json.loads(bag.gaps['lost_before_recorder'])) <= {'/eol/sound_meter'}
    assert bag.gaps['dropped_in_recorder'] == '{}'


def test_a_clock_that_is_ahead_is_subtracted_and_killed_machines_come_back(
    machines, tmp_path, monkeypatch
):
    clock = FakeClock(tmp_path, 300_000_000)
    variables = machines.variables['audio'] | clock.environment
    monkeypatch.setitem(machines.variables, 'audio', variables)
    scene = tmp_path / 'scene.yaml'
    scene.write_text(SCENE.format(folder=tmp_path, net=machines.net))
    with contextlib.ExitStack() as stack:
        rows = stack.enter_context(running(machines, scene, *machines.names))
        wait_until(lambda: rows('audio').get('sound', {}).get('rate', 0) > 0, 120)
        wait_until(lambda: 'clock_ahead_ms' in rows('audio')['sound']['values'], 60)
        wait_until(lambda: rows('audio')['sound']['values']['clock_ahead_ms'] > 200, 60)
        found = rows('audio')
        values, error_ms = found['sound']['values'], found['machine']['values']['offset_error_ms']
        assert abs(values['clock_ahead_ms'] - 300) < 2 + error_ms
        assert ' ms of clock offset subtracted' in found['sound']['text']
        assert found['machine']['level'] == 2
        assert "this machine's clock is " in found['machine']['text']

        def named(lost):
            return all(
                f'{one}: not heard for ' in rows(name)['machine']['text']
                for one in lost
                for name in set(machines.names) - lost
            )

        def heard():
            """Return whether all nodes work; ignore what `machine` says of the clock of audio."""
            seen = [rows(name) for name in machines.names]
            return all(
                len(found) == 11
                and 'not heard' not in found['machine']['text']
                and all(row['level'] < 2 for name, row in found.items() if 'machine' not in name)
                for found in seen
            )

        def triggers():
            return rows('audio')['sound']['values'].get('triggers', 0)

        wait_until(heard, 120)
        for lost in ({'show'}, {'audio', 'walls'}):
            for name in lost:
                machines.kill(name)
            wait_until(functools.partial(named, lost), 60)
            stack.enter_context(running(machines, scene, *lost))
            wait_until(heard, 120)
            before = triggers()
            wait_until(lambda before=before: triggers() > before + 20, 60)


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_a_bag_of_ten_minutes_at_load_8_lacks_no_event(machines, tmp_path):
    """Or it names them. Slips, cascades and triggers are recomputed from its blocks."""
    scene = tmp_path / 'scene.yaml'
    text = SCENE.format(folder=tmp_path, net=machines.net)
    scene.write_text(text.replace(', recorder]', ']').replace('[sound]', '[sound, recorder]'))
    done = 0
    with running(machines, scene, *machines.names) as rows:
        wait_until(lambda: _well(rows('audio'), 11), 120)
        with busy(8):
            end_s = time.monotonic() + 600
            while time.monotonic() < end_s:
                words = 'param', 'set', 'sound', 'gain_db', f'{-done % 10}', '--lan'
                call = machines.run('walls', sys.executable, '-m', 'eol_ros', *words)
                call.communicate()
                done += call.returncode == 0
                time.sleep(5)
    bag = open_bag(tmp_path / 'bags')
    proof = retrack(bag)
    for check in proof.topics.values():
        print(check.topic, check.recorded, check.words())
    print(f'{bag.duration_s:.0f} s, {done} requests answered', bag.gaps, proof.holes)
    assert {'slips', 'cascades', 'grain_triggers'} <= set(proof.topics)
    assert proof.verdict != DIFFERENT and bag.gaps['dropped_in_recorder'] == '{}'
    named = json.loads(bag.gaps['lost_before_recorder'])
    slips = bag.table('slips')
    slips = slips[slips['kind'] == Slip.KIND_START]
    # slips of one image are published in the order of their onsets
    starts = slips['slip'][np.lexsort((slips['slip'], slips['stamp']))].astype(int)
    numbers = {
        'blocks': bag.table('blocks')['image'].astype(int),
        'grain_triggers': bag.table('grain_triggers')['sequence'].astype(int),
        'slips': starts,
    }
    for topic, found in numbers.items():
        steps = np.diff(found)
        assert len(found) > 100 and (steps != 0).all()
        # what is lost where a node begins to count again, or of the ends of slips, has no number
        assert (steps[steps > 1] - 1).sum() <= named.pop(f'/eol/{topic}', 0)
    assert '/eol/cascades' not in named
    answered = set(bag.table('request_results')['id'])
    alone = answered - set(bag.table('requests')['id'])
    assert len(alone) == named.pop('/eol/requests', 0) and len(answered) >= done > 10


def test_a_bad_cable_loses_no_message_and_grains_are_late_until_the_latency_may_rise(
    machines, tmp_path
):
    """20 ms each way, and 1 % of the packets lost."""
    scene = tmp_path / 'scene.yaml'
    text = SCENE.format(folder=tmp_path, net=machines.net).replace('1.0}', '0.025}')
    scene.write_text(text.replace(', recorder]', ']').replace('[sound]', '[sound, recorder]'))
    with (
        machines.slow('audio', 20, tmp_path),
        machines.losing(1) as lost,
        running(machines, scene, *machines.names) as rows,
    ):
        seen = []

        def sound():
            row = rows('audio').get('sound', {'text': '', 'values': {}})
            seen.append([row['values'].get(name, 0) for name in ('triggers', 'late')])
            return row

        def in_time():
            """Whether 1 % of the last 200 grains or more are late, at most."""
            sound()
            return any(
                new - old >= 200 and late - before <= 0.01 * (new - old)
                for (old, before), (new, late) in zip(seen, seen[-1:] * len(seen), strict=True)
            )

        wait_until(lambda: 'latency_s of ' in sound()['text'], 120)
        triggers, late = seen[-1]
        assert late > triggers / 2
        machines.eol('show', 'param', 'set', 'sound', 'latency_max_s', '1', '--lan')
        seen.clear()
        wait_until(in_time, 120)
        wait_until(lambda: 'latency_s of ' not in sound()['text'], 60)
        assert lost() > 20
    bag = open_bag(tmp_path / 'bags')
    assert bag.count('grain_triggers') > 300
    for topic, number in (('blocks', 'image'), ('grain_triggers', 'sequence')):
        assert set(np.diff(bag.table(topic)[number].astype(int))) == {1}
    # a command may ask before it discovers the recorder: discovery loses packets, too
    named = json.loads(bag.gaps['lost_before_recorder'])
    alone = set(bag.table('request_results')['id']) - set(bag.table('requests')['id'])
    assert named.pop('/eol/requests', 0) == len(alone) and not named
    assert bag.gaps['dropped_in_recorder'] == '{}'
    asked = bag.table('requests')
    raised = [
        value['value']['double_value']
        for values in asked['values'][asked['node'] == 'sound']
        for value in values
        if value['name'] == 'latency_s'
    ]
    assert raised and 0.04 < raised[-1] <= 1


@pytest.mark.soak
def test_one_call_restarts_or_stops_all_machines(machines, tmp_path):
    """In `network: secure`; with `lan` anybody could call."""
    needs.system('wireguard-tools', 'wireguard-go', 'nftables')
    call = [sys.executable, '-c', CALL]
    machines.mesh(tmp_path)
    scene = tmp_path / 'scene.yaml'
    text = SCENE.format(folder=tmp_path, net='10.77.0')
    scene.write_text(text.replace('network: lan', 'network: secure'))
    with running(machines, scene, *machines.names) as rows:
        wait_until(lambda: _all_well(machines, rows), 120)
        before = {row['pid'] for name in machines.names for row in rows(name).values()}
        done = answer(machines.run('audio', *call, 'restart'), 120)
        assert sorted(done.split('; ')) == [
            f'{name}: restart in 6 s' for name in sorted(machines.names)
        ]

        def new():
            return not before & {
                row['pid'] for name in machines.names for row in rows(name).values()
            }

        wait_until(lambda: _all_well(machines, rows) and new(), 120)
        answer(machines.run('show', *call, 'stop'), 120)
        for name in machines.names:
            wait_until(lambda name=name: not rows(name), 60)


def _well(rows, count):
    return len(rows) == count and all(row['level'] < 2 for row in rows.values())


def _all_well(machines, rows):
    return all(_well(rows(name), 11) for name in machines.names)

# SPDX-License-Identifier: Apache-2.0
"""The door to ROS over real DDS."""

import ast
import contextlib
import dataclasses
import fcntl
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import xml.dom.minidom
from pathlib import Path

import numpy as np
import pytest
from eol_msgs.msg import NodeState
from rcl_interfaces.msg import ParameterType
from rclpy.clock import ClockType, ROSClock
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.time import Time
from support.spinning import Nodes
from support.waiting import wait_until

from eol_ros import nodes
from eol_ros import scene as scenes
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from eol_ros.ros import network
from eol_ros.ros.definitions import definition
from eol_ros.ros.health_pipe import HealthPipe
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import parameter_messages
from eol_ros.ros.run import run_waiting
from eol_ros.ros.run_record import about
from eol_ros.ros.stamps import system_ns, to_ns
from eol_ros.ros.topics import PUBLISHER_QOS, QOS, message_class
from eol_ros.settings import MontageSettings
from eol_ros.streams.graph import NODES, TOPICS, providers
from eol_ros.streams.images import TYPE, Codec
from eol_ros.streams.requests import values_of

CODEC = Codec(definition(TYPE))


class ProbeNode(EolNode):
    NAME = 'montage'


def spin(node, until, timeout_s=30.0):
    executor = EventsExecutor()
    executor.add_node(node)
    wait_until(until, timeout_s, turn=lambda: executor.spin_once(timeout_sec=0.05))
    executor.remove_node(node)


def test_image_round_trip(ros):
    node = ProbeNode(MontageSettings())
    publisher = ImagePublisher(node, 'camera/image_raw')
    got = []
    node.subscribe('camera/image_raw', got.append, raw=True)
    image = np.random.default_rng(3).integers(0, 256, (800, 1280), dtype=np.uint8)
    stamp = 1_700_000_000_123_456_789
    spin(node, lambda: publisher.subscribers() > 0)
    publisher.publish(stamp, image)
    small = image[:101, :77].copy()
    publisher.publish(stamp + 1, small)
    spin(node, lambda: len(got) == 2)

    first, second = (CODEC.read(raw) for raw in got)

    assert first[0] == stamp and np.array_equal(first[1], image)
    assert second[0] == stamp + 1 and np.array_equal(second[1], small)


def test_the_lens_goes_with_every_image_while_somebody_subscribes(ros):
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import CameraInfo

    node, stamp = ProbeNode(MontageSettings()), 1_700_000_000_123_456_789
    calibration = Calibration.ideal(640, 400)
    topics = 'camera/image_raw', 'camera/camera_info'
    calibrated, other = ImagePublisher(node, *topics, calibration), ImagePublisher(node, *topics)
    image, got = np.zeros((400, 640), np.uint8), []
    calibrated.publish(stamp, image)
    assert not calibrated._info  # nobody subscribes: nothing is made
    node.subscribe(topics[1], got.append, raw=True)
    spin(node, lambda: all(p._infos.get_subscription_count() for p in (calibrated, other)))
    for k in range(3):
        calibrated.publish(stamp + k, image)
    other.publish(stamp + 3, image)
    other.publish(stamp + 4, image[:100, :200].copy())
    spin(node, lambda: len(got) == 5)

    messages = [deserialize_message(raw, CameraInfo) for raw in got]
    messages.sort(key=lambda m: to_ns(m.header.stamp))
    assert [to_ns(m.header.stamp) for m in messages] == [stamp + k for k in range(5)]
    assert {m.header.frame_id for m in messages} == {'camera_optical'}
    sizes = [(m.width, m.height) for m in messages]
    assert sizes == [(640, 400)] * 4 + [(200, 100)]
    for message in messages[:3]:
        assert len(serialize_message(message)) == len(got[0])
        np.testing.assert_array_equal(message.k, calibration.camera_matrix.ravel())
        assert message.distortion_model == 'plumb_bob'
    assert not any(message.k.any() for message in messages[3:])


def test_health_goes_both_ways(ros, monkeypatch):
    out, into = os.pipe()
    monkeypatch.setenv('EOL_HEALTH_FD', str(into))
    node = ProbeNode(MontageSettings())
    seen, states = [], []
    node.subscribe('/diagnostics', seen.append)
    node.subscribe('node_states', states.append)
    node.health.values |= {'pairs': 24, 'mean': np.float64(0.5), 'last': np.int64(7), 'names': ()}
    spin(node, lambda: seen)  # it says how it is once a second, also while it starts
    node.health.warn('no image on the right')
    spin(node, lambda: seen[-1].status[0].message.startswith('no image') and states[-1].level == 1)
    assert {m.status[0].level for m in seen} == {b'\x01'}  # also while starting: not stale
    lines = [json.loads(line) for line in os.read(out, 65536).splitlines()]

    assert lines[0]['level'] == 3  # starting
    assert lines[-1]['level'] == 1 and lines[-1]['text'] == 'no image on the right'
    told = {'rejected': 0, 'pairs': 24, 'mean': 0.5, 'last': 7, 'names': ()}
    assert lines[-1]['values']['pairs'] == 24 and values_of(states[-1].values) == told
    assert (states[0].level, states[0].code) == (NodeState.LEVEL_STARTING, 'starting')
    assert (states[-1].level, states[-1].text, states[-1].code) == (1, 'no image on the right', '')
    row = seen[-1].status[0]
    assert (row.name, row.message) == ('eol: montage', 'no image on the right')
    assert any(kv.key == 'pairs' and kv.value == '24' for kv in row.values)


def test_a_status_is_sent_whole_while_another_thread_adds_a_value(ros, monkeypatch):
    node, sent = ProbeNode(MontageSettings()), []

    def parameters_meanwhile(values):
        for name in values:
            node.health.values[f'late_{name}'] = 1
            sent.append(name)
        return parameter_messages(values)

    monkeypatch.setattr('eol_ros.ros.health.parameter_messages', parameters_meanwhile)
    node.health.report()
    assert 'rejected' in sent and 'late_rejected' in node.health.values
    assert 'late_rejected' not in sent
    node.destroy_node()


def test_silence_is_told(ros):
    node = ProbeNode(MontageSettings())
    node.health.expects('slips', within_s=3600.0)
    node.health.tick()
    node.health.ok('fine')

    assert node.health.status()['level'] == 0

    node.health.expects('slips', within_s=0.0)

    assert node.health.status()['level'] == 1
    assert node.health.status()['text'].startswith('no slips for')


def test_a_node_that_has_never_had_its_input_says_so(ros, monkeypatch):
    node = ProbeNode(MontageSettings())
    node.health.expects('slips')
    assert node.health.status()['text'] == 'starting'
    later_s = time.monotonic() + 31.0
    monkeypatch.setattr(node.health, '_now_s', lambda: later_s)
    status = node.health.status()
    assert (status['level'], status['text']) == (1, 'no slips for 31 s')


def test_the_pin_is_in_no_parameter_and_in_no_bag(ros, tmp_path):
    """The node has it; who asks for its parameters, or is given a bag, does not get it."""

    class Panel(EolNode):
        NAME = 'panel'

    path = tmp_path / 'scene.yaml'
    path.write_text('nodes: {panel: {host: 0.0.0.0, pin: kept-to-ourselves}}')
    scene = scenes.load(path)
    node = Panel(scene.nodes['panel'], scene=scene)
    assert node.settings.pin == 'kept-to-ourselves'
    assert node.get_parameter('pin').value == '***'
    told = about(scene)
    assert 'kept-to-ourselves' not in str(told)
    assert "pin: '***'" in told['scene'] and "pin: '***'" in told['settings']
    node.destroy_node()


def test_command_line_parameters_are_checked(ros):
    good = ProbeNode(MontageSettings(), parameter_overrides=[Parameter('period_s', value=2)])

    assert good.settings.period_s == 2.0
    with pytest.raises(ConfigError, match='^period_s: 0 is out of range'):
        ProbeNode(MontageSettings(), parameter_overrides=[Parameter('period_s', value=0.0)])


# Asks the nodes that it is given for all their parameters, as any ROS tool would.
DESCRIBE = """
import json, sys
import rclpy
from rcl_interfaces.srv import DescribeParameters, ListParameters

rclpy.init()
asking, found = rclpy.create_node('asking'), {}
for name in sys.argv[1:]:
    def call(kind, service, **request):
        client = asking.create_client(kind, f'{name}/{service}')
        client.wait_for_service()
        future = client.call_async(kind.Request(**request))
        rclpy.spin_until_future_complete(asking, future)
        return future.result()

    names = call(ListParameters, 'list_parameters').result.names
    rows = call(DescribeParameters, 'describe_parameters', names=names).descriptors
    found[name] = {
        row.name: [
            row.type, row.description, row.read_only,
            [[r.from_value, r.to_value, r.step]
             for r in (*row.floating_point_range, *row.integer_range)],
            len(row.floating_point_range),
        ]
        for row in rows
    }
assert not [module for module in sys.modules if module.startswith('eol')]
print(json.dumps(found))
"""
ROS_TYPES = {
    bool: ParameterType.PARAMETER_BOOL, int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE, str: ParameterType.PARAMETER_STRING,
    tuple[str, ...]: ParameterType.PARAMETER_STRING_ARRAY,
}  # fmt: skip


def described(field):
    """What a ROS tool must be told of a setting: type, text, read-only, ranges, those of floats."""
    of, ranges = field.metadata, []
    if None not in (of['min'], of['max']):
        ranges = [[of['min'], of['max'], 0]]
    text = f'{of["doc"]} [{of["unit"]}]' if of['unit'] else of['doc']
    floats = len(ranges) * (field.type is float)
    return [ROS_TYPES[field.type], text, not of['live'], ranges, floats]


def test_a_stock_tool_reads_every_parameter_as_its_setting_describes_it(ros, tmp_path):
    stock = {k: v for k, v in os.environ.items() if not k.startswith(('FASTRTPS', 'FASTDDS'))}
    bare = {name: type('Bare', (EolNode,), {'NAME': name}) for name in NODES}
    made = {name: bare[name](row.settings()) for name, row in NODES.items()}
    names = {name: node.get_fully_qualified_name() for name, node in made.items()}
    words = [sys.executable, '-c', DESCRIBE, *names.values()]
    out = tmp_path / 'found.json'
    with (
        Nodes(*made.values()) as turning,
        out.open('w') as file,
        subprocess.Popen(words, env=stock, stdout=file) as child,
    ):
        try:
            turning.until(lambda: child.poll() is not None)
        finally:
            child.kill()

    found = json.loads(out.read_text())
    for name, row in NODES.items():
        told, fields = found[names[name]], dataclasses.fields(row.settings)
        assert {f.name: told[f.name] for f in fields} == {f.name: described(f) for f in fields}


def test_a_timer_that_is_called_several_times_at_once_is_not_put_off(ros):
    """Each change of this clock has the executor look at the timers; they run after the last."""
    node, clock, calls = ProbeNode(MontageSettings()), ROSClock(), []
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(seconds=100, clock_type=ClockType.ROS_TIME))
    timer = node.create_timer(1.0, lambda: calls.append(clock.now()), clock=clock)
    executor = EventsExecutor()
    executor.add_node(node)
    executor.spin_once(timeout_sec=0.05)
    for k in range(6):
        now = Time(nanoseconds=101_500_000_000 + k, clock_type=ClockType.ROS_TIME)
        clock.set_ros_time_override(now)
    wait_until(lambda: calls, turn=lambda: executor.spin_once(timeout_sec=0.02))
    for _ in range(20):
        executor.spin_once(timeout_sec=0.0)

    node.pull_in_timers()

    assert 0 < timer.time_until_next_call() <= 1_000_000_000
    executor.remove_node(node)
    node.destroy_node()


@pytest.mark.timeout(60)
def test_a_burst_ends_though_callbacks_never_do(ros):
    """A node under a flood of messages must look whether it is to stop."""
    executor, ran = EventsExecutor(), []

    def again(number):
        ran.append(number)
        executor.create_task(again, number)

    for number in range(50):
        executor.create_task(again, number)
    run_waiting(executor)
    assert ran[:50] == list(range(50)) and len(ran) <= 100
    executor.shutdown()


def test_topic_table():
    # Every image that the QoS keeps must fit in at once, or the oldest are overwritten unread.
    assert PUBLISHER_QOS['images'].depth * 1280 * 800 < network.BIG_SEGMENT
    for row in TOPICS.values():
        assert message_class(row.type_name).__name__ == row.type_name.split('/')[-1]
        least = 1 if row.qos in ('clock', 'state') else 10  # the newest is all that counts
        assert least <= PUBLISHER_QOS[row.qos].depth <= QOS[row.qos].depth
        for node in (*row.publishers, *row.subscribers):
            assert node in NODES or node == 'every node'
    for name, node in NODES.items():
        assert {*node.publishes, *node.subscribes} <= set(TOPICS)
        assert not node.requires or (node.requires in node.subscribes and providers(name))


@pytest.mark.parametrize('name', sorted(set(NODES) - {'replay', 'recorder'}))  # theirs depend
def test_a_row_names_the_topics_that_the_node_uses(name):
    named, used, heard = set(), set(), set()
    folder = Path(nodes.__file__).parent
    beside = folder.parent / 'ros' / f'{name}.py'
    paths = [folder / f'{name}.py', *folder.glob(f'{name}_*.py'), beside]
    for path in filter(Path.exists, paths):
        for part in ast.walk(ast.parse(path.read_text())):
            if isinstance(part, ast.Constant):
                named |= {part.value} & set(TOPICS)
            elif isinstance(part, ast.Call):
                by = ast.unparse(part.func).rpartition('.')[2]
                if by in ('publisher', 'subscribe', 'ImagePublisher'):
                    used |= {a.value for a in part.args if isinstance(a, ast.Constant)}
                elif by in ('MainClock', 'on_states'):
                    used.add('node_states')
                elif by == 'on_results':
                    heard.add('request_results')
    node = NODES[name]
    row = {*node.publishes, *node.on_request, *node.subscribes, *node.optional}
    of_every_node = {'requests', 'request_results'}
    assert used or row <= of_every_node
    assert heard <= {*node.subscribes, *node.optional}
    assert used <= row <= named | used | of_every_node


def test_who_waits_for_readers_asks_them_often(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_CACHE', str(tmp_path))
    texts = {}
    for asks in (False, True):
        found = network.environment('local', images=True, asks=asks)
        texts[asks] = Path(found['FASTRTPS_DEFAULT_PROFILES_FILE']).read_text()
    assert 'heartbeatPeriod' not in texts[False]
    writer = xml.dom.minidom.parseString(texts[True]).getElementsByTagName('data_writer')[0]
    period = writer.getElementsByTagName('heartbeatPeriod')[0]
    assert period.getElementsByTagName('nanosec')[0].firstChild.data == '20000000'
    assert writer.getAttribute('is_default_profile') == 'true'


def test_the_profile_is_not_a_cleaners_and_comes_back(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))
    monkeypatch.setenv('TMPDIR', str(tmp_path / 'tmp'))
    (tmp_path / 'tmp').mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', None)  # read TMPDIR again
    for _ in range(2):
        file = Path(network.environment('local')['FASTRTPS_DEFAULT_PROFILES_FILE'])
        assert file.read_text() == network.profile(False, ['127.0.0.1'])
        assert tmp_path / 'cache' in file.parents
        file.unlink()

    assert not list((tmp_path / 'tmp').iterdir())
    file.mkdir()
    with pytest.raises(ConfigError, match='Is a directory; set EOL_CACHE'):
        network.environment('local')


def test_a_profile_of_the_user_stays(monkeypatch):
    monkeypatch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', '/etc/mine.xml')

    assert 'FASTRTPS_DEFAULT_PROFILES_FILE' not in network.environment('local')


def brimful(size=4096):
    """Return both ends of a pipe into which nothing more fits, and how many bytes it holds."""
    out, into = os.pipe()
    fcntl.fcntl(into, fcntl.F_SETPIPE_SZ, size)
    os.set_blocking(into, False)
    count = 0
    with contextlib.suppress(BlockingIOError):
        while True:
            count += os.write(into, b'.' * 64)
    os.set_blocking(into, True)  # as a shell may hand it over that starts a node by hand
    return out, into, count


def test_a_full_health_pipe_does_not_hold_a_node_up(ros, monkeypatch):
    out, into, count = brimful()
    monkeypatch.setenv('EOL_HEALTH_FD', str(into))
    node = ProbeNode(MontageSettings())
    thread = threading.Thread(target=node.health.warn, args=('no image',), daemon=True)
    thread.start()
    thread.join(5.0)
    stuck = thread.is_alive()
    assert len(os.read(out, count)) == count  # the reader goes on, and frees who is stuck
    thread.join(5.0)
    assert not stuck

    node.health.error('no images at all')

    lines = os.read(out, 65536).splitlines()
    assert json.loads(lines[-1])['text'] == 'no images at all'


def test_a_report_that_goes_in_parts_spoils_no_other():
    out, into, _ = brimful(8192)
    pipe = HealthPipe(into)
    os.read(out, 5000)
    assert pipe.send({'text': 'a' * 6000})  # longer than what the kernel takes whole
    assert not pipe.send({'text': 'b'})
    got = os.read(out, 65536)
    assert pipe.send({'text': 'c'})
    got += os.read(out, 65536)

    texts = [json.loads(line)['text'] for line in got.lstrip(b'.').splitlines()]
    assert texts == ['a' * 6000, 'c']


def test_steady_time_in_system_time_is_not_off_by_being_held_up(monkeypatch):
    """Between the two clocks' first readings the process is held up for 3 ms."""
    clock = [7_000_000_000]
    held_up = [3_000_000]

    def steady():
        clock[0] += 400
        return clock[0]

    def system():
        clock[0] += 400 + (held_up.pop() if held_up else 0)
        return clock[0] + 1_790_000_000 * 10**9

    monkeypatch.setattr(time, 'monotonic_ns', steady)
    monkeypatch.setattr(time, 'time_ns', system)
    expected = 1_790_000_012 * 10**9
    assert abs(system_ns(12.0) - expected) <= 400

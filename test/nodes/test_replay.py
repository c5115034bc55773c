# SPDX-License-Identifier: Apache-2.0
"""The replay node over real DDS: the recorded bytes come out again, in order, at their time."""

import argparse
import json
import signal
import struct
import subprocess
import time
import types

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from eol_msgs.msg import Blocks, BlockTap, Calibration, Corpus, RequestResult, Slip, Wall
from eol_msgs.msg import Table as TableMessage
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from support.bag_samples import bag_of
from support.spinning import Nodes
from support.waiting import wait_until

from eol_ros.analysis.bag import open_bag
from eol_ros.core.table import Table
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.devices.files import calibration_file
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.nodes.replay import ReplayNode
from eol_ros.ros.definitions import describe
from eol_ros.ros.node import EolNode
from eol_ros.ros.played import played
from eol_ros.ros.qos import NO_HASH
from eol_ros.ros.requests import request_from_msg, request_to_msg
from eol_ros.ros.stamps import to_msg, to_ns
from eol_ros.ros.topics import CLOCK, CLOCK_QOS, QOS
from eol_ros.scene import Scene
from eol_ros.settings import MotionSettings, ReplaySettings
from eol_ros.streams import tables
from eol_ros.streams.graph import NODES, full_name
from eol_ros.streams.requests import Asked
from eol_ros.verbs import replay

T0 = 1_700_000_000_000_000_000
STEP_NS = 10_000_000

pytestmark = pytest.mark.usefixtures('any_stamp')


class Listener(EolNode):
    """Keeps what comes, with its time."""

    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.got, self.at, self.clock = {'blocks': [], 'slips': []}, [], []
        self.subscribe('blocks', self.on_blocks, raw=True)
        self.subscribe('slips', self.got['slips'].append, raw=True)
        self.create_subscription(Clock, CLOCK, self.on_clock, CLOCK_QOS)

    def on_clock(self, message):
        self.clock.append((time.monotonic(), to_ns(message.clock)))

    def on_blocks(self, raw):
        self.got['blocks'].append(raw)
        self.at.append(time.monotonic())


@pytest.fixture
def bag(tmp_path):
    """A bag of 100 blocks at 100 a second, and 20 slips."""
    topics = [BagTopic(f'/eol/{t}', **describe(t)) for t in ('blocks', 'slips', 'camera/image_raw')]
    writer = BagWriter(tmp_path / 'run', topics, {})
    sent = {'blocks': [], 'slips': []}
    for i in range(100):
        now = T0 + i * STEP_NS
        message = Blocks(image=i)
        message.header.stamp = to_msg(now)
        sent['blocks'].append(bytes(serialize_message(message)))
        writer.write('/eol/blocks', sent['blocks'][-1], now, now)
        if i % 5 == 0:
            sent['slips'].append(bytes(serialize_message(Slip(slip=i))))
            writer.write('/eol/slips', sent['slips'][-1], now, now)
    writer.close()
    return tmp_path / 'run', sent


def write(folder, messages):
    """Write (topic, seconds, message), stamped then and recorded 5 ms later; return the bytes."""
    topics = dict.fromkeys(topic for topic, _, _ in messages)
    writer = BagWriter(folder, [BagTopic(full_name(t), **describe(t)) for t in topics], {})
    sent = {topic: [] for topic in topics}
    for topic, seconds, message in messages:
        stamp = T0 + round(seconds * 1e9)
        if not to_ns(message.header.stamp):
            message.header.stamp = to_msg(stamp)
        sent[topic].append(bytes(serialize_message(message)))
        writer.write(full_name(topic), sent[topic][-1], stamp + 5_000_000, stamp + 5_000_000)
    writer.close()
    return sent


@pytest.fixture
def nodes(ros):
    with Nodes() as nodes:
        yield nodes


@pytest.fixture
def listener(nodes):
    return nodes.add(Listener())


def play(nodes, path, wait_s=10.0, **settings):
    node = nodes.add(ReplayNode(ReplaySettings(bag=str(path), wait_s=wait_s, **settings)))
    nodes.until(lambda: node.state == 'over')
    nodes.run(0.3)
    nodes.end(node)
    return node


@pytest.mark.slow
def test_the_recorded_bytes_come_at_their_time(nodes, listener, bag):
    path, sent = bag
    play(nodes, path, topics=('blocks', 'slips'), rate=2.0)
    assert listener.got == sent
    # 0.99 s recorded, at twice the speed; the first may be heard late
    assert listener.at[-1] - listener.at[0] > 0.35
    times = [recorded for _, recorded in listener.clock]
    assert times == sorted(times)
    standing = times.count(times[0])
    assert standing > 2 and times[0] < T0  # also before anything is due, and at the end
    assert times[-1] > T0 + 99 * STEP_NS
    going = {t for t in times if T0 < t < T0 + 99 * STEP_NS}
    assert len(going - {T0 + i * STEP_NS for i in range(100)}) > 2  # between the messages too


def test_a_calibration_that_an_old_bag_has_as_text_is_played_as_its_message(nodes, ros):
    """As in the sample that ships; the panel and own nodes subscribe to the message."""
    heard, reader = [], nodes.add(ros.create_node('reader', namespace='/eol'))
    reader.create_subscription(Calibration, 'calibration', heard.append, QOS['latched'])
    settings = ReplaySettings(bag='bags/sample', topics=('calibration',), wait_s=0.0)
    nodes.add(ReplayNode(settings))
    assert nodes.until(lambda: heard)
    text = str(open_bag('bags/sample').table('calibration')['data'][0])
    expected = calibration_file.loads(text, 'bags/sample')
    assert (heard[0].width, heard[0].digest) == (expected.image_width, expected.digest)
    assert heard[0].homography.tolist() == expected.homography.ravel().tolist()


@pytest.mark.slow
def test_it_has_the_services_of_rosbag2_player(ros, nodes, bag):
    from rosbag2_interfaces.srv import GetRate, IsPaused, Pause, Resume, Seek, SetRate

    node = nodes.add(ReplayNode(ReplaySettings(bag=str(bag[0]), wait_s=0.0, loop=True)))
    asking = nodes.add(ros.create_node('asking'))

    def call(type_, name, **fields):
        client = asking.create_client(type_, f'/eol/replay/{name}')
        assert client.wait_for_service(20.0)
        future = client.call_async(type_.Request(**fields))
        nodes.until(future.done)
        return future.result()

    call(Pause, 'pause')
    assert call(IsPaused, 'is_paused').paused and node.player.paused
    assert call(SetRate, 'set_rate', rate=2.0).success
    assert not call(SetRate, 'set_rate', rate=-1.0).success
    assert call(GetRate, 'get_rate').rate == node.player.rate == 2.0
    assert node.get_parameter('rate').value == 2.0
    assert call(Seek, 'seek', time=to_msg(T0 + 50 * STEP_NS)).success
    assert not call(Seek, 'seek', time=to_msg(T0 + 5000 * STEP_NS)).success
    call(Resume, 'resume')
    assert not call(IsPaused, 'is_paused').paused


@pytest.mark.slow
def test_a_reader_in_another_process_sets_the_pace(ros, bag, python):
    """It says what it has when it is asked: by itself Fast DDS asks every 3 s."""
    path, sent = bag
    echo = [python, '-m', 'eol_ros', 'echo', 'slips', '--json', '--namespace', 'eol']
    reader = subprocess.Popen(echo, stdout=subprocess.PIPE, text=True)
    node = ReplayNode(ReplaySettings(bag=str(path), topics=('slips',), wait_s=60.0, fast=True))
    try:
        wait_until(lambda: node.state in ('playing', 'over'), 70)  # it may be over in 10 ms
        wait_until(lambda: node.state == 'over', 30)  # 19 waits of 3 s would take 57
        lines = [json.loads(reader.stdout.readline()) for _ in sent['slips']]
        assert [line['slip'] for line in lines] == list(range(0, 100, 5))
    finally:
        reader.kill()
        reader.communicate()
        node.close()
        node.destroy_node()


IMAGES = 'camera/image_raw'


@pytest.fixture
def played_images(tmp_path, python):
    """A replay of 60 images, 30 a second, and a process that reads them, not yet begun."""
    images = [(IMAGES, i / 30, Image(step=i, data=bytes(100))) for i in range(60)]
    write(tmp_path / 'run', images)
    echo = [python, '-m', 'eol_ros', 'echo', IMAGES, '--json', '--namespace', 'eol']
    reader = subprocess.Popen(echo, stdout=subprocess.PIPE, text=True)
    settings = ReplaySettings(bag=str(tmp_path / 'run'), topics=(IMAGES,), wait_s=60.0)
    node = ReplayNode(settings)
    try:
        wait_until(lambda: node.player.played > 10, 70)
        yield node, reader
    finally:
        node.close()
        node.destroy_node()
        reader.kill()
        reader.communicate()


@pytest.mark.slow
def test_a_reader_that_was_held_up_misses_no_image(ros, played_images):
    node, reader = played_images
    reader.send_signal(signal.SIGSTOP)
    begin_s = node.player.position_s
    time.sleep(0.9)  # 27 images; the publisher keeps 12
    assert node.player.position_s - begin_s < 0.6
    reader.send_signal(signal.SIGCONT)
    wait_until(lambda: node.state == 'over')
    assert [json.loads(reader.stdout.readline())['step'] for _ in range(60)] == list(range(60))


@pytest.mark.slow
def test_a_reader_that_does_not_come_back_is_waited_for_once(ros, played_images, monkeypatch):
    monkeypatch.setattr('eol_ros.nodes.replay.ACKNOWLEDGED_S', 2.0)
    node, reader = played_images
    reader.kill()
    begin = time.monotonic(), node.player.position_s
    wait_until(lambda: node.state == 'over')
    taken_s = time.monotonic() - begin[0]
    expected_s = node.bag.duration_s - begin[1] + 0.3
    assert expected_s <= taken_s < expected_s + 6  # a wait for each history would take 8 s


@pytest.mark.slow
def test_a_bag_of_another_namespace_is_played_into_this_one(nodes, listener, tmp_path):
    names = {'blocks': '/museum/north/blocks', 'slips': '/museum/north/slips', 'else': '/x/blocks'}
    topics = [BagTopic(names['blocks'], **describe('blocks'))]
    topics += [BagTopic(names['slips'], **describe('slips'))]
    writer, sent = BagWriter(tmp_path / 'run', topics, {}), []
    for i in range(20):
        now = T0 + i * STEP_NS
        message = Blocks(image=i)
        message.header.stamp = to_msg(now)
        sent.append(bytes(serialize_message(message)))
        writer.write(names['blocks'], sent[-1], now, now)
        writer.write(names['slips'], bytes(serialize_message(Slip(slip=i))), now, now)
    writer.close()
    node = play(nodes, tmp_path / 'run', fast=True)
    assert node.names == [names['blocks']]
    assert listener.got == {'blocks': sent, 'slips': []}
    node = play(nodes, tmp_path / 'run', fast=True, topics=('slips',))
    assert len(listener.got['slips']) == 20


def ask(kind, node='', values=(), id_='', source='panel'):
    return request_to_msg(Asked(kind, node, dict(values), id=id_, source=source), T0)


def accept(kind, node, values=(), from_s=0.0, accepted=True):
    message = RequestResult(id=kind, node=node, kind=kind, accepted=accepted)
    message.values = request_to_msg(Asked(kind, node, dict(values)), T0).values
    message.from_stamp = to_msg(T0 + round(from_s * 1e9))
    return message


def preview(value):
    return {'preview_hz': value}


REQUESTS = [
    ('blocks', 0.0, Blocks()),
    ('request_results', 0.01, accept('set', 'tracker', preview(30.0), 0.1)),
    ('request_results', 0.02, accept('set', 'tracker', preview(20.0), 0.2)),
    ('request_results', 0.03, accept('calibrate', 'tracker', from_s=0.2)),
    ('request_results', 0.04, accept('set', 'grains', {'radius': 0.1}, 0.2)),
    ('request_results', 0.05, accept('set', 'grains', {'radius': 9.0}, 0.2, accepted=False)),
    ('request_results', 0.06, accept('set', 'sound', {'gain_db': -3.0}, 0.2)),
    ('blocks', 0.2, Blocks()),
    ('requests', 0.25, ask('sleep')),
    ('request_results', 0.255, accept('sleep', 'sound')),
    ('requests', 0.26, ask('calibrate', 'tracker')),
    ('requests', 0.27, ask('move_grain', 'grains', {'grain': 3, 'x': 0.5, 'y': 0.5})),
    ('request_results', 0.275, accept('move_grain', 'grains')),
    ('requests', 0.28, ask('infrared', 'twin', {'mask': '0'}, source='leds')),
    ('requests', 0.29, ask('cue', 'hours', {'name': 'night'}, source='hours')),
    ('requests', 0.291, ask('set', 'leds', {'look': 'embers'}, source='hours')),
    ('requests', 0.292, ask('set', 'grains', {'radius': 0.1}, source='hours')),  # asked before
    ('requests', 0.293, ask('set', 'leds', {'look': 'paper'})),  # by a person
    ('request_results', 0.30, accept('darkness', 'tracker', {'until_ns': 9}, 0.35)),
    ('block_taps', 0.32, BlockTap()),
    ('blocks', 0.4, Blocks()),
]
SET_20 = ('tracker', 'set', {'preview_hz': 20.0}, 0.2)
RADIUS = ('grains', 'set', {'radius': 0.1}, 0.2)
DARK = ('tracker', 'darkness', {'until_ns': 9}, 0.35)


@pytest.mark.parametrize(
    ('start_s', 'ahead'),
    [
        (0.0, [('tracker', 'set', {'preview_hz': 30.0}, 0.1), SET_20,
               ('tracker', 'calibrate', {}, 0.2), RADIUS, DARK]),
        (0.1, [SET_20, RADIUS, DARK]),
    ],
)  # fmt: skip
def test_what_nodes_heeded_is_asked_before_the_images_and_what_people_asked_in_its_time(
    nodes, listener, tmp_path, start_s, ahead
):
    sent = write(tmp_path / 'run', REQUESTS)
    order = []

    def hear(message):
        assert message.source == 'replay' and message.id
        asked = request_from_msg(message)
        from_s = round((asked.from_ns - T0) * 1e-9, 6) if asked.from_ns else 0.0
        order.append((asked.node, asked.kind, asked.values, from_s))

    listener.subscribe('requests', hear)
    listener.subscribe('block_taps', lambda m: order.append('tap'))
    node = play(nodes, tmp_path / 'run', start_s=start_s, rate=0.5)
    assert set(node.names) == {'/eol/blocks', '/eol/block_taps', '/eol/requests'}
    cue = ('leds', 'set', {'look': 'embers'}, 0.0)
    assert order == [*ahead, ('', 'sleep', {}, 0.0), cue, 'tap']
    assert listener.got['blocks'] == sent['blocks'][-3 if not start_s else -2 :]


@pytest.mark.slow
def test_what_was_latched_before_the_start_is_played_before_all_else(nodes, listener, tmp_path):
    stamped = [('corpus', 0.0, Corpus(name='ice')), ('wall', 0.1, Wall(change=1))]
    stamped += [('corpus', 0.2, Corpus(name='snow')), ('wall', 0.9, Wall(change=2))]
    stamped += [('blocks', 0.05 * i, Blocks(image=i)) for i in range(20)]
    write(tmp_path / 'run', sorted(stamped, key=lambda item: item[1]))
    heard = []
    listener.subscribe('corpus', lambda m: heard.append(m.name))
    listener.subscribe('wall', lambda m: heard.append(m.change))
    listener.subscribe('blocks', lambda raw: heard.append('block'), raw=True)
    topics = ('blocks', 'corpus', 'wall')
    play(nodes, tmp_path / 'run', topics=topics, start_s=0.5)
    assert sorted(map(str, heard[:2])) == ['1', 'snow']
    assert heard.count('block') == 10 and heard[2:].count(2) == 1 and len(heard) == 13
    heard.clear()
    play(nodes, tmp_path / 'run', topics=('blocks',), start_s=0.5)
    assert heard == ['block'] * 10  # only of what is played


@pytest.mark.slow
def test_all_is_not_what_processes_say_of_themselves(tmp_path, monkeypatch):
    write(tmp_path / 'run', [('blocks', 0.1, Blocks()), ('/diagnostics', 0.2, DiagnosticArray())])
    asked = []
    monkeypatch.setattr(replay, '_play', lambda args, topics: asked.append(topics))
    parser = argparse.ArgumentParser()
    replay.add_arguments(parser)
    for only in ('all', '/diagnostics,blocks'):
        replay.run(parser.parse_args([str(tmp_path / 'run'), '--only', only]))
    assert asked == [('/eol/blocks',), ('/diagnostics', '/eol/blocks')]


def test_two_givers_of_blocks_are_refused(nodes, listener, bag):
    path, _ = bag
    listener.publisher('blocks')
    with pytest.raises(ConfigError, match='motion publishes blocks, and so would the replay'):
        play(nodes, path)


def test_a_bag_of_another_table_is_refused(nodes, listener, tmp_path):
    bag_of(tmp_path / 'run', [('blocks', Blocks(), 0.0)], settings='table: {rows: 3}')
    row = tables.of(T0, Table(columns=4))
    listener.publisher('table').publish(tables.RECORD.fill(TableMessage(), row))
    told = 'run: its table is not that of the running graph: rows 3, not 5, columns 5, not 4: start'
    with pytest.raises(ConfigError, match=told):
        play(nodes, tmp_path / 'run')
    assert listener.got['blocks'] == []


@pytest.mark.parametrize(
    ('names', 'said'), [(['motion'], 'motion'), ([], 'another program')], ids=['known', 'unknown']
)
def test_who_has_no_name_yet_is_another_program(nodes, bag, monkeypatch, names, said):
    """As rmw_fastrtps tells it of a node that it has just met, and of programs without ROS."""
    more = {'qos_profile': QoSProfile(depth=1), 'topic_type_hash': NO_HASH}
    names = ['_NODE_NAME_UNKNOWN_', *names]
    ends = [types.SimpleNamespace(node_name=name, **more) for name in names]
    monkeypatch.setattr(ReplayNode, 'get_publishers_info_by_topic', lambda *_: ends)
    with pytest.raises(ConfigError, match=f'^{said} publishes blocks, and so would the replay'):
        play(nodes, bag[0], wait_s=0.5)


def scene_of(*names):
    return Scene('test', {name: NODES[name].settings() for name in names})


def test_what_is_played_follows_from_what_runs():
    """What a node of the scene takes and none gives."""
    behind = ('replay', 'tracker', 'motion', 'leds', 'grains', 'sound', 'montage')
    assert played(scene_of(*behind), True) == ['camera/image_raw', 'block_taps', 'requests']
    assert 'blocks' in played(scene_of('replay', *behind[2:]), True)
    assert 'camera/image_raw' not in played(scene_of('replay', *behind[2:], 'recorder'), True)
    assert played(scene_of('replay', 'leds'), True) == ['block_taps', 'slips', 'requests']
    triggers = ['grain_triggers', 'felt_triggers']
    assert played(scene_of('replay', 'sound'), True) == ['corpus', *triggers, 'requests']
    assert 'wall' in played(scene_of('replay', 'panel'), True)
    assert played(scene_of('replay'), True)[1] == 'camera/image_raw'
    assert played(scene_of('replay'), False) == ['blocks', 'block_taps', 'requests']


def test_what_cannot_be_played_is_said(ros, tmp_path, bag):
    with pytest.raises(ConfigError, match='name a bag folder'):
        ReplayNode(ReplaySettings())
    with pytest.raises(DeviceMissing, match='no such bag'):
        ReplayNode(ReplaySettings(bag=str(tmp_path / 'absent')))
    with pytest.raises(ConfigError, match='no topic wall in this bag'):
        ReplayNode(ReplaySettings(bag=str(bag[0]), topics=('wall',)))
    topic = BagTopic('/eol/blocks', **{**describe('blocks'), 'type_hash': 'RIHS01_' + 'a' * 64})
    writer = BagWriter(tmp_path / 'other', [topic], {})
    writer.write('/eol/blocks', struct.pack('<I', 256), T0, T0)
    writer.close()
    with pytest.raises(ConfigError, match='another definition of eol_msgs/msg/Blocks'):
        ReplayNode(ReplaySettings(bag=str(tmp_path / 'other')))


def test_what_is_not_installed_is_left_out_and_the_others_are_played(ros, tmp_path, capfd):
    there = BagTopic('/eol/point', 'geometry_msgs/msg/Point', 'float64 x\nfloat64 y\nfloat64 z\n')
    others = [
        BagTopic('/gone', 'gone_msgs/msg/Gone', 'int32 a\n'),
        BagTopic('/name', 'geometry_msgs/msg/Gone', 'int32 a\n'),
        BagTopic('/other', 'geometry_msgs/msg/Point', 'float64 y\nfloat64 x\nfloat64 z\n'),
        BagTopic('/json', 'Point', '{}', encoding='json', schema_encoding='jsonschema'),
        BagTopic('/bare', '', '', encoding='json', schema_encoding=''),
        BagTopic('/ros1', 'std_msgs/String', 'string data', '', '', 'ros1', 'ros1msg'),
    ]
    writer = BagWriter(tmp_path / 'bag', [there, *others], {})
    for k, topic in enumerate([there, *others]):
        writer.write(topic.key, b'\0\1\0\0' + bytes(24), T0 + k, T0 + k)
    writer.close()
    names = tuple(topic.key for topic in (there, *others))
    node = ReplayNode(ReplaySettings(bag=str(tmp_path / 'bag'), topics=names))
    try:
        assert node.names == ['/eol/point']
        told = capfd.readouterr().err
        assert all(told.count(f': {topic.name}') == 1 for topic in others)
    finally:
        node.close()
        node.destroy_node()
    with pytest.raises(ConfigError, match='install the package gone_msgs'):
        ReplayNode(ReplaySettings(bag=str(tmp_path / 'bag'), topics=('/gone',)))

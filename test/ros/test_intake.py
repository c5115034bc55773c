# SPDX-License-Identifier: Apache-2.0
"""Messages that nobody should send: each node lives on, uses none of them, and counts them all."""

import ast
import ctypes
import gc
import math
import random
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from eol_msgs.msg import BlockTap, FeltSlip, NodeState, Slip
from rclpy.serialization import deserialize_message, serialize_message
from scipy.stats import theilslopes
from sensor_msgs.msg import Image
from std_msgs.msg import String
from support.spinning import Nodes

import eol_ros
from assets.ice import ice
from eol_ros.devices.audio import audio_file
from eol_ros.devices.bag.reader import BagReader
from eol_ros.ros.echo import listen
from eol_ros.ros.health import REJECTED_TOLD_S
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import request_to_msg
from eol_ros.ros.run import node_class
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.ros.topics import topic_class
from eol_ros.scene import Scene
from eol_ros.settings import (
    GrainsSettings,
    HoursSettings,
    LedsSettings,
    MidiSettings,
    MontageSettings,
    MotionSettings,
    OscSettings,
    PanelSettings,
    RecorderSettings,
    SoundSettings,
    TrackerSettings,
    TwinSettings,
)
from eol_ros.streams import checks
from eol_ros.streams.graph import NODES, TOPICS
from eol_ros.streams.requests import Asked

SOURCE = Path(eol_ros.__file__).parent
SAMPLE = SOURCE.parent / 'bags' / 'sample'
VISITORS = {'echo.py', 'requests.py'}  # they are no nodes of the graph
READ = {('panel', 'calibration'), ('panel', 'node_states')}
DECODED = {'slips', 'requests', 'request_results'}  # by the recorder
MAY_LACK = {'x', 'y', 'values'}  # of a corpus


class Probe(EolNode):
    NAME = 'probe'


def settings(folder):
    """What each node is started with; camera, replay and projectors subscribe to no stream."""
    return {
        'twin': TwinSettings(accelerometer=False, fps=10.0),
        'tracker': TrackerSettings(),
        'motion': MotionSettings(),
        'leds': LedsSettings(port='twin'),
        'grains': GrainsSettings(sound=str(folder / 'ice.wav')),
        'sound': SoundSettings(device='wav', wav=str(folder / 'out.wav'), sample_rate=16000),
        'montage': MontageSettings(),
        'hours': HoursSettings('Europe/Vienna', ('Mon-Sun 10:00-18:00',)),
        'midi': MidiSettings('no such output'),
        'osc': OscSettings(send_to=('127.0.0.1:9',)),
        'panel': PanelSettings(port=0),
        'recorder': RecorderSettings(folder=str(folder / 'bags'), min_free_gb=0.0),
    }


@pytest.fixture
def live(ros, tmp_path, monkeypatch):
    """Return a function that makes the nodes named, in one executor."""
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    audio_file.write(tmp_path / 'ice.wav', ice(2.0, 16000, 1), 16000, 'PCM_16')
    with Nodes() as nodes:

        def make(*names):
            known = settings(tmp_path)
            made = [node_class(n)(known[n], scene=Scene(n, {n: known[n]})) for n in names]
            for node in made:
                nodes.add(node)
            return nodes, *made

        yield make


def give(node, topic, raw):
    """Hand bytes to a node as its executor does."""
    for subscription in node.subscriptions:
        if subscription.topic_name == node.resolve_topic_name(topic):
            if node.NAME == 'recorder':
                info = dict.fromkeys(('received_timestamp', 'source_timestamp'), time.time_ns())
                subscription.callback(raw, info | {'publication_sequence_number': 1})
            else:
                subscription.callback(raw)
    if isinstance(node, EolNode):
        node.catch_up()


def packed(message, stamp=True):
    if stamp and hasattr(message, 'header'):
        message.header.stamp = to_msg(now_ns())
    return bytes(serialize_message(message))


def stamped(message, sec):
    message.header.stamp = Time(sec=sec)
    return packed(message, stamp=False)


NAN = math.nan


@pytest.mark.parametrize(
    ('name', 'topic', 'raw'),
    [
        ('leds', 'block_taps', lambda: packed(BlockTap(block=25))),
        ('leds', 'slips', lambda: packed(Slip(kind=1, block=25))),
        ('leds', 'slips', lambda: packed(Slip(kind=1, block=255))),
        ('leds', 'slips', lambda: stamped(Slip(kind=1, block=3), 2**31 - 1)),
        ('leds', 'slips', lambda: stamped(Slip(kind=1, block=3), -1)),
        ('leds', 'slips', lambda: stamped(Slip(kind=1, block=3), 0)),
        ('montage', 'slips', lambda: packed(Slip(kind=1, block=25))),
        ('grains', 'felt_slips', lambda: packed(FeltSlip(kind=1, block=255))),
        ('grains', 'felt_slips', lambda: packed(FeltSlip(kind=1, block=3, x=NAN))),
        ('grains', 'felt_slips', lambda: packed(FeltSlip(kind=1, block=3, x=1e300))),
        ('motion', 'block_taps', lambda: packed(BlockTap(block=3, sigma=NAN))),
        ('motion', 'blocks', lambda: b'\0\1\0\0' + bytes(500)),
        ('tracker', 'camera/image_raw', lambda: packed(Image(encoding='rgb8', width=1, height=1))),
        ('tracker', 'camera/image_raw', lambda: packed(Image(encoding='mono8'))),
        ('recorder', 'slips', lambda: b'\0\1\0\0\7'),
        ('panel', 'calibration', lambda: packed(String(data='}\n- [no YAML: \0'))),
        ('panel', 'calibration', lambda: packed(String(data='image_width: 7'))),
        ('panel', 'node_states', lambda: packed(NodeState(node='motion', level=4))),
        ('panel', 'wall', lambda: b'\1'),
        ('sound', 'corpus', lambda: b'\0\1\0\0' + b'\xff' * 64),
    ],
)
def test_an_absurd_message_is_counted_and_nothing_else(live, name, topic, raw):
    _nodes, node = live(name)
    told = []
    node.get_logger().warning = told.append
    give(node, topic, raw())
    status = node.health.status()
    assert status['values']['rejected'] == 1
    assert [line for line in told if line.startswith(f'1 messages rejected, the last on {topic}: ')]
    assert status['text'].endswith(told[-1])


def test_the_log_has_one_line_a_minute_and_the_status_says_it_as_long(live, monkeypatch):
    _nodes, node = live('motion')
    told, now_s = [], time.monotonic()
    node.get_logger().warning = told.append
    monkeypatch.setattr('eol_ros.ros.health.time.monotonic', lambda: now_s)
    for _ in range(9):
        give(node, 'blocks', b'\0\1\0\0')
    assert len(told) == 1
    now_s += REJECTED_TOLD_S
    give(node, 'blocks', b'\0\1\0\0')
    assert [line.split(' ')[0] for line in told] == ['1', '10']
    assert 'rejected' in node.health.status()['text']
    now_s += REJECTED_TOLD_S
    assert 'rejected' not in node.health.status()['text']
    assert node.health.status()['values']['rejected'] == 10


def test_a_stamp_may_be_of_all_that_a_replay_has_played(ros):
    node = EolNode.__new__(EolNode)
    hour = 3600 * 10**9
    told = iter((0, 500_000 * hour, 500_007 * hour, 500_000 * hour))  # it begins again
    node.sim_time, node._round, node.now_ns = True, None, lambda: next(told)
    assert node.stamps_span() == checks.ANY_TIME
    for last in (500_000, 500_007, 500_007):
        span = 500_000 * hour - checks.PLAYED_SPAN_NS, last * hour + checks.PLAYED_SPAN_NS
        assert node.stamps_span() == span


@pytest.mark.slow
def test_bytes_that_are_no_message_come_over_dds_and_cost_nothing(live, capfd):
    nodes, motion, recorder = live('motion', 'recorder')
    probe = nodes.add(Probe(MotionSettings(), scene=Scene('probe', {})))
    heard = []
    listen(probe, '/eol/slips', heard.append)
    taps, slips = (probe.publisher(t) for t in ('block_taps', 'slips'))
    nodes.meet()
    before = recorder.health.rejected
    for publisher in (taps, slips):
        publisher.publish(b'\0\1\0\0\7')
    slips.publish(packed(Slip(kind=1, block=3)))
    nodes.until(lambda: motion.health.rejected == 1 and heard)
    nodes.until(lambda: recorder.health.rejected == before + 1)
    assert [slip.block for slip in heard] == [3]
    assert 'overwritten' not in capfd.readouterr().err  # by rclpy, at each


def test_no_node_subscribes_past_the_checks():
    """`create_subscription` of EolNode checks; other files that subscribe are named above."""
    found = {
        (path.parent.name, path.name)
        for path in SOURCE.rglob('*.py')
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and node.attr == 'create_subscription'
    }
    assert found == {('ros', name) for name in {'node.py', 'qos.py', *VISITORS}}
    raw = {
        path.name
        for path in (SOURCE / 'nodes').glob('*.py')
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.keyword) and node.arg == 'raw'
    }
    assert raw == {'recorder.py', 'machine.py'}  # they read bytes by an intake


def real():
    """Return messages of each topic: of the sample bag, and of what it lacks."""
    bag, found = BagReader(SAMPLE), {}
    for message in bag.messages():
        name = next(n for n in TOPICS if bag.name(n) == message.topic)
        some = found.setdefault(name, [])
        if len(some) < 40:
            some.append(message.data)
    pixels = np.zeros((40, 60), np.uint8)
    image = Image(height=40, width=60, step=60, encoding='mono8', data=pixels.tobytes())
    image.header.frame_id = 'camera_optical'
    found['camera/image_raw'] = [packed(image)]
    asks = [
        Asked('set', 'grains', {'radius': 0.1}), Asked('set', 'motion', {'start_mps': 0.01}),
        Asked('sleep'), Asked('wake'), Asked('mute'), Asked('test', 'leds'),
        Asked('play_grain', 'sound', {'grain': 3}), Asked('infrared', 'twin', {'mask': '7'}),
        Asked('move_grain', 'grains', {'grain': 3, 'x': 0.5, 'y': 0.5}), Asked('calibrate'),
        Asked('recall_preset', 'sound', {'preset': 'a', 'over_s': 1.0}),
        Asked('background', 'tracker', data=b'PNG'), Asked('covers', 'tracker', data=b'123'),
        Asked('darkness', 'tracker', {'until_ns': now_ns()}),
    ]  # fmt: skip
    found['requests'] = [packed(request_to_msg(asked, now_ns())) for asked in asks]
    for name in TOPICS:
        found.setdefault(name, [packed(topic_class(name)())])
    return found


def absurd(rng, raw):
    """Return a message with one to four changes: numbers, sizes, ends."""
    data = bytearray(raw)
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        at = rng.randrange(4, max(len(data) - 8, 5)) // 4 * 4
        match rng.randrange(6):
            case 0:
                data[rng.randrange(len(data))] = rng.randrange(256)
            case 1:
                data[at : at + 4] = rng.choice(
                    (b'\xff' * 4, b'\0' * 4, b'\x19\0\0\0', b'\0\0\0\x80')
                )
            case 2:
                data[at : at + 8] = struct.pack('<d', rng.choice((NAN, math.inf, -1e300, 1e7, 0.1)))
            case 3:
                data[at : at + 4] = struct.pack('<f', rng.choice((NAN, -math.inf, 1e30, 1.0)))
            case 4 if rng.random() < 0.3:
                del data[rng.randrange(len(data)) :]
            case 5:
                data[at:at] = rng.randbytes(rng.choice((1, 4, 64)))
        if len(data) < 12:
            break
    return bytes(data) or b'\0'


def numbers(value, name=''):
    """Yield name and each number of a message."""
    if hasattr(value, 'get_fields_and_field_types'):
        for field in value.get_fields_and_field_types():
            yield from numbers(getattr(value, field), field)
    elif isinstance(value, float):
        yield name, value
    elif hasattr(value, 'typecode') or isinstance(value, np.ndarray):
        if not isinstance(value, np.ndarray) or value.dtype.kind == 'f':
            yield from ((name, v) for v in value if isinstance(v, (float, np.floating)))
    elif isinstance(value, list):
        for item in value:
            yield from numbers(item, name)


def good(topic, raw, now):
    """Whether a message may be used: an independent check, with none of the tested code."""
    try:
        m = deserialize_message(raw, topic_class(topic))
    except RuntimeError:
        return False
    kind = type(m).__name__
    if kind in ('Request', 'RequestResult', 'DiagnosticArray', 'MarkerArray'):
        found = []
    elif kind == 'NodeState':  # its arguments and values may be any
        found = [m.rate]
    else:
        found = [v for n, v in numbers(m) if not (kind == 'Corpus' and n in MAY_LACK and v != v)]
    if kind == 'Blocks':
        ids = [b.id for b in m.blocks]
        if ids != list(range(25)) or m.state > 4 or m.header.frame_id.split('/')[-1] != 'table':
            return False
        flags = raw[23], *raw[84::56][:25]  # which rclpy takes to be true whatever they are
        if max(flags) > 1:
            return False
        found = [v for b in m.blocks for _, v in numbers(b) if v == v]
    if not all(abs(v) <= 1e6 for v in found):
        return False
    times = [
        getattr(m, n) for n in ('onset', 'sent', 'flip', 'from_stamp', 'clock') if hasattr(m, n)
    ]
    times += [m.header.stamp] if hasattr(m, 'header') else []
    if kind not in ('Blocks', 'Image') and any(t.sec < 0 or t.nanosec >= 10**9 for t in times):
        return False
    if TOPICS[topic].stamped:
        s = m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 - now
        if abs(s) > 60 or (hasattr(m, 'onset') and m.onset.sec - now > 60):
            return False
    match kind:
        case 'Slip':
            return m.block < 25 and m.kind in (1, 2)
        case 'FeltSlip':
            return m.block < 25 and m.kind in (1, 2, 3)
        case 'BlockTap':
            return m.block < 25
        case 'NodeState':
            return m.level < 4
        case 'GrainTrigger':
            return m.block < 25 or m.block == 255
        case 'Cascade':
            many = len(m.blocks)
            return m.nucleus < 25 and 0 < many == m.area <= 25 and all(b < 25 for b in m.blocks)
        case 'Corpus':
            n = len(m.file)
            same = n == len(m.start) == len(m.duration) and len(m.x) == len(m.y) in (0, n)
            full = len(m.values) in (0, n * len(m.descriptors)) and len(m.bounds) in (0, 4)
            return same and full and all(f < len(m.files) for f in m.file)
        case 'LedCommand':
            return len(m.white) == 25
        case 'Truth':
            return len(m.x) == len(m.y) == len(m.yaw) == len(m.moving) == 25
        case 'SoundMeter':
            return len(m.wave_min) == len(m.wave_max)
        case 'SoundSamples':
            return m.channels > 0 and len(m.samples) % m.channels == 0
        case 'Image':
            rows = m.step >= m.width > 0 and m.height * m.step == len(m.data) > 0  # padded, too
            return rows and m.encoding in ('mono8', '8UC1')
    return True


def live_on(node, topic):
    """Whether a node has subscribed: to some topics only where asked for."""
    return node.resolve_topic_name(topic) in {s.topic_name for s in node.subscriptions}


def restamped(topic, raw, now_s):
    """Return it with the stamp of now, so that most of what is wrong is something else."""
    if not TOPICS[topic].stamped:
        return raw
    return raw.replace(raw[4:8], struct.pack('<i', int(now_s)))  # its onset, too


class Mallinfo2(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t) for name in (
            'arena', 'ordblks', 'smblks', 'hblks', 'hblkhd', 'usmblks', 'fsmblks', 'uordblks',
            'fordblks', 'keepcost',
        )
    ]  # fmt: skip


def in_use_mb():
    """Return the memory that malloc has allocated for all threads (mallinfo(3)), in MB.

    The size of this process is no measure: it has sixteen arenas for the threads of all nodes,
    which keep free memory. A process that bringup starts has two (`MALLOC_ARENA_MAX`).
    """
    gc.collect()
    mallinfo2 = ctypes.CDLL(None).mallinfo2
    mallinfo2.restype = Mallinfo2
    found = mallinfo2()
    return (found.uordblks + found.hblkhd) / 1e6


@pytest.mark.timeout(3600)
@pytest.mark.parametrize('count', [160, pytest.param(10_000, marks=pytest.mark.soak)])
def test_nodes_live_on_and_count_true(live, count):
    nodes, *made = live(*settings(Path()))
    nodes.run(1.0)
    rng, seeds, sizes = random.Random(51), real(), []
    for _ in range(10):
        for topic in TOPICS:
            readers = [node for node in made if topic in NODES[node.NAME].subscribes]
            if topic in ('/clock', 'ready') or not readers:
                continue
            for _ in range(count // 10):
                now_s = time.time()
                raw = absurd(rng, restamped(topic, rng.choice(seeds[topic]), now_s))
                wrong = not good(topic, raw, now_s)
                for node in readers:
                    before = node.health.rejected
                    with np.errstate(invalid='ignore'):  # signalling NaN
                        give(node, topic, raw)
                    dropped = node.health.rejected - before
                    if node.NAME == 'recorder' and topic not in DECODED:
                        assert not dropped
                    elif (node.NAME, topic) in READ:  # what they hold may be bad, too
                        assert wrong <= dropped <= 1
                    elif live_on(node, topic):
                        assert dropped == wrong, (node.NAME, topic, raw, now_s)
            nodes.turn()
        nodes.run(0.2 + count / 10_000)  # else deferred work of nodes stays in memory
        sizes.append(in_use_mb())
    warm = sizes[2:]
    grown = theilslopes(warm, np.linspace(0, 1, len(warm)))
    print('in use, MB:', sizes, grown)
    assert grown.low_slope < 0.05 * warm[0], sizes  # the lower end of its 95 % interval
    nodes.run(2.0)
    for node in made:
        assert node.health.status()['text'] and not node.health.hung

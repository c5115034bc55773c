# SPDX-License-Identifier: Apache-2.0
"""The node osc over real DDS and real UDP: what other programs hear, and what they ask for."""

import contextlib
import itertools
import json
import math
import queue
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from eol_msgs.msg import (
    Cascade,
    Corpus,
    FeltSlip,
    GrainTrigger,
    LedCommand,
    NodeState,
    Slip,
    SoundMeter,
    Wall,
)
from support.running import free_udp_port
from support.spinning import Nodes
from support.waiting import wait_until
from support.work_states import STATES

from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.osc import TimeTag, bundle, decode, encode
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.nodes import osc as module
from eol_ros.nodes.osc import OscNode
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import parameter_messages
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.scene import Scene
from eol_ros.settings import OSC_MESSAGES, OscSettings
from eol_ros.streams.blocks import BLOCK, Blocks
from eol_ros.streams.graph import NODES
from eol_ros.streams.work_state import States

LIBRARIES = Path(sys.prefix, 'browser', 'node_modules')
CLIENT = Path(__file__).parents[1] / 'support' / 'tuio_client.mjs'


class Ear:
    """A program of somebody else that listens, and speaks from the same port."""

    def __init__(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        self.address = f'127.0.0.1:{self.port}'
        self.tags = []
        self.flush = lambda: None  # what a node has to send, where no executor does it

    def take(self):
        self.flush()
        found = []
        while True:
            try:
                packet = self._socket.recv(65536)
            except BlockingIOError:
                return found
            if packet.startswith(b'#bundle'):
                self.tags.append(int.from_bytes(packet[8:16], 'big'))
            found += decode(packet)

    def say(self, port, *messages):
        for address, *values in messages:
            self._socket.sendto(encode(address, *values), ('127.0.0.1', port))

    def throw(self, port, packet):
        self._socket.sendto(packet, ('127.0.0.1', port))

    def close(self):
        self._socket.close()


@pytest.fixture
def ear():
    made = Ear()
    yield made
    made.close()


@pytest.fixture
def node(ros, ear):
    """Return a function that makes the node, which sends to `ear`."""
    made = []

    def make(nodes=(), **settings):
        scene = Scene('here', defaults('osc', *nodes))
        settings = {'send_to': (ear.address,), 'rate_hz': 240.0} | settings
        made.append(OscNode(OscSettings(**settings), scene=scene))
        ear.flush = made[-1].flush
        return made[-1]

    yield make
    for one in made:
        one.close()
        one.destroy_node()


def defaults(*nodes):
    return {name: NODES[name].settings() for name in nodes}


def blocks(table, state=TRACKING, stamp_ns=None):
    rows = np.zeros(table.cells, BLOCK)
    rows['x'], rows['y'] = table.rest.T
    rows['yaw'], rows['sigma'], rows['seen'] = 0.25, 0.5, True
    return Blocks(stamp_ns or now_ns(), state, False, 1, rows)


def stamped(message, stamp_ns, onset_ns=None):
    message.header.stamp = to_msg(stamp_ns)
    if onset_ns is not None:
        message.onset = to_msg(onset_ns)
    return message


def test_events_with_the_time_of_their_image(node, ear):
    one, at = node(), now_ns()
    early = at - 30_000_000
    one.tell('slip', stamped(Slip(block=3, kind=1, slip=7, x=0.5, y=0.25, speed=0.125, cascade=2,
                                  distance=0.0, duration=0.0, tapped=True), at, early))  # fmt: skip
    one.tell('provisional', stamped(FeltSlip(block=4, kind=3, strength=2.0), at, early))
    blocks_of = [4, 3]
    one.tell('cascade', stamped(Cascade(cascade=2**32 - 1, nucleus=4, area=2, size=3, duration=0.5,
                                        blocks=blocks_of, distance=0.25), at, early))  # fmt: skip
    wall = stamped(
        Wall(change=5, moving=True, left='a.png', right='b.png', caption='c'), at - 10**10
    )
    wall.flip = to_msg(at)
    one.on_wall(wall)
    one.on_lights(stamped(LedCommand(white=[0, 255, 3]), at))
    one.on_lights(stamped(LedCommand(white=[0, 255, 3]), at))  # no change
    one.on_meter(stamped(SoundMeter(peak_dbfs=-math.inf, voices=3, load=0.5), at))
    since = pytest.approx(-0.03, abs=1e-6)
    assert ear.take() == [
        ('/eol/slip', 3, 1, 0.5, 0.25, 7, since, 0.125, 0.0, 0.0, 2, 1),
        ('/eol/provisional', 4, 3, 0.0, 0.0, 0, since, 2.0, 0.0),
        ('/eol/cascade', 2**32 - 1, 4, 2, 3, since, 0.5, 0.25, 4, 3),
        ('/eol/wall', 5, 1, 'a.png', 'b.png', 'c'),
        ('/eol/lights', 0, 255, 3),
        ('/eol/meter', -math.inf, 0.0, 0.0, 0.0, 3, 0.5),
    ]
    assert set(ear.tags) == {TimeTag.of(at)}


def test_what_no_image_has_caused_has_the_time_of_now(node, ear):
    one = node()
    one.on_lights(LedCommand(white=[1]))
    assert ear.take() and abs(ear.tags[0] - TimeTag.of(now_ns())) < 5 << 32
    one.on_lights(LedCommand(white=[0]))  # the last of all is not lost, however soon it comes
    one.again()
    assert ear.take() == [('/eol/lights', 0)] * 2


def test_poses_of_blocks_that_have_moved(node, ear):
    one = node(send=('block', 'tracking', 'stress'))
    first = blocks(one.table)
    one.on_blocks(first)
    found = ear.take()
    assert found[0] == ('/eol/block', 0, *map(pytest.approx, one.table.rest[0]), 0.25, 0.5, 1)
    names = [address for address, *_ in found]
    assert names == ['/eol/block'] * 25 + ['/eol/tracking', '/eol/stress']
    assert found[-2][1:] == (TRACKING, 25) and found[-1][1:] == pytest.approx([0.0] * 25, abs=1e-6)
    assert ear.tags == [TimeTag.of(first.stamp_ns)]  # one bundle
    second = blocks(one.table)
    second.rows['x'][3] += 0.01
    second.rows['x'][4] += 0.0004  # noise
    second.rows['x'][5], second.rows['seen'][6] = np.nan, False
    time.sleep(0.01)
    one.on_blocks(second)
    found = ear.take()
    assert [words[:2] for words in found[:2]] == [('/eol/block', 3), ('/eol/block', 6)]
    assert found[2] == ('/eol/tracking', TRACKING, 24)
    assert found[1][-1] == 0 and math.isnan(found[3][1 + 5])
    time.sleep(0.01)
    one.on_blocks(blocks(one.table, state=2))  # lost: nobody knows where any block is
    assert [words[0] for words in ear.take()] == ['/eol/tracking', '/eol/stress']


def test_a_bundle_holds_what_udp_carries(node, ear, monkeypatch):
    monkeypatch.setattr(module, 'FULL', 150)  # a slip has 72 bytes
    one, at = node(send=('slip',)), now_ns()
    for block in range(4):
        one.tell('slip', stamped(Slip(block=block), at, at))
    assert [words[1] for words in ear.take()] == [0, 1, 2, 3]
    assert ear.tags == [TimeTag.of(at)] * 2


def test_messages_leave_by_themselves(ros, ear):
    scene = Scene('here', defaults('osc', 'motion'))
    one = OscNode(OscSettings(send_to=(ear.address,), send=('slip',)), scene=scene)
    motion = Other('motion')
    slips, heard = motion.publisher('slips'), []
    with Nodes(one, motion) as nodes:
        nodes.meet()
        for block in range(5):
            slips.publish(stamped(Slip(block=block, kind=1), now_ns(), now_ns()))
        nodes.until(lambda: heard.extend(ear.take()) or len(heard) == 5)
    assert [words[1] for words in heard] == list(range(5))


def test_a_scene_says_what_is_sent(node, ear):
    one = node(send=('slip', 'grain'))
    one.tell('slip', stamped(Slip(block=3), now_ns(), now_ns()))
    one.on_wall(stamped(Wall(), now_ns()))
    assert [words[0] for words in ear.take()] == ['/eol/slip']
    topics = {s.topic_name for s in one.subscriptions if s.topic_name.startswith('/eol/')}
    assert topics - {'/eol/ready'} == {'/eol/slips', '/eol/corpus', '/eol/grain_triggers',
                                       '/eol/felt_triggers'}  # fmt: skip
    everything = node(tuio=(ear.address,), port=free_udp_port())
    names = {s.topic_name.removeprefix('/eol/') for s in everything.subscriptions}
    assert set(NODES['osc'].optional) - {'work_state'} <= names
    assert set(OSC_MESSAGES) == everything.to.keys()


def trigger(at, grain=1, block=3):
    return stamped(GrainTrigger(grain=grain, block=block, gain=0.5, rate=1.0, pan=-0.5), at)


def test_grains_have_their_descriptors(node, ear):
    one, at = node(send=('grain', 'descriptors')), now_ns()
    one.on_grain(trigger(at, grain=7))
    assert ear.take() == [('/eol/grain', 3, 7, 0.5, 1.0, -0.5)]
    told = Corpus(
        descriptors=['flatness', 'pitch_hz'], values=[0.25, 100.0, 0.5, 200.0],
        x=[0.0, 0.75], y=[0.0, 0.5], file=[0, 0], bounds=[-0.5, -0.5, 0.5, 0.5],
    )  # fmt: skip
    one.on_corpus(stamped(told, at))
    one.on_corpus(stamped(Corpus(), at + 10**10))  # counts from then on
    one.on_grain(trigger(at), felt=True)
    one.on_grain(trigger(at + 20_000_000))  # the image asks for what the knock has sounded
    place = (0.25, 0.0, 0.5, 200.0)
    assert ear.take() == [
        ('/eol/descriptors', 'flatness', 'pitch_hz'),
        ('/eol/descriptors',),
        ('/eol/grain', 3, 1, 0.5, 1.0, -0.5, *place),
    ]
    one.on_corpus(stamped(told, at + 10**10))
    ear.take()
    one.described_s -= 6
    for _ in range(2):  # named again, once, for a listener that came later
        one.on_grain(trigger(at, block=255))
    assert [words[0] for words in ear.take()] == ['/eol/descriptors', '/eol/grain', '/eol/grain']


def state_of(name, row):
    return NodeState(
        node=name, level=row['level'], text=row['text'], code=row['code'], rate=row['rate'],
        args=parameter_messages(row['args']), values=parameter_messages(row['values']),
    )  # fmt: skip


@pytest.mark.parametrize('panel', [True, False])
def test_every_state_of_the_work(node, ear, panel):
    one = node(('panel',) if panel else (), send=('state', 'health'))
    topics = {subscription.topic_name for subscription in one.subscriptions}
    assert ('/eol/work_state' in topics) == panel and '/eol/node_states' in topics
    for code, (rows, english, _) in STATES.items():
        if panel:
            one.on_state((code, english))
        else:
            one.states, one.state, one.levels = States(), None, {}
            for name, row in rows.items():
                one.on_node(state_of(name, row))
        found = ear.take()
        assert [words for words in found if words[0] == '/eol/state'][-1][1:] == (code, english)
        levels = {words[1]: words[2] for words in found if words[0] == '/eol/health'}
        assert panel or levels == {name: row['level'] for name, row in rows.items()}
        one.again()  # for a listener that came later
        assert ear.take() == [('/eol/state', code, english)]


class Other(EolNode):
    """The node that the requests are for."""

    def __init__(self, name):
        self.NAME = name
        super().__init__(NODES[name].settings(), scene=Scene(name, {name: None}))
        self.asked = []
        kinds = ('restore_grain',) if name == 'grains' else ('sleep', 'wake')
        self.requests.serve(**dict.fromkeys(kinds, self.serve))

    def serve(self, asked):
        self.asked.append((asked.kind, asked.source, asked.values))
        if asked.kind == 'restore_grain':
            raise ConfigError('no grain was moved')


def test_requests_are_answered(ros, ear, capfd):
    port = free_udp_port()
    scene = Scene('here', defaults('osc', 'montage', 'grains'))
    one = OscNode(OscSettings(port=port), scene=scene)
    with Nodes(one, Other('montage'), Other('grains')) as nodes:
        nodes.meet()
        _, montage, grains = nodes._nodes
        heard = []

        def answers(count):
            nodes.until(lambda: heard.extend(ear.take()) or len(heard) >= count)
            found, heard[:] = [words[1:] for words in heard], []
            return found

        ear.say(port, ('/eol/call/sleep',))
        assert answers(1) == [('/eol/call/sleep', 1, '')]
        assert montage.asked == [('sleep', 'osc 127.0.0.1', {})]
        for value in range(1, 20):  # a fader: the last of a look counts
            ear.say(port, ('/eol/set/grains/radius', value / 100))
        nodes.until(lambda: grains.settings.radius == 0.19)
        told = answers(1)
        nodes.run(0.2)
        told += [words[1:] for words in ear.take()]
        assert len(told) < 19 and {words[:2] for words in told} == {('/eol/set/grains/radius', 1)}
        assert told[-1][2] == 'radius is 0.19'
        settings = [('/eol/set/grains/radius', 0.2), ('/eol/set/grains/k', 5)]
        ear.throw(port, bundle(TimeTag(1), [encode(*one) for one in settings]))
        told = answers(2)  # of one request
        assert [words[:2] for words in told] == [(address, 1) for address, _ in settings]
        assert told[0][2] == told[1][2] == 'radius is 0.2; k is 5'
        assert (grains.settings.radius, grains.settings.k) == (0.2, 5)
        for wrong in (math.nan, True):  # T is no radius of 1 m
            ear.say(port, ('/eol/set/grains/radius', wrong))
            assert answers(1)[0][1] == 0
        ear.say(port, ('/eol/call/restore_grain', 3), ('/eol/call/mute',), *[('/else', 1)] * 5)
        found = {address: (done, why) for address, done, why in answers(7)}
        assert not any(done for done, _ in found.values())
        assert found['/eol/call/restore_grain'][1] == 'grains: no grain was moved'
        assert found['/eol/call/mute'][1] == 'sound does not run'
        assert found['/else'][1].startswith('no such address')
        assert grains.settings.radius == 0.2
        ear.throw(port, b'no packet')
        nodes.until(lambda: one.input.malformed)
        one.report()
        values = one.health.values
        assert (values['received'], values['refused'], values['malformed']) == (31, 9, 1)
        error = capfd.readouterr().err
        assert 'OSC /eol/call/mute: sound does not run' in error and error.count('OSC /else') == 1
        nodes.end(montage)
        ear.say(port, ('/eol/call/sleep',))
        assert answers(1) == [('/eol/call/sleep', 0, 'montage does not answer')]
        assert not one.client.waiting


def test_replies_go_to_the_port_that_the_scene_names(node, ear):
    port, mouth = free_udp_port(), Ear()
    one = node(port=port, reply_port=ear.port, send_to=())
    mouth.say(port, ('/else', 1))
    wait_until(lambda: one.look() or one.refused)
    assert [words[:3] for words in ear.take()] == [('/eol/reply', '/else', 0)]
    assert mouth.take() == []
    mouth.close()


def test_no_more_requests_wait_than_can_be_answered(node, ear, monkeypatch):
    monkeypatch.setattr(module, 'MOST_OPEN', 2)
    one = node(('sound',), port=free_udp_port(), send_to=())
    ear.say(one.input.port, ('/eol/call/mute',), ('/eol/call/unmute',), ('/eol/call/sleep',))
    wait_until(lambda: one.look() or one.input.received == 3)
    assert [words[1:3] for words in ear.take()] == [('/eol/call/sleep', 0)]
    assert one.client.waiting == 2
    for answers in one.client._open.values():
        answers.until_s = 0.0  # their time is over
    one.look()
    assert len(ear.take()) == 2 and not one.client.waiting and one.refused == 3


def test_requests_that_are_alike_are_one_and_their_replies_one_bundle(node, ear):
    one, other = node(('sound',), port=free_udp_port(), send_to=()), Ear()
    packet = bundle(TimeTag(1), [encode('/eol/call/mute')] * 2 + [encode('/eol/call/mute', 1)])
    ear.throw(one.input.port, packet)
    other.say(one.input.port, ('/eol/call/mute',))
    wait_until(lambda: one.look() or one.input.received == 4)
    assert one.client.waiting == 2  # with its 1 it is another one
    for answers in list(one.client._open.values()):
        one.answered(answers.done.args[0], answers)  # in vain, of no node
    one.flush()
    assert [len(found) for found in (ear.take(), other.take())] == [3, 1]
    assert ear.tags == [TimeTag(1)] and other.tags == []
    other.close()


def test_what_cannot_be(ros, ear):
    for settings, what in (
        ({}, 'nothing to do: set send_to'),
        ({'send_to': ('here',)}, "'here': give HOST:PORT"),
        ({'tuio': ('127.0.0.1:x',)}, 'give HOST:PORT'),
        ({'port': 9, 'peers': ('synth.lan',)}, 'give an IPv4 address or network'),
    ):
        with pytest.raises(ConfigError, match=what):
            OscNode(OscSettings(**settings))
    with pytest.raises(DeviceMissing, match=f'port {ear.port}: it cannot be had'):
        OscNode(OscSettings(port=ear.port))


def test_a_peer_that_is_gone_is_no_fault_and_a_name_that_is_not_known_is_told(node):
    one = node(send_to=(f'127.0.0.1:{free_udp_port()}', 'no-such-host.invalid:9'))
    for _ in range(20):
        one.tell('slip', stamped(Slip(), now_ns(), now_ns()))
    wait_until(lambda: one.outs[1].trouble)
    one.report()
    assert one.health.level == 1
    assert one.health.text.startswith('not sent: no-such-host.invalid:9: ')
    assert one.outs[0].trouble == '' and one.sent == 20


def test_tuio_over_the_wire(node, ear):
    two = Ear()
    one = node(send_to=(), tuio=(ear.address,), tuio2=(two.address,))
    at = now_ns()
    one.on_blocks(blocks(one.table, stamp_ns=at))
    first, second = ear.take(), two.take()
    assert first[0] == ('/tuio/2Dobj', 'source', 'eol@127.0.0.1')
    assert first[1] == ('/tuio/2Dobj', 'alive', *range(1, 26)) and len(first) == 28
    assert first[-1] == ('/tuio/2Dobj', 'fseq', 1)
    assert second[0][1] == 1 and second[0][3:] == (1400 << 16 | 1400, 'eol:0@0x7F000001')
    assert second[-1] == ('/tuio2/alv', *range(1, 26)) and len(second) == 27
    assert ear.tags == two.tags == [TimeTag.of(at)]
    one.restart()
    one.on_blocks(blocks(one.table, stamp_ns=at - 10**9))
    assert ear.take()[1] == ('/tuio/2Dobj', 'alive', *range(26, 51))
    one.send_tokens(at, np.full((25, 3), np.nan))
    assert ear.take()[1] == ('/tuio/2Dobj', 'alive')
    two.close()


@pytest.mark.parametrize('version', [1, 2])
def test_a_client_library_of_others_follows_the_blocks(node, version):
    """tuio-client of a maker of TUIO tables, from npm, in a process of its own."""
    if not (LIBRARIES / 'tuio-client').exists():
        pytest.skip('tools/setup_env.sh test installs tuio-client, with npm')
    words = ['node', str(CLIENT), str(LIBRARIES), str(version)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as client:
        try:
            lines = queue.Queue()
            threading.Thread(target=lambda: [*map(lines.put, client.stdout)], daemon=True).start()
            address = (f'127.0.0.1:{int(lines.get(timeout=60.0))}',)
            one = node(send_to=(), **{'tuio' if version == 1 else 'tuio2': address})
            at, frames = now_ns(), itertools.count()

            def shown(**change):
                told = blocks(one.table, stamp_ns=at + next(frames) * 20_000_000)
                for name, value in change.items():
                    told.rows[name][7] = value
                one.on_blocks(told)
                one.flush()
                with contextlib.suppress(queue.Empty):  # UDP may lose it
                    return lines.get(timeout=10.0)

            def frame(**change):
                return {row[1]: row for row in json.loads(wait_until(lambda: shown(**change)))}

            def whole(ids, **change):
                found = frame(**change)
                return sorted(found) == ids and found

            everywhere, x = [*range(25)], one.table.rest[7, 0]
            places = wait_until(lambda: whole(everywhere))
            x0, angle = places[7][2], places[7][4]
            assert angle == pytest.approx(2 * math.pi - 0.25)
            places = [frame(x=x + 0.01 * k)[7] for k in range(1, 6)][-1]
            wide_m = one.table.platform_m[0]
            assert places[2] == pytest.approx(x0 + 0.05 / wide_m, abs=1e-6)
            assert places[5] == pytest.approx(0.5 / wide_m, rel=0.02)
            everywhere.remove(7)
            assert wait_until(lambda: whole(everywhere, seen=False, x=np.nan, y=np.nan))
        finally:
            client.kill()

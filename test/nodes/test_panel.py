# SPDX-License-Identifier: Apache-2.0
"""The panel node over real DDS: from the graph to a WebSocket, from people to the graph."""

import asyncio
import json
import struct
import threading
import time
import urllib.request

import aiohttp
import numpy as np
import pytest
from eol_msgs.msg import Calibration as CalibrationMessage
from eol_msgs.msg import Cascade, NodeState, RequestResult, Wall
from sensor_msgs.msg import CompressedImage
from support.spinning import Nodes, matched
from support.tables import on_tables
from support.waiting import wait_until

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.nodes import panel_streams
from eol_ros.nodes.panel import PanelNode
from eol_ros.nodes.panel_streams import STREAMS
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import request_from_msg
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.scene import Scene
from eol_ros.settings import GrainsSettings, PanelSettings
from eol_ros.streams import blocks, calibrations
from eol_ros.web.hub import CHANNELS

GIVES = ('wall', 'cascades', 'corpus', 'blocks', 'camera/image_raw/compressed',
         'sound_meter', 'sound_samples', 'slips', 'calibration')  # fmt: skip

pytestmark = pytest.mark.usefixtures('any_stamp')


class Around(EolNode):
    """Stands in for all other nodes; its name is grains, so that settings can be changed."""

    NAME = 'grains'

    def __init__(self):
        super().__init__(GrainsSettings())
        self.gives = {name: self.publisher(name) for name in GIVES}
        self.states = self.publisher('node_states')
        self.asked, self.rims, self.works = [], [], []
        self.subscribe('work_state', self.works.append)
        self.subscribe('requests', self.on_asked)
        self.subscribe('rim_command', self.rims.append)
        self.answers = self.publisher('request_results')

    def on_asked(self, message):
        """Answer for the sound: it sleeps, and has no grains."""
        self.asked.append(request_from_msg(message))
        if message.kind != 'set':
            good = message.kind == 'sleep'
            reason = '' if good else 'no such grain'
            self.answers.publish(
                RequestResult(id=message.id, node='sound', accepted=good, reason=reason)
            )


class Rig(Nodes):
    """The test talks to the panel, so a thread turns the nodes."""

    def __init__(self, table):
        scene = Scene('panel', {}, table=table)
        self.panel, self.around = PanelNode(PanelSettings(port=0), scene=scene), Around()
        super().__init__(self.panel, self.around)
        self.url = f'http://127.0.0.1:{self.panel.server.port}'
        self.stopping = False
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self):
        while not self.stopping:
            self.turn()

    def readers(self, topic):
        return self.around.gives[topic].get_subscription_count()

    def close(self):
        self.stopping = True
        self.thread.join(5)
        super().close()


@pytest.fixture
def rig(ros, table, tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    monkeypatch.setattr(panel_streams, 'LINGER_S', 0.3)
    with Rig(table) as made:
        wait_until(lambda: matched(made.panel, made.around))
        yield made


def live(rig, talk):
    async def session():
        async with aiohttp.ClientSession() as client, client.ws_connect(f'{rig.url}/live') as ws:
            return await asyncio.wait_for(talk(ws), 60)

    return asyncio.run(session())


async def packet(ws, kind):
    while True:
        message = await ws.receive(timeout=30)
        if message.type == aiohttp.WSMsgType.BINARY and message.data[0] == kind:
            return message.data


def test_every_stream_has_its_topic_and_its_channel():
    assert set(STREAMS) == CHANNELS


@pytest.mark.slow
@on_tables
def test_streams_run_only_while_somebody_looks(rig, table):
    streams = ('blocks', 'camera/image_raw/compressed', 'sound_meter', 'sound_samples', 'slips')
    assert not any(rig.readers(topic) for topic in streams)

    async def talk(ws):
        await ws.send_str('{"wants": ["blocks", "image"]}')
        await asyncio.to_thread(wait_until, lambda: rig.readers('blocks'))
        await asyncio.to_thread(wait_until, lambda: rig.readers('camera/image_raw/compressed'))
        assert not rig.readers('sound_samples') and not rig.readers('slips')
        rows = np.zeros(table.cells, blocks.BLOCK)
        rows['x'], rows['seen'] = np.arange(table.cells) / 100, table.present
        codec = blocks.Codec(definition(blocks.TYPE), cells=table.cells)
        stamp_ns = now_ns()
        rig.around.gives['blocks'].publish(codec.pack(stamp_ns, 1, False, 7, rows))
        data = await packet(ws, 1)
        assert struct.unpack_from('<d', data, 8)[0] == pytest.approx(stamp_ns * 1e-9, abs=1e-6)
        shown = np.frombuffer(data, '<f4', offset=16).reshape(table.cells, 8)
        assert shown[table.ids, 0] == pytest.approx(table.ids / 100)
        assert shown[:, 7].tolist() == table.present.tolist()
        image = CompressedImage(format='jpeg')
        image.data.frombytes(b'\xff\xd8jpeg')
        rig.around.gives['camera/image_raw/compressed'].publish(image)
        assert (await packet(ws, 3))[16:] == b'\xff\xd8jpeg'
        await ws.send_str('{"wants": []}')
        await asyncio.to_thread(wait_until, lambda: not rig.readers('blocks'))

    live(rig, talk)
    wait_until(lambda: not any(rig.readers(topic) for topic in streams))


@pytest.mark.slow
def test_a_latecomer_is_told_wall_day_and_health(rig):
    rig.around.gives['wall'].publish(Wall(change=9, left='a.svg', right='b.svg', ahead=['c', 'd']))
    for area in (1, 1, 3):
        cascade = Cascade(area=area, size=area, blocks=range(area))
        cascade.onset = to_msg(now_ns())
        rig.around.gives['cascades'].publish(cascade)
    row = calibrations.of(now_ns(), Calibration.ideal(640, 400))
    message = calibrations.RECORD.fill(CalibrationMessage(), row)
    rig.around.gives['calibration'].publish(message)
    wait_until(lambda: sum(rig.panel.day.notice()['areas']) == 3)

    async def talk(ws):
        told = {}
        while not {'wall', 'cascades', 'health panel', 'camera'} <= set(told):
            message = await ws.receive(timeout=30)
            if message.type == aiohttp.WSMsgType.TEXT:
                data = json.loads(message.data)
                told[' '.join((data['t'], data.get('node', ''))).strip()] = data
        wall, day, status = (told[name] for name in ('wall', 'cascades', 'health panel'))
        assert (wall['change'], wall['left'], wall['ahead']) == (9, 'a.svg', ['c', 'd'])
        assert (told['camera']['width'], told['camera']['height']) == (640, 400)
        assert day['areas'][1] == 2 and day['areas'][3] == 1
        assert status['level'] == 'ok' and rig.url in status['text']

    wait_until(lambda: {'panel', 'grains'} <= set(rig.panel.roster.states(time.monotonic())))
    live(rig, talk)
    with urllib.request.urlopen(f'{rig.url}/status', timeout=30) as answer:
        assert set(json.load(answer)) >= {'panel', 'grains'}


@pytest.mark.slow
def test_a_page_opened_during_a_test_is_told_of_it(rig):
    def told(code):
        return bool(rig.around.works) and rig.around.works[-1].code == code

    async def first_state(ws):
        while (data := json.loads((await ws.receive(timeout=30)).data))['t'] != 'work':
            pass
        return data

    rig.around.health.ok('well')
    wait_until(lambda: told('awake'))
    rig.panel.on_test(None)
    wait_until(lambda: told('test'))
    assert live(rig, first_state)['said'] == [['test', {}]]
    rig.panel.test_until_s = 0.0
    wait_until(lambda: told('awake'))
    assert [work.text for work in rig.around.works[-3:]] == ['awake', 'test running', 'awake']


def test_a_restart_forgets_no_address_that_gave_the_pin(rig):
    for known in ([], ['192.168.1.9']):
        node = PanelNode(PanelSettings(port=0, host='0.0.0.0', pin='471147'))
        try:
            gate = node.server.routes.pin
            assert gate.known == known
            assert gate.check('471147', '192.168.1.9', 0.0) == 'ok'
        finally:
            node.close()
            node.destroy_node()


@pytest.mark.slow
def test_what_people_ask_reaches_the_graph(rig):
    async def post(client, name, body):
        async with client.post(f'{rig.url}/control/{name}', data=json.dumps(body)) as answer:
            return answer.status, await answer.json()

    async def talk(ws):
        async with aiohttp.ClientSession() as client:
            status, answer = await post(client, 'sleep', {})
            assert (status, answer['error']) == (409, 'leds, sound, montage do not run')
            status, answer = await post(client, 'play', {'grain': 12})
            assert (status, answer['error']) == (409, 'sound does not run')
            rig.around.states.publish(NodeState(node='sound'))
            runs = rig.panel.runs
            await asyncio.to_thread(wait_until, lambda: runs('sound') and runs('grains'))
            assert await post(client, 'sleep', {}) == (200, {'ok': True, 'text': '', 'said': []})
            status, answer = await post(client, 'play', {'grain': 12})
            assert (status, answer['error']) == (409, 'sound: no such grain')
            said = [['is_now', {'setting': 'radius', 'value': '0.125'}]]
            told = {'ok': True, 'text': 'radius is 0.125', 'said': said}
            told |= {'node': 'grains', 'values': {'radius': 0.125}}
            assert await post(client, 'radius', {'value': 0.125}) == (200, told)
            status, answer = await post(client, 'calibrate', {})
            assert status == 409 and 'tracker does not run' in answer['error']
        await ws.send_str('{"rim": [0.1, -0.2, 0.3]}')
        await asyncio.to_thread(wait_until, lambda: rig.around.rims)

    live(rig, talk)
    wait_until(lambda: len(rig.around.rims) >= 2)
    asked = rig.around.asked
    assert [(a.kind, a.node, a.values) for a in asked] == [
        ('sleep', '', {}), ('play_grain', '', {'grain': 12}), ('set', 'grains', {'radius': 0.125}),
    ]  # fmt: skip
    assert {a.source for a in asked} == {'panel 127.0.0.1'} and len({a.id for a in asked}) == 3
    assert rig.around.settings.radius == 0.125
    push, release = rig.around.rims[0], rig.around.rims[-1]
    assert (push.vx, push.vy, push.yaw_rate) == (0.1, -0.2, 0.3) and 0 < push.hold <= 1
    assert (release.vx, release.vy, release.yaw_rate) == (0.0, 0.0, 0.0)

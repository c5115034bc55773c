# SPDX-License-Identifier: Apache-2.0
"""The server as browsers, programs and attackers meet it."""

import asyncio
import contextlib
import dataclasses
import gzip
import json
import re
import socket
import time
import urllib.error
import urllib.request
from pathlib import Path

import aiohttp
import pytest
from support.waiting import wait_until

from eol_ros.core import terrain
from eol_ros.core.budget import Budget
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.said import said
from eol_ros.streams.requests import KINDS
from eol_ros.web import screens
from eol_ros.web.controls import CONTROLS
from eol_ros.web.hub import FULL
from eol_ros.web.routes import MAX_MESSAGE


def ask(server, path, body=None, **headers):
    """Return status, headers and text of a request; a body makes it a POST."""
    request = urllib.request.Request(
        f'http://127.0.0.1:{server.port}{path}',
        data=None if body is None else body.encode(),
        headers={k.replace('_', '-'): v for k, v in headers.items()},
    )
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status, answer.headers, answer.read().decode('utf-8', 'replace')
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read().decode()


def raw(server, text):
    """Send bytes as they are and return what comes back."""
    with socket.create_connection(('127.0.0.1', server.port), 5) as sock:
        sock.sendall(text)
        sock.settimeout(5)
        return sock.recv(65536)


def live(server, talk, **options):
    """Run `talk(websocket)` with a WebSocket client."""

    async def session():
        async with aiohttp.ClientSession() as client:
            url = f'http://127.0.0.1:{server.port}/live'
            async with client.ws_connect(url, **options) as ws:
                return await asyncio.wait_for(talk(ws), 60)

    return asyncio.run(session())


async def notice(ws, kind):
    """Return the next notice of a kind."""
    while True:
        message = await ws.receive(timeout=30)
        assert message.type == aiohttp.WSMsgType.TEXT, message
        data = json.loads(message.data)
        if data['t'] == kind:
            return data


async def wants(server, ws, channel):
    """Ask for a channel, and wait until the server knows."""
    await notice(ws, 'hello')
    await ws.send_json({'wants': [channel]})
    while server.hub.demand != {channel}:
        await asyncio.sleep(0.01)


async def closed(ws):
    """Return the code with which the server closes."""
    while True:
        message = await ws.receive(timeout=30)
        if message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED):
            return ws.close_code


@pytest.mark.parametrize('path', ['/', '/table', '/wall/left', '/wall/right', '/static/link.js'])
def test_pages_come_with_the_policy(serve, path):
    status, headers, text = ask(serve(), path)
    assert status == 200 and len(text) > 200
    assert headers['Content-Security-Policy'].startswith("default-src 'none'")
    assert headers['X-Content-Type-Options'] == 'nosniff'
    server = serve()
    assert ask(server, path, If_None_Match=headers['ETag'])[0] == 304


@pytest.mark.parametrize(
    'path',
    [
        '/static/../server.py',
        '/static/%2e%2e/server.py',
        '/static/..%2f..%2fsettings.py',
        '/static//etc/passwd',
        '/media/../../etc/passwd',
        '/media/%2e%2e/%2e%2e/etc/passwd',
        '/media/etc/passwd',
        '/wall/..',
        '/nothing',
        '/static/',
        '/corpus',
    ],
)
def test_what_is_not_offered_is_not_found(serve, path):
    answer = raw(
        serve(), f'GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n'.encode()
    )
    assert answer.startswith(b'HTTP/1.1 404') and b'root:' not in answer and b'SPDX' not in answer


def test_pictures_only_of_pairs_and_powerless(serve, tmp_path):
    (tmp_path / 'a.svg').write_text('<svg xmlns="http://www.w3.org/2000/svg"><script/></svg>')
    (tmp_path / 'c.svgz').write_bytes(gzip.compress((tmp_path / 'a.svg').read_bytes()))
    names = ('a.svg', 'c.svgz', 'gone.png')
    server = serve(picture={name: tmp_path / name for name in names}.get)
    for name, encoding in (('a.svg', None), ('c.svgz', 'gzip')):
        status, headers, _ = ask(server, f'/media/{name}')
        assert status == 200 and headers['Content-Type'] == 'image/svg+xml'
        assert headers.get('Content-Encoding') == encoding
        assert 'script-src' not in headers['Content-Security-Policy']
        assert headers['Content-Security-Policy'].startswith("default-src 'none'")
    assert ask(server, '/media/gone.png')[0] == ask(server, '/media/b.svg')[0] == 404


def test_foreign_hosts_and_origins_are_refused_in_one_line(serve):
    server = serve()
    assert ask(server, '/', Host='evil.example')[0] == 403
    assert ask(server, '/control/wake', '{}', Origin='http://evil.example')[0] == 403
    with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
        live(server, closed, origin='http://evil.example')
    assert caught.value.status == 403
    assert server.bridge.calls == []
    assert len(server.lines) == 2 and all('\n' not in line for line in server.lines)
    own = f'http://127.0.0.1:{server.port}'
    assert ask(server, '/control/wake', '{}', Origin=own)[0] == 200


def test_strangers_of_many_addresses_write_one_line(serve):
    server = serve()
    for k in range(1000):
        server.say(f'too many wrong PINs from 2001:db8::{k:x}: locked out for 9 s')
        server.say(f'Error handling request from 10.0.{k // 256}.{k % 256}: ValueError()')
    assert len(server.lines) == len(server._said) == 2


def test_each_control_reaches_the_graph(serve):
    server = serve()
    bodies = {
        'cue': {'name': 'evening'},
        'gain_db': {'value': -12.0},
        'radius': {'value': 0.05},
        'play': {'grain': 7},
        'axes': {'x': 'centroid_mean_hz', 'y': 'loudness'},
        'move': {'grain': 3, 'x': 0.5, 'y': 1},
        'blend': {'value': 0.5},
        'restore': {'grain': 3},
        'mode': {'value': 'chain'},
        'weights': {'value': ['ice 0.5']},
        'regions': {'value': []},
        'paths': {'value': ['0,0 1,1']},
        'filter': {'value': 'low-pass'},
        'filter_hz': {'value': 300},
        'filter_q': {'value': 2},
        'filter_by': {'value': 'area'},
        'filter_octaves': {'value': -2},
        'save_preset': {'preset': 'calm'},
        'recall_preset': {'preset': 'calm', 'over_s': 3},
        'morph_presets': {'from': 'calm', 'to': 'storm', 'share': 0.25},
    }
    for name in CONTROLS:
        status, _, text = ask(server, f'/control/{name}', json.dumps(bodies.get(name, {})))
        answer = json.loads(text)
        assert (status, answer.pop('ok'), answer.pop('text'), answer.pop('said')) == (
            200, True, '', [],
        ), name  # fmt: skip
        kind, node, values, _ = server.bridge.calls[-1]
        told = {'node': node, 'values': json.loads(json.dumps(values))} if kind == 'set' else {}
        assert answer == told, 'the page learns the new value from the answer'
    calls = server.bridge.calls
    people = 'panel 127.0.0.1'
    for name in ('sleep', 'wake', 'mute', 'unmute', 'test', 'calibrate', 'learn_background'):
        assert (name, '', {}, people) in calls
    assert ('set', 'grains', {'radius': 0.05}, people) in calls
    axes = {'x_axis': 'centroid_mean_hz', 'y_axis': 'loudness'}
    assert ('set', 'grains', axes, people) in calls
    assert ('set', 'twin', {'hands': 'visitors'}, people) in calls
    assert ('set', 'twin', {'hands': 'nobody'}, people) in calls
    assert ('play_grain', '', {'grain': 7}, people) in calls
    assert ('move_grain', '', {'grain': 3, 'x': 0.5, 'y': 1.0}, people) in calls
    assert ('set', 'sound', {'filter': 'low-pass'}, people) in calls
    assert ('set', 'grains', {'weights': ('ice 0.5',)}, people) in calls
    assert ('recall_preset', '', {'preset': 'calm', 'over_s': 3.0}, people) in calls
    assert len(calls) == len(CONTROLS)


def test_the_answer_is_that_of_the_nodes(serve):
    server = serve()
    server.bridge.answer = False, said('no_grain', grain=7, last=3)
    status, _, text = ask(server, '/control/play', '{"grain": 7}')
    assert status == 409
    why = [['no_grain', {'grain': '7', 'last': '3'}]]
    assert json.loads(text) == {
        'error': 'sound: grain 7: the corpus has grains 0 to 3',
        'said': [['of_node', {'node': 'sound', 'why': why}]],
    }
    server.bridge.answer = True, 'background learnt'
    status, _, text = ask(server, '/control/learn_background', '{}')
    assert (status, json.loads(text)['text']) == (200, 'background learnt')


def test_a_node_that_does_not_answer_is_named(serve, monkeypatch):
    server = serve()
    server.bridge.answer = None
    monkeypatch.setitem(KINDS, 'mute', dataclasses.replace(KINDS['mute'], within_s=0.05))
    status, _, text = ask(server, '/control/mute', '{}')
    parts = [['does_not_answer', {'names': 'sound'}]]
    assert (status, json.loads(text)) == (409, {'error': 'sound does not answer', 'said': parts})
    assert server.bridge.calls[-1] == ('give up', 'mute')


def test_a_node_that_does_not_run_is_named(serve):
    server = serve()
    server.bridge.missing = {'tracker', 'sound'}
    bodies = (('calibrate', '{}'), ('learn_background', '{}'), ('play', '{"grain": 1}'))
    for name, body in bodies:
        status, _, text = ask(server, f'/control/{name}', body)
        assert status == 409 and json.loads(text)['error'].endswith('does not run'), name
    assert server.bridge.calls == []
    assert ask(server, '/control/sleep', '{}')[0] == 200  # leds and montage do


@pytest.mark.parametrize(
    ('name', 'body', 'words'),
    [
        ('radius', '', 'value: missing'),
        ('radius', '{"value": null}', 'is not a number, text or list of texts'),
        ('weights', '{"value": [1]}', 'is not a number, text or list of texts'),
        ('radius', '{"value": NaN}', 'not JSON: a number that is not finite'),
        ('move', '{"grain": 1, "x": 9, "y": 0}', 'not within 0 to 1'),
        ('move', '{"grain": true, "x": 0, "y": 0}', 'not a number'),
        ('radius', '{"value": 0.1, "more": 1}', 'more: radius takes'),
        ('play', '{"grain": 1.5}', 'not a whole number'),
        ('axes', '{"x": "a b", "y": "c"}', 'is not a name'),
        ('sleep', '[]', 'a JSON object'),
        ('sleep', '{', 'not JSON'),
        ('sleep', '[' * 16000, 'not JSON'),
        ('dance', '{}', 'controls are: sleep'),
    ],
)
def test_bad_requests_are_told_what_is_wrong(serve, name, body, words):
    server = serve()
    status, _, text = ask(server, f'/control/{name}', body)
    assert status in (400, 404) and words in json.loads(text)['error']
    assert server.bridge.calls == []


def test_a_long_body_and_a_wrong_method(serve):
    server = serve()
    status, _, text = ask(server, '/control/sleep', 'x' * 16385)
    assert status == 413 and json.loads(text)['error'] == 'a request has at most 16384 bytes'
    path = ' '.join(['0.20,0.25'] * 100)
    assert ask(server, '/control/paths', json.dumps({'value': [path] * 16}))[0] == 200
    assert ask(server, '/control/sleep')[0] == 405
    assert ask(server, '/', '{}')[0] == 405


WHOLE = {'corners': [[0, 0], [1, 0], [1, 1], [0, 1]], 'edges': [0, 0, 0.1, 0]}


def test_a_screen_is_kept_by_its_name_with_the_pin(serve):
    server = serve(host='0.0.0.0', pin='471147')
    assert json.loads(ask(server, '/screen/north')[2]) == {}
    assert ask(server, '/screen/north', json.dumps(WHOLE))[0] == 401
    assert ask(server, '/screen/north', json.dumps(WHOLE), X_Pin='471147')[0] == 200
    assert json.loads(ask(server, '/screen/north')[2]) == WHOLE
    assert ask(server, '/screen/North!')[0] == 404
    for number in range(15):
        assert ask(server, f'/screen/s{number}', json.dumps(WHOLE), X_Pin='471147')[0] == 200
    assert ask(server, '/screen/one-more', json.dumps(WHOLE), X_Pin='471147')[0] == 409
    assert screens.kept(server.routes.screens | {'bad': {'corners': 1}}) == server.routes.screens
    assert screens.kept(None) == {}


@pytest.mark.parametrize(
    'wrong',
    [[], {}, {**WHOLE, 'more': 1}, {**WHOLE, 'edges': [0, 0, 0, 1]}, {**WHOLE, 'edges': [0, 0, 0]},
     {**WHOLE, 'corners': [[0, 0], [1, 0], [1, 1]]}, {**WHOLE, 'corners': [[0, 0]] * 4},
     {**WHOLE, 'corners': [[0, 0], [1, 0], [1, 1], [0, 'x']]},
     {**WHOLE, 'corners': [[0, 0], [0, 1], [1, 1], [1, 0]]},
     {**WHOLE, 'corners': [[0, 0], [1, 0], [0.1, 0.1], [0, 1]]}],
)  # fmt: skip
def test_a_screen_that_makes_no_sense_is_refused_in_words(serve, wrong):
    server = serve()
    code, _, text = ask(server, '/screen/left', json.dumps(wrong))
    assert code == 400 and json.loads(text)['error'] and server.routes.screens == {}
    assert ask(server, '/screen/left', '{')[0] == 400


def test_open_to_the_network_every_control_asks_for_the_pin(serve):
    server = serve(host='0.0.0.0', pin='471147')
    for name in CONTROLS:
        assert ask(server, f'/control/{name}', '{}')[0] == 401
    assert ask(server, '/wall/left')[0] == 200  # walls stay read-only and open
    assert ask(server, '/control/sleep', '{}', X_Pin='471147')[0] == 200
    for _ in range(3):
        assert ask(server, '/pin', '', X_Pin='000000')[0] == 401
    status, headers, text = ask(server, '/control/sleep', '{}', X_Pin='471147')
    assert status == 429 and headers['Retry-After'] in ('1', '2') and 'wait' in text
    assert server.bridge.calls == [('sleep', '', {}, 'panel 127.0.0.1')]
    with pytest.raises(ConfigError):
        serve(host='0.0.0.0')


def test_hands_on_the_rim_need_trust_and_are_bounded(serve):
    server = serve(host='0.0.0.0', pin='471147')

    async def talk(ws):
        assert (await notice(ws, 'hello'))['push'] is False
        await ws.send_str('{"rim": [0.1, 0, 0]}')
        await ws.send_str('{"pin": "000000"}')
        assert (await notice(ws, 'trust'))['ok'] is False
        await ws.send_str('{"rim": [0.1, 0, 0]}')
        await ws.send_str('{"pin": "471147"}')
        assert (await notice(ws, 'trust'))['push'] is True
        await ws.send_str('{"rim": [30, 40, 1]}')
        await ws.send_str('{"ping": 1}')
        await notice(ws, 'pong')

    live(server, talk)
    wait_until(lambda: len(server.bridge.calls) > 1)
    (_, source, velocity, hold_s), last = server.bridge.calls
    assert velocity == pytest.approx((0.36, 0.48, 0.012)) and 0 < hold_s <= 1
    assert last == ('rim', source, (0.0, 0.0, 0.0), hold_s)  # gone: the hand lets go


@pytest.mark.parametrize(
    ('settings', 'kept'),
    [
        ({}, {'image', 'sound'}),
        ({'public': ('image',)}, {'sound'}),
        ({'visitors': True}, {'image'}),
        ({'public': ('image', 'sound')}, set()),
    ],
)
def test_camera_and_sound_are_for_those_with_the_pin(serve, settings, kept):
    server = serve(host='0.0.0.0', pin='471147', **settings)
    wants = {'blocks', 'image', 'sound'}

    async def talk(ws):
        hello = await notice(ws, 'hello')
        assert set(hello['private']) == kept
        assert hello['push'] is settings.get('visitors', False)
        await ws.send_str('{"rim": [0.1, 0, 0]}')

        async def wanted():
            await ws.send_str('{"ping": 1}')
            await notice(ws, 'pong')
            (viewer,) = server.hub.viewers
            return viewer.wants

        await ws.send_str(json.dumps({'wants': sorted(wants)}))
        assert await wanted() == wants - kept
        await ws.send_str('{"pin": "471147"}')
        assert (await notice(ws, 'trust'))['private'] == []
        assert await wanted() == wants  # without asking again
        await ws.send_str('{"pin": "000000"}')
        assert set((await notice(ws, 'trust'))['private']) == kept
        assert await wanted() == wants - kept

    live(server, talk)
    pushes = [call[2] for call in server.bridge.calls]
    assert pushes[:1] == [(0.1, 0.0, 0.0)] * bool(settings.get('visitors'))


def test_no_answer_names_a_library_or_a_version(serve):
    server = serve()
    for text in (
        b'GET / HTTP/1.1\r\nHost: localhost\r\n\r\n',
        b'GET /nothing HTTP/1.1\r\nHost: localhost\r\n\r\n',
        b'GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n',
        b'POST /control/sleep HTTP/1.1\r\nHost: localhost\r\nContent-Length: x\r\n\r\n',
        b'nonsense\r\n\r\n',
    ):
        answer = raw(server, text).decode('latin-1')
        head = answer.partition('\r\n\r\n')[0].lower()
        assert 'server: eol\r\n' in head + '\r\n'
        assert 'aiohttp' not in answer.lower() and 'python' not in answer.lower()


@pytest.mark.parametrize(
    'message',
    [
        'hello',
        '[]',
        '{}',
        '{"rim": [1, 2]}',
        '{"rim": [1, 2, null]}',
        '{"rim": [NaN, 0, 0]}',
        '{"rim": [0,0,0], "wants": []}',
        '{"wants": "blocks"}',
        '{"wants": [1]}',
        '{"pin": 471147}',
        '{"pace": -1}',
        '{"pace": true}',
        '{"pace": NaN}',
        '{"flipped": ["up", 1, 2]}',
        '{"__class__": 1}',
        '{"rim": [1e999, 0, 0]}',
        f'{{"ping": 1{"0" * 400}}}',
        f'{{"flipped": ["left", 1, 1{"0" * 400}]}}',
        r'{"pin": "\ud800"}',
        '[' * 3000,
    ],
)
def test_malformed_messages_end_the_connection_in_one_line(serve, message):
    server = serve()

    async def talk(ws):
        await ws.send_str(message)
        return await closed(ws)

    assert live(server, talk) == aiohttp.WSCloseCode.POLICY_VIOLATION
    assert len(server.lines) == 1 and server.lines[0].startswith('refused message')
    assert server.bridge.calls == []
    assert ask(server, '/')[0] == 200


def test_binary_and_oversized_messages_end_the_connection(serve):
    server = serve()

    async def binary(ws):
        await ws.send_bytes(b'\0' * 10)
        return await closed(ws)

    async def large(ws):
        await ws.send_str('x' * (MAX_MESSAGE + 1))
        return await closed(ws)

    assert live(server, binary) == aiohttp.WSCloseCode.POLICY_VIOLATION
    assert live(server, large) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
    assert ask(server, '/')[0] == 200


def test_a_flood_of_messages_ends_the_connection(serve):
    server = serve()

    async def talk(ws):
        for _ in range(2000):
            await ws.send_str('{"wants":["blocks"]}')
        return await closed(ws)

    # The sender may meet the closed door before it reads why: both are refusals.
    with contextlib.suppress(ConnectionError, aiohttp.ClientError):
        assert live(server, talk) == aiohttp.WSCloseCode.POLICY_VIOLATION
    assert 'too many at once' in server.lines[0]


def test_garbage_instead_of_http_is_one_line_at_most(serve):
    server = serve()
    for text in (
        b'\x16\x03\x01\x02\x00\x01\x00',
        b'GET / HTTP/9.9\r\n\r\n',
        b'\0' * 9000,
        b'A' * 70000,
    ):
        try:
            raw(server, text + b'\r\n\r\n')
        except (ConnectionError, TimeoutError):
            pass
    assert ask(server, '/')[0] == 200
    assert all('\n' not in line and 'Traceback' not in line for line in server.lines)


def test_one_viewer_more_than_allowed_is_refused(serve):
    server = serve(viewers=2)

    async def crowd():
        async with aiohttp.ClientSession() as client:
            url = f'http://127.0.0.1:{server.port}/live'
            first = [await client.ws_connect(url) for _ in range(2)]
            with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                await client.ws_connect(url)
            assert caught.value.status == 503
            await first[0].close()
            while len(server.hub.viewers) > 1:
                await asyncio.sleep(0.01)
            await (await client.ws_connect(url)).close()
            await first[1].close()

    asyncio.run(crowd())
    assert [line.partition(':')[0] for line in server.lines] == ['too many viewers']


def test_streams_flow_only_to_who_asks_and_end_with_the_server(serve):
    server = serve()

    async def talk(ws):
        await wants(server, ws, 'blocks')
        server.hub.put('image', b'no')
        server.hub.put('blocks', b'yes')
        message = await ws.receive(timeout=30)
        assert (message.type, message.data) == (aiohttp.WSMsgType.BINARY, b'yes')
        began_s = time.time()
        await ws.send_str('{"ping": 12.5}')
        pong = await notice(ws, 'pong')
        assert pong['ping'] == 12.5 and began_s <= pong['now'] <= time.time()
        tick = await notice(ws, 'tick')
        assert tick['viewers'] == 1
        server.stop()
        return await closed(ws)

    assert live(server, talk) == aiohttp.WSCloseCode.GOING_AWAY
    assert server.lines == []


def test_a_viewer_that_does_not_read_costs_a_bounded_amount_and_then_sees_the_newest(serve):
    server = serve()

    async def talk(ws):
        await wants(server, ws, 'image')
        (viewer,) = server.hub.viewers
        ws._reader._protocol.transport.pause_reading()
        for i in range(400):  # 20 MB, and nobody reads
            server.hub.put('image', i.to_bytes(4, 'big') + bytes(50_000))
            await asyncio.sleep(0.002)
        assert viewer._line.get_write_buffer_size() < FULL + 60_000
        assert viewer.dropped > 100
        ws._reader._protocol.transport.resume_reading()
        newest = -1
        while newest != 399:
            message = await ws.receive(timeout=30)
            if message.type == aiohttp.WSMsgType.BINARY:
                number = int.from_bytes(message.data[:4], 'big')
                assert number > newest and len(message.data) == 50_004
                newest = number

    live(server, talk, max_msg_size=0)


def test_the_skew_of_the_walls_is_of_one_change(serve):
    server = serve()

    async def talk(ws):
        for side, change, at_ms in (
            ('left', 4, 1000.0),
            ('right', 3, 1900.0),
            ('right', 4, 1007.5),
        ):
            await ws.send_str(json.dumps({'flipped': [side, change, at_ms]}))
        await ws.send_str('{"ping": 1}')
        await notice(ws, 'pong')

    live(server, talk)
    assert server.routes.skew_ms == 7.5


def test_a_taken_port_and_a_wrong_address_are_one_line_with_code_69(serve):
    server = serve()
    with pytest.raises(DeviceMissing, match=f'{server.port} on 127.0.0.1 is taken') as caught:
        from eol_ros.settings import PanelSettings
        from eol_ros.web.server import WebServer

        WebServer(PanelSettings(port=server.port), server.bridge)
    assert caught.value.exit_code == 69
    with pytest.raises(DeviceMissing):
        serve(host='192.0.2.1', pin='471147')
    with pytest.raises(DeviceMissing):
        serve(host='no.such.host.invalid', pin='471147')


def test_documents_are_handed_out(serve):
    server = serve()
    heights = terrain.landscape(1)
    server.routes.documents['terrain'] = (heights * 65535).astype('<u2').tobytes()
    url = f'http://127.0.0.1:{server.port}/terrain'
    with urllib.request.urlopen(url, timeout=30) as answer:
        assert len(answer.read()) == 2 * 161 * 161  # what static/terrain.js expects
    server.routes.documents['status'] = b'{"a": 1}'
    assert json.loads(ask(server, '/status')[2]) == {'a': 1}


def test_the_documented_routes_are_these():
    document = (Path(__file__).parents[2] / 'docs/reference/web.md').read_text('utf-8')
    form = r'^\| `POST /control/(\w+)` \| (.*?)(?:; takes (.*))? \|$'
    takes = {c.name: ', '.join(f'`{item.name}`' for item in c.takes) for c in CONTROLS.values()}
    assert re.findall(form, document, re.M) == [
        (c.name, c.doc, takes[c.name]) for c in CONTROLS.values()
    ]


def test_a_grain_has_an_outline_or_is_not_there(serve):
    server = serve()
    server.routes.grain = lambda number: {'peaks': [[-0.5, 0.5]]} if number < 3 else None
    assert json.loads(ask(server, '/grain/2')[2]) == {'peaks': [[-0.5, 0.5]]}
    for address in ('/grain/3', '/grain/-1', '/grain/x', f'/grain/{"9" * 30}'):
        assert ask(server, address)[0] == 404


def test_sound_files_are_read_for_outlines_at_a_limited_rate(serve):
    server, read = serve(), []
    server.routes.grain = lambda number: read.append(number) or {'peaks': []}
    began, codes = time.monotonic(), []
    while 429 not in codes:
        codes.append(ask(server, f'/grain/{len(codes)}')[0])
    took_s = time.monotonic() - began

    assert set(codes) == {200, 429} and len(read) == len(codes) - 1
    assert 30 <= len(read) <= 30 + 30 * took_s
    server.routes._grains = Budget(1.0)
    assert ask(server, '/grain/7')[0] == 200

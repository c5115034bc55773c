# SPDX-License-Identifier: Apache-2.0
"""JSON from outside: by a generator of odd values, through each door of the server."""

import asyncio
import http.client
import json
import math

import aiohttp
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eol_ros.web import wire
from eol_ros.web.controls import CONTROLS
from eol_ros.web.visitor import Visitor

GOOD = [
    b'{"a": [1, -2.5, true, null, "\\u00e9\\ud83d\\ude00"]}',
    b'9007199254740992',
    b'-9007199254740992',
    b'1e308',
    '"\u6d77"'.encode(),
]
BAD = [
    b'9007199254740993',
    b'-9007199254740993',
    b'1' + b'0' * 400,
    b'{"ping": 1' + b'0' * 4400 + b'}',
    b'1e400',
    b'-1e999',
    b'NaN',
    b'[Infinity]',
    b'"\\ud800"',
    b'{"\\udfff": 1}',
    b'"\xff"',
    b'\xff\xfe{\0}\0',
    '{"a": 1}'.encode('utf-16'),
    b'\xef\xbb\xbf{}',
    b'[' * 4000,
    b'{"a":' * 800,
    b'',
    b'{',
    '"\ud800"',
]

numbers = st.one_of(
    st.integers(-(10**400), 10**400), st.integers(-(2**54), 2**54), st.floats(), st.booleans()
)
values = st.recursive(
    st.one_of(
        st.none(), numbers, st.text(st.characters(exclude_categories=()), max_size=20),
        st.sampled_from(['left', 'right', 'blocks', 'image']),
    ),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.text(st.characters(exclude_categories=()), max_size=5), inner, max_size=3),
    max_leaves=8,
)  # fmt: skip
fields = st.sampled_from(sorted({item.name for row in CONTROLS.values() for item in row.takes}))
objects = st.dictionaries(fields, values, max_size=3)
texts = st.tuples(values | objects, st.booleans()).map(
    lambda drawn: json.dumps(drawn[0], ensure_ascii=drawn[1])
)
bodies = st.binary(max_size=60) | texts.map(lambda text: text.encode('utf-8', 'surrogatepass'))


@pytest.mark.parametrize('data', GOOD)
def test_what_is_json_is_read(data):
    assert wire.loads(data) == wire.loads(data.decode()) == json.loads(data)


@pytest.mark.parametrize('data', BAD, ids=range(len(BAD)))
def test_what_is_not_is_one_line(data):
    with pytest.raises(ValueError, match='.') as caught:
        wire.loads(data)
    assert str(caught.value).isprintable()


@given(bodies)
@settings(deadline=None, max_examples=150)
def test_what_passes_is_within_bounds_and_can_be_written_again(data):
    try:
        found = wire.loads(data)
    except ValueError:
        return
    assert found == json.loads(data)
    again = json.dumps(found, ensure_ascii=False, allow_nan=False).encode()
    assert wire.loads(again) == found
    ahead = [found]
    while ahead:
        one = ahead.pop()
        if isinstance(one, (int, float)):
            assert math.isfinite(one) and (isinstance(one, float) or abs(one) <= 2**53)
        elif isinstance(one, (list, dict)):
            ahead += one.values() if isinstance(one, dict) else one


CONTENT_TYPES = [
    '', 'application/json; charset=foo', 'text/plain; charset=utf-16', 'a/b; charset="', '/', ';',
    'application/json; charset=utf-8', 'multipart/form-data', 'application/json; charset=idna',
]  # fmt: skip
PATHS = ['/screen/left', *(f'/control/{name}' for name in CONTROLS)]


@pytest.fixture
def post(serve):
    """Return a function that posts to one server and returns the status of the answer."""
    server = serve()
    line = http.client.HTTPConnection('127.0.0.1', server.port, timeout=30)

    def ask(path, body, **headers):
        line.request('POST', path, body, headers={k: v for k, v in headers.items() if v})
        answer = line.getresponse()
        json.loads(answer.read())
        return answer.status

    ask.server = server
    yield ask
    line.close()


@given(st.sampled_from(PATHS), bodies, st.sampled_from(CONTENT_TYPES))
@settings(
    deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_no_body_is_a_fault_of_the_server(post, path, body, content_type):
    assert post(path, body, **{'Content-Type': content_type}) in (200, 400)
    assert [line for line in post.server.lines if 'Error' in line] == []


@pytest.mark.parametrize('content_type', CONTENT_TYPES)
def test_a_body_is_utf_8_whatever_its_header_says(post, content_type):
    for path, body in (('/control/play', '{"grain": 7}'), ('/control/sleep', '')):
        assert post(path, body, **{'Content-Type': content_type}) == 200
    for body in BAD:
        if isinstance(body, bytes) and 0 < len(body) <= 4096:
            assert post('/control/radius', body, **{'Content-Type': content_type}) == 400
    assert post('/control/play', '{"grain": 1%s}' % ('0' * 400)) == 400
    assert post.server.lines == []
    assert post('/control/play', 'no gzip', **{'Content-Encoding': 'gzip'}) == 400


ODD_PATHS = [
    '/media/%00',
    '/media/a%00.svg',
    '/media/%ed%a0%80',
    '/media/%ff',
    '/static/%00',
    '/screen/%00',
    '/control/%ed%a0%80',
    '/control/%00',
    '/media/' + 'a' * 5000,
]


@pytest.mark.parametrize('path', ODD_PATHS, ids=range(len(ODD_PATHS)))
def test_odd_names_are_not_found(serve, tmp_path, path):
    from eol_ros.devices.files.media_folder import Pictures

    server = serve(picture=Pictures(str(tmp_path)).file)
    line = http.client.HTTPConnection('127.0.0.1', server.port, timeout=30)
    line.request('POST' if path.startswith('/control') else 'GET', path)
    assert line.getresponse().status == 404
    line.close()


KINDS = [name.removeprefix('_take_') for name in vars(Visitor) if name.startswith('_take_')]


@given(st.lists(st.tuples(st.sampled_from(KINDS), values) | texts, min_size=1, max_size=8))
@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_no_message_is_a_fault_of_the_server(post, messages):
    server = post.server

    async def talk():
        async with aiohttp.ClientSession() as client:
            for message in messages:
                text = message
                if not isinstance(message, str):
                    text = json.dumps(dict([message]))
                async with client.ws_connect(f'http://127.0.0.1:{server.port}/live') as ws:
                    await ws._writer.send_frame(text.encode('utf-8', 'surrogatepass'), 1)
                    await ws.send_str('{"ping": 1}')
                    while True:  # until the pong, or the door is closed with a reason
                        got = await ws.receive(timeout=30)
                        if got.type != aiohttp.WSMsgType.TEXT:
                            assert ws.close_code in (1007, 1008)
                            break
                        if json.loads(got.data)['t'] == 'pong':
                            break

    asyncio.run(talk())
    assert [line for line in server.lines if 'Error' in line] == []

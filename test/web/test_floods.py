# SPDX-License-Identifier: Apache-2.0
"""Honest requests while one address takes all it can get."""

import asyncio
import contextlib
import socket
import ssl
import statistics
import threading
import time
from collections import deque
from pathlib import Path

import aiohttp
import pytest

from eol_ros.web.connections import SERVING, VIEWING, WAITING, Connections
from eol_ros.web.server import SPARE_CONNECTIONS

FLOOD, HONEST = '127.0.0.2', '127.0.0.3'
SERVED_S = 1.0
REQUEST = b'GET /wall/left HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n'
HALF = {
    'nothing': b'',
    'half a header': b'GET / HTTP/1.1\r\nHost: localhost\r\nX-Half: ',
    'half a body': b'POST /screen/a HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\n{',
    'a whole request, kept alive': b'GET /static/link.js HTTP/1.1\r\nHost: localhost\r\n\r\n',
}


def request(server, source, tls=None):
    """Return the first bytes of an answer to a request from address `source`."""
    with contextlib.ExitStack() as opened:
        sock = socket.create_connection(('127.0.0.1', server.port), 10, (source, 0))
        opened.enter_context(sock)
        if tls:
            sock = opened.enter_context(tls.wrap_socket(sock, server_hostname='localhost'))
        sock.sendall(REQUEST)
        return sock.recv(12)


def served(server, tls=None):
    """Assert that honest requests are served in time, once the flood has been accepted."""
    took_s = []
    for _ in range(40):
        began = time.monotonic()
        assert request(server, HONEST, tls) == b'HTTP/1.1 200'
        took_s.append(time.monotonic() - began)
    assert statistics.median(took_s) < SERVED_S


@contextlib.contextmanager
def flood(server, count, sent):
    """Hold `count` connections of one address that have sent `sent`, and go on to open more."""
    held = deque()
    full, over = threading.Event(), threading.Event()

    def pour():
        while not over.is_set():
            with contextlib.suppress(OSError):  # there are too many already
                held.append(socket.create_connection(('127.0.0.1', server.port), 10, (FLOOD, 0)))
                held[-1].sendall(sent)
            if len(held) == count:
                held.popleft().close()
                full.set()
                time.sleep(0.001)

    thread = threading.Thread(target=pour)
    thread.start()
    try:
        assert full.wait(60)
        yield
    finally:
        over.set()
        thread.join()
        for sock in held:
            sock.close()


@pytest.mark.parametrize('sent', HALF.values(), ids=HALF)
def test_honest_requests_are_served_during_a_flood_of_one_address(serve, sent):
    server = serve(viewers=4)
    with flood(server, 2 * (4 + SPARE_CONNECTIONS), sent):
        served(server)


def test_the_oldest_half_header_goes_first(serve):
    server = serve(viewers=4)
    most = 4 + SPARE_CONNECTIONS
    with contextlib.ExitStack() as opened:
        held = []
        for _ in range(most + 1):
            sock = socket.create_connection(('127.0.0.1', server.port), 10, (FLOOD, 0))
            held.append(opened.enter_context(sock))
            sock.sendall(HALF['half a header'])
        with contextlib.suppress(ConnectionError):
            assert held[0].recv(1) == b''
        held[-1].sendall(b'\r\n\r\n')
        assert held[-1].recv(12) == b'HTTP/1.1 200'


def test_handshakes_of_one_address_keep_nobody_out(serve):
    pem = Path(__file__).parents[1] / 'support/localhost.pem'
    server = serve(viewers=4, certificate=str(pem))
    tls = ssl.create_default_context(cafile=str(pem))
    for sent in (b'', b'\x16\x03\x01'):
        with flood(server, 2 * (4 + SPARE_CONNECTIONS), sent):
            served(server, tls)


def test_websockets_of_one_address_keep_no_viewer_out(serve):
    """All places are taken from one address; two come from another, and one more of the first."""
    server = serve(viewers=10)
    url = f'http://127.0.0.1:{server.port}/live'

    async def greeted(client):
        ws = await client.ws_connect(url)
        assert (await ws.receive_json(timeout=30))['t'] == 'hello'
        return ws

    async def crowd():
        one, other = (
            aiohttp.ClientSession(connector=aiohttp.TCPConnector(local_addr=(source, 0)))
            for source in (FLOOD, HONEST)
        )
        async with one, other:
            crowd = [await greeted(one) for _ in range(10)]
            began = time.monotonic()
            mine = [await greeted(other) for _ in range(2)]
            assert time.monotonic() - began < 5 * SERVED_S
            with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                await one.ws_connect(url)
            assert caught.value.status == 503
            for ws in mine + crowd[:8]:  # the newest of the crowd have gone
                await ws.send_json({'ping': 1})
                while (await ws.receive_json(timeout=30))['t'] != 'pong':
                    pass
            for ws in crowd[8:]:
                while not ws.closed:
                    await ws.receive(timeout=30)
            return len(server.hub.viewers)

    assert asyncio.run(crowd()) == 10


class Held:
    """What a table of connections knows of one."""

    def __init__(self, dropped, address, state, since_s):
        self.address, self.state, self.since_s = address, state, since_s
        self.drop = lambda: dropped.append(since_s)


def held_of(*rows):
    """Return connections (address, state, since) and the table that holds them, full."""
    held, dropped = Connections(len(rows)), []
    for row in rows:
        held.add(Held(dropped, *row))
    return held, dropped


@pytest.mark.parametrize(
    ('rows', 'newcomer', 'gone'),
    [
        ([('a', WAITING, 2), ('a', WAITING, 1), ('a', SERVING, 0)], 'b', 1),
        ([('a', WAITING, 2), ('a', WAITING, 1), ('b', WAITING, 0)], 'a', 1),
        ([('a', SERVING, 2), ('a', VIEWING, 0), ('a', SERVING, 3)], 'b', 2),
        ([('a', VIEWING, 0), ('a', VIEWING, 1), ('b', VIEWING, 2)], 'c', 1),
        ([('a', SERVING, 0), ('a', VIEWING, 1), ('b', WAITING, 2)], 'a', None),
        ([('a', WAITING, 2), ('b', WAITING, 1), ('c', SERVING, 0)], 'd', 1),
        ([('a', VIEWING, 0), ('b', SERVING, 1)], 'c', None),
        ([('a', SERVING, 0), ('a', VIEWING, 1)], 'a', None),
    ],
)
def test_which_connection_gives_way(rows, newcomer, gone):
    held, dropped = held_of(*rows)
    assert held.make_room(newcomer) is (gone is not None)
    assert dropped == ([] if gone is None else [gone])
    assert len(held) == len(rows) - len(dropped)


def test_what_the_gate_says_is_the_same_after_others_have_guessed(serve):
    server = serve(host='0.0.0.0', pin='471147')

    def pin(source, given):
        with socket.create_connection(('127.0.0.1', server.port), 5, (source, 0)) as sock:
            head = f'POST /pin HTTP/1.1\r\nHost: localhost\r\nX-Pin: {given}\r\n'
            sock.sendall(f'{head}Connection: close\r\n\r\n'.encode())
            return int(sock.makefile('rb').readline().split()[1])

    assert pin('127.0.1.1', '471147') == 200
    for i in range(2, 42):
        assert [pin(f'127.0.1.{i}', '000000') for _ in range(4)] == [401, 401, 401, 429]
    assert pin('127.0.1.1', '471147') == pin('127.0.1.99', '471147') == 200
    assert server.routes.pin.known == ['127.0.1.1', '127.0.1.99']

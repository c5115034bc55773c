# SPDX-License-Identifier: Apache-2.0
"""The panel over HTTPS, as the standard library's and aiohttp's clients meet it."""

import asyncio
import contextlib
import re
import shutil
import socket
import ssl
import urllib.request
from pathlib import Path

import aiohttp
import pytest

from eol_ros.errors import ConfigError

SUPPORT = Path(__file__).parents[1] / 'support'
RENEWED = SUPPORT / 'localhost_renewed.pem'


@pytest.fixture
def pem(tmp_path):
    """Return a certificate with its key, in a file that a test may change."""
    return Path(shutil.copy(SUPPORT / 'localhost.pem', tmp_path / 'panel.pem'))


def parts(pem):
    """Return key and certificate of a file."""
    return re.findall('-----BEGIN.*?-----END [A-Z ]*-----\n', pem.read_text(), re.DOTALL)


def trusting(pem):
    """Return a client's context that trusts this certificate and no other."""
    return ssl.create_default_context(cafile=str(pem))


def test_pages_and_live_data_come_over_https(serve, pem):
    server = serve(certificate=str(pem))
    assert server.address == f'https://127.0.0.1:{server.port}'
    url = f'https://localhost:{server.port}'
    with urllib.request.urlopen(f'{url}/wall/left', context=trusting(pem), timeout=30) as answer:
        assert answer.status == 200
    with pytest.raises(urllib.error.URLError, match='CERTIFICATE_VERIFY_FAILED'):
        urllib.request.urlopen(url, timeout=30)  # a default client does not trust it

    async def talk():
        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(f'{url}/live', ssl=trusting(pem)) as ws,
        ):
            hello = await asyncio.wait_for(ws.receive_json(), 5)
            server.hub.put('notices', {'t': 'big', 'text': 'x' * 300_000}, sticky='big')
            while (notice := await asyncio.wait_for(ws.receive_json(), 5))['t'] != 'big':
                pass  # a tick
        return hello['t'], len(notice['text'])

    assert asyncio.run(asyncio.wait_for(talk(), 20)) == ('hello', 300_000)


@pytest.mark.filterwarnings('ignore:ssl.TLSVersion:DeprecationWarning')  # what is tried is old
def test_plain_http_and_old_tls_get_nothing(serve, pem):
    server = serve(certificate=str(pem))
    with socket.create_connection(('127.0.0.1', server.port), 5) as sock:
        sock.sendall(b'GET / HTTP/1.1\r\nHost: localhost\r\n\r\n')
        assert b'html' not in sock.recv(4096)
    for version, taken in ((ssl.TLSVersion.TLSv1_2, True), (ssl.TLSVersion.TLSv1_1, False)):
        client = trusting(pem)
        client.minimum_version = client.maximum_version = version
        client.set_ciphers('DEFAULT:@SECLEVEL=0')
        with (
            socket.create_connection(('127.0.0.1', server.port), 5) as sock,
            contextlib.nullcontext() if taken else pytest.raises(ssl.SSLError),
        ):
            client.wrap_socket(sock, server_hostname='localhost').close()


@pytest.mark.parametrize('wrong', ['missing', 'text', 'no key', 'other key', 'locked key'])
def test_a_certificate_that_is_none_is_one_line(serve, pem, wrong):
    key, cert = parts(pem)
    if wrong == 'locked key':
        from cryptography.hazmat.primitives import serialization

        found = serialization.load_pem_private_key(key.encode(), None)
        form = serialization.PrivateFormat.PKCS8, serialization.BestAvailableEncryption(b'secret')
        pem.write_text(cert + found.private_bytes(serialization.Encoding.PEM, *form).decode())
    elif wrong == 'missing':
        pem.unlink()
    else:
        its = {'text': 'hello', 'no key': cert, 'other key': cert + parts(RENEWED)[0]}
        pem.write_text(its[wrong])
    with pytest.raises(ConfigError) as caught:
        serve(certificate=str(pem))
    words = str(caught.value)
    assert words.startswith(f'panel.certificate: {pem}: ') and '\n' not in words

# SPDX-License-Identifier: Apache-2.0
"""Who gets in."""

import socket

import pytest

from eol_ros.errors import ConfigError
from eol_ros.web import guard


@pytest.mark.parametrize('host', ['127.0.0.1', '127.8.8.8', '::1', 'localhost'])
def test_loopback_needs_no_pin(host):
    assert guard.check_settings(host, '') is None  # it raises where one is needed, as below


@pytest.mark.parametrize('host', ['0.0.0.0', '::', '192.168.1.4', 'museum.local'])
def test_open_to_the_network_needs_one(host):
    with pytest.raises(ConfigError, match=r'panel\.pin'):
        guard.check_settings(host, '')
    guard.check_settings(host, '4711')
    with pytest.raises(ConfigError, match='4 to 32'):
        guard.check_settings(host, '12')


@pytest.mark.parametrize(
    ('host', 'local', 'opened'),
    [
        ('localhost:8080', True, True),
        ('127.0.0.1', True, True),
        ('[::1]:8080', True, True),
        ('LOCALHOST', True, True),
        ('192.168.1.4:8080', False, True),
        (f'{socket.gethostname()}:80', False, True),
        ('evil.example', False, False),
        ('127.0.0.1.evil.example', False, False),
        ('localhost.evil.example:8080', False, False),
        ('', False, False),
        ('[::1', False, False),
    ],
)
def test_hosts(host, local, opened):
    assert guard.host_allowed(host, False) is local
    assert guard.host_allowed(host, True) is opened


def test_a_named_host_is_allowed():
    assert guard.host_allowed('echoes.museum:8080', False, ['Echoes.Museum'])


@pytest.mark.parametrize(
    ('origin', 'good'),
    [
        (None, True),
        ('http://localhost:8080', True),
        ('https://localhost:8080', True),
        ('http://localhost:9999', False),
        ('http://evil.example', False),
        ('null', False),
        ('http://[', False),
        ('file://localhost:8080', False),
    ],
)
def test_origins(origin, good):
    assert guard.same_origin(origin, 'localhost:8080') is good


def test_the_gate_opens_to_the_pin_and_locks_after_five_wrong_ones():
    gate = guard.PinGate('4711')
    assert gate.check('4711', 'a', 0.0) == 'ok'
    assert gate.check('', 'a', 0.0) == 'wrong'
    for i in range(5):
        assert gate.check('0000', 'a', float(i)) == 'wrong'
    assert gate.check('4711', 'a', 10.0) == 'locked'
    assert gate.check('4711', 'b', 10.0) == 'ok'
    assert gate.check('4711', 'a', 70.0) == 'ok'
    assert gate.check('\udcff', 'c', 0.0) == 'wrong'
    assert guard.PinGate('').check('', 'a', 0.0) == 'ok'


def test_the_policy_lets_nothing_in_from_elsewhere():
    policy = guard.HEADERS['Content-Security-Policy']
    assert "default-src 'none'" in policy and 'unsafe' not in policy and 'http' not in policy

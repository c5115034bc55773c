# SPDX-License-Identifier: Apache-2.0
"""Who gets in."""

import socket

import pytest

from eol_ros.errors import ConfigError
from eol_ros.web import guard

PIN = '471147'


@pytest.mark.parametrize('host', ['0.0.0.0', '::', '192.168.1.4', 'museum.local'])
def test_open_to_the_network_needs_one(host):
    with pytest.raises(ConfigError, match=r'panel\.pin'):
        guard.check_settings(host, '')
    guard.check_settings(host, '471147')
    guard.check_settings(host, 'ice breaks slowly')
    for weak in ('12', '47114', 'x' * 65, 'umlaut\xe4'):
        with pytest.raises(ConfigError, match='six digits or a passphrase'):
            guard.check_settings(host, weak)
    for first in ('000000', '123456', '987654', 'abcdef'):
        with pytest.raises(ConfigError, match='easy to guess'):
            guard.check_settings(host, first)


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


def test_the_gate_opens_to_the_pin():
    gate = guard.PinGate(PIN)
    assert gate.check(PIN, 'a', 0.0) == 'ok'
    assert [gate.check('', 'a', 0.0) for _ in range(9)] == ['wrong'] * 9  # no guesses
    assert gate.check('\udcff', 'c', 0.0) == 'wrong'
    assert gate.check(PIN, 'a', 0.0) == 'ok'
    assert guard.PinGate('').check('', 'a', 0.0) == 'ok'


def test_who_guesses_waits_longer_after_each_wrong_one():
    gate, now_s, waits = guard.PinGate(PIN), 0.0, []
    assert gate.check(PIN, 'a', now_s) == 'ok'  # an address that is known: its own wait alone
    for _ in range(14):
        assert gate.check('000000', 'a', now_s) == 'wrong'
        waits.append(gate.wait_s('a', now_s))
        if waits[-1]:
            assert gate.check(PIN, 'a', now_s + waits[-1] / 2) == 'locked'  # not looked at
            assert gate.check(PIN, 'b', now_s) == 'ok'  # no concern of others
        now_s += waits[-1]
    assert waits == [0, 0, 2, 4, 8, 16, 32, 64, 128, 256, 512, 900, 900, 900]
    assert gate.check(PIN, 'a', now_s) == 'ok'
    assert gate.check('000000', 'a', now_s) == 'wrong'
    assert gate.wait_s('a', now_s) == 0  # after the right one counting begins again


def test_many_addresses_guess_no_more_than_their_bound_in_all():
    """Ten hours, one guess in 0.9 s: of 40,000 addresses in turn, and of as many as count alone."""
    for count in (40_000, guard.MOST_GUESSERS):
        gate, looked_at = guard.PinGate(PIN), 0
        gate.remember(['192.168.1.9'])
        for i in range(40_000):
            n, now_s = i % count, i * 0.9
            address = f'10.{n >> 16}.{n >> 8 & 255}.{n & 255}'
            looked_at += gate.check('000000', address, now_s) == 'wrong'
        of_one = guard.FREE_TRIES + 15  # 2 + 4 + ... + 2^15 s are more than ten hours
        assert looked_at <= (guard.MOST_GUESSERS + 1) * of_one
        assert gate.check(PIN, '10.200.9.9', now_s) == ('locked' if count == 40_000 else 'ok')
        assert gate.check(PIN, '192.168.1.9', now_s) == 'ok'  # who is known is not shut out


def test_an_address_that_never_stops_waits_a_day_and_a_known_one_15_minutes():
    gate, now_s = guard.PinGate(PIN), 0.0
    gate.remember(['b'])
    for _ in range(2000):  # 2 ** 1998 s is no float
        for address in 'ab':
            gate.check('000000', address, now_s)
        now_s += max(gate.wait_s(address, now_s) for address in 'ab')
    gate.check('000000', 'a', now_s)
    assert gate.wait_s('a', now_s) == 86_400.0
    gate.check('000000', 'b', now_s)
    assert gate.wait_s('b', now_s) == 900.0


def test_what_is_known_is_taken_up_as_far_as_it_makes_sense():
    gate, next_one = guard.PinGate(PIN), guard.PinGate(PIN)
    for address in ('a', 'b', 'a', '::ffff:192.0.2.1'):
        assert gate.check(PIN, address, 0.0) == 'ok'
    assert gate.known == ['b', 'a', '192.0.2.1']
    next_one.remember(gate.known)
    assert next_one.known == gate.known
    for odd in (None, {}, 'a', [1, None, 'c']):
        next_one.remember(odd)
    assert next_one.known == ['c']


def test_an_ipv6_network_is_one_guesser():
    gate = guard.PinGate(PIN)
    for i in range(3):
        assert gate.check('000000', f'2001:db8::{i}', 0.0) == 'wrong'
    assert gate.check(PIN, '2001:db8::ffff', 1.0) == 'locked'
    assert gate.check(PIN, '2001:db8:0:1::1', 1.0) == 'ok'
    for _ in range(3):
        assert gate.check('000000', '::ffff:192.0.2.1', 0.0) == 'wrong'
    assert gate.check(PIN, '::ffff:192.0.2.2', 1.0) == 'ok'


def test_the_policy_lets_nothing_in_from_elsewhere():
    policy = guard.HEADERS['Content-Security-Policy']
    assert "default-src 'none'" in policy and 'unsafe' not in policy and 'http' not in policy

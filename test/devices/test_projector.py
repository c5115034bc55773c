# SPDX-License-Identifier: Apache-2.0
"""Projectors by PJLink, against a fake that was written from the specification."""

import contextlib
import hashlib
import socket
import threading

import pytest
from support.fake_projector import FakeProjector
from support.waiting import wait_until

from eol_ros.devices.projector import pjlink
from eol_ros.devices.projector.pjlink import (
    Unanswered,
    WrongPassword,
    converse,
    faults,
    host_and_port,
    lamp_hours,
)
from eol_ros.devices.projector.projector import ERROR, OBEYS_S, OK, WARN, Projector
from eol_ros.errors import ConfigError


@pytest.fixture
def fake():
    made = []

    def make(password=''):
        made.append(FakeProjector(password))
        return made[-1]

    yield make
    for one in made:
        one.unplug()


class Kept:
    """A projector of ours on a clock that it shares with the fake."""

    def __init__(self, fake, password='', on=True):
        self.fake = fake
        self.ours = Projector(fake.address, password, on, clock=lambda: fake.now_s)

    def after(self, seconds):
        self.fake.now_s += seconds
        self.ours.look()
        return self.ours.words().removeprefix(f'{self.fake.address} ')


def test_on_through_warming_up_and_off_through_cooling_down(fake):
    one = fake()
    kept = Kept(one)
    assert kept.after(0) == 'warming up, lamp 1200 h' and one.power == 3
    assert kept.after(30) == 'warming up, lamp 1200 h'
    kept.ours.want(False)
    assert kept.after(1) == 'warming up, lamp 1200 h'  # it cannot be told before it is warm
    assert 'POWR 0' not in one.log
    assert kept.after(30) == 'cooling down, lamp 1200 h'
    kept.ours.want(True)
    assert kept.after(80) == 'cooling down, lamp 1200 h'
    assert kept.after(10) == 'warming up, lamp 1200 h'
    assert kept.after(60) == 'on, lamp 1200 h'
    assert [word for word in one.log if word in ('POWR 0', 'POWR 1')] == [
        'POWR 1',
        'POWR 0',
        'POWR 1',
    ]
    assert kept.ours.level() == OK


def test_the_digest_goes_before_the_first_command_alone(fake):
    one = fake('JBMIAProjectorLink')
    assert converse(one.address, one.password, ['POWR ?', 'POWR 1', 'POWR ?']) == ['0', 'OK', '3']
    with pytest.raises(WrongPassword, match='refuses the password'):
        converse(one.address, 'wrong', ['POWR ?'])
    with pytest.raises(WrongPassword, match='asks for a password'):
        converse(one.address, '', ['POWR ?'])
    assert converse(fake().address, 'not needed', ['POWR ?']) == ['0']


@contextlib.contextmanager
def answering(*said):
    """Serve one connection: say the first, and each of the others when something has come.

    Yields the address and a list of what comes.
    """
    heard = []

    def serve(server):
        line, _ = server.accept()
        with line, contextlib.suppress(OSError):
            line.sendall(said[0])
            for one in (*said[1:], b''):
                heard.append(line.recv(100))
                line.sendall(one)

    with socket.create_server(('127.0.0.1', 0)) as server:
        thread = threading.Thread(target=serve, args=(server,), daemon=True)
        thread.start()
        yield f'127.0.0.1:{server.getsockname()[1]}', heard
        thread.join(10)


def test_the_example_of_the_specification():
    """Chapter 5.3: the digest of 498e4a67 and JBMIAProjectorLink."""
    with answering(b'PJLINK 1 498e4a67\r', b'%1POWR=1\r') as (address, heard):
        assert converse(address, 'JBMIAProjectorLink', ['POWR ?']) == ['1']
    assert heard[0] == b'5d8409bc1c3fa39749434aa3a5c38682%1POWR ?\r'
    assert hashlib.md5(b'498e4a67JBMIAProjectorLink').hexdigest() in heard[0].decode()


def test_busy_is_asked_again_and_a_fault_is_told(fake):
    one = fake()
    kept = Kept(one, on=False)
    assert kept.after(0) == 'off, lamp 1200 h'
    converse(one.address, '', ['POWR 1'])  # by somebody's remote control
    kept.ours.want(False)
    assert kept.after(1) == 'warming up, lamp 1200 h' and kept.ours.level() == OK
    assert kept.after(59) == 'cooling down, lamp 1200 h'
    one.errors, one.lamps = '010020', [(3000, 1), (2999, 1)]
    assert kept.after(90) == 'off, lamp 3000 h and 2999 h, filter has failed, lamp warns'
    assert kept.ours.level() == ERROR
    one.errors, one.lamps = '000100', []
    assert kept.after(1) == 'off, cover warns' and kept.ours.level() == WARN
    one.failed = True
    assert kept.after(1) == 'has failed' and kept.ours.level() == ERROR


def test_one_that_does_not_obey_is_told_in_time(fake, monkeypatch):
    one = fake()
    monkeypatch.setattr(one, 'answer', lambda command, value: {'POWR': '0'}.get(command, 'ERR3')
                        if value == '?' else 'ERR3')  # fmt: skip
    kept = Kept(one)
    assert kept.after(OBEYS_S) == 'off' and kept.ours.level() == OK
    assert kept.after(1) == 'off, though it should be on' and kept.ours.level() == WARN


def test_unplugged_and_plugged_in_again(fake):
    one = fake('secret')
    kept = Kept(one, 'secret')
    assert kept.after(0).startswith('warming up')
    one.unplug()
    assert 'does not answer (Connection refused)' in kept.after(60)
    assert kept.ours.level() == WARN
    one.power = 0  # it comes back in standby
    one.plug()
    assert kept.after(1).startswith('warming up') and kept.ours.level() == OK
    wrong = Kept(one, 'wrong')
    assert wrong.after(0) == 'refuses the password' and wrong.ours.level() == ERROR


@pytest.mark.parametrize(
    ('said', 'what'),
    [
        ([b'PJLINK 0\r'], 'hangs up'),
        ([b'220 mail.museum.at ESMTP\r'], 'does not speak PJLink'),
        ([b'x' * 1000], 'does not speak PJLink|does not answer'),
        ([b'PJLINK 0\r%1LAMP=0\r'], "answers '%1LAMP=0' to POWR"),
        ([b'PJLINK 0'], 'does not answer'),
    ],
)
def test_something_else_answers_at_this_address(said, what, monkeypatch):
    monkeypatch.setattr(pjlink, 'TIMEOUT_S', 0.2)
    with answering(*said) as (address, _), pytest.raises(Unanswered, match=what):
        converse(address, '', ['POWR ?'])


def test_a_thread_keeps_it_and_ends(fake):
    one = fake()
    one.WARM_S = 0.0
    ours = Projector(one.address, '', True)
    ours.start(poll_s=0.02)
    wait_until(lambda: ours.reading.power == pjlink.ON)
    ours.want(False)
    wait_until(lambda: one.power == 2)
    ours.end()
    ours._thread.join(10)
    assert not ours._thread.is_alive()


def test_addresses_and_answers():
    assert host_and_port('10.0.0.5') == ('10.0.0.5', 4352)
    assert host_and_port('[fe80::1]:4353') == ('fe80::1', 4353)
    for wrong in ('', 'a b', 'beamer:', 'beamer:port', ':4352'):
        with pytest.raises(ConfigError, match='is not HOST or HOST:PORT'):
            host_and_port(wrong)
    assert lamp_hours('1200 1 1300 0') == [1200, 1300] and lamp_hours('ERR1') == []
    assert faults('200001') == (['fan'], ['something else']) and faults('ERR3') == ([], [])

# SPDX-License-Identifier: Apache-2.0
import errno
import socket
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonosc.osc_message import OscMessage, ParseError
from support.waiting import wait_until

from eol_ros.devices.osc import IMMEDIATELY, OscIn, Peer, TimeTag, bundle, decode, encode
from eol_ros.devices.udp import UdpOut
from eol_ros.errors import ConfigError, DeviceMissing

VALUES = st.lists(
    st.one_of(
        st.integers(-(2**31), 2**31 - 1),
        st.floats(width=32, allow_nan=False),
        st.booleans(),
        st.text(st.characters(blacklist_characters='\0', blacklist_categories=['Cs'])),
    )
)


@given(VALUES)
def test_what_goes_in_comes_out(values):
    assert decode(encode('/eol/x', *values)) == [('/eol/x', *values)]
    assert len(encode('/eol/x', *values)) % 4 == 0


def test_the_examples_of_the_specification():
    """OSC 1.0, section "OSC Message Examples"."""
    assert encode('/oscillator/4/frequency', 440.0) == (
        b'/oscillator/4/frequency\0,f\0\0\x43\xdc\0\0'
    )
    assert encode('/foo', 1000, -1, 'hello', 1.234, 5.678) == bytes.fromhex(
        '2f666f6f000000002c6969736666000000000 3e8ffffffff68656c6c6f0000003f9df3b640b5b22d'.replace(
            ' ', ''
        )
    )


def test_a_bundle_whose_sizes_do_not_add_up_is_refused():
    """A part of -4 bytes had python-osc read the same size for ever: one datagram, no sound."""
    head, message = b'#bundle\0' + bytes(8), encode('/eol/x', 1)
    for size in (-4, -1, -(2**31), len(message) + 1, 2**31 - 1):
        with pytest.raises(ValueError, match=f'part of {size} bytes'):
            decode(head + size.to_bytes(4, 'big', signed=True) + message)
    with pytest.raises(ValueError, match='part of 0 bytes'):
        decode(bundle(IMMEDIATELY, [message]) + b'\0\0')  # a size that is cut off
    nested = message
    for _ in range(16):
        nested = bundle(IMMEDIATELY, [nested])
    assert decode(nested) == [('/eol/x', 1)]
    for _ in range(3000):
        nested = bundle(IMMEDIATELY, [nested])
    with pytest.raises(ValueError, match='more than 16'):
        decode(nested)


@given(st.lists(st.sampled_from([*range(256), *b'ifTFs,/\0\0\0']), max_size=24).map(bytes))
def test_messages_are_read_as_python_osc_does(rest):
    packet = b'/a\0\0,' + rest
    try:
        theirs = OscMessage(packet)
    except (ParseError, ValueError, IndexError):
        with pytest.raises(ValueError):
            decode(packet)
    else:
        assert repr(decode(packet)) == repr([(theirs.address, *theirs.params)])  # NaN, too


@st.composite
def packets(draw):
    """Draw noise, and messages and bundles of which some bytes are others, or missing."""
    parts = [encode('/eol/x', *draw(VALUES)) for _ in range(draw(st.integers(1, 3)))]
    whole = bundle(IMMEDIATELY, parts)
    nested = [parts[0], whole, bundle(IMMEDIATELY, [whole, *parts])]
    packet = bytearray(draw(st.sampled_from([draw(st.binary(max_size=60)), *nested])))
    for _ in range(draw(st.integers(0, 4)) if packet else 0):
        packet[draw(st.integers(0, len(packet) - 1))] = draw(st.integers(0, 255))
    return bytes(packet[: draw(st.integers(0, len(packet)))])


@given(packets())
def test_no_packet_harms(packet):
    try:
        found = decode(packet)
    except ValueError:
        return
    assert all(isinstance(address, str) for address, *_ in found)


def test_time_tags_count_from_1900():
    """RFC 5905, section 6: the tag of 1970 is 2208988800 s; a half second is 2**31."""
    assert TimeTag.of(0) == 2208988800 << 32
    assert TimeTag.of(1_500_000_000) == (2208988801 << 32) + 2**31
    message = encode('/a', TimeTag.of(1_500_000_000))
    assert message == b'/a\0\0,t\0\0' + ((2208988801 << 32) + 2**31).to_bytes(8, 'big')
    assert bundle(TimeTag.of(0), [])[8:] == (2208988800 << 32).to_bytes(8, 'big')


class Warned(list):
    def __call__(self, who, why):
        self.append((who, why))


def test_over_the_wire():
    source, warned = OscIn(0), Warned()
    out = UdpOut(f'127.0.0.1:{source.port}')
    assert out.own == '127.0.0.1'
    out.send(encode('/eol/set/gain_db', -12.0))
    out.send(bundle(IMMEDIATELY, [encode('/a', 1)]))
    out.send(b'nonsense')
    found = []
    wait_until(lambda: found.extend(source.take(0.0, warned)) or source.malformed)
    assert [message for _, message in found] == [('/eol/set/gain_db', -12.0), ('/a', 1)]
    assert (source.received, source.malformed) == (2, 1)
    assert [who for who, _ in warned] == ['127.0.0.1'] and '8 bytes that are no OSC' in warned[0][1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('127.0.0.1', 0))
        other.settimeout(5)
        source.reply(Peer(*other.getsockname()), encode('/eol/reply', 1))
        assert decode(other.recv(100)) == [('/eol/reply', 1)]
    with pytest.raises(DeviceMissing, match='cannot be had'):
        OscIn(source.port)
    for wrong in ('here', 'localhost:', 'localhost:99999', ':57120'):
        with pytest.raises(ConfigError, match='HOST:PORT'):
            UdpOut(wrong)
    source.close()
    out.close()


def test_the_network_card_that_sends_can_be_chosen():
    group = '239.255.77.1'
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(('', 0))
        ear.settimeout(5)
        card = socket.inet_aton(group) + socket.inet_aton('127.0.0.1')
        ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, card)
        port = ear.getsockname()[1]
        for target in ('127.0.0.1', group):
            out = UdpOut(f'{target}:{port}', '127.0.0.1')
            out.send(b'sound')
            assert ear.recvfrom(100)[0] == b'sound'
            out.close()
        out = UdpOut(f'127.0.0.1:{port}', '127.0.0.2')
        out.send(b'light')
        packet, (host, _) = ear.recvfrom(100)
        assert (packet, host, out.own) == (b'light', '127.0.0.2', '127.0.0.2')
        out.close()
    away = UdpOut(f'127.0.0.1:{port}', '192.0.2.9')
    assert away.trouble == f'127.0.0.1:{port} from 192.0.2.9: Cannot assign requested address'
    for wrong in ('eth1', '239.255.0.1', '255.255.255.255', '0.0.0.0', '::1'):
        with pytest.raises(ConfigError, match=f"'{wrong}': give the IPv4 address"):
            UdpOut(f'127.0.0.1:{port}', wrong)


class Card(socket.socket):
    """A socket on a network card that can be pulled out; it never works on that card again."""

    made: ClassVar[list['Card']] = []
    there = True

    def __init__(self, *args):
        super().__init__(*args)
        self.made.append(self)
        self.pulled, self.fault = not Card.there, errno.ENODEV

    def setsockopt(self, level, option, value):
        if option == socket.IP_MULTICAST_IF and self.pulled:
            raise OSError(errno.ENODEV, 'No such device')
        super().setsockopt(level, option, value)

    def sendto(self, packet, address):
        if self.pulled:
            raise OSError(self.fault, 'No such device')
        return super().sendto(packet, address)


def test_a_network_card_may_be_pulled_out_and_come_back(monkeypatch):
    monkeypatch.setattr(Card, 'made', [])
    ear = OscIn(0)
    monkeypatch.setattr(socket, 'socket', Card)
    out = UdpOut(f'127.0.0.1:{ear.port}', '127.0.0.1')
    monkeypatch.setattr(Card, 'there', False)
    old = Card.made[-1]
    for old.fault in (errno.EMSGSIZE, errno.ENODEV):  # only the second is one of the card
        old.pulled = True
        out.send(encode('/lost'))
        assert out.trouble == f'127.0.0.1:{ear.port}: No such device'
        assert (old.fileno() < 0) == (old.fault == errno.ENODEV)
    tried = len(Card.made)
    out.resolve()
    wait_until(lambda: 'from' in out.trouble)
    assert out.trouble == f'127.0.0.1:{ear.port} from 127.0.0.1: No such device'
    assert len(Card.made) > tried and all(one.fileno() < 0 for one in Card.made)
    monkeypatch.setattr(Card, 'there', True)
    wait_until(lambda: out.resolve() or not out.trouble)
    out.send(encode('/a'))
    wait_until(lambda: ear.take(0.0, Warned()))
    out.close()
    ear.close()


def test_peers_and_their_rate():
    source, warned = OscIn(0, ['10.0.0.5', '192.168.1.7/24'], rate_hz=3.0), Warned()
    one = encode('/a', 1)
    for host, taken in {'10.0.0.5': 1, '10.0.0.6': 0, '192.168.1.200': 1, '127.0.0.9': 1}.items():
        assert len(source.read(one, host, 0.0, warned)) == taken
    assert source.strangers == 1 and warned[0][0] == '10.0.0.6'
    five = bundle(IMMEDIATELY, [one] * 5)
    assert len(source.read(five, '10.0.0.5', 0.0, warned)) == 2  # of the 3, one was before
    assert len(source.read(five, '10.0.0.5', 0.1, warned)) == 0  # not even looked at
    assert len(source.read(five, '10.0.0.5', 0.5, warned)) == 1
    assert len(source.read(five, '192.168.1.200', 9.0, warned)) == 3  # never more than a second's
    assert source.dropped == 3 + 1 + 4 + 2 and source.received == 3 + 2 + 1 + 3
    assert 'more than 3 messages' in warned[-1][1]
    source.close()
    with pytest.raises(ConfigError, match=r"'10.0.0.256': give an IPv4 address or network"):
        OscIn(0, ['10.0.0.256'])


def test_a_name_that_does_not_resolve_is_looked_up_again(monkeypatch):
    found, real = [], socket.getaddrinfo

    def resolver(host, *args, **kwargs):
        found.append(host)
        if len(found) < 3:
            raise socket.gaierror(-2, 'Name or service not known')
        return real('127.0.0.1', *args, **kwargs)

    monkeypatch.setattr(socket, 'getaddrinfo', resolver)
    ear = OscIn(0)
    out = UdpOut(f'synth.lan:{ear.port}')
    wait_until(lambda: out.trouble)
    assert out.trouble.endswith(': Name or service not known')
    out.send(encode('/lost'))
    wait_until(lambda: out.resolve() or (len(found) == 3 and not out.trouble))
    wait_until(lambda: out.send(encode('/a')) or ear.take(0.0, Warned()))
    out.resolve()
    assert len(found) == 3
    out.close()
    ear.close()
    monkeypatch.undo()
    long = UdpOut('a' * 70 + '.lan:9')  # a label of more than 63 letters
    wait_until(lambda: long.trouble)
    long.close()

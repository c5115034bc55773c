# SPDX-License-Identifier: Apache-2.0
"""Open Sound Control 1.0 over UDP: packets out to other programs, and in from the peers allowed.

python-osc reads messages that hold more than numbers. The sockets are ours: a node sends from its
callbacks and looks from a timer.
"""

import functools
import ipaddress
import logging
import socket
import struct
from collections.abc import Callable, Iterable
from typing import NamedTuple

from eol_ros.core.budget import Budget
from eol_ros.devices.address import networks
from eol_ros.errors import DeviceMissing, pip_install

try:
    from pythonosc.osc_message import OscMessage, ParseError
except ImportError:  # in a ROS workspace, where rosdep has no key for it
    raise DeviceMissing(f'the node osc needs python-osc: {pip_install("python-osc")}') from None

LARGEST = 65536  # bytes in a datagram
DEEPEST = 16  # bundles in bundles; the specification names no limit, Python's stack has one
NTP_S = 2_208_988_800  # s from 1900, where time tags count from, to 1970
SHORT = 20  # tags of numbers in a message that is read without python-osc, at most
KNOWN = 1000  # peers with a budget of messages in memory; with one more all start full
_BUNDLE, _HEAD = b'#bundle\0', 16  # with the time tag; then sizes with what they measure
_NUMBERS = frozenset((int, float))
# python-osc says on the root logger what is wrong with a packet; here it is counted instead, or a
# stranger's packets would fill the logs.
logging.getLogger().addFilter(lambda record: 'pythonosc' not in record.pathname)


class TimeTag(int):
    """A time tag as a value of a message: seconds since 1900 in 1/2**32 s."""

    @classmethod
    def of(cls, unix_ns: int) -> 'TimeTag':
        """Return the tag of a system time."""
        seconds, ns = divmod(max(unix_ns, 0), 10**9)
        return cls(((seconds + NTP_S) << 32 | (ns << 32) // 10**9) & (2**64 - 1))


Value = int | float | str | bool
IMMEDIATELY = TimeTag(1)


@functools.lru_cache(1000)
def _layout(address: str, kinds: tuple[type, ...]) -> tuple[bytes, struct.Struct]:
    """Return address and tags of a message of int and float, and what packs its values."""
    tags = ''.join('f' if kind is float else 'i' for kind in kinds)
    return _text(address) + _text(',' + tags), struct.Struct('>' + tags)


def encode(address: str, *values: Value) -> bytes:
    """Return one OSC message."""
    kinds = tuple(map(type, values))
    if _NUMBERS.issuperset(kinds):
        head, layout = _layout(address, kinds)
        try:
            return head + layout.pack(*values)
        except (struct.error, OverflowError):
            pass  # int32 or float32 cannot hold one of them
    tags, data = ',', [_text(address), b'']
    for value in values:
        tag, part = _encoded(value)
        tags += tag
        data.append(part)
    data[1] = _text(tags)
    return b''.join(data)


def bundle(tag: TimeTag, messages: Iterable[bytes]) -> bytes:
    """Return a bundle of messages."""
    parts = [_BUNDLE, struct.pack('>Q', tag)]
    for message in messages:
        parts += struct.pack('>i', len(message)), message
    return b''.join(parts)


def _encoded(value: Value) -> tuple[str, bytes]:
    if isinstance(value, float):
        try:
            return 'f', struct.pack('>f', value)
        except OverflowError:
            return 'f', struct.pack('>f', float('inf') if value > 0 else float('-inf'))
    if isinstance(value, str):
        return 's', _text(value)
    if isinstance(value, bool):
        return 'FT'[value], b''
    if isinstance(value, TimeTag):
        return 't', struct.pack('>Q', value)
    small = -(2**31) <= value < 2**31
    return ('i', struct.pack('>i', value)) if small else ('h', struct.pack('>q', value))


def _text(text: str) -> bytes:
    data = text.encode(errors='replace').replace(b'\0', b'')
    return data + bytes(4 - len(data) % 4)


def decode(packet: bytes, depth: int = 0) -> list[tuple]:
    """Return (address, value, ...) of each message in a packet; raises ValueError if it is none."""
    if not packet.startswith(_BUNDLE):
        return [_message(packet)]
    if depth == DEEPEST:
        raise ValueError(f'bundles in more than {DEEPEST} bundles')
    if len(packet) <= _HEAD:
        raise ValueError('a bundle without a message')
    found, at = [], _HEAD
    while at < len(packet):
        size = int.from_bytes(packet[at : at + 4], 'big', signed=True)
        at += 4 + size
        if not 0 <= size <= len(packet) - (at - size):
            raise ValueError(f'a bundle with a part of {size} bytes')
        found += decode(packet[at - size : at], depth + 1)
    return found


def _message(packet: bytes) -> tuple:
    """Return one message; numbers alone in a tenth of the time that python-osc takes."""
    if not packet.startswith(b'/'):
        raise ValueError('neither a message nor a bundle')
    address_end = packet.find(b'\0')
    at = (address_end | 3) + 1  # a multiple of 4
    end = packet.find(b'\0', at)
    tags = packet[at:end]
    if at < end < at + SHORT and tags[:1] == b',' and not tags[1:].strip(b'if'):
        try:
            values = struct.unpack_from('>' + tags[1:].decode(), packet, (end | 3) + 1)
            return (packet[:address_end].decode(), *values)
        except struct.error:
            pass  # too short: python-osc says what for
    try:
        message = OscMessage(packet)
    except (ParseError, struct.error, IndexError) as error:
        raise ValueError(str(error)) from None
    return (message.address, *message.params)


class Peer(NamedTuple):
    """Who sent a message, and the text that names it in logs."""

    host: str
    port: int


class OscIn:
    """Receives on UDP `port` (0: any free one) from this machine and from `peers`.

    Raises ConfigError for a peer that is neither an address nor a network, and DeviceMissing if
    the port is taken. Of each peer it takes at most `rate_hz` messages a second.
    """

    def __init__(self, port: int, peers: Iterable[str] = (), rate_hz: float = 1000.0):
        self._networks = networks(peers)
        self._rate_hz = rate_hz
        self._peers: dict[str, Budget] = {}  # of messages
        self.received = self.malformed = self.dropped = self.strangers = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(('0.0.0.0' if len(self._networks) > 1 else '127.0.0.1', port))
        except OSError as error:
            self._socket.close()
            raise DeviceMissing(
                f'port {port}: it cannot be had ({error.strerror}); choose another'
            ) from None
        self.port = int(self._socket.getsockname()[1])

    def take(
        self, now_s: float, warn: Callable[[str, str], None], most: int = 256
    ) -> list[tuple[Peer, tuple]]:
        """Return peer and (address, value, ...) of what has come, `most` packets at a time.

        What is not taken is counted, and goes to `warn` with the host that sent it.
        """
        found: list[tuple[Peer, tuple]] = []
        for _ in range(most):
            try:
                packet, peer = self._socket.recvfrom(LARGEST)
            except OSError:
                break
            found += [(Peer(*peer), message) for message in self.read(packet, peer[0], now_s, warn)]
        return found

    def read(
        self, packet: bytes, host: str, now_s: float, warn: Callable[[str, str], None]
    ) -> list[tuple]:
        """Return what one packet of a host holds, as `take`."""
        budget = self._budget(host)
        if budget is None:
            self.strangers += 1
            warn(host, 'is not among the peers: its packets are dropped')
            return []
        left = budget.left(now_s)
        try:
            messages = decode(packet) if left else []
        except ValueError as error:
            self.malformed += 1
            budget.spend(1)
            warn(host, f'sent {len(packet)} bytes that are no OSC ({error})')
            return []
        taken = messages[:left]
        dropped = len(messages) - len(taken) if left else 1  # a packet, not read
        budget.spend(len(taken))
        self.received += len(taken)
        if dropped:
            self.dropped += dropped
            warn(host, f'sent more than {self._rate_hz:g} messages in a second: some are dropped')
        return taken

    def reply(self, peer: Peer, packet: bytes) -> None:
        """Send a packet back, from the port that receives."""
        try:
            self._socket.sendto(packet, peer)
        except OSError:
            pass

    def _budget(self, host: str) -> Budget | None:
        """Return the budget of a host, None for one that may send nothing."""
        budget = self._peers.get(host)
        if budget is None:
            address = ipaddress.IPv4Address(host)
            if not any(address in network for network in self._networks):
                return None
            if len(self._peers) >= KNOWN:
                self._peers.clear()
            budget = self._peers[host] = Budget(self._rate_hz)
        return budget

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

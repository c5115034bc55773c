# SPDX-License-Identifier: Apache-2.0
"""Open Sound Control 1.0 over UDP: the table plays another synthesiser, or is set by one.

python-osc reads and writes the packets. The sockets are ours: a node sends from its callbacks and
looks from a timer, without a thread.
"""

import logging
import socket
import struct

from eol_ros.errors import ConfigError, DeviceMissing, pip_install

try:
    from pythonosc.osc_message_builder import OscMessageBuilder
    from pythonosc.osc_packet import OscPacket, ParseError
except ImportError:  # in a ROS workspace, where rosdep has no key for it
    raise DeviceMissing(
        f'osc_out and osc_in need python-osc: {pip_install("python-osc")}'
    ) from None

LARGEST = 65536  # bytes in a datagram
DEEPEST = 16  # bundles in bundles; the specification names no limit, Python's stack has one
_BUNDLE, _HEAD = b'#bundle\0', 16  # then a time tag, then sizes with what they measure
# python-osc says on the root logger what is wrong with a packet; here it is counted instead, or a
# stranger's packets would fill the logs.
logging.getLogger().addFilter(lambda record: 'pythonosc' not in record.pathname)


def encode(address: str, *values: int | float | str | bool) -> bytes:
    """Return one OSC message."""
    message = OscMessageBuilder(address)
    for value in values:
        message.add_arg(value)
    return message.build().dgram


def decode(packet: bytes) -> list[tuple]:
    """Return (address, value, ...) of each message in a packet; raises ValueError if it is none."""
    _measure(packet)
    try:
        messages = [timed.message for timed in OscPacket(packet).messages]
    except (ParseError, struct.error, IndexError) as error:
        raise ValueError(str(error)) from None
    return [(message.address, *message.params) for message in messages]


def _measure(packet: bytes, depth: int = 0) -> None:
    """Raise ValueError for a bundle whose sizes do not add up: python-osc (1.10.2) follows a size
    below 0 backwards, for ever."""
    if not packet.startswith(_BUNDLE):
        return
    if depth == DEEPEST:
        raise ValueError(f'bundles in more than {DEEPEST} bundles')
    at = _HEAD
    while at < len(packet):
        size = int.from_bytes(packet[at : at + 4], 'big', signed=True)
        at += 4 + size
        if not 0 <= size <= len(packet) - (at - size):
            raise ValueError(f'a bundle with a part of {size} bytes')
        _measure(packet[at - size : at], depth + 1)


def target_of(target: str) -> tuple[str, int]:
    """Return host and port of "host:port"; raise ConfigError."""
    host, _, port = target.rpartition(':')
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ConfigError(f'osc_out {target!r}: give host:port, such as 127.0.0.1:57120')
    return host, int(port)


class OscOut:
    """Sends to `target`, "host:port"."""

    def __init__(self, target: str):
        host, port = target_of(target)
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(found[0], found[1])
            self._socket.setblocking(False)
            self._address = found[4]
        except OSError as error:
            raise ConfigError(f'osc_out {target!r}: {error.strerror}') from None

    def send(self, address: str, *values: int | float | str | bool) -> None:
        """Send one message; a receiver that cannot be reached is no fault of ours."""
        try:
            self._socket.sendto(encode(address, *values), self._address)
        except OSError:
            pass

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()


class OscIn:
    """Receives on UDP `port` (0: any free one); raises DeviceMissing if that is taken."""

    def __init__(self, port: int):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.bad = 0  # packets that were no OSC
        try:
            self._socket.bind(('127.0.0.1', port))
        except OSError as error:
            self._socket.close()
            raise DeviceMissing(
                f'osc_in {port}: the port cannot be had ({error.strerror}); choose another'
            ) from None
        self.port = int(self._socket.getsockname()[1])

    def take(self, most: int = 256) -> list[tuple]:
        """Return (address, value, ...) of what has come, `most` packets at a time."""
        found: list[tuple] = []
        for _ in range(most):
            try:
                packet = self._socket.recv(LARGEST)
            except OSError:
                break
            try:
                found += decode(packet)
            except ValueError:
                self.bad += 1
        return found

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

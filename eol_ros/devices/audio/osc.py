# SPDX-License-Identifier: Apache-2.0
"""Open Sound Control 1.0 over UDP: the table plays another synthesiser, or is set by one.

Only what that needs: messages of numbers, truth values and text; bundles are taken apart.
"""

import socket
import struct
from typing import Any

from eol_ros.errors import ConfigError, DeviceMissing

LARGEST = 65536  # bytes in a datagram


def _padded(data: bytes) -> bytes:
    return data + b'\0' * (-len(data) % 4)


def encode(address: str, *values: int | float | str | bool) -> bytes:
    """Return one OSC message."""
    tags, data = ',', b''
    for value in values:
        if isinstance(value, bool):
            tags += 'T' if value else 'F'
        elif isinstance(value, int):
            tags, data = tags + 'i', data + struct.pack('>i', value)
        elif isinstance(value, float):
            tags, data = tags + 'f', data + struct.pack('>f', value)
        else:
            tags, data = tags + 's', data + _padded(value.encode() + b'\0')
    return _padded(address.encode() + b'\0') + _padded(tags.encode() + b'\0') + data


def decode(packet: bytes) -> list[tuple]:
    """Return (address, value, ...) of each message in a packet; raises ValueError if it is none."""
    if packet.startswith(b'#bundle\0'):
        messages, at = [], 16
        while at + 4 <= len(packet):
            (size,) = struct.unpack_from('>i', packet, at)
            if size <= 0 or at + 4 + size > len(packet):
                raise ValueError('bundle cut short')
            messages += decode(packet[at + 4 : at + 4 + size])
            at += 4 + size
        return messages

    def text(at: int) -> tuple[str, int]:
        end = packet.index(b'\0', at)
        return packet[at:end].decode(), (end // 4 + 1) * 4

    try:
        address, at = text(0)
        tags, at = text(at)
        if not address.startswith('/') or not tags.startswith(','):
            raise ValueError('no OSC message')
        values: list[Any] = []
        for tag in tags[1:]:
            if tag in 'ifhd':
                kind = {'i': '>i', 'f': '>f', 'h': '>q', 'd': '>d'}[tag]
                values.append(struct.unpack_from(kind, packet, at)[0])
                at += struct.calcsize(kind)
            elif tag in 'TF':
                values.append(tag == 'T')
            elif tag == 's':
                value, at = text(at)
                values.append(value)
            else:
                raise ValueError(f'OSC type {tag}')
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from None
    return [(address, *values)]


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

    def __init__(self, port: int, host: str = '127.0.0.1'):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.bad = 0  # packets that were no OSC
        try:
            self._socket.bind((host, port))
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

# SPDX-License-Identifier: Apache-2.0
"""Streaming ACN (sACN): light levels as channels of a DMX512 universe, by ANSI E1.31-2018.

A packet is three layers, each with its length: root (octets 0 to 37), framing (38 to 114) and DMP
(115 to the end); table 4-1 of the standard names every field.
"""

import struct
from collections.abc import Iterator

from eol_ros.core.light.local import FIELD
from eol_ros.settings import LedsSettings

PORT = 5568
CHANNELS = 512  # of a universe
MOST_HZ = 44.0  # that DMX512 can carry with all its channels (E1.11)
AGAIN_S = 0.8  # an unchanged level is sent again within 0.8 to 1 s (6.6.1)
REPEATS = 3  # of each change, and of the end of the stream (6.6.1, 6.2.6)
SILENT_S = 2.5  # without levels while lights shine: the source is gone, so all go dark (6.7.1)
_TERMINATED = 0x40


def multicast(universe: int) -> str:
    """Return where a universe goes by multicast (9.3.1).

    >>> multicast(258)
    '239.255.1.2:5568'
    """
    return f'239.255.{universe >> 8}.{universe & 255}:{PORT}'


def target(text: str) -> str:
    """Return HOST:PORT of a receiver given as HOST or HOST:PORT."""
    return text if ':' in text else f'{text}:{PORT}'


def mistakes(
    first_channel: int, leds: LedsSettings | None, cells: int, replayed: bool
) -> Iterator[tuple[str, str]]:
    """Yield the setting of each mistake, and what is wrong.

    leds: settings of `leds`, None where the scene has none. replayed: whether a bag is played.
    """
    if replayed:
        yield 'sacn', 'a replay has its own speed, and the flash limit is that of the recorded time'
    elif leds is None or leds.flash_limit != FIELD:
        what = 'theatre lights are seen together, however far apart their blocks are'
        yield 'sacn', f'needs leds in this scene with leds.flash_limit: field; {what}'
    if first_channel + cells - 1 > CHANNELS:
        what = f'{first_channel} leaves {CHANNELS + 1 - first_channel} channels'
        yield 'first_channel', f'{what} for {cells} places: at most {CHANNELS + 1 - cells}'


class Stream:
    """The packets of a universe: each change when MOST_HZ allows it, repeated, and kept alive.

    Times are s of a steady clock. cid: identity of the source, 16 octets. levels: the first ones,
    one byte for each channel from `first_channel` on.
    """

    def __init__(self, cid: bytes, universe: int, first_channel: int, priority: int, levels: bytes):
        self.levels, self._dark = levels, bytes(len(levels))
        self._before = bytes(first_channel)  # the start code, and channels of others
        self._cid, self._universe, self._priority = cid, universe, priority
        self._sequence = 0
        self._sent, self._left = b'', 0
        self._sent_s = self._heard_s = float('-inf')

    def take(self, levels: bytes, now_s: float) -> None:
        """Take new levels, which `due` then sends."""
        self.levels, self._heard_s = levels, now_s

    def wait_s(self, now_s: float) -> float:
        """Return how long the rate forbids the next packet."""
        return max(0.0, self._sent_s + 1 / MOST_HZ - now_s)

    def due(self, now_s: float) -> bytes:
        """Return the packet to be sent now; empty if there is none."""
        if self.levels != self._dark and now_s - self._heard_s > SILENT_S:
            self.levels = self._dark
        if self.levels != self._sent:
            self._left = REPEATS
        again = now_s - self._sent_s >= AGAIN_S
        if self.wait_s(now_s) or not (self._left or again):
            return b''
        self._left = max(self._left - 1, 0)
        self._sent, self._sent_s = self.levels, now_s
        return self._packet()

    def end(self) -> list[bytes]:
        """Return the packets that end the stream, dark."""
        self.levels = self._dark
        return [self._packet(_TERMINATED) for _ in range(REPEATS)]

    def _packet(self, options: int = 0) -> bytes:
        slots = self._before + self.levels
        dmp = _layer(struct.pack('>BBHHH', 2, 0xA1, 0, 1, len(slots)) + slots)
        name = b'Echoes of the Land'
        head = struct.pack(
            '>I64sBHBBH', 2, name, self._priority, 0, self._sequence, options, self._universe
        )
        root = _layer(struct.pack('>I16s', 4, self._cid) + _layer(head + dmp))
        self._sequence = (self._sequence + 1) % 256
        return struct.pack('>HH12s', 16, 0, b'ASC-E1.17') + root


def _layer(body: bytes) -> bytes:
    """Return a layer with its flags and length before it (4.1.1)."""
    return struct.pack('>H', 0x7000 | (len(body) + 2)) + body

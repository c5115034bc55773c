# SPDX-License-Identifier: Apache-2.0
"""The language of the serial line between host and board: packets and the messages in them.

A packet on the wire is `00 | COBS(kind, sequence, body, crc) | 00`; the byte 00 appears nowhere
else, so a reader finds its feet again at the next 00 whatever happened before. COBS: Cheshire and
Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Trans. Networking 7 (1999) 159. The checksum is
CRC-16 with polynomial 0x1021 and start value 0xFFFF (its value for b'123456789' is 0x29B1) over
kind, sequence and body. All integers are little-endian. Documented in docs/reference/serial.md.

This is version 2: blocks flash by themselves, and the bridge between them and the host limits the
flashes. Version 1, in which the host sent the level of each white LED, is no longer supported.
"""

import binascii
import struct
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

VERSION = 2
MAX_BODY = 48
MAX_PACKET = MAX_BODY + 4  # kind, sequence, body, crc
MAX_ENCODED = MAX_PACKET + 1  # COBS adds one byte to fewer than 255
MOST_BLOCKS = 225  # of any board, row * columns + column
GROUP = 25  # blocks for which a word of the bridge is (firmware/link.h)
ALL_BLOCKS = (1 << MOST_BLOCKS) - 1
STRENGTH_UNIT = 0.01  # m/s^2 for each count of the strength in a Knock
BRIDGE = 255  # as the block of a BlockStatus
BY_ITSELF, LIMITED, EACH_FIELD = 1, 2, 4  # flags of Lighting
WOKE = 1  # flag of Knock
LINKED, SENSOR_DEAD, ASLEEP, RADIO_DEAD, TWICE = 1, 2, 4, 8, 16  # flags of BlockStatus
ANSWERS = 1  # flag of SelfTested
NOT_LIT = 0xFFFF  # as Knock.lit_us
FIRMWARE = (2, 6)  # of firmware/: major and minor
SHARES = 128  # of the peak, the level that DimLight counts in

MASK_BYTES = (MOST_BLOCKS - 32 + 7) // 8  # of a mask at most, beyond its first four

_HEAD = struct.Struct('<BB')
_CRC = struct.Struct('<H')


class ProtocolError(ValueError):
    """A message that cannot be put into a packet, or a body that is not what its kind says."""


class Message:
    """A message: `KIND` is its byte in the packet, `BODY` the struct of its fields.

    With MASK its last field is a mask of blocks, whose bits from 32 on follow in as many bytes as
    they need.
    """

    KIND: ClassVar[int]
    BODY: ClassVar[struct.Struct]
    MASK: ClassVar[bool]

    def __init_subclass__(cls, kind: int, form: str, mask: bool = False):
        cls.KIND, cls.BODY, cls.MASK = kind, struct.Struct(form), mask
        MESSAGES[kind] = cls


MESSAGES: dict[int, type[Message]] = {}


@dataclass(frozen=True)
class Hello(Message, kind=0x01, form='<B'):
    """Host to board, first of all, until it answers: the version that the host speaks."""

    version: int = VERSION


@dataclass(frozen=True)
class Infrared(Message, kind=0x04, form='<I', mask=True):
    """Host to board: bit b of `mask` is the infrared LED of block b."""

    mask: int = ALL_BLOCKS


@dataclass(frozen=True)
class Ping(Message, kind=0x05, form='<I'):
    """Host to board: I am here; answer with your clock."""

    host_us: int


@dataclass(frozen=True)
class Lighting(Message, kind=0x06, form='<BBH'):
    """Host to bridge: how blocks flash, from `peak` on, dying within `decay_ms`.

    `flags`: BY_ITSELF, a knock lights its block; LIMITED, the whole field flashes three times a
    second at most, or with EACH_FIELD each field of view of 10 degrees.
    """

    flags: int
    peak: int
    decay_ms: int


@dataclass(frozen=True)
class Detector(Message, kind=0x07, form='<6HI'):
    """Host to bridge: when blocks feel a knock; eol_knock_config of firmware/block/knock.h.

    Zero leaves what the firmware has.
    """

    threshold: int = 0
    ratio: int = 0
    quiet: int = 0
    slow: int = 0
    still: int = 0
    longest: int = 0
    idle: int = 0


@dataclass(frozen=True)
class Light(Message, kind=0x08, form='<II', mask=True):
    """Host to bridge: flash the blocks of `mask` now, for the image of `stamp_us`, 0: of none."""

    stamp_us: int
    mask: int


@dataclass(frozen=True)
class DimLight(Message, kind=0x0B, form='<BII', mask=True):
    """Host to bridge: Light, but to `share` of SHARES of the peak."""

    share: int
    stamp_us: int
    mask: int


@dataclass(frozen=True)
class SelfTest(Message, kind=0x09, form='<B'):
    """Host to bridge: let `block` test its LEDs and accelerometer; SelfTested answers."""

    block: int


@dataclass(frozen=True)
class Lattice(Message, kind=0x0A, form='<BBB'):
    """Host to bridge: the shape of a table other than the default.

    `columns` of the table; `falls` of a block in a second (core/light/local.py); `places`, rows
    times columns. Hello ends it.
    """

    columns: int
    falls: int
    places: int


@dataclass(frozen=True)
class Welcome(Message, kind=0x81, form='<BB16s'):
    """Board to host, answer to Hello: what it is. `name` is ASCII, filled up with zeros."""

    version: int
    blocks: int
    name: bytes


@dataclass(frozen=True)
class Pong(Message, kind=0x85, form='<IIIH'):
    """Board to host, answer to Ping: `host_us` as it came, its clock at that moment, counters."""

    host_us: int
    board_us: int
    good: int
    bad: int


@dataclass(frozen=True)
class Knock(Message, kind=0x88, form='<IBHHB'):
    """Bridge to host: a block was let go at `board_us`, and lit itself `lit_us` later, or NOT_LIT.

    `strength` in 0.01 m/s^2. `flags`: WOKE, it slept until then, and when is known to 3 ms only.
    """

    board_us: int
    block: int
    strength: int
    lit_us: int
    flags: int


@dataclass(frozen=True)
class BlockStatus(Message, kind=0x89, form='<BHbBBB'):
    """Bridge to host, every ten seconds and at each change: how a block is, or the BRIDGE itself.

    `millivolts` of its battery, 0 where it has none; `celsius`; version of its firmware; `flags`:
    LINKED, the bridge hears it; SENSOR_DEAD, its accelerometer repeats one value; ASLEEP;
    RADIO_DEAD, that of the bridge does not work; TWICE, more than one block has this number.
    """

    block: int
    millivolts: int
    celsius: int
    major: int
    minor: int
    flags: int


@dataclass(frozen=True)
class SelfTested(Message, kind=0x8A, form='<BB3h3H'):
    """Bridge to host, answer to SelfTest: what `block` has measured.

    `flags`: ANSWERS, its accelerometer says what it is. `x_mg`, `y_mg`, `z_mg`: by how much they
    change while its own force pulls. `white_off_mv`, `white_on_mv`: behind the white LED, dark and
    lit. `infrared_mv`: over the infrared LED, lit. `devices.board.self_test` judges.
    """

    block: int
    flags: int
    x_mg: int
    y_mg: int
    z_mg: int
    white_off_mv: int
    white_on_mv: int
    infrared_mv: int


@dataclass(frozen=True)
class Refused(Message, kind=0x87, form='<BB'):
    """Board to host: it cannot speak `host_version`; it stays dark. It speaks `version`."""

    version: int
    host_version: int


class Received(NamedTuple):
    """One good packet: its sequence number 0..255 and the message in it."""

    sequence: int
    message: Message


def crc16(data: bytes) -> int:
    """Return the CRC-16 of `data`, polynomial 0x1021, start 0xFFFF, not reflected."""
    return binascii.crc_hqx(data, 0xFFFF)


def cobs_encode(data: bytes) -> bytes:
    """Return `data` without any zero byte, one byte longer for each 254 begun."""
    out = bytearray()
    for run in data.split(b'\0'):
        while len(run) >= 254:
            out += b'\xff' + run[:254]
            run = run[254:]
        out.append(len(run) + 1)
        out += run
    return bytes(out)


def cobs_decode(data: bytes) -> bytes:
    """Return what `cobs_encode` was given; ProtocolError where no encoder can have made `data`."""
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        run = data[at + 1 : at + code]
        if code == 0 or len(run) != code - 1 or 0 in run:
            raise ProtocolError(f'bad COBS run of {code} at byte {at} of {len(data)}')
        out += run
        at += code
        if code < 255 and at < len(data):
            out.append(0)
    if not data:
        raise ProtocolError('empty packet')
    # A full run at the very end is followed by an empty one in this encoder and by none in others.
    return bytes(out)


def encode(message: Message, sequence: int) -> bytes:
    """Return the packet of `message` with its delimiters; `sequence` counts modulo 256."""
    try:
        values, further = list(vars(message).values()), 0
        if message.MASK:
            values[-1], further = values[-1] & 0xFFFFFFFF, values[-1] >> 32
        body = message.BODY.pack(*values) + further.to_bytes(
            -(-further.bit_length() // 8), 'little'
        )
    except struct.error as error:
        raise ProtocolError(f'{message}: {error}') from error
    packet = _HEAD.pack(message.KIND, sequence & 0xFF) + body
    return b'\0' + cobs_encode(packet + _CRC.pack(crc16(packet))) + b'\0'


class Decoder:
    """Decodes a byte stream into messages.

    `good` counts valid packets. `bad` counts packets that are damaged, too long, or of a kind
    unknown to this version.
    """

    def __init__(self) -> None:
        self.good = self.bad = 0
        self._pending = b''

    def feed(self, data: bytes) -> list[Received]:
        """Take in `data`, cut anywhere, and return the messages that are now complete."""
        *ended, rest = (self._pending + data).split(b'\0')
        self._pending = rest[: MAX_ENCODED + 1]  # longer than any packet
        found = [self._read(encoded) for encoded in ended if encoded]
        return [received for received in found if received]

    def _read(self, encoded: bytes) -> Received | None:
        try:
            packet = cobs_decode(encoded[: MAX_ENCODED + 1])  # a longer one fails the checksum
        except ProtocolError:
            packet = b''
        body = packet[2:-2]
        kind = MESSAGES.get(packet[0]) if len(packet) >= 4 else None
        whole = packet[-2:] == _CRC.pack(crc16(packet[:-2]))
        size = kind.BODY.size if kind else 0
        if kind is None or not whole or not 0 <= len(body) - size <= MASK_BYTES * kind.MASK:
            self.bad += 1
            return None
        self.good += 1
        values = list(kind.BODY.unpack_from(body))
        if kind.MASK:
            values[-1] |= int.from_bytes(body[size:], 'little') << 32
        return Received(packet[1], kind(*values))

# SPDX-License-Identifier: Apache-2.0
"""eol_msgs/Blocks to and from the wire as arrays: 25 message objects an image cost more than
tracking.

A Blocks message has one layout (plain CDR, little-endian, alignment from behind the 4-byte
header): the 25 blocks lie 56 bytes apart from byte 36 on, each block's id one alignment before it.
A test holds this against the serialiser of rclpy.
"""

import struct
from dataclasses import dataclass

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.ros.stamps import NS

FRAME_ID = b'table\0'
RECORD = np.dtype(
    {
        'names': ['x', 'y', 'yaw', 'u', 'v', 'sigma', 'visibility', 'seen', 'next_id'],
        'formats': ['<f8', '<f8', '<f8', '<f8', '<f8', '<f4', '<f4', '?', 'u1'],
        'offsets': [0, 8, 16, 24, 32, 40, 44, 48, 49],
        'itemsize': 56,
    }
)
_START = 36  # 4 + 32
_SIZE = _START + RECORD.itemsize * N_BLOCKS - 7  # ends behind the last `seen`


@dataclass(frozen=True)
class BlocksArrays:
    """One Blocks message; `blocks` is a (25,) record view with the fields of RECORD."""

    stamp_ns: int
    state: int
    symmetry_ambiguous: bool
    image: int
    blocks: np.ndarray


def pack_blocks(
    stamp_ns: int, state: int, symmetry_ambiguous: bool, image: int, blocks: np.ndarray
) -> bytes:
    """Return the CDR bytes of a Blocks message; blocks: (25,) of RECORD, ids are set here."""
    raw = bytearray(_SIZE + 7)
    raw[1] = 1  # little-endian
    struct.pack_into(
        '<iII6sB?', raw, 4, stamp_ns // NS, stamp_ns % NS, len(FRAME_ID), FRAME_ID, state,
        symmetry_ambiguous,
    )  # fmt: skip
    struct.pack_into('<II', raw, 24, image % 2**32, N_BLOCKS)
    body = np.frombuffer(raw, RECORD, N_BLOCKS, _START)
    body[:] = blocks
    body['next_id'] = np.arange(1, N_BLOCKS + 1)
    return bytes(memoryview(raw)[:_SIZE])


def blocks_from_cdr(raw: bytes) -> BlocksArrays:
    """Return the arrays of a raw Blocks message.

    Raises ValueError when it is not 25 blocks in frame `table`, little-endian.
    """
    if len(raw) < _SIZE or raw[1] != 1 or raw[12:22] != struct.pack('<I', 6) + FRAME_ID:
        raise ValueError('blocks: not a little-endian message of 25 blocks in frame table')
    seconds, nanoseconds = struct.unpack_from('<iI', raw, 4)
    state, ambiguous, image, count = struct.unpack_from('<B?II', raw, 22)
    if count != N_BLOCKS:
        raise ValueError(f'blocks: {count} blocks, not {N_BLOCKS}')
    body = np.frombuffer(bytes(raw) + bytes(7), RECORD, N_BLOCKS, _START)
    return BlocksArrays(seconds * NS + nanoseconds, state, ambiguous, image, body)

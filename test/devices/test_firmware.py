# SPDX-License-Identifier: Apache-2.0
"""firmware/eol_serial.h, compiled, against the Python of the host: two writers of one protocol."""

import ctypes
import dataclasses
import random
import shutil
import subprocess
from pathlib import Path

import pytest

from eol_ros.core import serial_protocol as p

HEADER = Path(__file__).parents[2] / 'firmware' / 'eol_serial.h'
GLUE = """
#include "eol_serial.h"
size_t encode(uint8_t *w, uint8_t k, uint8_t s, const uint8_t *b, size_t n)
{ return eol_encode(w, k, s, b, n); }
static eol_decoder line;
uint32_t good(void) { return line.good; }
uint16_t bad(void) { return line.bad; }
void reset(void) { memset(&line, 0, sizeof line); }
size_t feed(const uint8_t *in, size_t n, uint8_t *out)
{
    uint8_t kind; const uint8_t *body; size_t size, used = 0;
    for (size_t k = 0; k < n; k++)
        if (eol_decode(&line, in[k], &kind, &body, &size)) {
            out[used++] = kind; out[used++] = (uint8_t)size;
            memcpy(out + used, body, size); used += size;
        }
    return used;
}
uint32_t round_trip(uint32_t v) { uint8_t b[4]; eol_put32(b, v); return eol_get32(b); }
"""
MESSAGES = [
    p.Hello(),
    p.Levels(0, bytes(25)),
    p.Levels(2**32 - 1, bytes(range(25))),
    p.Flash(7, 3, 255, 400),
    p.Infrared(),
    p.Ping(1),
    p.Welcome(1, 25, b'c board'.ljust(16, b'\0')),
    p.Pong(1, 2, 3, 4),
    p.Tap(99, 24, 65535),
    p.Refused(1, 2),
]


@pytest.fixture(scope='module')
def board(tmp_path_factory):
    compiler = shutil.which('cc') or shutil.which('gcc') or shutil.which('clang')
    if compiler is None:
        pytest.skip('no C compiler here')
    folder = tmp_path_factory.mktemp('firmware')
    (folder / 'glue.c').write_text(GLUE)
    library = folder / 'glue.so'
    strict = ['-std=c99', '-Wall', '-Wextra', '-Werror', '-Wno-unused-function']
    subprocess.run(
        [compiler, *strict, '-shared', '-fPIC', '-I', str(HEADER.parent), 'glue.c', '-o', library],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    loaded = ctypes.CDLL(str(library))
    loaded.encode.restype = loaded.feed.restype = ctypes.c_size_t
    loaded.round_trip.restype = loaded.good.restype = ctypes.c_uint32
    loaded.reset()
    return loaded


def hear(board, wire):
    out = ctypes.create_string_buffer(65536)
    used = board.feed(wire, ctypes.c_size_t(len(wire)), out)
    data, found = out.raw[:used], []
    while data:
        kind, size = data[:2]
        found.append(p.MESSAGES[kind](*p.MESSAGES[kind].BODY.unpack(data[2 : 2 + size])))
        data = data[2 + size :]
    return found


def test_the_board_reads_what_the_host_writes(board):
    wire = b''.join(p.encode(m, k) for k, m in enumerate(MESSAGES))

    assert hear(board, wire) == MESSAGES


def test_the_board_writes_what_the_host_writes(board):
    for sequence, message in enumerate(MESSAGES):
        expected = p.encode(message, sequence)
        body = message.BODY.pack(*dataclasses.astuple(message))
        wire = ctypes.create_string_buffer(64)
        size = board.encode(wire, message.KIND, sequence, body, ctypes.c_size_t(len(body)))
        assert wire.raw[:size] == expected


def test_the_board_reads_on_after_noise_and_damage(board):
    rng = random.Random(4)
    for _ in range(200):
        noise = rng.randbytes(rng.randint(0, 200))
        damaged = bytearray(p.encode(rng.choice(MESSAGES), 0))
        damaged[rng.randrange(1, len(damaged) - 1)] ^= rng.randint(1, 255)
        before = board.good()
        found = hear(board, noise + bytes(damaged) + p.encode(p.Ping(5), 0))
        assert found[-1] == p.Ping(5)
        assert board.good() == before + len(found)
    assert board.bad() > 100


def test_its_integers_are_little_endian(board):
    assert board.round_trip(ctypes.c_uint32(0x12345678)) == 0x12345678

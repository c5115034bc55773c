# SPDX-License-Identifier: Apache-2.0
"""firmware/eol_serial.h, compiled, against the Python of the host: two writers of one protocol.

And all firmware: compiled without a warning, and run where undefined behaviour ends the program.
"""

import ctypes
import dataclasses
import random
import re

import pytest
from support.native import FIRMWARE, assert_compiles, library, output

from eol_ros.core import serial_protocol as p

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
    p.Infrared(2**25 - 1),
    p.Ping(1),
    p.Welcome(1, 25, b'c board'.ljust(16, b'\0')),
    p.Pong(1, 2, 3, 4),
    p.Refused(1, 2),
    p.Lighting(p.BY_ITSELF | p.LIMITED, 255, 350),
    p.Detector(256, 13, 40, 7000, 67, 2016, 80640),
    p.Light(2**32 - 1, 2**25 - 1),
    p.DimLight(64, 2**32 - 1, 2**25 - 1),
    p.Lattice(4, 1, 12),
    p.Knock(99, 24, 65535, p.NOT_LIT, p.WOKE),
    p.BlockStatus(p.BRIDGE, 3000, -5, 2, 0, p.LINKED | p.SENSOR_DEAD),
]


@pytest.fixture(scope='module')
def board(tmp_path_factory):
    loaded = library(tmp_path_factory.mktemp('firmware'), GLUE)
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


def test_both_name_the_same_kinds_and_flags(tmp_path):
    """The header's own numbers, by its own compiler."""
    kinds = {m.__name__.upper(): m.KIND for m in p.MESSAGES.values()}
    kinds['KNOCKED'], kinds['BLOCK_STATUS'] = kinds.pop('KNOCK'), kinds.pop('BLOCKSTATUS')
    kinds['SELF_TEST'], kinds['SELF_TESTED'] = kinds.pop('SELFTEST'), kinds.pop('SELFTESTED')
    kinds['DIM_LIGHT'] = kinds.pop('DIMLIGHT')
    flags = ('BY_ITSELF', 'LIMITED', 'WOKE', 'LINKED', 'SENSOR_DEAD', 'ASLEEP', 'ANSWERS', 'BRIDGE')
    numbers = kinds | {n: getattr(p, n) for n in (*flags, 'NOT_LIT', 'VERSION', 'MAX_BODY')}
    tests = '\n'.join(f'typedef char is_{n}[EOL_{n} == {v} ? 1 : -1];' for n, v in numbers.items())
    (tmp_path / 'numbers.c').write_text(f'#include "eol_serial.h"\n{tests}\n')
    assert_compiles(tmp_path, '-I', FIRMWARE, '-c', 'numbers.c', '-o', 'numbers.o')


# What needs its own processor's compiler `make firmware` compiles, without a warning, too.
OF_A_PROCESSOR = ('<avr/', '<simavr/', '<unicorn/', '__asm')
SOURCES = [
    path
    for path in sorted([*FIRMWARE.glob('*.c'), *FIRMWARE.glob('*/*.c')])
    if not any(name in path.read_text() for name in OF_A_PROCESSOR)
]
STORM = """
#include <stdio.h>
#include "knock.h"
int main(void)
{
    static const int16_t EXTREMES[] = {-32768, -32767, -1, 0, 1, 32704, 32767};
    uint32_t seed = 1, felt = 0;
    for (int round = 0; round < 200; round++) {
        eol_knock knock;
        eol_knock_config config = EOL_KNOCK_DEFAULTS;
        if (round % 3 == 1) config.threshold = config.ratio = config.slow = UINT16_MAX;
        if (round % 3 == 2) config.threshold = config.ratio = config.quiet = config.longest = 1;
        eol_knock_begin(&knock, &config);
        for (int n = 0; n < 5000; n++) {
            seed = seed * 1664525u + 1013904223u;
            int16_t x = EXTREMES[(seed >> 8) % 7], y = EXTREMES[(seed >> 16) % 7];
            if (round % 2) x = (int16_t)(n / 500 % 2 ? 32767 : -32768), y = x;
            felt += eol_knock_sample(&knock, x, y) == EOL_KNOCK_FELT;
            if (knock.state > EOL_KNOCK_MOVES) return 2;
            if (n % 1999 == 0) eol_knock_wake(&knock);
        }
    }
    printf("%u\\n", felt);
    return felt == 0;
}
"""


@pytest.mark.parametrize('source', SOURCES, ids=lambda path: f'{path.parent.name}/{path.name}')
def test_the_firmware_compiles_without_a_warning(source, tmp_path):
    strict = ['-pedantic', '-Wall', '-Wextra', '-Wconversion', '-Wshadow', '-Werror']
    assert_compiles(tmp_path, *strict, '-O2', '-c', source, '-o', tmp_path / 'out.o')


def test_a_block_needs_no_floating_point(tmp_path):
    words = ['-O2', '-mgeneral-regs-only', '-c']
    for name in ('knock.c', 'light.c', 'block.c'):
        assert_compiles(tmp_path, *words, FIRMWARE / 'block' / name, '-o', tmp_path / 'out.o')


def test_no_sample_makes_the_detector_do_what_is_undefined(tmp_path):
    assert output(tmp_path, STORM, 'block/knock.c')[0] > 100


RADIO_STORM = """
#include <stdio.h>
#include "block.h"
int main(void)
{
    uint32_t seed = 1, now = 0xFFFF0000u, said = 0, lit = 0;
    uint8_t frame[EOL_FRAME];
    eol_block block;
    eol_block_begin(&block, 7);
    for (uint32_t n = 0; n < 1000000 / EOL_FRAME; n++) {
        for (int k = 0; k < EOL_FRAME; k++)
            frame[k] = (uint8_t)((seed = seed * 1664525u + 1013904223u) >> 24);
        if (n % 3) frame[0] = n % 64 ? EOL_FRAME_WORD : EOL_FRAME_FEELS;
        if (n % 64 == 3) eol_knock_begin(&block.knock, &EOL_KNOCK_DEFAULTS); /* not as told */
        eol_block_heard(&block, frame);
        for (int k = 0; k < 32; k++) {
            seed = seed * 1664525u + 1013904223u;
            int16_t x = (int16_t)(n % 64 > 40 ? 4000 : (int16_t)(seed >> 24));
            int16_t y = (int16_t)(seed >> 16 & 255);
            if (eol_block_sample(&block, now += 744, x, y) == EOL_KNOCK_FELT) {
                eol_block_shines(&block, now);
                lit += eol_block_level(&block) > 0;
            }
            eol_block_tick(&block);
            if (eol_block_says(&block, now, frame)) {
                if (frame[1] != 7) return 2;
                said++;
                eol_block_told(&block, seed >> 31);
            }
            if (eol_block_may_sleep(&block)) eol_block_sleeps(&block, !block.asleep);
        }
    }
    printf("%u %u\\n", said, lit);
    return 0;
}
"""


def test_a_million_bytes_by_radio_make_a_block_do_nothing_undefined(tmp_path):
    """And it goes on to feel, to flash and to talk."""
    sources = (f'block/{name}.c' for name in ('block', 'knock', 'light'))
    said, lit = output(tmp_path, RADIO_STORM, *sources)
    assert said > 100
    assert lit > 10


BRIDGE_STORM = """
#include <stdio.h>
#include "bridge.h"
static uint32_t seed = 1;
static uint8_t any(void)
{
    return (uint8_t)((seed = seed * 1664525u + 1013904223u) >> 24);
}
int main(void)
{
    uint64_t now = 0;
    uint32_t sent = 0, said = 0;
    uint8_t frame[EOL_FRAME], wire[EOL_MAX_WIRE], body[EOL_MAX_BODY], byte;
    static eol_bridge bridge;
    eol_bridge_begin(&bridge, now);
    for (uint32_t n = 0; n < 40000; n++) {
        size_t size = any() % (EOL_MAX_BODY + 1), length;
        now += any() * 40u;
        for (size_t k = 0; k < size; k++) body[k] = any();
        size = n % 2 ? size : (const size_t[]){1, 4, 4, 4, 16, 8, 3}[n / 2 % 7];
        uint8_t kind = (const uint8_t[]){1, 4, 5, 6, 7, 8, 10}[n / 2 % 7];
        length = eol_encode(wire, kind, 0, body, size);
        if (n % 5 == 0) wire[any() % length] = any();
        for (size_t k = 0; k < length; k++) eol_bridge_byte(&bridge, now, wire[k]);
        for (int k = 0; k < EOL_FRAME; k++) frame[k] = any();
        if (n % 4) {
            frame[0] = n % 3 ? EOL_FRAME_KNOCK : EOL_FRAME_STATUS;
            frame[1] %= n % 8 > 4 ? 255 : 32;
        }
        eol_bridge_heard(&bridge, now, frame);
        for (int k = 0; k < 4 && eol_bridge_says(&bridge, now, frame); k++) said++;
        for (int k = 0; k < (n & 1024 ? 2 : 60) && eol_bridge_sends(&bridge, &byte); k++) sent++;
        if (bridge.count > EOL_BRIDGE_ROOM) return 2;
    }
    printf("%u %u %u\\n", sent, said, bridge.dropped);
    return 0;
}
"""


def test_a_million_bytes_make_the_bridge_do_nothing_undefined(tmp_path):
    """Whole packets, spoilt ones and frames of the radio, and a host that reads too slowly."""
    sources = (f'bridge/{name}.c' for name in ('bridge', 'flash', 'local'))
    sent, said, dropped = output(tmp_path, BRIDGE_STORM, *sources)
    assert sent > 100_000
    assert said > 1000
    assert dropped > 100  # whole packets, so that the next one is read


def test_the_version_is_that_of_the_sources():
    for header, name in (('block/block.h', 'BLOCK'), ('bridge/bridge.h', 'BRIDGE')):
        text = (FIRMWARE / header).read_text()
        found = [int(re.search(rf'EOL_{name}_{n} = (\d+)', text)[1]) for n in ('MAJOR', 'MINOR')]
        assert tuple(found) == p.FIRMWARE, header

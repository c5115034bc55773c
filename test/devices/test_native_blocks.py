# SPDX-License-Identifier: Apache-2.0
"""firmware/block/block.c, compiled with the package: what blocks say, and how they shine."""

import struct

import numpy as np
import pytest
from support.paper import N_BLOCKS

from eol_ros.devices.board import block
from eol_ros.devices.board.block import LEARN
from eol_ros.devices.board.bluepill import FRAME, KNOCK
from eol_ros.devices.board.firmware import AIR_US, NativeBlocks
from eol_ros.devices.board.twin import LIVE, REST, Chunk

pytestmark = pytest.mark.skipif(
    not block.compiled(), reason='in a checkout: python setup.py build_ext --inplace'
)
PERIOD_S = 1 / 1344
ALL = 2**N_BLOCKS - 1
WORD, FALLS, BY_ITSELF = 0x57, 4, 1
ONSET_S = 0.5


def word(flags=BY_ITSELF, light=0, count=0):
    return struct.pack('<BBBHIIB', WORD, flags, 255, 350, ALL, light, count).ljust(FRAME, b'\0')


def counts(mg):
    return np.clip(np.rint(np.asarray(mg) / 4) * 64, -32768, 32704).astype(np.int16)


@pytest.fixture
def blocks():
    """25 that have learnt what rest is; block 7 is let go at ONSET_S."""
    random, made = np.random.default_rng(1), NativeBlocks()
    for b in range(N_BLOCKS):
        rest = counts(random.normal(0, 5.7, (LEARN + 288, 2)))
        made.feel(Chunk(b, REST, 0, PERIOD_S, rest), 0.0)
    mg = random.normal(0, 5.7, (700, 2))
    mg[100:260, 0] += 300 * np.cos(np.linspace(0, np.pi, 160))
    made.feel(Chunk(7, LIVE, 0, PERIOD_S, counts(mg)), ONSET_S - 99 * PERIOD_S)
    return made


def run(blocks, begin_ms, end_ms, heard=True, say=None):
    """Return (when, frame) of what is heard, and the levels of block 7."""
    said, levels = [], []
    for ms in range(begin_ms, end_ms):
        if say is not None and ms % 2 == 0:
            blocks.hear(say, bytes(N_BLOCKS))
        shown, frames = blocks.run(ms * 1e-3, bytes([not heard]) * N_BLOCKS)
        said += [(ms * 1e-3, frame) for frame in frames]
        levels.append(shown[7])
    return said, levels


def knocks(said):
    return [(at, struct.unpack('<BBBHHHB', f[:10])) for at, f in said if f[0] == KNOCK]


def test_a_block_lights_itself_and_says_when_it_was_let_go(blocks):
    said, levels = run(blocks, 1, 900, say=word())
    [(at, (_, number, flags, age_us, strength, lit_us, _))] = knocks(said)
    assert (number, flags) == (7, 0)
    assert at - (age_us + AIR_US) * 1e-6 == pytest.approx(ONSET_S, abs=1e-3)
    assert strength == pytest.approx(294, rel=0.1)  # 300 mg in 0.01 m/s^2
    assert 0 < lit_us < 5000
    first = np.flatnonzero(levels)[0]
    assert (first + 1) * 1e-3 == pytest.approx(ONSET_S, abs=5e-3)


def test_it_says_so_until_it_is_heard_and_the_age_grows(blocks):
    said, _ = run(blocks, 1, 520, heard=False)
    assert said == []
    [(at, (_, _, _, age_us, *_))] = knocks(run(blocks, 520, 700)[0])
    assert at - (age_us + AIR_US) * 1e-6 == pytest.approx(ONSET_S, abs=1e-3)
    assert age_us > 15_000


def test_without_a_word_light_falls_slowly_and_with_it_as_set(blocks):
    _, levels = run(blocks, 1, 900)
    assert levels[-1] == pytest.approx(255 * np.exp(-0.4 / 4.003), abs=2)
    _, levels = run(blocks, 900, 1250, say=word(BY_ITSELF | FALLS))
    assert levels[-1] == pytest.approx(255 * np.exp(-0.4 / 4.003 - 0.35 / 0.35), abs=3)


def test_an_order_lights_those_that_it_names_once(blocks):
    _, levels = run(blocks, 1, 100, say=word(light=1 << 7, count=3))
    assert not any(levels)  # given before it started
    _, levels = run(blocks, 100, 110, say=word(light=1 << 8, count=4))
    assert not any(levels)
    _, levels = run(blocks, 110, 120, say=word(light=1 << 7, count=5))
    assert levels[-1] > 250
    _, levels = run(blocks, 120, 450, say=word(BY_ITSELF | FALLS, light=1 << 7, count=5))
    assert levels[-1] < 110  # the same order, said again, is none


def test_where_blocks_may_not_the_knock_is_told_all_the_same(blocks):
    said, levels = run(blocks, 1, 700, say=word(flags=0))
    [(_, (_, _, _, _, _, lit_us, _))] = knocks(said)
    assert lit_us == 0xFFFF
    assert not any(levels)

# SPDX-License-Identifier: Apache-2.0
"""firmware/bridge/flash.c and local.c against core/light/flash.py and local.py, to the level.

And with the firmware of blocks: those of a table that flash by themselves, and the bridge that
holds them.
"""

import ctypes
import time

import numpy as np
import pytest
from support.fields_of_view import RATE_HZ, distinct, fields, most_in_a_second
from support.flashes import changes, most_flashes_in_a_second
from support.native import library
from support.paper import N_BLOCKS

from eol_ros.core.light.bridge import Bridge
from eol_ros.core.light.flash import FLASHES_PER_S, HOLD_RATE, MIN_PERIOD_S, FlashField
from eol_ros.core.light.local import LocalField, block_falls
from eol_ros.core.light.looks import IDLE_SHARE, stressed
from eol_ros.core.serial_protocol import GROUP
from eol_ros.core.table import Table

OTHERS = [
    Table(rows=3, columns=4),
    Table(rows=3, columns=7, block_side_m=0.03, gap_m=0.02),
    Table(rows=8, columns=8, platform_m=(2.4, 2.4)),
]
LARGEST = Table(rows=15, columns=15, platform_m=(3.6, 3.6))
GLUE = """
#include <stdlib.h>
#include "block.h"
#include "bridge.h"
size_t flash_size(void) { return sizeof(eol_flash_field); }
size_t local_size(void) { return sizeof(eol_local_field); }

enum { MOST = EOL_BLOCKS };
static int B = EOL_LOCAL_BLOCKS;

/* Light at `hz` under the limit of each field of view: of slips at `at_s`, where a block from 128
 * on holds block - 128 and 255 sets the peak; or of an adversary, who lights a block of `mask` when
 * it has lost `depth`, in `often` of 1000 looks: to the full, or a little above what it has. */
void storm(double decay_s, int slips, const double *at_s, const uint8_t *block,
           const double *share, int frames, double hz, uint8_t *shown)
{
    eol_local_field field;
    int next = 0;
    eol_local_begin(&field, decay_s, 1.0);
    for (int k = 0; k < frames; k++) {
        for (; next < slips && at_s[next] <= k / hz; next++) {
            uint8_t b = block[next];
            if (b == 255)
                eol_local_set(&field, at_s[next], decay_s, share[next]);
            else if (b >= 128)
                eol_local_hold(&field, at_s[next], at_s[next], b - 128);
            else
                eol_local_slip(&field, at_s[next], b, share[next]);
        }
        eol_local_levels(&field, k / hz, shown + k * B);
    }
}

void adversary(double decay_s, uint32_t mask, int depth, int often, int dims, int seed, int frames,
               double hz, uint8_t *shown)
{
    eol_local_field field;
    uint8_t now[MOST], peak[MOST] = {0};
    int frame = 0;
    srand((unsigned)seed);
    eol_local_begin(&field, decay_s, 1.0);
    for (int t = 0; frame < frames; t++) {
        eol_local_levels(&field, t * 1e-3, now);
        for (int b = 0; b < B; b++) {
            if (now[b] > peak[b]) peak[b] = now[b];
            if (!(mask >> b & 1) || (peak[b] && peak[b] - now[b] < depth)) continue;
            if (rand() % 1000 >= often) continue;
            double share = dims && rand() % 2 ? (now[b] + 1 + rand() % 60) / 255.0 : 1.0;
            eol_local_slip(&field, t * 1e-3, (uint8_t)b, share < 1.0 ? share : 1.0);
            peak[b] = 0;
        }
        for (; frame < frames && frame / hz < (t + 1) * 1e-3; frame++)
            eol_local_levels(&field, frame / hz, shown + frame * B);
    }
}

/* What a sample says is what the detector says: 1 felt, 2 told, 3 too weak to be told. */
const eol_knock_config EOL_KNOCK_DEFAULTS;
void eol_knock_begin(eol_knock *k, const eol_knock_config *c) { k->config = *c; }
void eol_knock_wake(eol_knock *k) { k->woken = 0; }
uint8_t eol_knock_sample(eol_knock *k, int16_t x, int16_t y)
{
    k->state = x == 1 ? EOL_KNOCK_FEELS : x ? EOL_KNOCK_MOVES : k->state;
    k->strength = (uint16_t)(1000 + y);
    return x == 3 ? EOL_KNOCK_NONE : (uint8_t)x;
}

static void host(eol_bridge *bridge, int t, uint8_t kind, uint8_t *body, size_t size)
{
    uint8_t wire[EOL_MAX_WIRE];
    size_t length = eol_encode(wire, kind, 0, body, size);
    for (size_t k = 0; k < length; k++) eol_bridge_byte(bridge, 1000u * (uint64_t)t, wire[k]);
}

/* What the host says before each Lighting, where it is not all zeros. */
static uint8_t lattice[3];
void shape(uint8_t columns, uint8_t most, uint8_t places)
{
    lattice[0] = columns, lattice[1] = most, lattice[2] = places;
    B = places ? places : EOL_LOCAL_BLOCKS;
}

static void say_lighting(eol_bridge *bridge, int t, uint8_t *lighting)
{
    if (lattice[0]) host(bridge, t, EOL_LATTICE, lattice, 3);
    host(bridge, t, EOL_LIGHTING, lighting, 4);
}

/* `ms` milliseconds of the whole firmware of all blocks and their bridge. felt[t * B + b]: block b
 * feels a knock (1) or a weak one (2), or the host lights it (3), or to half of the peak (4),
 * or to n / 128 (128 + n). `flags` are those of Lighting. Of 1000 frames `lost` are lost
 * either way, and so many answers. The bridge is started again at `gone_ms`, after 0.1 s,
 * and block 12 at `reset_ms`. shown[t * B + b]: the light of a block. */
void table(int ms, const uint8_t *felt, int flags, int decay_ms, int lost, int gone_ms,
           int reset_ms, uint8_t *shown)
{
    static eol_bridge bridge;
    static eol_block block[MOST];
    static int measured[MOST];
    uint8_t frame[EOL_FRAME], word[EOL_FRAME] = {0}, byte;
    uint8_t lighting[4] = {(uint8_t)flags, 255, (uint8_t)decay_ms, (uint8_t)(decay_ms >> 8)};
    srand(1);
    eol_bridge_begin(&bridge, 0);
    say_lighting(&bridge, 0, lighting);
    for (int b = 0; b < B; b++) eol_block_begin(&block[b], (uint8_t)b), measured[b] = -1;
    for (int t = 0; t < ms; t++) {
        uint32_t now_us = 1000u * (uint32_t)t;
        uint8_t light[33] = {0}, dim[34] = {EOL_WHOLE / 2}, lights = 0, dims = 0;
        int there = t < gone_ms || t >= gone_ms + 100;
        if (t == gone_ms + 100) eol_bridge_begin(&bridge, now_us);
        if (t == gone_ms + 300) say_lighting(&bridge, t, lighting);
        if (t == reset_ms) eol_block_begin(&block[12], 12);
        for (int b = 0; b < B; b++) {
            uint8_t kind = felt[t * B + b];
            int busy = measured[b] >= 0;
            if (word[0] && rand() % 1000 >= lost) eol_block_heard(&block[b], word);
            if (kind > 128) {
                uint8_t one[34] = {(uint8_t)(kind - 128)};
                one[5 + b / 8] = (uint8_t)(1 << b % 8);
                host(&bridge, t, EOL_DIM_LIGHT, one, B > 32 ? sizeof one : 9);
            }
            if (kind == 4) dim[5 + b / 8] |= (uint8_t)(1 << b % 8), dims = 1;
            if (kind == 3) light[4 + b / 8] |= (uint8_t)(1 << b % 8), lights = 1;
            if ((kind == 1 || kind == 2) && !busy && t > reset_ms + (b == 12 ? 380 : 0)) {
                eol_block_sample(&block[b], now_us, 1, 0);
                measured[b] = 3 + 100 * kind;
            } else if (busy && --measured[b] % 100 == 0) {
                eol_block_sample(&block[b], now_us, measured[b] / 100 == 1 ? 2 : 3, 0);
                measured[b] = -1;
            }
            if (eol_block_says(&block[b], now_us, frame)) {
                uint8_t heard = there && rand() % 1000 >= lost;
                if (heard) eol_bridge_heard(&bridge, now_us, frame);
                eol_block_told(&block[b], heard && rand() % 1000 >= lost);
            }
            eol_block_tick(&block[b]);
            shown[t * B + b] = eol_block_level(&block[b]);
        }
        word[0] = 0;
        if (!there) continue;
        if (lights) host(&bridge, t, EOL_LIGHT, light, B > 32 ? sizeof light : 8);
        if (dims) host(&bridge, t, EOL_DIM_LIGHT, dim, B > 32 ? sizeof dim : 9);
        if (eol_bridge_says(&bridge, now_us, frame) && frame[0] >= EOL_FRAME_WORD)
            memcpy(word, frame, EOL_FRAME);
        while (eol_bridge_sends(&bridge, &byte)) {}
    }
}
"""


@pytest.fixture(scope='module')
def bridge(tmp_path_factory):
    sources = (
        'bridge/bridge.c',
        'bridge/flash.c',
        'bridge/local.c',
        'block/block.c',
        'block/light.c',
    )
    lib = library(tmp_path_factory.mktemp('bridge'), GLUE, *sources)
    number, memory = ctypes.c_double, ctypes.c_void_p
    lib.flash_size.restype = lib.local_size.restype = ctypes.c_size_t
    lib.table.argtypes = [ctypes.c_int, memory, *[ctypes.c_int] * 5, memory]
    lib.storm.argtypes = [number, ctypes.c_int, *[memory] * 3, ctypes.c_int, number, memory]
    lib.adversary.argtypes = [number, ctypes.c_uint32, *[ctypes.c_int] * 5, number, memory]
    lib.eol_local_begin.argtypes = [memory, number, number]
    lib.eol_local_shape.argtypes = [memory, *[ctypes.c_uint8] * 3]
    lib.eol_local_slip.argtypes = [memory, number, ctypes.c_uint8, number]
    lib.eol_local_hold.argtypes = [memory, number, number, ctypes.c_uint8]
    lib.eol_local_levels.argtypes = [memory, number, memory]
    lib.eol_local_falls.argtypes = [memory, number, ctypes.c_uint8]
    lib.eol_local_falls.restype = ctypes.c_uint32
    lib.eol_flash_begin.argtypes = [memory, number, number, *[ctypes.c_uint8] * 2]
    lib.eol_flash_slip.argtypes = [memory, number, ctypes.c_uint8, number]
    lib.eol_flash_levels.argtypes = [memory, number, memory]
    lib.eol_flash_hold.argtypes = [memory, number, number]
    lib.eol_flash_holds.argtypes = [memory, number]
    lib.eol_flash_holds.restype = ctypes.c_uint8
    lib.eol_flash_share.argtypes = [memory, number, ctypes.c_uint8]
    lib.eol_flash_share.restype = number
    return lib


class Field:
    """A field of the firmware, with the methods of FlashField; KIND names it in C."""

    KIND = 'flash'

    def __init__(self, lib, *settings, count=N_BLOCKS):
        for name in ('slip', 'hold', 'levels'):
            setattr(self, f'_{name}', getattr(lib, f'eol_{self.KIND}_{name}'))
        self.lib = lib
        self.memory = ctypes.create_string_buffer(getattr(lib, f'{self.KIND}_size')())
        self.out = ctypes.create_string_buffer(count)
        getattr(lib, f'eol_{self.KIND}_begin')(self.memory, *settings)

    def slip(self, now_s, block, share=1.0):
        self._slip(self.memory, now_s, block, share)

    def hold(self, *when):
        self._hold(self.memory, *when)

    def level_bytes(self, now_s):
        self._levels(self.memory, now_s, self.out)
        return self.out.raw


class Local(Field):
    """The limit within each field of view, with the methods of LocalField."""

    KIND = 'local'

    def __init__(self, lib, decay_s, peak, table):
        super().__init__(lib, decay_s, peak, count=table.cells)
        lib.eol_local_shape(self.memory, table.columns, block_falls(table), table.cells)
        self.groups = -(-table.cells // GROUP)

    def falls(self, now_s):
        masks = [self.lib.eol_local_falls(self.memory, now_s, g) for g in range(self.groups)]
        return (np.array(masks)[:, None] >> np.arange(GROUP) & 1).astype(bool).ravel()


def furthest_local(lib, seed, sequences, table=Table()):
    """As `furthest`, of the limit within each field of view, in storms that it has to hold."""
    random, most, held = np.random.default_rng(seed), 0, 0
    for _ in range(sequences):
        decay_s, peak = 10 ** random.uniform(-1.7, 0), random.uniform(0.1, 1)
        ours = Local(lib, decay_s, peak, table)
        theirs = LocalField(decay_s, peak, table=table)
        some = random.permutation(table.ids)[: random.integers(1, 9)]
        now_s = random.uniform(0, 1e4)
        for step in random.exponential(10 ** random.uniform(-2.5, -1), 60):
            now_s += step if random.uniform() < 0.98 else -step
            block = int(random.choice(some))
            if random.uniform() < 0.98:
                share = random.choice([1.0, 0.7, 33 / 128])
                ours.slip(now_s, block, share)
                theirs.slip(now_s, block, share)
            else:
                until_s = now_s + random.choice([0.0, 2.0])
                ours.hold(now_s, until_s, block)
                theirs.hold(now_s, until_s, block)
            assert (ours.falls(now_s)[: table.cells] == theirs.falls(now_s)).all()
        one = np.frombuffer(ours.level_bytes(now_s), np.uint8).astype(int)[: table.cells]
        other = np.frombuffer(theirs.level_bytes(now_s), np.uint8).astype(int)
        most, held = max(most, int(np.abs(one - other).max())), held + theirs.lengthened
    assert held
    return most


def furthest(lib, seed, sequences):
    """The greatest difference, in levels, over random sequences of slips, looks and settings."""
    random, most = np.random.default_rng(seed), 0
    for _ in range(sequences):
        decay_s, peak = 10 ** random.uniform(-1.7, 1), random.uniform(0, 1)
        limited = bool(random.uniform() < 0.9)
        ours = Field(lib, decay_s, peak, limited, N_BLOCKS)
        theirs = FlashField(decay_s, peak, limited)
        now_s = random.uniform(0, 1e6)
        for step in random.exponential(10 ** random.uniform(-3, 0), random.integers(2, 30)):
            now_s += step if random.uniform() < 0.95 else -step  # a clock may go back
            if random.uniform() < 0.5:
                block = int(random.integers(N_BLOCKS))
                share = random.choice([1.0, 0.7, 1 / 128])
                ours.slip(now_s, block, share)
                theirs.slip(now_s, block, share)
            elif random.uniform() < 0.1:
                until_s = now_s + random.exponential(0.5)
                ours.hold(now_s, until_s)
                theirs.hold(now_s, until_s)
            one = np.frombuffer(ours.level_bytes(now_s), np.uint8).astype(int)
            other = np.frombuffer(theirs.level_bytes(now_s), np.uint8).astype(int)
            most = max(most, int(np.abs(one - other).max()))
    return most


def test_the_bridge_limits_as_the_host_does(bridge):
    assert furthest(bridge, 1, 500) <= 1
    assert furthest_local(bridge, 1, 80) <= 1


@pytest.mark.parametrize(
    'table', [*OTHERS, LARGEST, Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))]
)
def test_the_bridge_limits_as_the_host_does_at_another_table(bridge, table):
    assert furthest_local(bridge, 1, 40, table) <= 1


@pytest.mark.soak
def test_the_bridge_limits_as_the_host_does_in_1e5_sequences(bridge):
    assert furthest(bridge, 2, 100_000) <= 1
    assert furthest_local(bridge, 2, 20_000) <= 1


MS = 4000
PLENTY = np.iinfo(np.int32).max
FREE, WHOLE, EACH = 1, 3, 7  # flags of Lighting: BY_ITSELF, with LIMITED, with EACH_FIELD


NEVER = -1000


def shown(bridge, felt, decay_ms=100, lost=0, gone_ms=PLENTY - 1000, reset_ms=NEVER, flags=EACH):
    """Light (ms, 25) in 0..1 of the whole firmware, of what `table` takes."""
    felt, out = np.ascontiguousarray(felt, np.uint8), np.zeros(felt.shape, np.uint8)
    settings = flags, decay_ms, lost, gone_ms, reset_ms
    bridge.table(len(felt), felt.ctypes.data, *settings, out.ctypes.data)
    return out / 255


def storm(seed, hz, count=N_BLOCKS):
    """Knocks (ms, count) of some blocks, `hz` times a second in all, now and then in volleys."""
    random = np.random.default_rng(seed)
    felt = np.zeros((MS, count), bool)
    some = random.permutation(count)[: random.integers(1, count)]
    at = np.cumsum(random.exponential(1000 / hz, 4 * MS)).astype(int)
    at = at[at < MS]
    felt[at, random.choice(some, len(at))] = True
    return felt


def eyes(levels, seed):
    """What it is to eyes that take in all of the field, one block, or some of it, dazzled."""
    random = np.random.default_rng(seed)
    yield levels.mean(axis=1)
    yield from levels.T[:4]
    for _ in range(4):
        some = random.permutation(N_BLOCKS)[: random.integers(2, 9)]
        yield (levels[:, some] * random.uniform(0.1, 1, len(some))).sum(axis=1).clip(0, 1)


@pytest.mark.slow
@pytest.mark.parametrize('decay_ms', [182, 350, 1500])
def test_blocks_that_flash_by_themselves_are_no_strobe(bridge, decay_ms):
    """Over links that lose a third or nearly all, and where the bridge is started again."""
    never = PLENTY - 1000
    cases = [(4, 300, never), (25, 300, never), (12, 900, never), (12, 300, 0), (12, 300, 1500)]
    for seed, (hz, lost, gone_ms) in enumerate(cases):
        levels = shown(bridge, storm(seed, hz), decay_ms, lost, gone_ms, flags=WHOLE)
        for light in eyes(levels, seed):
            assert most_flashes_in_a_second(light[::4], 250) <= FLASHES_PER_S


@pytest.mark.parametrize('decay_ms', [20, 182, 350, 2000])
def test_a_block_that_no_word_reaches_falls_by_1_1_percent_and_then_holds(bridge, decay_ms):
    light = ctypes.create_string_buffer(64)
    bridge.eol_light_begin(light, 1, 255, ctypes.c_uint16(decay_ms), 0, 1)
    assert bridge.eol_light_felt(light) == 1
    level = lambda: int.from_bytes(light.raw[:4], 'little') / (255 << 16)  # noqa: E731
    bridge.eol_light_told(light, 1)
    for _ in range(round(1000 * MIN_PERIOD_S)):
        bridge.eol_light_tick(light)
    held = np.exp(-HOLD_RATE * MIN_PERIOD_S)
    assert held * np.exp(-0.011) - 1e-4 < level() < held * 0.9965
    before = level()
    bridge.eol_light_told(light, 1)
    bridge.eol_light_felt(light)  # its own flash is the end of what it was told
    bridge.eol_light_tick(light)
    assert level() > before and level() > 0.999


def of_all_kinds(seed, hz, count=N_BLOCKS):
    """A storm of knocks, of weak ones, and of orders by the host."""
    felt = storm(seed, hz, count).astype(np.uint8)
    felt[felt > 0] = np.random.default_rng(seed).choice([1, 1, 2, 3, 4], int(felt.sum()))
    return felt


def areas_of(table):
    near = (0.0, 0.0, 0.4), (0.0, -0.4, 0.3), (0.0, 0.0, 0.8), (0.0, -0.9, 0.6)
    eyes = (
        *near,
        (0.0, -1.0, 1.1),
        (1.0, -1.0, 0.9),
        (0.0, 0.0, 2.2),
        (0.0, -2.0, 1.5),
    )  # the farthest: test_local.py
    return distinct(np.concatenate([fields(table.rest, eye) for eye in eyes]))


@pytest.fixture(scope='module')
def areas_sr():
    return areas_of(Table())


SECONDS = 4
COUNTS = [pytest.param(100_000, 1000, marks=[pytest.mark.soak, pytest.mark.timeout(7200)])]


@pytest.mark.slow
@pytest.mark.parametrize(('storms', 'adversaries'), [(60, 12), *COUNTS])
def test_no_sequence_makes_a_field_of_view_flash_four_times(bridge, areas_sr, storms, adversaries):
    """Orders of any share, taps, changed peaks and lost blocks; no host is between."""
    seed = time.time_ns() if storms > 60 else storms  # other sequences in each soak
    random, shown = np.random.default_rng(seed), np.zeros((int(SECONDS * RATE_HZ), 25), np.uint8)
    counts, where = np.zeros(9, int), shown.ctypes.data
    for _ in range(storms):
        some = random.permutation(N_BLOCKS)[: random.integers(1, N_BLOCKS + 1)]
        at_s = np.cumsum(random.exponential(1 / random.uniform(3, 200), 800))
        at_s = np.repeat(at_s, random.choice([1, len(some)], 800, p=[0.95, 0.05]))
        at_s = np.round(at_s * RATE_HZ) / RATE_HZ + 1e-6  # an image shows the light before each
        blocks = random.choice(some, len(at_s)).astype(np.uint8)
        decay_s = 10 ** random.uniform(-1.7, 0)
        dim = random.uniform(size=len(at_s)) < random.choice([0.0, 0.3, 0.9])
        shares = np.where(dim, random.integers(1, 129, len(at_s)) / 128, 1.0)
        what = random.uniform(size=len(at_s))
        blocks[what < random.choice([0, 0.01, 0.1])] += 128
        peaks = what > 1 - random.choice([0, 0.02, 0.3])
        blocks[peaks], shares[peaks] = 255, random.choice([1.0, 0.5, 0.1, 0.0], peaks.sum())
        slips = len(at_s), at_s.ctypes.data, blocks.ctypes.data, shares.ctypes.data
        bridge.storm(decay_s, *slips, len(shown), float(RATE_HZ), where)
        counts[most_in_a_second(shown / 255, areas_sr)] += 1
    for k in range(adversaries):
        corner = 5 * random.integers(4) + random.integers(4)
        square = sum(1 << int(corner + b) for b in random.permutation([0, 1, 5, 6])[: 1 + k % 4])
        mask = square if k % 3 else 2**N_BLOCKS - 1
        depth, often = int(random.integers(1, 60)), int(random.choice([10, 100, 1000]))
        dims, images = int(k % 2), np.zeros((int(SECONDS * 1000), N_BLOCKS), np.uint8)
        decay_s = float(random.choice([0.02, 0.05, 0.1, 0.35]))
        draws = int(random.integers(2**31))
        to = images.ctypes.data
        bridge.adversary(decay_s, mask, depth, often, dims, draws, len(images), 1000.0, to)
        counts[most_in_a_second(images / 255, areas_sr, 1000)] += 1
    print(f'seed {seed}; sequences by the most flashes of a field in a second: {counts}')
    assert counts[3] > 0 and not counts[4:].any()


@pytest.mark.slow
@pytest.mark.parametrize('decay_ms', [20, 100, 350])
def test_no_field_of_view_of_the_firmware_flashes_four_times(bridge, areas_sr, decay_ms):
    """Over links that lose much, while the bridge or a block is started again."""
    at = np.round(np.arange(MS * RATE_HZ / 1000 - 1) * 1000 / RATE_HZ).astype(int)
    cases = [(8, 0, 0), (60, 0, 0), (60, 300, 0), (150, 300, 0), (60, 600, 0), (60, 300, 1500)]
    for seed, (hz, lost, gone_ms) in enumerate(cases):
        more = {'gone_ms': gone_ms, 'reset_ms': 2500} if gone_ms else {}
        levels = shown(bridge, of_all_kinds(seed, hz), decay_ms, lost, **more)
        assert most_in_a_second(levels[at], areas_sr) <= 3, (hz, lost, gone_ms)


@pytest.fixture
def of_largest(bridge):
    """The firmware of a table of 225 blocks."""
    bridge.shape(LARGEST.columns, block_falls(LARGEST), LARGEST.cells)
    yield bridge
    bridge.shape(0, 0, 0)


FIRST = [(20, 600, 300), (100, 1500, 300)]
OTHERS_TOO = [*FIRST, (100, 60, 0), (350, 600, 600)]


@pytest.mark.slow
@pytest.mark.parametrize('cases', [FIRST, pytest.param(OTHERS_TOO, marks=pytest.mark.soak)])
def test_no_field_of_view_of_225_blocks_flashes_four_times(of_largest, cases):
    """Words of nine groups take turns, and many are lost."""
    areas_sr = areas_of(LARGEST)
    at = np.round(np.arange(MS * RATE_HZ / 1000 - 1) * 1000 / RATE_HZ).astype(int)
    for seed, (decay_ms, hz, lost) in enumerate(cases):
        levels = shown(of_largest, of_all_kinds(seed, hz, LARGEST.cells), decay_ms, lost)
        assert most_in_a_second(levels[at], areas_sr) <= 3, (decay_ms, hz, lost)


@pytest.mark.parametrize('lost', [0, 300])
def test_orders_that_are_told_again_make_no_fall_that_is_not_counted(of_largest, lost):
    for seed in (3, 4, 6):
        felt = np.where(storm(seed, 600, LARGEST.cells), 3, 0)
        light = shown(of_largest, felt, lost=lost)
        for one in light.T[light.max(axis=0) > 0]:
            found = np.array(changes(np.arange(MS) / 1000, one))
            falls = [((found >= t) & (found <= t + 1)).sum() // 2 for t in found]
            assert max(falls, default=0) <= block_falls(LARGEST), seed


@pytest.mark.parametrize(('kind', 'peak'), [(3, 1.0), (4, 0.5)])
def test_an_order_of_225_blocks_is_obeyed_within_the_time_of_30_a_second(of_largest, kind, peak):
    """All are ordered at once; then groups by themselves, 30 orders a second. In full, and dim."""
    felt = np.zeros((MS, LARGEST.cells), np.uint8)
    felt[1500] = kind
    light = shown(of_largest, felt)
    assert (light[1499] < 0.05).all() and (light[1500 + 33] > 0.4 * peak).all()
    felt[:] = 0
    ordered = [(1500 + round(k * 1000 / 30), 7 * k % LARGEST.cells) for k in range(60)]
    for at_ms, block in ordered:
        felt[at_ms, block] = kind
    light = shown(of_largest, felt)
    assert all(light[at_ms + 5, block] > 0.5 * peak for at_ms, block in ordered)


def test_a_map_of_stress_keeps_its_levels_in_the_words_of_225_blocks(of_largest):
    stress = np.arange(LARGEST.cells) % 9 / 8
    felt = np.zeros((MS, LARGEST.cells), np.uint8)
    for late_s, block, share in stressed(stress):
        felt[2500 + round(1000 * late_s), block] = 128 + round(128 * share)
    light = shown(of_largest, felt)

    assert light.max(axis=0) == pytest.approx(0.75 * IDLE_SHARE * stress, abs=0.01)


def test_an_order_of_half_of_the_peak_gives_half_of_the_light(bridge):
    """Beside an order of the whole peak that is still told again, all get the whole."""
    felt = np.zeros((MS, N_BLOCKS), np.uint8)
    felt[1200, 3] = felt[1500, 4] = felt[1510, 5] = felt[1600, 6] = 4
    felt[1500, 7] = 3
    light = shown(bridge, felt)

    brightest = light.max(axis=0)
    assert brightest[[3, 6]] == pytest.approx(0.375, abs=0.01)
    assert brightest[[4, 5, 7]] == pytest.approx(0.75, abs=0.01)
    assert light[3900].max() == 0


@pytest.mark.parametrize(('hz', 'seed'), [(6, 1), (6, 2), (40, 3)])
def test_each_block_of_the_firmware_shines_as_that_of_the_model(bridge, hz, seed):
    begin = 2200  # until then the hold at the start counts, which the model has not
    felt, model = of_all_kinds(seed, hz), Bridge()
    felt[:begin] = 0  # while the bridge does not know what shines
    theirs = np.zeros((MS, N_BLOCKS))
    for ms in range(MS):
        for block in np.flatnonzero(felt[ms]).tolist():
            if felt[ms, block] < 3:
                model.field.slip(ms * 1e-3, block)
            else:
                model.light(ms * 1e-3, 1 << block, 0.5 if felt[ms, block] == 4 else 1.0)
        theirs[ms] = model.levels((ms + 1) * 1e-3)
    ours = shown(bridge, felt)
    # it falls some 10 ms later, when the bridge is known to know
    late = np.abs(ours[10:] - theirs[:-10])
    if hz < 10:  # in a storm 10 ms decide which flash is the one that waits
        assert np.quantile(late[theirs[:-10] > 0.1], 0.9) < 0.06
    shines, should = (light[begin + 100 :] > 0.1 for light in (ours, theirs))
    # and an order is told for 20 ms, in which its block holds
    assert shines.mean() == pytest.approx(should.mean(), rel=0.08) and should.any()


def test_a_block_that_the_bridge_does_not_hear_holds_and_falls_when_it_is_heard(bridge):
    felt = np.zeros((MS, N_BLOCKS), np.uint8)
    felt[1100, 3], felt[1700, 4] = 1, 2
    light = shown(bridge, felt, gone_ms=1050)  # until 1150
    assert light[1140, 3] == light[1700, 4] == pytest.approx(0.75, abs=0.01)
    assert light[1140 + 1000, 3] > 0.65  # the new bridge holds for a second
    assert light[3900].max() == 0


def test_a_storm_that_nobody_holds_is_a_strobe(bridge):
    felt = np.zeros((MS, N_BLOCKS), bool)
    felt[::120, 7] = True
    free, held = (shown(bridge, felt, 182, flags=flags)[:, 7] for flags in (FREE, WHOLE))

    assert most_flashes_in_a_second(free[::4], 250) > 5
    assert most_flashes_in_a_second(held[::4], 250) <= FLASHES_PER_S

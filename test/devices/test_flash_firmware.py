# SPDX-License-Identifier: Apache-2.0
"""firmware/bridge/flash.c, compiled, against core/light/flash.py: one limit in two languages."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.light.flash import HOLD_RATE, MIN_PERIOD_S, FlashField

BRIDGE = Path(__file__).parents[2] / 'firmware' / 'bridge'
GLUE = '#include "flash.h"\nsize_t flash_size(void) { return sizeof(eol_flash_field); }\n'


@pytest.fixture(scope='module')
def bridge(tmp_path_factory):
    compiler = shutil.which('cc') or shutil.which('gcc') or shutil.which('clang')
    if compiler is None:
        pytest.skip('no C compiler here')
    folder = tmp_path_factory.mktemp('bridge')
    (folder / 'glue.c').write_text('#include <stddef.h>\n' + GLUE)
    library = folder / 'flash.so'
    strict = ['-std=c99', '-O2', '-Wall', '-Wextra', '-Werror', '-shared', '-fPIC']
    subprocess.run(
        [compiler, *strict, '-I', BRIDGE, BRIDGE / 'flash.c', 'glue.c', '-o', library, '-lm'],
        cwd=folder, check=True,
    )  # fmt: skip
    lib = ctypes.CDLL(str(library))
    number, memory = ctypes.c_double, ctypes.c_void_p
    lib.flash_size.restype = ctypes.c_size_t
    lib.eol_flash_begin.argtypes = [memory, number, number, ctypes.c_uint8]
    lib.eol_flash_slip.argtypes = [memory, number, ctypes.c_uint8]
    lib.eol_flash_levels.argtypes = [memory, number, memory]
    lib.eol_flash_holds.argtypes = [memory, number]
    lib.eol_flash_holds.restype = ctypes.c_uint8
    lib.eol_flash_share.argtypes = [memory, number, ctypes.c_uint8]
    lib.eol_flash_share.restype = number
    return lib


class Field:
    """The firmware's field, with the methods of FlashField."""

    def __init__(self, lib, decay_s, peak=1.0, limited=True):
        self.lib, self.memory = lib, ctypes.create_string_buffer(lib.flash_size())
        self.out = ctypes.create_string_buffer(N_BLOCKS)
        lib.eol_flash_begin(self.memory, decay_s, peak, limited)

    def slip(self, now_s, block):
        self.lib.eol_flash_slip(self.memory, now_s, block)

    def level_bytes(self, now_s):
        self.lib.eol_flash_levels(self.memory, now_s, self.out)
        return self.out.raw


def furthest(lib, seed, sequences):
    """The greatest difference, in levels, over random sequences of slips, looks and settings."""
    random, most = np.random.default_rng(seed), 0
    for _ in range(sequences):
        decay_s, peak = 10 ** random.uniform(-1.7, 1), random.uniform(0, 1)
        limited = bool(random.uniform() < 0.9)
        ours, theirs = Field(lib, decay_s, peak, limited), FlashField(decay_s, peak, limited)
        now_s = random.uniform(0, 1e6)
        for step in random.exponential(10 ** random.uniform(-3, 0), random.integers(2, 30)):
            now_s += step if random.uniform() < 0.95 else -step  # a clock may go back
            if random.uniform() < 0.5:
                block = int(random.integers(N_BLOCKS))
                ours.slip(now_s, block)
                theirs.slip(now_s, block)
            one = np.frombuffer(ours.level_bytes(now_s), np.uint8).astype(int)
            other = np.frombuffer(theirs.level_bytes(now_s), np.uint8).astype(int)
            most = max(most, int(np.abs(one - other).max()))
    return most


def test_the_bridge_limits_as_the_host_does(bridge):
    assert furthest(bridge, 1, 1500) <= 1


@pytest.mark.soak
def test_the_bridge_limits_as_the_host_does_in_1e5_sequences(bridge):
    assert furthest(bridge, 2, 100_000) <= 1


def test_it_says_when_blocks_must_hold_and_how_they_fall(bridge):
    field = Field(bridge, 0.2)
    holds = lambda t: field.lib.eol_flash_holds(field.memory, t)  # noqa: E731
    field.slip(10.0, 3)
    assert not holds(10.0)  # the first flash falls at once
    field.level_bytes(10.1)
    field.slip(10.1, 4)  # meets falling light: the whole field holds
    assert holds(10.1) and holds(10.1 + MIN_PERIOD_S - 1e-6)
    assert not holds(10.1 + MIN_PERIOD_S + 1e-6)
    assert field.lib.eol_flash_share(field.memory, 0.3, 1) == pytest.approx(
        np.exp(-HOLD_RATE * 0.3)
    )
    assert field.lib.eol_flash_share(field.memory, 0.3, 0) == pytest.approx(np.exp(-0.3 / 0.2))
    free = Field(bridge, 0.2, limited=False)
    free.slip(1.0, 0)
    free.slip(1.1, 1)
    assert not free.lib.eol_flash_holds(free.memory, 1.1)


def test_a_block_that_is_none_lights_nothing(bridge):
    field = Field(bridge, 0.2)
    field.slip(1.0, 25)
    field.slip(1.0, 255)
    assert field.level_bytes(1.0) == bytes(25)

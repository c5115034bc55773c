# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.sound.takes import Takes

RATE = 8000


def sound():
    """Noise that rises three times, once too shortly."""
    random, level = np.random.default_rng(1), np.full(5 * RATE, 1e-4)
    for begin, end, loud in ((0.5, 1.2, 0.1), (2.0, 2.02, 0.3), (3.1, 4.05, 0.05)):
        level[round(begin * RATE) : round(end * RATE)] = loud
    return (level * random.standard_normal(5 * RATE)).astype(np.float32)


def test_takes_have_what_lies_before_and_behind():
    heard = sound()
    found = Takes(RATE, before_s=0.05, hold_s=0.3).feed(heard)
    assert len(found) == 2
    for take, (begin, end) in zip(found, ((0.5, 1.2), (3.1, 4.05)), strict=True):
        expected = heard[round((begin - 0.05) * RATE) : round((end + 0.3) * RATE)]
        np.testing.assert_array_equal(take, expected)


@pytest.mark.parametrize('block', [1, 37, 512, 9000])
def test_blocks_of_any_size_give_the_same(block):
    heard, takes, found = sound()[: 2 * RATE], Takes(RATE), []
    for k in range(0, len(heard), block):
        found += takes.feed(heard[k : k + block])
    (whole,) = Takes(RATE).feed(heard)
    (take,) = found
    np.testing.assert_array_equal(take, whole)


def test_a_long_sound_is_cut_and_one_that_goes_on_is_ended():
    takes = Takes(RATE, most_s=1.0, before_s=0.01)
    assert [len(take) for take in takes.feed(np.full(2 * RATE + 4000, 0.5))] == [RATE, RATE]
    assert [len(take) for take in takes.end()] == [4000]
    assert takes.end() == []

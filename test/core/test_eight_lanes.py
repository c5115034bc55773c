# SPDX-License-Identifier: Apache-2.0
"""Vectors of eight float32 against plain NumPy."""

import numpy as np

from eol_ros.core import lanes
from eol_ros.core.compiled import njit

RANDOM = np.random.default_rng(1)


def numbers(*shape):
    return RANDOM.normal(0, 1, shape).astype(np.float32)


@njit
def _lane_by_lane(rows, out):
    a, b = lanes.take(rows, 0, 0), lanes.take(rows, 1, 0)
    lanes.put(out, 0, 0, lanes.above(a, b, a, b))
    lanes.put(out, 1, 0, lanes.signed(a, b))
    lanes.put(out, 2, 0, lanes.whole(a * lanes.splat8(np.float32(10.0))))
    lanes.put(out, 3, 0, lanes.less(a, a, b))
    lanes.put(out, 4, 0, lanes.most(lanes.least(a, b), lanes.magnitude(b)))
    return lanes.added(a), lanes.all_below(a, lanes.splat8(np.float32(9.0))), lanes.all_below(a, b)


def test_each_lane_is_computed_by_itself():
    rows, out = numbers(2, 8), np.empty((5, 8), np.float32)
    a, b = rows
    total, small, below = _lane_by_lane(rows, out)
    assert abs(total - a.sum()) < 1e-5 and small and below == (a < b).all()
    assert np.array_equal(out[0], np.maximum(a, b))
    assert np.array_equal(out[1], np.where(b < 0, -a, a))
    assert np.array_equal(out[2], np.trunc(a * np.float32(10)))
    assert np.abs(out[3] - (a - a * b)).max() < 1e-6
    assert np.array_equal(out[4], np.maximum(np.minimum(a, b), abs(b)))


@njit
def _products(rows, sums, other):
    w, v = lanes.take(rows, 0, 0), lanes.take(rows, 1, 0)
    a, b, c = lanes.take(rows, 2, 0), lanes.take(rows, 3, 0), lanes.take(rows, 4, 0)
    lanes.add_products(sums, w, (a, b, c), v, (c, a, b))
    lanes.put(other, 0, 0, lanes.weighted(other, 1, (a, b, c, a, b, c, a, b)))


def test_products_of_all_pairs_are_added():
    rows, sums, other = numbers(5, 8), np.zeros((5, 8), np.float32), numbers(2, 8)
    _products(rows, sums, other)
    w, v, a, b, c = rows
    wanted = [w * a * a + v * c * c, w * a * b + v * c * a, w * b * b + v * a * a]
    wanted += [w * a * c + v * c * b, w * b * c + v * a * b]
    assert np.abs(sums - wanted).max() < 1e-5
    by = other[1]
    wanted = a * (by[0] + by[3] + by[6]) + b * (by[1] + by[4] + by[7]) + c * (by[2] + by[5])
    assert np.abs(other[0] - wanted).max() < 1e-5


@njit
def _read(rows, table, pixels, places, out):
    index = lanes.take(rows, 0, 0)
    lanes.put(out, 0, 0, lanes.pluck(table[0], index))
    lanes.put(out, 1, 0, lanes.look(pixels, places, 2, 5))
    for k, column in enumerate(lanes.pluck_rows(table, index)):
        lanes.put(out, 2 + k, 0, column)


def test_what_lies_anywhere_is_read():
    index = np.array([[3, 0, 1, 2, 3, 3, 0, 1]], np.float32)
    table, out = numbers(4, 4), np.empty((6, 8), np.float32)
    pixels, places = np.arange(40, dtype=np.uint8), np.arange(20, 0, -2).astype(np.int32)
    _read(index, table, pixels, places, out)
    at = index[0].astype(int)
    assert np.array_equal(out[0], table[0][at])
    assert np.array_equal(out[1], pixels[places[2:] + 5])
    assert np.array_equal(out[2:], table[at].T)

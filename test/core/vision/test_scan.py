# SPDX-License-Identifier: Apache-2.0
"""Regions of light against SciPy's labelling of the same samples."""

import numpy as np
from scipy import ndimage

from eol_ros.core.vision.detect import scan


def test_regions_are_those_of_another_labelling():
    random = np.random.default_rng(1)
    compared = 0
    for shape in ((40, 57), (199, 319), (64, 64)):
        light = ndimage.gaussian_filter(random.random(shape), 1.5)
        grid = np.rint(255 * (light - light.min()) / np.ptp(light)).astype(np.uint8)
        tiles = np.full([-(-n // scan.TILE) for n in shape], 90, np.uint8)
        tiles[1:, 1] = 120
        label, parent = np.zeros(shape, np.int16), np.zeros(5000, np.int32)
        stats, found = np.zeros((5000, 7)), np.zeros((500, 6))
        n = scan.regions(grid, tiles, 60.5, 4, 300, label, parent, stats, found)

        over = np.kron(tiles, np.ones((scan.TILE, scan.TILE)))[: shape[0], : shape[1]] + 60.5
        other, count = ndimage.label(grid > over)
        sizes = np.bincount(other.ravel())[1:]
        kept = [i for i in range(count) if 4 <= sizes[i] <= 300]
        assert n == len(kept) > 0
        for row, i in zip(found[:n], kept, strict=True):
            r, c = np.nonzero(other == i + 1)
            np.testing.assert_allclose(row[:2], [4 * c.mean() + 1, 4 * r.mean() + 1])
            assert row[3:].tolist() == [sizes[i], 4 * np.ptp(r) + 4, 4 * np.ptp(c) + 4]
        compared += n
    assert compared > 200

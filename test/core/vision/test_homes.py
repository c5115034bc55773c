# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import edges
from eol_ros.core.vision.detect.homes import Homes

CAMERA = Calibration.ideal()


def show(homes, xy, seconds=1 / 60, little=(), hidden=()):
    """Show blocks at xy (25, 2) for so long, `little` of some; return u, v of their homes."""
    visibility, seen = np.full(25, 0.95, np.float32), np.ones(25, bool)
    visibility[list(little)], seen[list(hidden)] = 0.5, False
    for _ in range(round(seconds * 60)):
        homes.learn(1 / 60, xy, seen, visibility)
    found = np.empty((25, 2))
    homes.expected(CAMERA.packed(), found)
    return found


def test_an_arm_leads_a_block_away_from_its_home():
    homes, xy = Homes(), rest_lattice()
    assert show(homes, xy) == pytest.approx(np.full((25, 2), np.nan), nan_ok=True)
    assert show(homes, xy, 0.2) == pytest.approx(CAMERA.to_pixels(xy))
    for _ in range(12):
        xy[7, 0] += 3e-4  # 0.16 px from image to image
        homes_px = show(homes, xy, little=[7])
    away = np.hypot(*(CAMERA.to_pixels(xy) - homes_px).T)
    assert away[7] > 0.8 * 12 * 3e-4 * CAMERA.px_per_m()
    assert np.delete(away, 7) == pytest.approx(0.0, abs=1e-6)
    # but what stays there for long is at home there
    assert np.hypot(*(CAMERA.to_pixels(xy) - show(homes, xy, 2.0, little=[7])).T)[7] < 0.1


def test_nobody_has_a_home_while_the_table_moves():
    homes, xy = Homes(), rest_lattice()
    show(homes, xy, 0.5)
    for _ in range(20):
        xy += 4e-4
        found = show(homes, xy, little=[7])
    assert np.isnan(found).all()
    assert show(homes, xy, 0.2) == pytest.approx(CAMERA.to_pixels(xy), abs=0.5)


def test_a_block_that_slips_alone_takes_its_home_along():
    homes, xy = Homes(), rest_lattice()
    show(homes, xy, 0.5)
    xy[12] += 5e-3
    found = show(homes, xy)
    assert np.isnan(found[12]).all() and np.isfinite(np.delete(found, 12, 0)).all()
    assert show(homes, xy, 0.2) == pytest.approx(CAMERA.to_pixels(xy))


def test_a_home_outlives_a_moment_under_an_arm_but_no_renaming():
    homes, xy = Homes(), rest_lattice()
    show(homes, xy, 1.0)
    assert np.isfinite(show(homes, xy, 0.3, hidden=[3])).all()
    assert np.isnan(show(homes, xy, 0.3, hidden=[3])[3]).all()
    homes.renamed(np.arange(25) == 9)
    assert np.isnan(show(homes, xy)[9]).all()


def test_of_two_squares_that_a_block_may_be_neither_is_taken():
    better, other = np.zeros((2, edges.FIELDS))
    better[[edges.U, edges.HALF, edges.VISIBLE, edges.SIGMA]] = 9.0, 21.0, 0.6, 0.2
    other[[edges.HALF, edges.VISIBLE, edges.SIGMA]] = 21.0, 0.4, 0.3
    assert edges.either(better, other, False)
    for field, value in ((edges.SIGMA, 0.6), (edges.VISIBLE, 0.2), (edges.U, 8.5)):
        less = other.copy()
        less[field] = value
        assert not edges.either(better, less, False)
        assert edges.either(better, less, True) == (field == edges.SIGMA)
    better[edges.VISIBLE] = 0.8
    assert not edges.either(better, other, True)

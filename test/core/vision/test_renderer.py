# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from support.clutter import LEVELS, Cluttered, clutter_calibration
from support.paper import BLOCK_SIDE_M, rest_lattice

from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import NOISE_LEVELS, Renderer, RenderOptions
from eol_ros.errors import ConfigError

pytestmark = pytest.mark.slow  # the first run compiles
SMALL = Calibration.ideal(160, 120, px_per_m=545)


def one(x=0.0, y=0.0, yaw=0.0, noise='none', **options):
    renderer = Renderer(RenderOptions(noise=noise, **options), SMALL, n_blocks=1)
    return renderer.render([x], [y], [yaw], 0).astype(float)


@pytest.mark.parametrize('yaw', [0.12, 0.3, -0.7])
def test_a_cover_is_what_brute_force_says(yaw):
    """Oracle: 14 x 14 points a pixel, inside or outside, blurred by a true Gaussian."""
    x, y, fine = 0.0013, -0.0021, 14
    u0, v0 = SMALL.to_pixels([[x, y]])[0]
    place = (np.arange(120 * fine) + 0.5) / fine - 0.5
    across = (np.arange(160 * fine) + 0.5) / fine - 0.5
    du, dv = across[None] - u0, place[:, None] - v0
    half = BLOCK_SIDE_M * 545 / 2
    inside = (abs(du * np.cos(yaw) - dv * np.sin(yaw)) < half) & (
        abs(du * np.sin(yaw) + dv * np.cos(yaw)) < half
    )
    seen = gaussian_filter(inside.astype(np.float32), 1.2 * fine)
    seen = seen.reshape(120, fine, 160, fine).mean(axis=(1, 3))
    assert np.abs(one(x, y, yaw) - (14 + 170 * seen)).max() < 1.2  # half a grey level is rounding


@pytest.mark.parametrize('noise', ['L1', 'L3'])
def test_noise_has_the_stated_variance_and_is_fresh_in_every_image(noise):
    read, gain = NOISE_LEVELS[noise]
    renderer = Renderer(RenderOptions(noise=noise), SMALL, n_blocks=1)
    stack = np.array([renderer.render([0], [0], [0], k) for k in range(60)], float)
    for part, level in ((stack[:, :20, :20], 14), (stack[:, 50:70, 70:90], 184)):
        expected = read**2 + gain * level + 1 / 12
        assert part.var(axis=0, ddof=1).mean() == pytest.approx(expected, rel=0.03)
    corner = stack[:, :30, :30].reshape(60, -1)
    alike = np.corrcoef(corner)[np.triu_indices(60, 1)]
    assert abs(alike.mean()) < 0.005
    assert abs(alike).max() < 0.2


def test_an_image_depends_on_its_index_and_seed_alone():
    camera, xy = clutter_calibration('hard'), rest_lattice()
    first = Cluttered('hard', camera, 3)
    a = first.render(xy[:, 0], xy[:, 1], np.zeros(25), 200).copy()
    first.render(xy[:, 0] + 0.1, xy[:, 1], np.ones(25), 7, flash=np.ones(25))
    b = first.render(xy[:, 0], xy[:, 1], np.zeros(25), 200)
    c = Cluttered('hard', camera, 3).render(xy[:, 0], xy[:, 1], np.zeros(25), 200)
    other = Cluttered('hard', camera, 4).render(xy[:, 0], xy[:, 1], np.zeros(25), 200)
    assert np.array_equal(a, b)
    assert np.array_equal(a, c)
    assert not np.array_equal(a, other)


def test_motion_blurs_about_the_pose():
    renderer = Renderer(RenderOptions(noise='none'), SMALL, n_blocks=1)
    still = renderer.render([0], [0], [0], 0).astype(float)
    moved = renderer.render([0], [0], [0], 0, velocity=[[2.0, 0, 0]]).astype(float)
    light = moved - 14
    assert (light * np.arange(160)).sum() / light.sum() == pytest.approx(79.5, abs=5e-3)
    assert light.sum() == pytest.approx((still - 14).sum(), rel=2e-3)
    assert np.abs(np.diff(moved[60])).max() < 0.8 * np.abs(np.diff(still[60])).max()


def test_arms_hide_what_they_say_they_hide():
    renderer = Cluttered('clean', SMALL, n_blocks=1, noise='none')
    arm = [[0.0, 0.5, 0.0, -0.5, 0.02]]  # 4 cm wide, across the middle
    shown = renderer.render([0], [0], [0], 0, arms=arm)
    lit = (shown > 130).sum() / (renderer.render([0], [0], [0], 0) > 130).sum()
    assert renderer.visible_share([0], [0], [0], 0, arms=arm)[0] == pytest.approx(lit, abs=0.05)
    assert lit == pytest.approx(1 - 0.04 / 0.084, abs=0.05)


def test_unknown_levels_are_named():
    with pytest.raises(ConfigError, match="noise 'L9'"):
        Renderer(RenderOptions(noise='L9'))


@pytest.mark.parametrize(
    'table',
    [
        Table(rows=3, columns=4, block_side_m=0.05),
        Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18)),
    ],
)
@pytest.mark.parametrize('velocity', [False, True])
def test_it_draws_the_blocks_of_a_table_and_nothing_where_none_is(table, velocity):
    renderer = Renderer(RenderOptions(noise='none'), Calibration.ideal(px_per_m=545.0, table=table))
    x, y = table.rest.T
    rates = np.full((table.cells, 3), 0.2) if velocity else None
    white = 1.0 * ~table.present  # of no block
    renderer.render(x, y, 0 * x, 0, velocity=rates, flash=white)
    light = renderer.light.sum() - 14 * renderer.light.size
    side_px = table.block_side_m * renderer.calibration.px_per_m()
    assert light == pytest.approx(170 * table.count * side_px**2, rel=2e-3)
    for level in LEVELS:
        shown = Cluttered(level, Calibration.ideal(px_per_m=545.0, table=table))
        shown.render(x, y, 0 * x, 3)
        assert shown.visible_share(x, y, 0 * x, 3).shape == (table.cells,)

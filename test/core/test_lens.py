# SPDX-License-Identifier: Apache-2.0
import functools
import math

import numpy as np
import pytest
from scipy.special import erf

from eol_ros.core.vision import lens
from eol_ros.core.vision.lens import Light, edge_blur, exposure_verdict, focus_verdict

W, H = 288, 288


@functools.cache
def squares(blur_px, level=180.0, ground=14.0, angle=0.2, side=46.0, shift=0.0):
    """Blurred squares in closed form: along each axis, the difference of two error functions."""
    image = np.full((H, W), ground, np.float32)
    v, u = np.mgrid[:H, :W].astype(np.float32)
    for cu in range(48, W, 96):
        for cv in range(48, H, 96):
            x = (u - cu - shift) * math.cos(angle) + (v - cv) * math.sin(angle)
            y = -(u - cu - shift) * math.sin(angle) + (v - cv) * math.cos(angle)
            ways = [
                (
                    erf((a + side / 2) / (blur_px * 2**0.5))
                    - erf((a - side / 2) / (blur_px * 2**0.5))
                )
                / 2
                for a in (x, y)
            ]
            image += (level - ground) * ways[0] * ways[1]
    return image


def noisy(image, seed, sigma=2.0):
    rng = np.random.default_rng(seed)
    return (image + rng.normal(0, sigma, image.shape)).round().clip(0, 255).astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize('blur_px', [0.8, 1.2, 4.0])
@pytest.mark.parametrize(('level', 'sigma'), [(60, 2.0), (180, 8.0)])
def test_blur_is_that_of_the_edges_whatever_light_and_noise(blur_px, level, sigma):
    image = squares(blur_px, level)
    found = edge_blur(noisy(image, 1, sigma), noisy(image, 2, sigma))

    assert found.px == pytest.approx(blur_px, rel=0.06)
    np.testing.assert_allclose(found.tiles, blur_px, rtol=0.15)


@pytest.mark.slow
def test_a_corner_out_of_focus_shows_in_its_part():
    image = np.where(np.arange(W) < W // 3 * 2, squares(1.0), squares(3.0))
    found = edge_blur(noisy(image, 1), noisy(image, 2))

    np.testing.assert_allclose(found.tiles[:, 0], 1.0, rtol=0.15)
    np.testing.assert_allclose(found.tiles[:, 2], 3.0, rtol=0.15)


def test_where_nothing_is_there_is_no_number():
    dark = np.full((H, W), 14.0)
    assert math.isnan(edge_blur(noisy(dark, 1), noisy(dark, 2)).px)
    assert math.isnan(edge_blur(noisy(dark, 1, 0), noisy(dark, 2, 0)).px)


def test_what_moves_between_the_images_gives_no_number():
    found = edge_blur(noisy(squares(1.0), 1), noisy(squares(1.0, shift=4.0), 2))

    assert math.isnan(found.px)


@pytest.mark.parametrize(
    ('seen', 'flicker', 'words'),
    [
        (Light(180, 14, 0), 0.0, ''),
        (Light(97, 14, 0), 0.0, 'exposure_us 6000'),
        (Light(255, 14, 0.6), 0.0, '60% of what is bright is saturated: exposure_us 1500'),
        (Light(240, 14, 0), 0.0, 'no room for flashes: exposure_us 2204'),
        (Light(3, 1, 0), 0.0, 'no block stands out'),
        (Light(180, 14, 0), 0.05, 'brightness varies by 5%'),
    ],
)
def test_advice_is_one_line(seen, flicker, words):
    found = exposure_verdict(seen, 3000, flicker)
    told = str(found)

    assert (found.grade == 'good') == (words == '') == (found.do == '')
    assert all(part in told for part in words.split(': '))
    assert '\n' not in told
    assert ' us' not in str(exposure_verdict(seen, None)).replace('3000 us', '')


@pytest.mark.parametrize(
    ('px', 'corner', 'grade'),
    [(1.2, 1.25, 'good'), (1.2, 1.7, 'usable'), (1.2, 2.4, 'poor'), (math.nan, 1.2, 'poor')],
)
def test_the_most_blurred_part_decides_on_focus(px, corner, grade):
    tiles = np.full((3, 3), 1.2)
    tiles[2, 0], tiles[0, 1] = corner, math.nan
    found = focus_verdict(lens.Blur(px, tiles))
    assert found.grade == grade and bool(found.do) == (grade != 'good')

# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.vision_bound import position_bound_px

from eol_ros.core.geometry import BLOCK_SIDE_M, rest_lattice
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.detect import scan, usual_outline
from eol_ros.core.vision.detect.blobs import BlobFinder
from eol_ros.core.vision.render.clutter import clutter_calibration
from eol_ros.core.vision.render.renderer import NOISE_LEVELS, Renderer, RenderOptions
from eol_ros.errors import ConfigError

pytestmark = pytest.mark.slow  # the first run compiles


def scene(seed, spread=0.004):
    rng = np.random.default_rng(seed)
    return rest_lattice() + rng.normal(0, spread, (25, 2)), rng.uniform(-0.75, 0.75, 25)


def paired(blobs, truth, reach=5.0):
    """Errors (n, 2) of the blobs nearest to each true centre; NaN where none is near."""
    far = np.hypot(blobs['u'][:, None] - truth[:, 0], blobs['v'][:, None] - truth[:, 1])
    left = np.full(truth.shape, np.nan)
    hit = far.min(axis=0) < reach
    at = far.argmin(axis=0)[hit]
    left[hit] = np.column_stack([blobs['u'][at], blobs['v'][at]]) - truth[hit]
    return left


@pytest.mark.parametrize('noise', ['L1', 'L2', 'L4'])
def test_position_comes_near_the_cramer_rao_bound(noise):
    renderer = Renderer(RenderOptions(noise=noise))
    finder, rng = BlobFinder(), np.random.default_rng(0)
    errors, sigma = [], []
    for k in range(16):
        xy, yaw = scene(k)
        truth = renderer.calibration.to_pixels(xy)
        near = np.column_stack([truth + rng.normal(0, 0.3, truth.shape), yaw])
        blobs = finder.find(renderer.render(*xy.T, yaw, k), near if k else None)
        assert len(blobs) == 25
        errors.append(paired(blobs, truth))
        sigma.append(blobs['sigma_px'])
    rms = np.sqrt((np.array(errors) ** 2).mean())
    assert rms < 1.3 * position_bound_px(*NOISE_LEVELS[noise])
    assert np.median(sigma) == pytest.approx(rms, rel=0.35)  # it knows how well it knows


def test_angle_size_and_visibility():
    renderer = Renderer(RenderOptions(noise='L2'))
    xy, yaw = scene(3)
    blobs = BlobFinder().find(renderer.render(*xy.T, yaw, 0))
    truth = renderer.calibration.to_pixels(xy)
    order = [np.hypot(blobs['u'] - u, blobs['v'] - v).argmin() for u, v in truth]
    turn = (blobs['theta'][order] - yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
    assert np.abs(turn).max() < 2e-3
    assert np.abs(blobs['side_px'] - BLOCK_SIDE_M * 545).max() < 0.2
    assert blobs['visibility'].min() > 0.95
    assert blobs['quality'].min() > 0.9


@pytest.mark.parametrize('level', ['ordinary', 'hard'])
def test_clutter_hides_no_block_and_adds_none(level):
    camera = clutter_calibration(level)
    whole, errors = 0, []
    for seed in (11, 22):
        renderer = Renderer(RenderOptions(clutter=level), camera, seed)
        finder = BlobFinder(calibration=camera)
        for k in range(12):
            xy, yaw = scene(k)
            yaw = yaw * 0.3
            truth = camera.to_pixels(xy)
            visible = renderer.visible_share(*xy.T, yaw, 23 * k)
            blobs = finder.find(
                renderer.render(*xy.T, yaw, 23 * k), np.column_stack([truth, yaw]) if k else None
            )
            pose = camera.poses_to_table(
                np.column_stack([blobs['u'], blobs['v']]), blobs['theta'], blobs['side_px']
            )
            far = np.hypot(pose[:, None, 0] - xy[:, 0], pose[:, None, 1] - xy[:, 1])
            assert far.min(axis=1).max() < 0.005  # nothing that is no block
            assert not (far.min(axis=0)[visible < 0.02] < 0.005).any()
            assert (far.min(axis=0)[visible > 0.98] < 0.005).all()
            errors.append(far.min(axis=0)[visible > 0.98] * 545)
            whole += (visible > 0.98).sum()
    assert whole > 400
    rms = np.sqrt((np.concatenate(errors) ** 2).mean() / 2)
    assert rms < {'ordinary': 0.05, 'hard': 0.1}[level]


def test_half_a_block_is_measured_by_its_other_half():
    renderer = Renderer(RenderOptions(noise='L2'))
    xy, yaw = rest_lattice(), np.full(25, 0.1)
    truth = renderer.calibration.to_pixels(xy)
    near = np.column_stack([truth + 0.4, yaw])
    arm = [[-0.7, 0.055, 0.7, 0.055, 0.04]]  # lies over the upper part of the middle row
    visible = renderer.visible_share(*xy.T, yaw, 0, arms=arm)
    finder = BlobFinder()
    finder.find(renderer.render(*xy.T, yaw, 0), near)
    blobs = finder.find(renderer.render(*xy.T, yaw, 1, arms=arm), near)
    left = paired(blobs, truth)
    partly = (visible > 0.5) & (visible < 0.98)
    assert partly.sum() == 5
    assert np.isfinite(left[partly]).all()
    assert np.sqrt((left[partly] ** 2).mean()) < 0.25
    seen = {
        int(np.hypot(truth[:, 0] - b['u'], truth[:, 1] - b['v']).argmin()): b['visibility']
        for b in blobs
    }
    assert all(seen[k] < 0.9 for k in np.flatnonzero(partly))


def test_a_lost_prediction_is_found_by_the_scan():
    renderer = Renderer(RenderOptions(noise='L2'))
    xy, yaw = scene(5)
    image = renderer.render(*xy.T, yaw, 0)
    truth = renderer.calibration.to_pixels(xy)
    wrong = np.column_stack([truth, yaw])
    wrong[:5, 0] += 60.0
    finder = BlobFinder()
    finder.find(image)
    assert np.isfinite(paired(finder.find(image, wrong), truth, 0.1)).all()


@pytest.mark.parametrize(
    'image',
    [
        np.zeros((800, 1280), np.uint8),
        np.full((800, 1280), 255, np.uint8),
        np.random.default_rng(0).normal(60, 20, (800, 1280)).clip(0, 255).astype(np.uint8),
        (np.indices((800, 1280)).sum(axis=0) // 8).astype(np.uint8),
    ],
)
def test_nothing_is_found_where_nothing_is(image):
    finder = BlobFinder()
    assert len(finder.find(image)) == 0
    assert len(finder.find(image, [[640.0, 400.0, 0.0], [np.nan, 1.0, 0.0]])) == 0


def test_blocks_out_of_the_picture_do_no_harm():
    renderer = Renderer(RenderOptions(noise='L2'))
    xy, yaw = rest_lattice(), np.zeros(25)
    xy = xy + [0.0, 0.38]  # the upper row is cut by the edge of the image
    finder = BlobFinder()
    image = renderer.render(*xy.T, yaw, 0)
    truth = renderer.calibration.to_pixels(xy)
    for _ in range(2):
        blobs = finder.find(image, np.column_stack([truth, yaw]))
        assert np.isfinite(paired(blobs, truth, 0.5)[:20]).all()
        assert len(blobs) <= 25


def test_the_same_images_give_the_same_numbers():
    renderer = Renderer(RenderOptions(clutter='hard'), clutter_calibration('hard'), 5)
    images = []
    for k in range(20):
        xy, yaw = scene(k)
        images.append(renderer.render(*xy.T, yaw * 0.2, 9 * k).copy())
    first, second = BlobFinder(), BlobFinder()
    answers = [first.find(i) for i in images]
    assert all(np.array_equal(a, second.find(i)) for a, i in zip(answers, images, strict=True))


@pytest.mark.parametrize(
    ('image', 'words'),
    [
        (np.zeros((800, 1280, 3), np.uint8), 'grey'),
        (np.zeros((800, 1280), np.uint16), 'uint16'),
        (np.zeros((20, 30), np.uint8), 'too small'),
    ],
)
def test_wrong_images_are_refused_with_their_shape(image, words):
    with pytest.raises(ConfigError, match=words):
        BlobFinder().find(image)


@pytest.mark.slow
@pytest.mark.parametrize('clutter', ['clean', 'ordinary', 'hard'])
def test_an_arm_across_half_a_block_moves_it_little_and_is_told(clutter):
    """Lens, tilt and texture included: the image of a square is not a square there."""
    calibration = clutter_calibration(clutter)
    renderer = Renderer(RenderOptions(clutter=clutter), calibration, 4)
    renderer.clutter.arms = lambda index: (np.zeros((0, 5)), np.zeros(0))
    finder, rest, yaw = BlobFinder(calibration=calibration), rest_lattice(), np.full(25, 0.05)
    near = np.column_stack([calibration.to_pixels(rest), yaw])
    for k in range(8):  # it learns how bright covers are
        finder.find(renderer.render(*rest.T, yaw, k, flash=np.zeros(25)), near)
    left, sigma, shares = [], [], []
    for k in range(12):
        xy = rest + np.random.default_rng(k).normal(0, 0.003, (25, 2))
        y = xy[10:15, 1].mean() + (0.05 if k % 2 else -0.05)
        arm = np.array([[-0.6, y, 0.6, y + 0.04, 0.035]])
        image = renderer.render(*xy.T, yaw, 20 + k, flash=np.zeros(25), arms=arm)
        share = renderer.visible_share(*xy.T, yaw, 20 + k, arms=arm)
        blobs = finder.find(image, np.column_stack([calibration.to_pixels(xy), yaw]))
        px = np.column_stack([blobs['u'], blobs['v']])
        place = calibration.poses_to_table(px, blobs['theta'], blobs['side_px'])[:, :2]
        for block in np.flatnonzero((share > 0.5) & (share < 0.98)):
            far = (place - xy[block]) * calibration.px_per_m()
            i = np.hypot(*far.T).argmin()
            if np.abs(far[i]).max() < 5:
                left.append(far[i])
                sigma.append(blobs['sigma_px'][i])
            shares.append(share[block])
    assert len(left) > 0.9 * len(shares) > 20
    rms = np.sqrt(np.mean(np.square(left)))
    assert rms < {'clean': 0.05, 'ordinary': 0.12, 'hard': 0.2}[clutter]
    assert rms < 3 * np.sqrt(np.mean(np.square(sigma)))


def drawn(centre, theta, half, level=200.0, size=300):
    """Return an image (size, size) of a square on a platform of 12 grey levels."""
    v, u = np.mgrid[:size, :size] - np.array(centre)[::-1, None, None]
    x, y = u * np.cos(theta) - v * np.sin(theta), u * np.sin(theta) + v * np.cos(theta)
    away = np.clip(np.maximum(abs(x), abs(y)) - half, -1, 1)
    return 12.0 + (level - 12.0) * 0.5 * (1 - away)


def sought(image, u, v, theta, half, over=60.0, taken=()):
    """Return the places (2, 3) where scan.seek finds a square."""
    found, tiles = np.empty((2, 3)), np.full((5, 5), 12, np.uint8)
    image = scan.read_only(np.rint(image).astype(np.uint8))
    taken = np.reshape(taken, (-1, 2)).astype(float)
    scan.seek(image, tiles, u, v, theta, half, over, taken, len(taken), found)
    return found


def test_a_square_is_sought_where_most_of_its_sides_show():
    rng = np.random.default_rng(5)
    for _ in range(10):
        theta, half, centre = rng.uniform(-0.7, 0.7), 22.0, rng.uniform(130, 170, 2)
        image = drawn(centre, theta, half) + rng.normal(0, 3, (300, 300))
        u, v = centre + rng.uniform(-30, 30, 2)
        found = sought(image, u, v, theta, half)
        assert np.hypot(*(found[0, :2] - centre)) < 3.0
        assert found[0, 2] > 0.9
        assert found[0, 2] > found[1, 2] + 0.3


def test_no_square_is_sought_on_the_ground_of_another():
    image = drawn((150, 150), 0.2, 22.0)
    assert (sought(image, 160, 150, 0.2, 22.0, taken=[(149, 151)])[:, 2] == 0).all()


@pytest.mark.parametrize('wide', [6, 21, 44])
def test_no_square_is_sought_along_an_arm(wide):
    image = np.full((300, 300), 12.0)
    image[:, 150 - wide : 151 + wide] = 100.0
    assert (sought(image, 150, 150, 0.0, 22.0, 40.0)[:, 2] == 0).all()


@pytest.mark.parametrize('bright', [14.0, 40.0, 90.0])
@pytest.mark.parametrize('strip', [4, 9, 15])
def test_an_edge_of_an_arm_is_told_from_the_side_across(bright, strip):
    rng = np.random.default_rng(int(bright) + strip)
    theta, half, centre = 0.0, 22.0, (150, 150)
    v, u = np.mgrid[:300, :300] - 150
    away = np.maximum(np.maximum(abs(u), abs(v)) - half, 0)
    image = np.maximum(drawn(centre, theta, half), 12.0 + 100.0 * np.exp(-away / 8.0))  # its glow
    image[:, : 151 - int(half) + strip] = bright  # an arm hides a strip of its left side
    image = np.rint(np.clip(image + rng.normal(0, 2, image.shape), 0, 255))
    image = scan.read_only(image.astype(np.uint8))

    def misled(du):
        return scan.side_within(image, 150.0 + du, 150.0, theta, half, 80.0)

    assert not misled(0.0)
    assert misled(float(strip))  # the arm's edge as the left side: the right one shows within


def test_a_dim_block_beside_a_reflection_is_found_where_the_lattice_misses_it():
    renderer = Renderer(RenderOptions(noise='L2'))
    xy, yaw = rest_lattice(), np.zeros(25)
    image = renderer.render(*xy.T, yaw, 0).copy()
    truth = renderer.calibration.to_pixels(xy)
    u, v = np.rint(truth[12]).astype(int)
    block = image[v - 40 : v + 41, u - 40 : u + 41]
    ground = np.median(image)
    block[:] = np.rint(ground + 0.35 * (block - ground)).clip(0, 255)
    half = round(renderer.calibration.px_per_m() * BLOCK_SIDE_M / 2)
    block[:, 40 + half + 1 : 40 + half + 9] = 200
    others = np.arange(25) != 12
    finder = BlobFinder(calibration=renderer.calibration)
    near = np.column_stack([truth, yaw])
    finder.find(image, near[others])
    assert np.isfinite(paired(finder.find(image, near), truth, 2.0)[12]).all()
    finder = BlobFinder(calibration=renderer.calibration)
    finder.find(image, near[others])
    assert np.isnan(paired(finder.find(image, near[others]), truth, 2.0)[12]).all()


def lit_beside(lamp, arm=None, flat=False, shines=0.35):
    """Return the blob found where block 12 is expected, and how far off, px; None for none.

    lamp: u, v from its centre, width in px and height in grey levels of a glow. arm: a first and a
    last column from its centre between which all has one grey level. flat: are the covers.
    shines: how bright it is, times the others.
    """
    renderer = Renderer(RenderOptions(noise='L2'))
    xy = rest_lattice()
    image = renderer.render(*xy.T, np.zeros(25), 0).astype(float)
    truth = renderer.calibration.to_pixels(xy)
    ground = np.median(image)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    u_off, v_off = u - truth[12, 0], v - truth[12, 1]
    dim = (abs(u_off) < 40) & (abs(v_off) < 40)
    image[dim] = ground + shines * (image[dim] - ground)
    away = (u_off - lamp[0]) ** 2 + (v_off - lamp[1]) ** 2
    image += lamp[3] * np.exp(-0.5 * away / lamp[2] ** 2)
    if arm is not None:
        image[(arm[0] < u_off) & (u_off < arm[1]) & (abs(v_off) < 60)] = arm[2]
    image = np.rint(image.clip(0, 255)).astype(np.uint8)
    covers = CoverOutlines(15.0, np.full((25, 4, 5), 15.0))  # mm: known, and all in one plane
    calibration = replace(renderer.calibration, cover_height_m=0.015, covers=covers)
    finder = BlobFinder(calibration=renderer.calibration if flat else calibration)
    near = np.column_stack([truth, np.zeros((25, 3))])
    for _ in range(2):
        blobs = finder.find(image, near)
    off = np.hypot(blobs['u'] - truth[12, 0], blobs['v'] - truth[12, 1])
    i = off.argmin()
    return (blobs[i], off[i]) if off[i] < 20 else (None, off[i])


@pytest.mark.parametrize('flat', [False, True])
@pytest.mark.parametrize('lamp', [(22, 12, 11, 190), (-20, -20, 14, 150), (30, 0, 14, 200)])
def test_a_dim_block_in_the_glow_of_a_lamp_is_whole(lamp, flat):
    blob, off = lit_beside(lamp, flat=flat)
    assert blob['visibility'] > 0.9
    assert off < 0.5
    assert off < 3 * blob['sigma_px']


@pytest.mark.parametrize(
    'lamp', [(0, 18, 20, 160), (5, 15, 18, 150), (20, 20, 20, 120), (-20, -20, 18, 110)]
)
def test_a_block_that_a_lamp_makes_as_bright_as_a_pixel_can_be_is_whole(lamp):
    blob, off = lit_beside(lamp, flat=True, shines=1.0)
    assert blob['visibility'] > 0.9
    assert off < 0.5
    assert off < 3 * blob['sigma_px']


@pytest.mark.parametrize('flat', [False, True])
@pytest.mark.parametrize('grey', [40.0, 90.0, 160.0])
def test_a_bright_block_under_an_arm_is_not_whole(grey, flat):
    blob, off = lit_beside((0, 22, 14, 140), (4, 60, grey), flat, shines=1.0)
    assert blob is None or (blob['visibility'] < 0.8 and off < 1.0)


@pytest.mark.parametrize('flat', [False, True])
@pytest.mark.parametrize('grey', [40.0, 90.0, 160.0])
def test_a_block_in_the_glow_of_a_lamp_and_under_an_arm_is_not_whole(grey, flat):
    blob, off = lit_beside((-20, -20, 14, 150), (4, 60, grey), flat)
    assert blob is None or (blob['visibility'] < 0.8 and off < 1.0)


@pytest.mark.parametrize('turned', range(4))
@pytest.mark.parametrize('arm', [40.0, 120.0, 220.0])
def test_half_a_square_of_light_is_sought_by_the_sides_that_it_shows(turned, arm):
    """What an arm leaves of a block fills many squares as well, and so does a bright arm."""
    image = drawn((149.5, 149.5), 0.1, 22.0)
    v, u = np.mgrid[:300, :300] - 149.5
    image[(u + 0.35 * v < 0) & (u + 0.35 * v > -70)] = arm
    image = np.rot90(image, turned)
    for off_u, off_v in ((12, 8), (-20, 4), (4, -30), (0, 12)):
        found = sought(image, 149.5 - off_u, 149.5 - off_v, 0.1, 22.0)
        assert np.hypot(*(found[0, :2] - 149.5)) < 4.8  # px that the fit reaches


def test_what_an_arm_left_of_a_block_does_not_tell_how_it_usually_looks():
    usual = usual_outline.rows(1)[0]
    usual[usual_outline.QUARTER], usual[usual_outline.TIMES] = 0.0, usual_outline.MOST
    for share, believed in ((0.6, False), (0.95, True)):
        usual[usual_outline.SHARE] = share
        assert usual_outline.trusted(usual) == believed


def test_what_was_learnt_beside_an_arm_is_forgotten_once_more_is_in_view():
    usual = usual_outline.rows(1)[0]
    usual[usual_outline.QUARTER], usual[usual_outline.TIMES] = 0.0, usual_outline.MOST
    usual[usual_outline.SHARE] = 0.75
    usual_outline.outgrow(usual, 0.77)  # noise
    assert usual_outline.trusted(usual)
    usual_outline.outgrow(usual, 0.9)
    assert not usual_outline.trusted(usual)


@pytest.mark.slow
def test_whole_blocks_on_glittering_sandpaper_are_whole():
    """Grains and specks take their part of every edge; what is left is all that can agree."""
    calibration = clutter_calibration('glittering')
    renderer = Renderer(RenderOptions(clutter='glittering'), calibration, 4)
    renderer.clutter.arms = lambda index: (np.zeros((0, 5)), np.zeros(0))
    finder, rest, yaw = BlobFinder(calibration=calibration), rest_lattice(), np.full(25, 0.05)
    near = np.column_stack([calibration.to_pixels(rest), yaw])
    for k in range(40):
        blobs = finder.find(renderer.render(*rest.T, yaw, k, flash=np.zeros(25)), near)
    assert len(blobs) == 25
    assert np.median(blobs['visibility']) > 0.9  # 0.77 of their edges agree
    arm = np.array([[-0.6, 0.06, 0.6, 0.06, 0.05]])
    blobs = finder.find(renderer.render(*rest.T, yaw, 41, flash=np.zeros(25), arms=arm), near)
    share = renderer.visible_share(*rest.T, yaw, 41, arms=arm)
    off = np.hypot(*(np.array([blobs['u'], blobs['v']])[:, :, None] - near.T[:2, None]))
    partly = (share > 0.5) & (share < 0.98)
    assert partly.sum() >= 5
    shown = blobs['visibility'][off.argmin(axis=0)]
    assert np.abs(shown[partly] - share[partly]).max() < 0.25


def hidden_but_for(rows, columns):
    """Return a finder that has just seen all blocks, an image, true centres, what is expected.

    In the image an arm as dark as the platform leaves of block 12 what is given, from its centre.
    """
    renderer = Renderer(RenderOptions(noise='L2'))
    xy = rest_lattice()
    truth = renderer.calibration.to_pixels(xy)
    seen = np.column_stack([truth, np.zeros(25), np.full(25, 170.0), np.full(25, -1.0)])
    near = np.column_stack([seen, np.full(25, 1 / 60)])  # s since it was seen
    image = renderer.render(*xy.T, np.zeros(25), 0).copy()
    finder = BlobFinder(calibration=renderer.calibration)
    assert len(finder.find(image, near)) == 25
    ground = round(float(np.median(image)))
    u, v = np.rint(truth[12]).astype(int)
    v_off, u_off = np.mgrid[-40:41, -40:41]
    shown = (rows[0] <= v_off) & (v_off < rows[1]) & (columns[0] <= u_off) & (u_off < columns[1])
    image[v - 40 : v + 41, u - 40 : u + 41][~shown] = ground
    return finder, image, truth, near


@pytest.mark.parametrize('rows', [(-19, 1), (-17, 9), (-15, 11), (-13, 13)])
def test_the_edge_of_a_dark_arm_does_not_draw_a_block_along(rows):
    finder, image, truth, near = hidden_but_for(rows, (-40, 40))
    left = paired(finder.find(image, near), truth, 25.0)[12]
    assert not np.hypot(*left) > 2.0  # right, or hidden


@pytest.fixture(scope='module')
def known_block():
    """Return what each of several images says of block 12, of which an arm hides a strip.

    The arm is as dark as the platform and lies along one side of a block that is known well: called
    with the width of the strip in px and a number of images, it returns how far off each of them
    puts the block, and sigma, px, both NaN where it is not placed.
    """
    renderer = Renderer(RenderOptions(noise='L2'))
    xy = rest_lattice()
    truth = renderer.calibration.to_pixels(xy)
    near = np.column_stack([truth, np.zeros(25), np.full(25, 170.0), np.zeros(25)])
    near = np.column_stack([near, np.full(25, 1 / 60)])
    bare = renderer.render(*xy.T, np.zeros(25), 0).astype(float)
    u, v = np.rint(truth[12]).astype(int)
    ground, rng = float(np.median(bare)), np.random.default_rng(3)
    edge = u + 20
    while bare[v, edge] - ground > 0.5 * (bare[v, u + 15] - ground):
        edge += 1
    noisy = [bare + rng.normal(0, 1.0, bare.shape) for _ in range(60)]  # drawn once: it takes long
    noisy = [np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in noisy]

    def under(strip, images):
        finder, found = BlobFinder(calibration=renderer.calibration), []
        for k in range(100 + images):
            image = noisy[k % len(noisy)].copy()
            if k >= 100 and strip:
                image[v - 40 : v + 41, edge - strip : u + 45] = round(ground)
            blobs = finder.find(image, near)
            at = np.array([blobs['u'] - truth[12, 0], blobs['v'] - truth[12, 1]])
            one = np.hypot(*at) < 25.0
            found.append(
                [np.hypot(*at[:, one])[0], blobs['sigma_px'][one][0]] if one.any() else [np.nan] * 2
            )
        return np.array(found[100:]).T

    return under


@pytest.mark.parametrize('strip', [0, 1, 2, 3, 4, 6])
def test_sigma_says_how_far_a_dark_arm_along_one_side_may_lead_a_block(known_block, strip):
    off, sigma = known_block(strip, 20)
    if strip == 0:
        assert off.max() < 0.05 and sigma.max() < 0.02
    elif strip == 1:
        assert off.min() > 0.2  # nobody can tell which side the arm hides
    placed = np.isfinite(off)
    assert placed.all() or strip > 2
    assert (off[placed] < 3.0 * sigma[placed] + 0.03).all()
    assert (off[placed] < 2.0).all()


def test_a_block_that_stays_less_wide_is_known_so_in_the_end(known_block):
    """An arm goes, but what stands before a cover may stay."""
    _, sigma = known_block(1, 4000)
    assert sigma[:20].min() > 0.2
    assert sigma[-20:].max() < 0.15  # an edge so sharp is no cover's


def test_a_block_that_was_just_seen_is_followed_to_where_little_of_it_is_left():
    finder, image, truth, near = hidden_but_for((-40, 2), (-40, 2))
    left = paired(finder.find(image, near), truth)[12]
    assert np.hypot(*left) < 0.2
    near[12, 5] = 0.5  # long ago it might have been anywhere: so little is no proof
    assert np.isnan(paired(finder.find(image, near), truth)[12]).all()

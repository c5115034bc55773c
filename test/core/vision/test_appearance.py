# SPDX-License-Identifier: Apache-2.0
"""The tracker: its parts against independent oracles, then videos with known truth."""

import copy
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.clutter import Cluttered, clutter_calibration
from support.paper import BLOCK_SIDE_M, rest_lattice, turned
from support.relief import films
from support.vision_bound import position_bound_px

from eol_ros.core.compiled import njit
from eol_ros.core.table import Table
from eol_ros.core.vision import outline
from eol_ros.core.vision.appearance import find, learnt, model, pixels
from eol_ros.core.vision.appearance.follow import Follower
from eol_ros.core.vision.appearance.register import register
from eol_ros.core.vision.calibration import covers
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import NOISE_LEVELS, Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

HALF_M, BLUR_PX = BLOCK_SIDE_M / 2, math.hypot(1.2, math.sqrt(1 / 12))
REST, TURNED = rest_lattice(), Table().turned_ids
FLAT = np.zeros(outline.SIZE, np.float32)


@njit
def gather(*arguments):
    return pixels.gather(*arguments)


def read_only(image):
    image = np.ascontiguousarray(image)
    image.flags.writeable = False
    return image


@pytest.mark.parametrize(
    ('name', 'most_mm', 'mirror'),
    [
        ('straight-0mm', 0.15, False),
        ('tilted', 0.3, False),
        ('steep', 0.3, False),
        ('steep', 0.3, True),
        ('lens', 0.3, False),
    ],
)
def test_printed_covers_lie_where_they_were_put(name, most_mm, mirror):
    film = films.one(name)
    camera = films.calibration(film, True)
    if mirror:  # the same table, left for right in the image
        flip = np.array([[-1.0, 0, camera.image_width - 1], [0, 1, 0], [0, 0, 1]])
        matrix = camera.camera_matrix.copy()
        matrix[0, 2] = camera.image_width - 1 - matrix[0, 2]
        camera = replace(camera, homography=flip @ camera.homography, camera_matrix=matrix)
        assert camera.mirrored
    tracker = Tracker(TrackerSettings(), camera)
    found = []
    for k in range(40):
        image = films.sensed(film.light, k)
        found.append(tracker.update(k / 60, image[:, ::-1] if mirror else image))
    found = found[20:]
    assert all(f.seen.all() for f in found)
    off = np.array([f.world for f in found]) - film.shot.poses[:, :2]
    assert np.sqrt((off**2).sum(axis=2).mean()) < most_mm * 1e-3
    yaw = np.array([f.yaw for f in found]) - film.shot.poses[:, 2]
    assert np.abs(np.angle(np.exp(4j * yaw)) / 4).max() < math.radians(0.8)


def glow_at(place, level=160, width_px=16.0):
    """Return the light of a lamp at the place (u, v) px over an image of 1280x800."""
    u, v = np.arange(1280) - place[0], np.arange(800) - place[1]
    return level * np.exp(-(v[:, None] ** 2 + u**2) / (2 * width_px**2))


@pytest.mark.parametrize('beside_px', [(30, 0), (0, -30)])
def test_a_printed_cover_beside_a_lamp_is_learned_from_the_first_image_on(beside_px):
    film = films.one('tilted')
    camera = films.calibration(film, True)
    truth, follower = film.shot.poses[:, :2], Follower(camera)
    glow = glow_at(camera.to_pixels(truth[12:13])[0] + beside_px)
    for k in range(90):
        image = np.clip(films.sensed(film.light, k) + glow, 0, 255).astype(np.uint8)
        blocks = follower.update(k / 60, read_only(image))
        assert k < 30 or blocks['seen'].all()
    assert blocks['known'].all()
    off = np.hypot(blocks['x'] - truth[:, 0], blocks['y'] - truth[:, 1])
    assert off[12] < 2.5e-3  # 1.3 px: the lamp lights the cover too
    assert np.delete(off, 12).max() < 0.5e-3


def out_of_focus(image, noise):
    return noise + cv2.GaussianBlur(image, (0, 0), 2.5)


def shaken(image, noise):
    return noise + cv2.blur(image, (9, 1))


def compressed(image, noise):
    image = np.clip(image + noise, 0, 255).astype(np.uint8)
    return cv2.imdecode(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 50])[1], 0)


def of_four_bits(image, noise):
    return (image + noise) // 16 * 16


@pytest.mark.parametrize(
    ('spoil', 'most_px'),
    [(out_of_focus, 0.2), (shaken, 1.2), (compressed, 0.2), (of_four_bits, 0.3)],
)
def test_images_of_poor_cameras_show_all_blocks(spoil, most_px):
    renderer = Renderer(RenderOptions(noise='L0'), None, 2)
    camera, random, images = renderer.calibration, np.random.default_rng(3), []
    for k in range(40):
        light = renderer.render(*REST.T, np.zeros(25), k)
        image = spoil(light, random.normal(0.5, 3.0, light.shape))
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    found = followed(images, camera)
    assert found['seen'].all() and found['known'][-1].all()
    off = np.hypot(found['x'] - REST[:, 0], found['y'] - REST[:, 1])[20:] * camera.px_per_m()
    assert off.max() < most_px


@pytest.mark.parametrize('lens_px', [0.3, 0.5, 0.7, 0.9])
def test_blocks_at_rest_stay_where_they_are_under_a_sharp_lens(lens_px):
    """Images of half the usual size; the tracker learns the faces meanwhile."""
    camera = Calibration.ideal(640, 400)
    renderer = Renderer(RenderOptions(noise='L0', psf_px=lens_px), camera, 2)
    random = np.random.default_rng(1)
    xy, yaw = REST + random.normal(0, 0.004, (25, 2)), random.normal(0, 0.05, 25)
    found = followed([renderer.render(*xy.T, yaw, k) for k in range(40)], camera)
    off = np.hypot(found['x'] - xy[:, 0], found['y'] - xy[:, 1]) * camera.px_per_m()
    assert found['seen'].all() and found['known'][-1].all()
    assert off.max() < 0.03


def under_an_arm(image, centre, level):
    """Return the image with an arm from below whose hand ends at the place `centre`, px."""
    left = int(centre[0]) - 110
    v, u = np.mgrid[0 : image.shape[0], left : left + 220]
    u, v = u - centre[0], v - centre[1]
    lower = 20 - np.abs(u + 0.13 * v)  # the arm leans
    inside = np.where(v > 0, lower, 20 - np.hypot(u, v))
    weight = np.clip(0.5 + inside / 4, 0, 1)
    image = image.copy()
    part = image[:, left : left + 220]
    part[:] = np.clip(part * (1 - weight) + weight * level, 0, 255)
    return image


@pytest.mark.parametrize('level', [90, 150])
def test_an_arm_that_touches_a_cover_from_the_first_image_on_moves_it_little(level):
    film = films.one('tilted')
    camera = films.calibration(film, True)
    truth = film.shot.poses[:, :2]
    middle, follower = camera.to_pixels(truth[12:13])[0], Follower(camera)
    for k in range(90):
        image = films.sensed(film.light, k)
        if k < 60:  # it comes by 0.3 px an image
            image = under_an_arm(image, middle + (-44 + 0.3 * k, 0), level)
        blocks = follower.update(k / 60, read_only(image))
        off = np.hypot(*(np.array([blocks['x'][12], blocks['y'][12]]) - truth[12]))
        assert k < 12 or (blocks['seen'][12] and off < (0.6e-3 if k < 60 else 0.3e-3)), k
    assert blocks['known'][12]


def registered(noise, images=12, start_px=0.7):
    """Return errors (n, 2) px and sigmas (n,) px of flat blocks at random poses."""
    renderer = Renderer(RenderOptions(noise=noise), None, 1)
    camera, rng = renderer.calibration, np.random.default_rng(3)
    follower, errors, sigmas = Follower(camera), [], []
    found, faces = follower.found, follower.faces
    faces.spread[:], found['own'] = 1e-5, model.LEAST_OWN
    for k in range(images):
        xy = REST + rng.normal(0, 0.004, (25, 2))
        yaw = rng.uniform(-0.8, 0.8, 25)
        image = read_only(renderer.render(*xy.T, yaw, k))
        curve = np.empty(2)
        find.noise_by_level(image, curve)
        start = xy + rng.normal(0, start_px / 2 / 545, xy.shape)
        found['x'], found['y'], found['yaw'] = *start.T, yaw + rng.normal(0, 0.01, 25)
        found['start_px'], found['expected'] = start_px, 170.0
        register(
            image, camera.packed(), covers.FLAT, HALF_M, BLUR_PX, curve, faces.light, faces.spread,
            np.zeros(25, bool), model.ROUNDS, np.ones(25, bool), np.arange(25), found, faces.own,
            faces.own_px, *pixels.empty_patches(25),
        )  # fmt: skip
        errors.append(np.column_stack([found['x'], found['y']]) - xy)
        sigmas.append(found['sigma_m'].copy())
    return np.concatenate(errors) * 545, np.concatenate(sigmas) * 545


@pytest.mark.parametrize('noise', ['L0', 'L2', 'L4'])
def test_registration_is_near_the_bound_and_says_how_near(noise):
    errors, sigmas = registered(noise)
    rms, bound = np.sqrt((errors**2).mean()), position_bound_px(*NOISE_LEVELS[noise])
    # 600 coordinates: the rms is known to 3 %
    assert bound * 0.9 < rms < bound * 1.4
    assert 0.67 < rms / np.sqrt((sigmas**2).mean()) < 1.5
    assert np.abs(errors.mean(axis=0)).max() < 4 * rms / math.sqrt(len(errors))


@pytest.mark.parametrize('level', ['ordinary', 'brutal'])
@pytest.mark.parametrize('angle', [0.0, 0.5, 1.2])
def test_the_lattice_is_found_in_one_image_at_every_angle(level, angle):
    camera = clutter_calibration(level)
    renderer = Cluttered(level, camera, 5, noise='L3')
    at = turned(REST, angle) + [0.05, -0.08] + np.random.default_rng(4).normal(0, 0.008, (25, 2))
    image = read_only(renderer.render(*at.T, np.full(25, angle), 3))
    lattice = find.find_lattice(image, camera.packed(), camera.table, 20.0)
    away = np.hypot(*(lattice.nodes[:, None, :2] - at[None]).T).min(axis=0)
    hidden = renderer.visible_share(*at.T, np.full(25, angle), 3) < 0.9
    assert (away < 0.016).sum() >= 23 - hidden.sum()
    assert abs((lattice.angle - angle + np.pi / 4) % (np.pi / 2) - np.pi / 4) < math.radians(6)


def followed(images, camera, step_s=1 / 60):
    """Return blocks (n, 25) of a video."""
    follower = Follower(camera)
    return np.array(
        [follower.update(k * step_s, read_only(i)).copy() for k, i in enumerate(images)]
    )


def textured(image, camera, at, yaw):
    """Return the image with each block's light modulated by a pattern of its own."""
    image, rng = image.astype(float), np.random.default_rng(4)
    patterns = np.column_stack([rng.uniform(*r, 25) for r in ((0.05, 0.2), (0, 6)) * 2])
    for (x, y), p in zip(at, patterns, strict=True):
        u, v = np.rint(camera.to_pixels([[x, y]])[0]).astype(int)
        j, i = np.mgrid[v - 22 : v + 23, u - 22 : u + 23]
        a, b = (i - u) / 545, -(j - v) / 545
        c, s = math.cos(yaw), math.sin(yaw)
        a, b = c * a + s * b, c * b - s * a
        image[j, i] *= 1 + p[0] * np.cos(60 * a + p[1]) + p[2] * np.cos(60 * b + p[3])
    return np.clip(image, 0, 255).astype(np.uint8)


def test_a_turn_in_the_dark_is_told_by_the_covers():
    renderer = Renderer(RenderOptions(noise='L2'), None, 2)
    dark = np.random.default_rng(1).integers(8, 14, (800, 1280)).astype(np.uint8)
    images = []
    for k in range(120):
        angle = math.pi / 2 * (k > 70)
        at = turned(REST, angle)
        image = renderer.render(*at.T, np.full(25, angle), k)
        images.append(textured(image, renderer.calibration, at, angle))
    images[50:71] = [dark] * 21
    found = followed(images, renderer.calibration)
    assert found['seen'][76:].all()
    true = turned(REST, math.pi / 2)
    assert np.hypot(found['x'] - true[:, 0], found['y'] - true[:, 1])[76:].max() < 1e-3
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (found['yaw'][76:] - math.pi / 2))), 0, atol=0.02
    )


def test_which_way_round_the_lattice_lies_is_told_by_taps():
    quarters = 3
    renderer = Renderer(RenderOptions(noise='L2'), None, 2)
    tracker = Tracker(TrackerSettings(trust_start=False), renderer.calibration)
    at, slips = REST.copy(), {30 + 20 * n: place for n, place in enumerate([3, 16, 8, 22, 14, 1])}
    for k in range(180):
        place = slips.get(k - k % 10 if k % 20 >= 10 else -1)
        if place is not None and k % 10 < 4:  # from rest at 2 m/s2
            at[place] = REST[place] + [0.0, ((k % 10 + 0.5) / 60) ** 2]
        if place is not None and k % 10 == 0:
            tracker.tap((k - 0.5) / 60, int(TURNED[quarters, place]), 0.002)
        found = tracker.update(k / 60, renderer.render(*at.T, np.zeros(25), k))
        if k == 25:
            assert found.symmetry_ambiguous
    assert not found.symmetry_ambiguous
    true = np.empty_like(at)
    true[TURNED[quarters]] = at
    assert np.abs(found.world - true).max() < 2e-3
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (found.yaw - quarters * math.pi / 2))), 0, atol=0.02
    )
    assert found.seen.all()


def test_the_glow_of_a_lamp_is_no_block():
    renderer = Renderer(RenderOptions(noise='L2'), None, 2)
    cu, cv = renderer.calibration.to_pixels(REST)[12]
    glow = glow_at((cu, cv), 150, 14.0)
    images = []
    for k in range(40):
        image = renderer.render(*REST.T, np.zeros(25), k).astype(float)
        side = 40
        image[round(cv) - side : round(cv) + side, round(cu) - side : round(cu) + side] = 14
        image += glow
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    found = followed(images, renderer.calibration)
    assert not found['seen'][:, 12].any()
    assert np.delete(found['seen'], 12, axis=1)[12:].all()


def test_what_was_learned_is_known_to_the_next_tracker_in_its_first_image():
    renderer = Renderer(RenderOptions(noise='L2'), None, 2)
    camera = renderer.calibration

    def image(k, angle):
        at = turned(REST, angle)
        drawn = renderer.render(*at.T, np.full(25, angle), k)
        return textured(drawn, camera, at, angle)

    first = Tracker(TrackerSettings(), camera)
    for k in range(30):
        first.update(k / 60, image(k, 0.0))
    learned = first.learned()
    for quarters in (0, 1, 3):
        after = Tracker(TrackerSettings(trust_start=False), camera)
        after.requests.add(0, 'covers', learned)
        angle = quarters * math.pi / 2
        found = after.update(1.0, image(40 + quarters, angle))
        assert found.seen.all() and not found.symmetry_ambiguous
        assert np.abs(found.world - turned(REST, angle)).max() < 1e-3


@pytest.mark.parametrize('spoil', ['short', 'nan', 'negative'])
def test_damaged_covers_are_refused_in_one_line(spoil):
    camera = Calibration.ideal()
    follower = Follower(camera)
    follower.blocks['known'], follower.blocks['gain'], follower.faces.looks[:] = True, 170.0, 40
    data = learnt.pack(follower.faces, follower.blocks, follower.found)
    covers = learnt.check(data, 25).copy()
    assert (covers['looks'] == 40).all() and (covers['light'] == 1).all()
    if spoil == 'nan':
        covers['light'][3, 2, 1] = np.nan
    elif spoil == 'negative':
        covers['spread'][3, 2, 1] = -1.0
    spoilt = covers.tobytes()[: -3 if spoil == 'short' else None]
    with pytest.raises(ConfigError, match='learned covers'):
        Tracker(TrackerSettings(), camera).requests.add(0, 'covers', spoilt)


def test_twice_the_same_bits():
    renderer = Cluttered('hard', clutter_calibration('hard'), 2, noise='L3')
    images = [renderer.render(*REST.T, np.zeros(25), k) for k in range(20)]
    one, other = (followed(images, renderer.calibration) for _ in range(2))
    assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize(('size', 'px_per_m'), [((1920, 1200), 1400.0), ((1280, 800), 180.0)])
def test_blocks_of_15_to_118_px_are_tracked(size, px_per_m):
    camera = Calibration.ideal(*size, px_per_m)
    renderer = Renderer(RenderOptions(noise='L2'), camera, 1)
    found = followed((renderer.render(*REST.T, np.zeros(25), k) for k in range(14)), camera)
    assert found['seen'].all()
    off = np.hypot(found['x'] - REST[:, 0], found['y'] - REST[:, 1])
    assert off.max() * px_per_m < 0.2


def test_a_displaced_table_is_reacquired_in_one_image():
    renderer = Renderer(RenderOptions(noise='L2'), None, 1)
    tracker, there = Tracker(TrackerSettings(), renderer.calibration), REST + (0.03, -0.02)
    for k in range(30):
        tracker.update(k / 60, renderer.render(*REST.T, np.zeros(25), k))
    for k, at in ((30, there), (31, None), (32, there)):
        image = renderer.render(*(REST if at is None else at).T, np.zeros(25), k)
        found = tracker.update(k / 60, image // 16 if at is None else image)
        assert found.seen.all() == (at is not None)
        if at is not None:
            assert np.hypot(*(found.world - at).T).max() < 1e-3


def test_a_block_larger_than_its_room_overflows_nothing():
    camera = Calibration.ideal(1280, 800, 3000.0)  # a block of 252 px
    d, (patches, px, _rests, at, *room) = np.empty(12), pixels.empty_patches(1)
    pixels.taylor(camera.packed(), 0.0, 0.0, 0.3, d)
    gather(800, 1280, d, HALF_M, 60.0, 90.0, FLAT, 1.0, patches[0], px[0], at[0], *room)
    assert 8000 < patches['starts'][0, 5] * pixels.LANES <= px.shape[1] * pixels.LANES


@pytest.mark.parametrize(('pushed', 'axis'), [(-0.12, 0), (0.06, 1)])
def test_a_lattice_found_a_row_beside_its_place_is_put_right(pushed, axis):
    """While two opposite borders are hidden, two places of the lattice explain the others alike."""
    renderer = Renderer(RenderOptions(noise='L2'), None, 2)
    at = REST + pushed * np.eye(2)[axis]
    tracker = Tracker(TrackerSettings(), renderer.calibration)
    row = np.arange(25) // 5 if axis else np.arange(25) % 5
    hidden = renderer.calibration.to_pixels(at[(row == 0) | (row == 4)])[:, axis]
    wrong = 0
    for k in range(110):
        image = renderer.render(*at.T, np.zeros(25), k).copy()
        if k < 20:
            place = np.arange(image.shape[1 - axis])
            dark = np.abs(place[:, None] - hidden).min(axis=1) < 40
            image[(dark, slice(None)) if axis else (slice(None), dark)] = 12
        found = tracker.update(k / 60, image)
        beside = bool(np.nanmax(np.hypot(*(found.world - at).T)) > 0.1)
        assert k < 32 or not beside  # it is looked for again after half a second
        wrong += beside
    assert wrong  # else this test shows nothing
    assert found.seen.all()
    assert np.hypot(*(found.world - at).T).max() < 1e-3


@pytest.mark.parametrize(('moved_px', 'hidden'), [(0.004, False), (0.5, False), (0.0, True)])
def test_a_block_at_rest_is_placed_as_by_a_fit_in_full(moved_px, hidden):
    """Within noise by a linear estimate; moved or hidden it is fitted in full, to the same bits."""
    camera = Calibration.ideal()
    renderer, tracker = Renderer(calibration=camera), Tracker(TrackerSettings(), camera)
    rng = np.random.default_rng(8)
    xy, yaw = REST + rng.normal(0, 0.004, (25, 2)), rng.uniform(-0.3, 0.3, 25)
    for k in range(60):
        tracker.update(k / 60, renderer.render(*xy.T, yaw, k))
    follower = tracker.follower
    rested = follower._patches[0]['rests'] & (follower._patches[0]['starts'][:, 5] > 0)
    rested &= (np.arange(25) + follower._images) % model.CLOSELY != 0
    assert rested.sum() > 15
    image = renderer.render(*(xy + [moved_px / follower.px_per_m, 0.0]).T, yaw, 60)
    if hidden:
        for u, v in camera.to_pixels(xy[rested]):
            image[round(v) - 6 : round(v) + 7, round(u) - 30 : round(u) + 31] = 12
    fitted = copy.deepcopy(tracker)
    fitted.follower._patches[0]['rests'] = False
    ours, theirs = tracker.update(1.0, image), fitted.update(1.0, image)
    found = follower.found[rested]
    off_px = np.abs(ours.world - theirs.world)[rested] * follower.px_per_m
    if moved_px > 0.1 or hidden:
        assert not off_px.any()
        assert (found['visible'] < model.ALIKE).all() == hidden
    else:
        still = (off_px > 0).any(axis=1)  # of noise beyond the limit in some
        assert still.sum() > rested.sum() / 2
        sigma_px = found['sigma_m'].max() * follower.px_per_m  # of one image
        assert np.sqrt((off_px[still] ** 2).mean()) < 0.4 * sigma_px
        assert off_px.max() < 1.5 * sigma_px
        assert not found['close'][still].any()

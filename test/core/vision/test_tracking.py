# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from support.clutter import LEVELS, Cluttered, clutter_calibration
from support.paper import rest_lattice, turned
from support.relief import films

from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.requests import packed
from eol_ros.core.vision.states import CALIBRATING, FAULT, LOST, SEARCHING, TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def stills():
    """70 images of a table at rest, each with its own noise."""
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    x, y = rest_lattice().T
    return [renderer.render(x, y, np.zeros(25), k).copy() for k in range(70)]


@pytest.fixture
def tracker():
    return Tracker(TrackerSettings(), Calibration.ideal())


def feed(tracker, images, start=0):
    return [tracker.update((start + k) / 60, image) for k, image in enumerate(images)]


def test_first_image_is_enough(tracker, stills):
    tracked = tracker.update(0.0, stills[0])
    assert tracked.state == TRACKING
    assert tracked.seen.all()
    assert np.allclose(tracked.world, rest_lattice(), atol=5e-5)
    assert np.allclose(tracked.px, Calibration.ideal().to_pixels(rest_lattice()), atol=0.03)
    assert np.allclose(tracked.yaw, 0, atol=2e-3)
    assert (tracked.sigma_m < 1e-4).all()
    assert (tracked.visibility > 0.9).all()


@pytest.mark.parametrize(
    ('image', 'words'),
    [
        (np.zeros((800, 1280), np.uint8), 'black'),
        (np.full((800, 1280), 255, np.uint8), 'white'),
        (np.zeros((480, 640), np.uint8), '640x480'),
        (np.zeros((800, 1280, 3), np.uint8), 'grey'),
        (np.zeros((800, 1280), np.uint16), 'uint16'),
    ],
)
def test_an_unusable_image_is_a_fault_in_one_line_and_no_pose(tracker, stills, image, words):
    feed(tracker, stills[:3])
    tracked = tracker.update(0.1, image)
    assert tracked.state == FAULT
    assert words in tracked.why
    assert '\n' not in tracked.why
    assert not tracked.seen.any()
    assert np.isnan(tracked.world).all()
    assert np.isnan(tracked.px).all()
    back = tracker.update(0.12, stills[4])
    assert back.state == TRACKING
    assert back.seen.all()
    assert np.allclose(back.world, rest_lattice(), atol=1e-4)


def test_a_frozen_image_is_a_fault_but_a_still_table_is_not(tracker, stills):
    live = feed(tracker, stills)
    assert {t.state for t in live} == {TRACKING}
    frozen = feed(tracker, [stills[-1]] * 60, 70)
    assert frozen[5].state == TRACKING
    assert frozen[-1].state == FAULT
    assert 'frozen' in frozen[-1].why
    assert tracker.update(130 / 60 + 0.1, stills[0]).state in (TRACKING, LOST)


def test_stamps_that_stop_jump_and_run_backwards(tracker, stills):
    stamps = [0, 1 / 60, 1 / 60, 1 / 60, 100.0, 100.02, 3.0, 3.02, -7.0, 1e9, 1e9]
    for k, stamp in enumerate(stamps):
        tracked = tracker.update(stamp, stills[k])
        assert tracked.state == TRACKING
        assert tracked.seen.all()
        assert np.allclose(tracked.world, rest_lattice(), atol=1e-4)


@pytest.mark.parametrize('scale', [0.4, 2.5])
def test_a_calibration_of_another_camera_gives_no_pose(stills, scale):
    ideal = Calibration.ideal()
    other = dataclasses.replace(
        ideal, homography=ideal.homography @ np.diag([1 / scale, 1 / scale, 1])
    )
    for tracked in feed(Tracker(TrackerSettings(), other), stills[:5]):
        assert tracked.state != TRACKING
        assert not tracked.seen.any()
        assert tracked.why


def test_blocks_that_rest_off_their_lattice_are_no_measure():
    xy = rest_lattice()
    xy[[3, 8, 11, 20]] += [[0.04, 0], [0.03, 0.02], [-0.03, 0.02], [0.02, 0.04]]
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    tracker = Tracker(TrackerSettings(), None)
    images = [renderer.render(*xy.T, np.zeros(25), k).copy() for k in range(45)]
    last = feed(tracker, images)[-1]
    assert last.state == CALIBRATING
    assert 'off their lattice' in last.why
    assert np.isnan(last.world).all()


def test_darkness_then_light_says_that_the_turn_is_open(tracker, stills):
    feed(tracker, stills[:3])
    random = np.random.default_rng(1)
    dark = np.clip(random.normal(14, 2, (800, 1280)), 0, 255).astype(np.uint8)
    lost = feed(tracker, [dark] * 90, 3)[-1]
    assert lost.state == LOST
    assert not lost.seen.any()
    again = feed(tracker, stills[:6], 93)[-1]
    assert again.state == TRACKING
    assert again.symmetry_ambiguous
    assert np.allclose(again.world, rest_lattice(), atol=1e-4)


def night(renderer, seed=1):
    """An image with all infrared lights off."""
    x, y = rest_lattice().T
    return renderer.render(x, y, np.zeros(25), 1000 + seed, ir=np.zeros(25)).copy()


@pytest.fixture(scope='module')
def scattered():
    """Images of blocks some millimetres off their places: 60 at rest, and 30 in darkness."""
    level = dataclasses.replace(LEVELS['clean'], reflections=20, reflection_level=(30, 55))
    renderer = Cluttered(level, Calibration.ideal(), 2)
    xy = rest_lattice() + np.random.default_rng(3).normal(0, 0.004, (25, 2))
    lit = [renderer.render(*xy.T, np.zeros(25), k).copy() for k in range(300, 360)]
    return xy, lit, [night(renderer, k) for k in range(30)]


def ns(k):
    return round(k / 60 * 1e9)


def test_lamps_are_learnt_in_a_commanded_darkness_and_the_turn_stays_known(tracker, scattered):
    xy, lit, dark = scattered
    feed(tracker, lit[:20])
    tracker.requests.add(ns(20), 'darkness', ns(50))
    answers = feed(tracker, dark, 20)
    assert {a.state for a in answers} == {LOST}
    assert 'infrared' in answers[-1].why
    again = feed(tracker, lit[20:40], 50)
    assert tracker.background is not None
    assert tracker.background.light.max() > 10
    assert 'background learnt' in tracker.outcome.text
    assert not tracker.outcome.refused
    assert again[-1].state == TRACKING
    assert not again[-1].symmetry_ambiguous
    seen = again[-1].seen
    assert seen.sum() > 20
    assert np.allclose(again[-1].world[seen], xy[seen], atol=3e-4)


def test_requests_written_down_make_the_same_answers_again(scattered):
    _, lit, dark = scattered
    images = [*lit[:20], *dark, *lit[20:]]
    lamps = packed(BackgroundModel(np.full_like(lit[0], 9)))

    def run(ask):
        tracker = Tracker(TrackerSettings(), Calibration.ideal())
        answers = []
        for k, image in enumerate(images):
            ask(tracker, k)
            answers.append(tracker.update(k / 60, image))
        return b''.join(a.tobytes() for t in answers for a in (t.world, t.px, t.visibility))

    asked = [
        (ns(10), 'background', lamps),
        (ns(20), 'darkness', ns(48)),
        (ns(58), 'background', b''),
    ]

    def live(tracker, k):
        for request in asked:
            if ns(k - 1) < request[0] <= ns(k):
                tracker.requests.add(*request)

    def at_once(tracker, k):
        for request in asked if k == 0 else ():
            tracker.requests.add(*request)

    assert run(live) == run(at_once)
    assert run(live) != run(lambda tracker, k: None)


def test_a_calibration_asked_for_is_made_from_still_blocks(stills):
    wrong = Calibration.ideal(px_per_m=535.0)
    tracker = Tracker(TrackerSettings(), wrong)
    before = feed(tracker, stills[:12])[-1]
    assert before.world[24, 0] > 0.353
    tracker.requests.add(ns(12), 'calibrate')
    answers = feed(tracker, stills[12:], 12)
    assert 'calibrated by the blocks' in tracker.outcome.text
    states = [a.state for a in answers]
    assert states[0] == TRACKING
    assert states[-1] == TRACKING
    assert states.count(CALIBRATING) >= 15  # nobody compares new metres with old ones
    assert np.allclose(answers[-1].world, rest_lattice(), atol=3e-4)


def test_a_calibration_is_refused_while_blocks_do_not_rest(tracker):
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    before = tracker.calibration
    tracker.requests.add(0, 'calibrate')
    for k in range(16):
        xy = rest_lattice() + [0.004 * k, 0.0]
        tracked = tracker.update(k * 1.5 / 16 * 15, renderer.render(*xy.T, np.zeros(25), k))
    assert tracker.outcome.refused
    assert 'not calibrated' in tracker.outcome.text
    assert tracker.calibration is before
    assert tracked.state == TRACKING


def half_hidden(images, flash=None, dimmed=1.0):
    """Return what is made of block 12, hidden for a while and then half in sight again."""
    calibration, rest = Calibration.ideal(), rest_lattice()
    tracker = Tracker(TrackerSettings(), calibration)
    renderer = Cluttered('clean', calibration, 3)
    over = np.array([[rest[12, 0] - 0.07, -0.9, rest[12, 0] - 0.07, rest[12, 1], 0.0]])
    for k in range(images + 20):
        arm = over.copy()
        arm[0, 4] = 0.0 if k < images else 0.13 if k < images + 19 else 0.07
        lit = np.zeros(25) if flash is None or not images - 3 <= k < images else flash
        image = renderer.render(*rest.T, np.zeros(25), k, flash=lit, arms=arm)
        if k >= images + 5:
            image = np.rint(image * dimmed).astype(np.uint8)
        tracked = tracker.update(k / 60, image)
        if images + 2 < k < images + 19:
            assert not tracked.seen[12]
    share = renderer.visible_share(*rest.T, np.zeros(25), k, arms=arm)[12]
    assert 0.5 < share < 0.75
    return tracked


def test_a_half_hidden_block_is_known_again_after_a_flash_and_in_another_exposure():
    rest = rest_lattice()
    flash = 3.0 * np.eye(25)[12]
    for changes in ((), (flash,), (None, 0.55)):
        tracked = half_hidden(30, *changes)
        assert tracked.seen[12]
        assert np.hypot(*(tracked.world[12] - rest[12])) < 2e-4


def behind(arms, xy):
    """Return what is tracked in the sixth image of blocks at rest at `xy`, arms over them."""
    calibration = Calibration.ideal()
    tracker = Tracker(TrackerSettings(), calibration)
    renderer = Cluttered('clean', calibration, 3)
    for k in range(6):
        tracked = tracker.update(k / 60, renderer.render(*xy.T, np.zeros(25), k, arms=arms))
    assert tracked.state == TRACKING
    assert np.abs(tracked.world - xy)[tracked.seen].max() < 3e-4
    return tracked, renderer.visible_share(*xy.T, np.zeros(25), 0, arms=arms)


@pytest.mark.parametrize('shift', [(0.0, 0.0), (0.09, -0.07)])
def test_a_lattice_is_placed_by_blocks_of_which_arms_hide_half(shift):
    """A border row and a column are half in sight: without them any of four places would do."""
    xy = rest_lattice() + shift
    right, bottom = xy[24, 0] + 0.06, xy[0, 1] - 0.06
    arms = np.array([[right, -0.9, right, 0.9, 0.055], [-0.9, bottom, 0.9, bottom, 0.055]])
    tracked, share = behind(arms, xy)
    assert (abs(share[[1, 9]] - 0.5) < 0.1).all()
    assert tracked.seen.sum() >= 24


@pytest.mark.parametrize('shift', [(0.05, -0.03), (0.12, -0.03)])
@pytest.mark.parametrize('grey', [80.0, 14.0])
def test_a_column_that_a_sleeve_hides_at_the_start_is_known(grey, shift):
    """Also where the sleeve is as dark as the platform, and the rim pushed by 0.7 pitches."""
    xy = rest_lattice() + shift
    tracked, _ = behind(np.array([[xy[4, 0], -0.9, xy[4, 0], 0.9, 0.08, grey]]), xy)
    assert np.array_equal(np.flatnonzero(tracked.seen), np.flatnonzero(np.arange(25) % 5 < 4))


@pytest.mark.parametrize('level', ['ordinary', 'hard'])
def test_clutter_hides_no_block_and_adds_none(level):
    camera, yaw = clutter_calibration(level), np.random.default_rng(4).normal(0, 0.08, 25)
    whole, errors = 0, []
    for seed in (11, 22):
        renderer = Cluttered(level, camera, seed)
        tracker = Tracker(TrackerSettings(), camera)
        for k in range(60):
            xy = turned(rest_lattice(), 0.003 * k) + [0.0005 * k, 0.0]
            image = renderer.render(*xy.T, yaw + 0.003 * k, k)
            visible = renderer.visible_share(*xy.T, yaw + 0.003 * k, k)
            tracked = tracker.update(k / 60, image)
            off = np.hypot(*(tracked.world - xy).T)
            assert (off[tracked.seen] < 0.005).all()  # no name of another, nothing that is no block
            assert not tracked.seen[visible < 0.02].any()
            assert k < 6 or tracked.seen[visible > 0.98].all()
            errors.append(off[tracked.seen & (visible > 0.98)] * 545)
            whole += (visible > 0.98).sum()
    assert whole > 2000
    rms = np.sqrt((np.concatenate(errors) ** 2).mean() / 2)
    assert rms < {'ordinary': 0.05, 'hard': 0.1}[level]


def test_blocks_out_of_the_picture_do_no_harm(tracker):
    renderer = Renderer(RenderOptions(noise='L2'))
    xy = rest_lattice() + [0.0, 0.38]  # the upper row is cut by the edge of the image
    for k in range(6):
        tracked = tracker.update(k / 60, renderer.render(*xy.T, np.zeros(25), k))
    apart = np.hypot(*(xy[:, None] - tracked.world[tracked.seen][None]).transpose(2, 0, 1))
    assert apart.min(axis=1)[:20].max() < 1e-3  # which row is out of sight is not known
    assert apart.min(axis=0).max() < 1e-3


@pytest.mark.parametrize(
    'image',
    [
        np.random.default_rng(0).normal(60, 20, (800, 1280)).clip(0, 255).astype(np.uint8),
        (np.indices((800, 1280)).sum(axis=0) // 8).astype(np.uint8),
    ],
    ids=['noise', 'ramp'],
)
def test_nothing_is_found_where_nothing_is(tracker, image):
    for tracked in feed(tracker, [image] * 3):
        assert tracked.state == SEARCHING
        assert not tracked.seen.any() and np.isnan(tracked.world).all()


@pytest.mark.parametrize('before', [1, 30])  # images, in which covers are learned or not yet
def test_a_block_that_jumps_is_reported_where_it_lies_or_not_at_all(stills, before):
    """It jumps by 15 to 30 mm (8 to 16 px) between two images."""
    renderer, random = Renderer(RenderOptions(), Calibration.ideal(), 2), np.random.default_rng(7)
    found = []
    for k in range(12):
        tracker = Tracker(TrackerSettings(), Calibration.ideal())
        feed(tracker, stills[:before])
        there, which = np.column_stack([rest_lattice(), np.zeros(25)]), random.permutation(25)[:6]
        angle, far = random.uniform(0, 2 * np.pi, 6), random.uniform(0.015, 0.03, 6)
        there[which, :2] += np.column_stack([far * np.cos(angle), far * np.sin(angle)])
        there[which, 2] = random.uniform(-0.2, 0.2, 6)
        tracked = tracker.update(before / 60, renderer.render(*there.T, 100 + k))
        away = np.abs(tracked.world - there[:, :2]).max(1)
        assert away[tracked.seen].max() < 5e-4
        found.append(tracked.seen.sum())
    assert min(found) >= 19  # those that did not jump
    assert np.mean(found) > 21.5


def test_path_traced_covers_are_known_again_with_their_names_turned():
    """Darkness, then the table in another quarter: one image tells all names, without taps."""
    shown = {film.name: film for film in films.load(films.TURNED)}
    first = shown['tilted-0-0']
    tracker = Tracker(TrackerSettings(), films.calibration(first, False))
    feed(tracker, [films.sensed(first.light, k) for k in range(60)])
    now, dark = 1.0, np.full(first.light.shape, 3, np.uint8)
    for seed, name in enumerate(('tilted-2-1', 'tilted-1-2')):
        for _ in range(8):
            now += 3 / 8
            tracker.update(now, dark)
        film = shown[name]
        found = tracker.update(now + 1 / 60, films.sensed(film.light, seed))
        assert found.state == TRACKING and not found.symmetry_ambiguous
        off = np.hypot(*(found.world - film.shot.poses[:, :2]).T)[found.seen]
        assert len(off) >= 20 and off.max() < 0.05


def images_of(at, count):
    """Return images of textured covers without arms; block i stands where at[i] says."""
    camera = clutter_calibration('hard')
    renderer = Cluttered('hard', camera, 5)
    poses = np.column_stack([rest_lattice()[at], np.random.default_rng(1).normal(0, 0.05, 25)])
    clear = (
        k
        for k in range(0, 9000, 30)
        if renderer.visible_share(*poses.T, k).min() == 1 and not len(renderer.scenery.arms(k)[0])
    )
    return [renderer.render(*poses.T, next(clear), flash=np.zeros(25)) for _ in range(count)]


def test_names_stay_where_two_covers_are_exchanged():
    tracker = Tracker(TrackerSettings(), clutter_calibration('hard'))
    exchanged = np.arange(25)
    exchanged[[3, 8]] = 8, 3
    before, after = images_of(np.arange(25), 4), images_of(exchanged, 4)
    for k in range(160):
        found = tracker.update(k / 40, before[k % 4] if k < 80 else after[k % 4])
        assert found.seen.all() and not found.symmetry_ambiguous and found.changed == ()
        assert np.abs(found.world - rest_lattice()).max() < 1e-3


def test_a_block_whose_light_blinks_tells_the_turn():
    settings = TrackerSettings(trust_start=False, blink_block=4, blink_period_s=1.0)
    tracker, renderer = Tracker(settings, Calibration.ideal()), Renderer(RenderOptions())
    xy, at = turned(rest_lattice(), -np.pi / 2), np.arange(25)
    for k in range(230):
        lit = np.where((at == 4) & (0.5 <= k / 60 % 1.0 < 0.6), 0.0, 1.0)
        tracked = tracker.update(k / 60, renderer.render(*xy.T, np.zeros(25), k, ir=lit))
        assert k != 20 or tracked.symmetry_ambiguous
    assert not tracked.symmetry_ambiguous
    assert np.allclose(tracked.world, xy, atol=1e-4)

# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import scan, search
from eol_ros.core.vision.detect.blobs import BlobFinder
from eol_ros.core.vision.render import clutter as renderer_clutter
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.states import CALIBRATING, FAULT, LOST, SEARCHING, TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.core.vision.trackers import tracker_for
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow


def turned(xy, angle):
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


@pytest.fixture(scope='module')
def stills():
    """70 images of a table at rest, each with its own noise."""
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    x, y = rest_lattice().T
    return [renderer.render(x, y, np.zeros(25), k).copy() for k in range(70)]


@pytest.fixture(params=['edges', 'appearance'])
def method(request):
    return request.param


@pytest.fixture
def tracker(method):
    return tracker_for(TrackerSettings(method=method), Calibration.ideal())


@pytest.fixture
def by_edges():
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


def test_follows_a_turning_and_moving_table(tracker):
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    for k in range(60):
        angle = 0.02 * k
        xy = turned(rest_lattice(), angle) + [0.002 * k, 0]
        tracked = tracker.update(k / 60, renderer.render(*xy.T, np.full(25, angle), k))
        assert tracked.seen.all()
        assert np.allclose(tracked.world, xy, atol=2e-4)
        assert np.allclose(tracked.yaw, angle, atol=5e-3)


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


def test_noise_without_blocks_is_no_lattice(tracker):
    random = np.random.default_rng(0)
    for k in range(5):
        noise = np.clip(random.normal(14, 3, (800, 1280)), 0, 255).astype(np.uint8)
        tracked = tracker.update(k / 60, noise)
        assert tracked.state == SEARCHING
        assert not tracked.seen.any()
        assert np.isnan(tracked.world).all()


def test_a_frozen_image_is_a_fault_but_a_still_table_is_not(tracker, stills):
    live = feed(tracker, stills)
    assert {t.state for t in live} == {TRACKING}
    frozen = feed(tracker, [stills[-1]] * 60, 70)
    assert frozen[5].state == TRACKING
    assert frozen[-1].state == FAULT
    assert 'frozen' in frozen[-1].why
    assert tracker.update(130 / 60 + 0.1, stills[0]).state in (TRACKING, LOST)


def test_a_picture_without_noise_may_stand_still(tracker, stills):
    assert {t.state for t in feed(tracker, [stills[0]] * 120)} == {TRACKING}


def test_stamps_that_stop_jump_and_run_backwards(tracker, stills):
    stamps = [0, 1 / 60, 1 / 60, 1 / 60, 100.0, 100.02, 3.0, 3.02, -7.0, 1e9, 1e9]
    for k, stamp in enumerate(stamps):
        tracked = tracker.update(stamp, stills[k])
        assert tracked.state == TRACKING
        assert tracked.seen.all()
        assert np.allclose(tracked.world, rest_lattice(), atol=1e-4)


@pytest.mark.parametrize('scale', [0.4, 2.5])
def test_a_calibration_of_another_camera_gives_no_pose(method, stills, scale):
    ideal = Calibration.ideal()
    other = dataclasses.replace(
        ideal, homography=ideal.homography @ np.diag([1 / scale, 1 / scale, 1])
    )
    for tracked in feed(tracker_for(TrackerSettings(method=method), other), stills[:5]):
        assert tracked.state != TRACKING
        assert not tracked.seen.any()
        assert tracked.why


def test_without_calibration_pixels_come_at_once_and_metres_after_rest(method, stills):
    tracker = tracker_for(TrackerSettings(method=method), None)
    answers = feed(tracker, stills)
    assert answers[0].state == CALIBRATING
    assert answers[0].seen.all()
    assert np.isnan(answers[0].world).all()
    assert answers[-1].state == TRACKING
    assert np.allclose(answers[-1].world, rest_lattice(), atol=1e-4)
    for tracked in answers:
        assert np.allclose(tracked.px, Calibration.ideal().to_pixels(rest_lattice()), atol=0.03)


def test_blocks_that_rest_off_their_lattice_are_no_measure(method):
    xy = rest_lattice()
    xy[[3, 8, 11, 20]] += [[0.04, 0], [0.03, 0.02], [-0.03, 0.02], [0.02, 0.04]]
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    tracker = tracker_for(TrackerSettings(method=method), None)
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


def test_same_images_same_answer_to_the_bit(method, stills):
    def run():
        tracker = tracker_for(TrackerSettings(method=method), Calibration.ideal())
        tracker.warm_up()
        answers = feed(tracker, stills[:20])
        return b''.join(
            a.tobytes() for t in answers for a in (t.world, t.px, t.yaw, t.sigma_m, t.visibility)
        )

    assert run() == run()


def night(renderer, seed=1):
    """An image with all infrared lights off."""
    x, y = rest_lattice().T
    return renderer.render(x, y, np.zeros(25), 1000 + seed, ir=np.zeros(25)).copy()


@pytest.fixture(scope='module')
def scattered():
    """Images of blocks some millimetres off their places: 60 at rest, and 30 in darkness."""
    with pytest.MonkeyPatch.context() as patch:
        level = dataclasses.replace(
            renderer_clutter.LEVELS['clean'], reflections=20, reflection_level=(30, 55)
        )
        patch.setitem(renderer_clutter.LEVELS, 'lamps', level)
        renderer = Renderer(RenderOptions(clutter='lamps'), Calibration.ideal(), 2)
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


def test_lamps_are_not_learnt_while_blocks_are_lit(tracker, scattered):
    _, lit, _ = scattered
    tracker.requests.add(ns(5), 'darkness', ns(15))
    feed(tracker, lit[:20])
    assert tracker.background is None
    assert tracker.outcome.refused
    assert 'blocks are lit' in tracker.outcome.text


def test_requests_written_down_make_the_same_answers_again(method, scattered):
    _, lit, dark = scattered
    images = [*lit[:20], *dark, *lit[20:]]

    def run(ask):
        tracker = tracker_for(TrackerSettings(method=method), Calibration.ideal())
        answers = []
        for k, image in enumerate(images):
            ask(tracker, k)
            answers.append(tracker.update(k / 60, image))
        return b''.join(a.tobytes() for t in answers for a in (t.world, t.px, t.visibility))

    asked = [
        (ns(10), 'threshold', 60.0),
        (ns(20), 'darkness', ns(48)),
        (ns(58), 'threshold', 0.0),
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


def test_no_image_compiles_anything_again(by_edges, stills):
    """After warm_up every kind of image finds its loops ready: also the first without lamps."""
    by_edges.warm_up()
    loops = (search.at_predictions, scan.sample, mapping.glance)
    ready = [list(loop.signatures) for loop in loops]
    image = stills[0]
    over_the_wire = np.frombuffer(image.tobytes(), np.uint8).reshape(image.shape)
    for k, kind in enumerate((over_the_wire, image.copy(), np.asfortranarray(image))):
        by_edges.update(k / 60, kind)
    by_edges.finder.background = BackgroundModel(np.zeros_like(image))
    assert by_edges.update(0.1, image).seen.all()
    assert [list(loop.signatures) for loop in loops] == ready


def test_a_threshold_leaves_dimmer_squares_out(by_edges, stills):
    feed(by_edges, stills[:3])
    by_edges.requests.add(ns(3), 'threshold', 250.0)
    assert not feed(by_edges, stills[3:5], 3)[-1].seen.any()
    by_edges.requests.add(ns(5), 'threshold', 100.0)
    assert feed(by_edges, stills[5:12], 5)[-1].seen.all()


def test_a_calibration_asked_for_is_made_from_still_blocks(method, stills):
    wrong = Calibration.ideal(px_per_m=535.0)
    tracker = tracker_for(TrackerSettings(method=method), wrong)
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


def test_only_blocks_that_were_others_are_learnt_again_when_names_change():
    calibration, rest = Calibration.ideal(), rest_lattice()
    tracker = Tracker(TrackerSettings(), calibration)
    renderer = Renderer(RenderOptions(noise='L2'), calibration, 3)
    image = renderer.render(*rest.T, np.zeros(25), 0)
    for k in range(40):
        assert tracker.update(k / 60, image).state == TRACKING or k < 20
    update, looks = tracker.identity.update, tracker.brightness.looks.copy()
    assert looks.min() > 10

    def exchanged(*args):
        update(*args)
        tracker.lattice._exchange(3, 4)

    tracker.identity.update = exchanged
    tracker.update(40 / 60, image)
    assert (np.flatnonzero(tracker.brightness.looks < looks) == [3, 4]).all()

    tracker.identity.update = update
    tracker.lattice.turn_ids(1)  # between two images, as taps do; the block in the middle stays
    tracker.brightness.contrast[20] = 1000.0  # no other block's may be asked for
    tracker.update(41 / 60, image)
    assert (tracker.brightness.looks <= 1).all()
    assert tracker.brightness.contrast.max() < 500.0


def half_hidden(method, images, flash=None, dimmed=1.0):
    """Return what is made of block 12, hidden for a while and then half in sight again."""
    calibration, rest = Calibration.ideal(), rest_lattice()
    tracker = tracker_for(TrackerSettings(method=method), calibration)
    renderer = Renderer(RenderOptions(noise='L2'), calibration, 3)
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


def test_a_half_hidden_block_is_known_again_after_a_flash_and_in_another_exposure(method):
    rest = rest_lattice()
    flash = 3.0 * np.eye(25)[12]
    for changes in ((), (flash,), (None, 0.55)):
        tracked = half_hidden(method, 30, *changes)
        assert tracked.seen[12]
        assert np.hypot(*(tracked.world[12] - rest[12])) < 2e-4


@pytest.mark.parametrize('shift', [(0.0, 0.0), (0.09, -0.07)])
def test_a_lattice_is_placed_by_blocks_of_which_arms_hide_half(method, shift):
    """A border row and a column are half in sight: without them any of four places would do."""
    calibration, xy = Calibration.ideal(), rest_lattice() + shift
    right, bottom = xy[24, 0] + 0.06, xy[0, 1] - 0.06
    arms = np.array([[right, -0.9, right, 0.9, 0.055], [-0.9, bottom, 0.9, bottom, 0.055]])
    tracker = tracker_for(TrackerSettings(method=method), calibration)
    renderer = Renderer(RenderOptions(noise='L2'), calibration, 3)
    share = renderer.visible_share(*xy.T, np.zeros(25), 0, arms=arms)
    assert (abs(share[[1, 9]] - 0.5) < 0.1).all()
    for k in range(6):
        tracked = tracker.update(k / 60, renderer.render(*xy.T, np.zeros(25), k, arms=arms))
    assert tracked.state == TRACKING
    assert tracked.seen.sum() >= 24
    assert np.abs(tracked.world - xy)[tracked.seen].max() < 3e-4


@pytest.mark.parametrize(
    ('grey', 'across', 'state'),
    [(80.0, None, TRACKING), (14.0, None, SEARCHING), (80.0, 100.0, SEARCHING)],
)
def test_a_column_hidden_at_the_start_lies_where_the_platform_is_not_bare(grey, across, state):
    """Not where a sleeve is as dark as the platform, nor where another arm is across from it."""
    calibration, xy = Calibration.ideal(), rest_lattice() + [0.05, -0.03]
    over, other = xy[4, 0], xy[0, 0] - 0.174
    arms = [[over, -0.9, over, 0.9, 0.08, grey]]
    if across:
        arms.append([other, -0.9, other, 0.9, 0.06, across])
    tracker = Tracker(TrackerSettings(), calibration)
    renderer = Renderer(RenderOptions(noise='L2'), calibration, 3)
    for k in range(6):
        image = renderer.render(*xy.T, np.zeros(25), k, arms=np.array(arms))
        if k == 3:  # what is known of lamps does not take the platform for something else
            tracker.finder.background = BackgroundModel(np.full_like(image, 3))
        tracked = tracker.update(k / 60, image)
    assert tracked.state == state
    if state == TRACKING:
        assert np.array_equal(np.flatnonzero(tracked.seen), np.flatnonzero(np.arange(25) % 5 < 4))
        assert np.abs(tracked.world - xy)[tracked.seen].max() < 3e-4


def test_only_platform_is_bare(stills):
    """Not a cover, what an arm hides, half of it in the image, or what is not in it."""
    finder, calibration = BlobFinder(Calibration.ideal()), Calibration.ideal()
    image = stills[0].copy()
    xy = rest_lattice()
    image[:, 640 - 22 : 640 + 22] = 90  # over the column in the middle, and beyond it
    finder.find(image)
    places = np.array([xy[0], xy[12], [0.0, 0.522], [0.522, 0.1], [0.6, 0.1], [0.1, 5.0]])
    px = calibration.to_pixels(places)
    near = np.column_stack([px, np.zeros(len(px))])
    near[4, :2] = 700.0, 10.0
    assert finder.bare(image, near).tolist() == [False, False, False, True, False, False]

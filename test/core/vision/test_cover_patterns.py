# SPDX-License-Identifier: Apache-2.0
"""Covers tell names: by how each spreads its light, whatever its place, turn and brightness."""

import numpy as np
import pytest
from support.relief import films
from support.stick_slip import Onlooker, Ours, Table

from eol_ros.core.geometry import BLOCK_SIDE_M, rest_lattice
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import cover_light
from eol_ros.core.vision.detect.cover_light import SIZE
from eol_ros.core.vision.identity.cover_patterns import (
    BLOCKS,
    CHANGED_S,
    KEPT,
    TURNED_CELLS,
    CoverPatterns,
)
from eol_ros.core.vision.identity.symmetry import UNTURNED
from eol_ros.core.vision.render.clutter import clutter_calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.states import TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

ALL = np.arange(25)
NOISE = 0.009


def drawn(x, y, yaw, gain=1.0, plane=0.0, mirror=False, quarters=0):
    """Return the pattern of one cover with a bright corner and a dark bar, drawn by formula.

    quarters: it is looked at in axes that are so many right angles further round.
    """
    camera = Calibration.ideal(mirror=mirror)
    u, v = np.rint(camera.to_pixels(np.array([[x, y]]))[0]).astype(int)
    rows, columns = slice(max(v - 40, 0), v + 40), slice(max(u - 40, 0), u + 40)
    image = np.full((800, 1280), 12, np.uint8)
    v, u = np.mgrid[rows, columns].astype(float)
    v, u = np.clip(v, 0, 799), np.clip(u, 0, 1279)
    at = camera.to_table(np.column_stack([u.ravel(), v.ravel()])) - [x, y]
    c, s = np.cos(yaw), np.sin(yaw)
    a, b = (at @ [[c, -s], [s, c]]).T / BLOCK_SIDE_M
    light = 100 + 60 * np.exp(-((a - 0.2) ** 2 + (b - 0.25) ** 2) / 0.02)
    light -= 40 * np.exp(-((a + 0.2) ** 2) / 0.005)
    light *= gain * (1 + plane * a)
    light[(abs(a) > 0.5) | (abs(b) > 0.5)] = 12
    shown = image[rows, columns]
    shown[:] = np.clip(np.rint(light), 0, 255).reshape(v.shape)[: len(shown), : shown.shape[1]]
    image.flags.writeable = False
    pattern = np.empty(SIZE)
    turned = yaw + quarters * np.pi / 2
    good = cover_light.sample(camera.packed(), image, x, y, turned, pattern)
    return pattern if good else None


def test_a_pattern_is_of_the_cover_and_not_of_place_turn_brightness_or_a_lamp_beside_it():
    pattern = drawn(0.0, 0.0, 0.0)
    assert abs(pattern.mean()) < 1e-9 and pattern.std() > 0.08
    for other in (
        drawn(0.31, -0.2, 0.4),
        drawn(-0.3, 0.1, 2.0, gain=0.5),
        drawn(0.1, 0.1, -0.9, plane=0.3),
        drawn(0.2, 0.2, 0.7, mirror=True),
    ):
        assert np.sqrt(((other - pattern) ** 2).mean()) < 0.2 * pattern.std()


@pytest.mark.parametrize('quarters', range(4))
def test_axes_that_are_turned_see_the_cells_of_turned_cells(quarters):
    seen = drawn(0.013, 0.021, 0.3)[TURNED_CELLS[quarters]]
    assert np.abs(drawn(0.013, 0.021, 0.3, quarters=quarters) - seen).max() < 0.01


def test_a_dark_saturated_or_half_visible_cover_says_nothing():
    assert drawn(0.0, 0.0, 0.0, gain=0.1) is None
    assert drawn(0.0, 0.0, 0.0, gain=3.0) is None
    assert drawn(1.15, 0.0, 0.0) is None  # at the edge of the image


def covers_of(random, alike=0.0):
    """Return 25 patterns (25, SIZE) as far apart as path-traced covers are."""
    return random.normal(0, 0.09 * (1 - alike), (25, SIZE)) + random.normal(0, 0.09, SIZE) * alike


def learnt(random, shown, looks=12):
    covers = CoverPatterns()
    for k in range(looks):
        for block in range(25):
            pattern = shown[block] + random.normal(0, NOISE, SIZE)
            assert not covers.learn(k * 0.4, block, pattern, 0.01 * k, 0.0)
    return covers


@pytest.mark.parametrize('quarters', range(4))
def test_covers_tell_the_turn_from_one_image_with_many_hidden(quarters):
    random = np.random.default_rng(quarters)
    shown = covers_of(random)
    covers = learnt(random, shown, looks=1)
    for _ in range(20):
        # Block b stands where the names so far say UNTURNED[quarters, b]; in axes so far behind.
        present = np.empty((25, SIZE))
        back = TURNED_CELLS[-quarters % 4]
        present[UNTURNED[quarters]] = shown[:, back] + random.normal(0, NOISE, (25, SIZE))
        names = np.sort(random.permutation(25)[:BLOCKS])
        assert covers.quarters(present[names], names) == quarters
        assert covers.quarters(present[names[1:]], names[1:]) is None


@pytest.mark.parametrize(
    ('up', 'right', 'quarters'), [(1, 0, 0), (-1, 0, 3), (0, 1, 2), (1, -1, 1)]
)
def test_covers_tell_the_side_on_which_a_row_is_hidden(up, right, quarters):
    random = np.random.default_rng(11)
    shown = covers_of(random)
    covers = learnt(random, shown)
    present = np.empty((25, SIZE))
    present[UNTURNED[quarters]] = shown[:, TURNED_CELLS[-quarters % 4]]
    present += random.normal(0, NOISE, present.shape)
    row, column = np.divmod(ALL, 5)  # blocks in sight, by names that are off by up and right
    seen = ALL[(abs(row - up - 2) < 3) & (abs(column - right - 2) < 3)]
    found = seen - 5 * up - right
    assert covers.quarters(present[seen], found) is None
    assert covers.placed(present[seen], found, found) == (5 * up + right, quarters)
    few = slice(0, BLOCKS - 1)
    assert covers.placed(present[seen][few], found[few], found) is None
    alike = learnt(random, covers_of(random, alike=1.0))
    assert alike.placed(alike.mean[seen], found, found) is None


@pytest.mark.slow
@pytest.mark.parametrize(('row', 'pushed_m'), [(0, 0.12), (4, -0.12), (2, 0.12)])
def test_after_darkness_with_a_row_hidden_names_are_known_in_the_first_image(row, pushed_m):
    random = np.random.default_rng(12)
    shown = covers_of(random)
    identity, _ = watched(shown, 120)
    turned = rest_lattice() @ [[0.0, 1.0], [-1.0, 0.0]] + [
        pushed_m,
        0.0,
    ]  # nearer to a place one row off
    yaw = np.zeros(25)

    def show(stamp_s, blocks):
        def glance(at, yaw):
            quarters = np.round((yaw - np.pi / 2) / (np.pi / 2)).astype(int) % 4
            cells = TURNED_CELLS[quarters]
            return np.take_along_axis(shown[blocks[at]], cells, axis=1), np.ones(len(at), bool)

        identity.update(
            stamp_s, turned[blocks], yaw[blocks], np.full(len(blocks), 4e-5), glance=glance
        )

    for k in range(60):
        identity.lattice.break_off(2.0 + k / 60)
    blocks = np.flatnonzero(row != ALL // 5)
    show(3.0, blocks)
    lattice = identity.lattice
    assert lattice.state == TRACKING and not lattice.ambiguous
    assert (lattice.index[blocks] == np.arange(20)).all() and lattice.seen.sum() == 20


def test_covers_that_are_alike_or_others_than_learnt_say_nothing():
    random = np.random.default_rng(5)
    same = covers_of(random, alike=1.0)
    covers = learnt(random, same)
    for _ in range(100):
        assert covers.quarters(same + random.normal(0, NOISE, same.shape), ALL) is None
    covers = learnt(random, covers_of(random))
    assert all(covers.quarters(covers_of(random), ALL) is None for _ in range(100))
    assert CoverPatterns().quarters(same, ALL) is None


@pytest.mark.slow
def test_names_are_put_right_where_it_is_clear_and_only_there():
    random = np.random.default_rng(6)
    shown = covers_of(random)
    covers = learnt(random, shown)
    seen = shown + random.normal(0, NOISE, shown.shape)
    wrong = ALL.copy()
    wrong[[3, 4, 9]] = 4, 9, 3
    everyone = np.ones(25, bool)
    assert (covers.named(seen, wrong, everyone) == ALL).all()
    assert covers.named(seen, ALL, everyone) is None
    some = ALL != 9  # block 9 is hidden, or its name is held by one that is not whole
    assert (covers.named(seen[some], wrong[some], everyone) == ALL[some]).all()
    # where a light that is not whole has the name of block 4, that of block 4 has to wait
    found = covers.named(seen[some], wrong[some], ALL != 4)
    assert (found == np.where(ALL == 4, 9, ALL)[some]).all()
    half_dark = seen.copy()
    half_dark[7, :32] -= 0.4
    assert covers.named(half_dark, ALL, everyone) is None
    unknown = CoverPatterns()
    assert unknown.named(seen, wrong, everyone) is None


def test_another_cover_is_told_after_a_while_and_learnt_and_a_flash_is_not():
    random = np.random.default_rng(7)
    shown = covers_of(random)
    covers = learnt(random, shown)
    other = covers_of(random)[0]
    told, now = [], 100.0
    while now < 100.0 + 2 * CHANGED_S:
        told.append(covers.learn(now, 3, other + random.normal(0, NOISE, SIZE), 0.0, 0.0))
        if told[-1]:
            break
        now += 0.4
    assert now - 100.0 == pytest.approx(CHANGED_S, abs=0.5) and sum(told) == 1
    assert covers.departures(other[None])[0, 3] < 1 and covers.looks[3] == 1
    for k in range(400):  # flashes now and then
        flash = 0.3 if k % 10 < 3 else 0.0
        seen = shown[5] + flash * random.normal(0, 1, SIZE) + random.normal(0, NOISE, SIZE)
        assert not covers.learn(200 + 0.4 * k, 5, seen, 0.01 * k, 0.0)
    assert np.sqrt(((covers.mean[5] - shown[5]) ** 2).mean()) < 0.005


def test_what_was_learnt_of_covers_outlives_a_life_and_junk_is_refused():
    random = np.random.default_rng(8)
    shown = covers_of(random)
    before = learnt(random, shown)
    after = CoverPatterns.unpacked(before.packed())
    assert after.packed() == before.packed() and len(before.packed()) == KEPT < 2000
    assert np.abs(after.mean - before.mean).max() < 0.0021 and (after.looks == before.looks).all()
    for junk in (b'', b'x' * (KEPT - 1), b'\xff' * KEPT):
        with pytest.raises(ConfigError, match='patterns of covers cannot be read'):
            CoverPatterns.unpacked(junk)


def watched(shown, images, at=lambda k, tracker: None, turned_from=10**9, rate_hz=60.0):
    """Return our identity after `images`; from `turned_from` on all stands turned by 90 degrees."""
    table, onlooker = Table(4, rate_hz, askew_rad=0.0), Onlooker(4, losses_per_hour=0.0, arms=0.3)
    tracker = Ours(shown[None])
    tracker.begin(table.xy)
    if turned_from > images:  # nobody is there
        table.until_s, onlooker.arm_rate, onlooker.false_per_image = np.inf, 0.0, 0.0
    answers = []
    for k in range(images):
        moment = table.step()
        at(k, tracker)
        if k == turned_from - 90:
            onlooker.dark_until_s = moment.stamp_s + 1.49
        if k >= turned_from:
            moment.xy = moment.xy @ [[0.0, 1.0], [-1.0, 0.0]]
            moment.yaw = moment.yaw + np.pi / 2
        seen = onlooker.look(moment)
        index = tracker.update(moment, seen)
        answers.append(
            (seen.true[index[index >= 0]], np.flatnonzero(index >= 0), tracker.ambiguous)
        )
    return tracker.identity, answers


@pytest.mark.slow
def test_after_darkness_names_are_known_in_the_first_image_without_taps_or_yaws():
    random = np.random.default_rng(9)
    _, answers = watched(covers_of(random), 215, turned_from=200)
    for true, names, open_ in answers[200:]:
        assert not open_ and len(names) >= 15 and (true == names).all()
    _, answers = watched(covers_of(random, alike=1.0), 215, turned_from=200)
    assert all(open_ for _, _, open_ in answers[200:])


def test_covers_that_a_technician_exchanges_are_told_and_names_stay():
    random = np.random.default_rng(10)
    shown = covers_of(random)

    def exchange(k, tracker):
        if k == 60:
            tracker.covers = shown[None][:, [0, 1, 2, 8, 4, 5, 6, 7, 3, *range(9, 25)]]

    identity, answers = watched(shown, 600, exchange, rate_hz=10.0)
    assert all((true == names).all() and not open_ for true, names, open_ in answers[1:])
    assert identity.names.changed(60.0) == (3, 8)
    assert identity.names.changed(60.0 + 600.0) == ()


def images_of(at, count, seed):
    """Return `count` images of textured covers without arms; block i stands where at[i] says."""
    camera = clutter_calibration('hard')
    renderer = Renderer(RenderOptions(clutter='hard'), camera, 5)
    poses = np.column_stack([rest_lattice()[at], np.random.default_rng(seed).normal(0, 0.05, 25)])
    clear = (
        k
        for k in range(0, 9000, 30)
        if renderer.visible_share(*poses.T, k).min() == 1 and not len(renderer.clutter.arms(k)[0])
    )
    flash = np.zeros(25)
    return [renderer.render(*poses.T, next(clear), flash=flash).copy() for _ in range(count)]


@pytest.mark.slow
def test_a_tracker_that_runs_says_which_covers_were_exchanged():
    tracker = Tracker(TrackerSettings(), clutter_calibration('hard'))
    exchanged = ALL.copy()
    exchanged[[3, 8]] = 8, 3
    before, after = images_of(ALL, 4, 1), images_of(exchanged, 4, 1)
    for k in range(240):
        assert tracker.update(k / 40, before[k % 4]).changed == ()
    for k in range(240, 1300):
        found = tracker.update(k / 40, after[k % 4])
        assert found.seen.sum() == 25 and not found.symmetry_ambiguous
    assert found.changed == (3, 8)


@pytest.mark.slow
def test_path_traced_covers_are_known_again_with_their_names_turned():
    """Darkness, then the table in another quarter: one image tells all names, without taps."""
    shown = {film.name: film for film in films.load(films.TURNED)}
    first = shown['tilted-0-0']
    tracker = Tracker(TrackerSettings(), films.calibration(first, False))
    for k in range(60):
        tracker.update(k / 60, films.sensed(first.light, k))
    covers = tracker.identity.covers
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
        blocks = np.flatnonzero(tracker.lattice.seen)
        at = tracker.lattice.index[blocks], tracker.lattice.yaw[blocks]
        patterns, good = tracker._glance(*at)
        nats, _ = covers.weigh(patterns[good], blocks[good])
        assert nats[0] - nats[1:].max() > 500
    assert (covers.looks > 0).sum() >= 20

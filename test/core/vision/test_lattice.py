# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from support.stick_slip import Onlooker, Table

from eol_ros.core.geometry import N_BLOCKS, rest_lattice
from eol_ros.core.vision.identity.association import continued, placed, read_lattice
from eol_ros.core.vision.identity.fitting import affine, assign, folds, match, rotate_cell
from eol_ros.core.vision.identity.lattice import Lattice
from eol_ros.core.vision.states import LOST, SEARCHING, TRACKING

pytestmark = pytest.mark.slow  # the first run compiles


def turned(xy, angle):
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


def square(angle, n):
    return np.full(n, (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def feed(lattice, xy, start_s, images, angle=0.0, fps=60.0):
    for k in range(images):
        lattice.update(start_s + k / fps, xy, square(angle, len(xy)), np.full(len(xy), 1e-4))


@pytest.fixture
def settled():
    lattice = Lattice()
    feed(lattice, rest_lattice(), 0.0, 10)
    return lattice


def test_assignment_is_as_cheap_as_scipys():
    random = np.random.default_rng(1)
    for _ in range(50):
        n = random.integers(1, 26)
        cost = random.random((n, n + random.integers(0, 20)))
        rows, columns = linear_sum_assignment(cost)
        mine = assign(cost)
        assert len(set(mine)) == n
        assert cost[np.arange(n), mine].sum() == pytest.approx(cost[rows, columns].sum())


def test_matching_leaves_out_what_is_beyond_the_gate():
    xy = rest_lattice()
    points = np.concatenate([xy[3:] + 0.01, [[0.6, 0.6]]])
    found = match(xy, np.full(25, 0.02), points)
    assert list(found) == [-1, -1, -1, *range(22)]


@pytest.mark.parametrize('quarters', [0, 1, 2, 3, 5])
def test_turned_ids_stand_where_the_turned_lattice_stands(quarters):
    rest = rest_lattice()
    for block in range(N_BLOCKS):
        # axes turned by +90 degrees see the same point turned by -90 degrees
        there = turned(rest[block : block + 1], -quarters * np.pi / 2)[0]
        assert np.allclose(rest[rotate_cell(block, quarters)], there)


@pytest.mark.parametrize('degrees', [0, 20, 44, 60, 137, -100])
def test_lattice_is_read_with_holes_and_false_lights(degrees):
    random = np.random.default_rng(degrees % 360)
    angle = np.radians(degrees)
    truth = turned(rest_lattice() + random.normal(0, 0.008, (25, 2)), angle) + [0.1, -0.05]
    shown = np.setdiff1d(np.arange(25), [0, 7, 12, 18])
    false = np.array([[0.6, 0.62], [-0.65, 0.6], [0.05, -0.61]])
    xy = np.concatenate([truth[shown], false])
    yaw = np.concatenate([square(angle, len(shown)), random.uniform(-0.7, 0.7, 3)])
    order = random.permutation(len(xy))
    index, found, sure = read_lattice(xy[order], yaw[order], truth, False)
    assert sure
    quarters = round((angle - found) / (np.pi / 2))
    names = np.concatenate([shown, [-1, -1, -1]])[order]
    for cell in range(25):
        block = rotate_cell(cell, quarters % 4)
        want = block if block in shown else -1
        got = names[index[cell]] if index[cell] >= 0 else -1
        assert got == want


def test_a_hidden_border_row_leaves_the_place_open_unless_it_was_known():
    xy = rest_lattice()[5:]
    index, _, sure = read_lattice(xy, np.zeros(20), rest_lattice(), False)
    assert not sure
    index, _, sure = read_lattice(xy, np.zeros(20), rest_lattice(), True)
    assert sure
    assert list(index) == [-1] * 5 + list(range(20))


@pytest.mark.parametrize(('hidden', 'places'), [(slice(0, 0), 25), (slice(0, 5), 30), ('x', 36)])
def test_where_blocks_may_stand_about_a_patch(hidden, places):
    truth = turned(rest_lattice(), 0.3) + [0.07, -0.04]
    shown = np.ones(25, bool)
    if hidden == 'x':
        shown[:5] = shown[::5] = False
    else:
        shown[hidden] = False
    index, _, _ = read_lattice(truth[shown], square(0.3, shown.sum()), rest_lattice(), False)
    found = continued(truth[shown], index)
    assert len(found) == places
    off = np.hypot(*(found[:, None] - truth).transpose(2, 0, 1))
    assert off.min(0).max() < 1e-9


@pytest.mark.parametrize(
    ('near', 'far', 'hidden'),  # bare places where the hidden row is, and beyond the one across
    [(0, 5, 0), (1, 5, 0), (0, 3, 0), (5, 0, 4), (0, 2, None), (2, 5, None), (5, 5, None)],
)
def test_a_hidden_border_row_is_not_where_the_platform_is_bare(near, far, hidden):
    truth = turned(rest_lattice() + np.random.default_rng(2).normal(0, 0.004, (25, 2)), 0.2)
    xy = truth[5:]
    index, _, sure = read_lattice(xy, square(0.2, 20), rest_lattice(), False)
    assert not sure
    places = continued(xy, index)
    empty = np.concatenate([truth[:near], 2 * xy[15 : 15 + far] - xy[10 : 10 + far]])
    bare = (np.hypot(*(places[:, None] - empty).transpose(2, 0, 1)) < 0.05).any(1)
    assert bare.sum() == near + far
    moved, only = placed(xy, index, bare)
    assert only == (hidden is not None)
    if only:
        assert np.array_equal(np.delete(moved.reshape(5, 5), hidden, axis=0).ravel(), np.arange(20))
        assert (moved.reshape(5, 5)[hidden] == -1).all()


def test_a_corner_of_the_lattice_is_placed_by_what_is_bare_about_it():
    truth = turned(rest_lattice(), -0.3)
    shown = np.flatnonzero((np.arange(25) % 5 < 4) & (np.arange(25) >= 5))
    index, _, sure = read_lattice(truth[shown], square(-0.3, 16), rest_lattice(), False)
    assert not sure
    places = continued(truth[shown], index)
    bare = np.hypot(*(places[:, None] - truth).transpose(2, 0, 1)).min(1) > 0.05
    assert bare.sum() == 11
    moved, only = placed(truth[shown], index, bare)
    assert only
    assert np.array_equal(np.flatnonzero(moved >= 0), shown)


def beside(truth):
    """Return what says at which places no block of `truth` (25, 2) is."""
    return lambda xy, yaw: np.hypot(*(xy[:, None] - truth).transpose(2, 0, 1)).min(1) > 0.05


def test_a_row_hidden_at_the_start_is_named_by_bare_platform_in_three_images():
    truth, lattice = rest_lattice(), Lattice()
    for k in range(3):
        assert lattice.state == SEARCHING
        lattice.update(k / 60, truth[:20], np.zeros(20), np.full(20, 1e-4), bare=beside(truth))
    assert lattice.state == TRACKING
    assert np.array_equal(np.flatnonzero(lattice.seen), np.arange(20))
    assert np.allclose(lattice.xy, truth)


def test_bare_platform_is_believed_before_old_places(settled):
    """In the dark the rim was pushed on by more than half a pitch, and a row is hidden after it."""
    feed(settled, np.zeros((0, 2)), 0.2, 12)
    truth = rest_lattice() + [0.0, 0.1]
    for k in range(3):
        settled.update(
            0.4 + k / 60, truth[:20], np.zeros(20), np.full(20, 1e-4), bare=beside(truth)
        )
    assert settled.state == TRACKING
    assert np.allclose(settled.xy, truth)


def test_names_that_were_a_row_off_are_right_from_the_image_on_that_heals_them():
    """A new name says nothing of how fast a block goes: it was not where its name was before."""
    truth, lattice = rest_lattice(), Lattice()
    wrong = beside(truth + [0.174, 0.0])
    right = []
    for k in range(40):
        xy = truth[1 + np.arange(20) // 4 + np.arange(20)] if k < 20 else truth
        lattice.update(k / 60, xy, np.zeros(len(xy)), np.full(len(xy), 1e-4), bare=wrong)
        right.append(bool(lattice.seen.any() and np.allclose(lattice.xy, truth)))
    assert lattice.state == TRACKING and not any(right[:20])
    assert all(right[26:])
    assert right == sorted(right)


def test_a_line_of_lights_says_nothing_of_where_others_stand():
    index = np.full(25, -1)
    index[[5, 6, 8]] = np.arange(3)
    assert len(continued(rest_lattice()[[5, 6, 8]], index)) == 0


def test_starts_with_the_ids_of_the_plan(settled):
    assert settled.state == TRACKING
    assert settled.seen.all()
    assert not settled.ambiguous
    assert np.allclose(settled.xy, rest_lattice())
    assert np.allclose(settled.yaw, 0, atol=1e-9)


def test_24_blocks_26_lights_and_none():
    some = Lattice()
    feed(some, np.delete(rest_lattice(), 12, axis=0), 0, 10)
    assert some.state == TRACKING
    assert not some.seen[12]
    assert np.allclose(some.xy[12], 0, atol=1e-6)
    more = Lattice()
    feed(more, np.concatenate([rest_lattice(), [[0.6, 0.1]]]), 0, 10)
    assert more.seen.sum() == 25
    none = Lattice()
    feed(none, np.zeros((0, 2)), 0, 10)
    assert none.state == SEARCHING


def test_hidden_block_is_carried_by_its_neighbours_and_trusted_less(settled):
    rest = rest_lattice()
    hidden = 12
    for k in range(60):
        xy = np.delete(rest + [0.001 * (k + 1), 0], hidden, axis=0)
        settled.update(0.2 + k / 60, xy, np.zeros(24), np.full(24, 1e-4))
        assert not settled.seen[hidden]
    # friction may hold it back as far as its springs allow, no further
    behind = 0.06 - settled.xy[hidden, 0]
    assert 0 <= behind < 0.015
    assert 0.7 * behind < settled.sigma[hidden] < 0.03
    assert (settled.sigma[settled.seen] < 2e-4).all()


# away from the middle of its fellows; off after one image of 1.7 mm, and after six, of 10 mm
@pytest.mark.parametrize(('away_m', 'one_m', 'six_m'), [(0.0, 3e-4, 4e-3), (0.03, 1.5e-3, 9e-3)])
def test_a_block_that_an_arm_hides_on_the_way_goes_on_for_a_while(settled, away_m, one_m, six_m):
    """Where it was just seen is no matter of what springs and friction are thought to allow."""
    rest, hidden, speed = rest_lattice(), 12, 0.1

    def at(second):
        moved = speed * second * np.ones((25, 1)) * [1.0, 0.0]
        moved[hidden, 1] += min(second / 0.5, 1.0) * away_m
        return rest + moved

    for k in range(60):
        settled.update(0.2 + k / 60, at(k / 60), np.zeros(25), np.full(25, 1e-4))
    assert settled.seen.all()
    behind = []
    for k in range(60, 90):
        xy = np.delete(at(k / 60), hidden, axis=0)
        settled.update(0.2 + k / 60, xy, np.zeros(24), np.full(24, 1e-4))
        assert not settled.seen[hidden]
        behind.append(np.hypot(*(settled.xy[hidden] - at(k / 60)[hidden])))
    assert behind[0] < one_m and behind[5] < six_m and behind[-1] < 0.04


@pytest.mark.parametrize(('step_m', 'seen'), [(0.002, True), (0.004, False), (0.036, False)])
def test_a_faint_block_may_stand_far_from_its_fellows_if_it_was_followed_there(
    settled, step_m, seen
):
    """A faint light that leaps so far, or goes there fast, is an arm's edge."""
    xy, faint = rest_lattice(), np.zeros(25, bool)
    for k in range(round(0.036 / step_m)):
        xy[12, 0] += step_m
        faint[12] = xy[12, 0] > 0.01
        settled.update(0.2 + k / 60, xy, np.zeros(25), np.full(25, 1e-4), faint)
    assert settled.seen[12] == seen


def test_a_light_that_flickers_is_no_block(settled):
    xy = np.delete(rest_lattice(), 12, axis=0)
    for k in range(40):
        lights = np.concatenate([xy, [[0.004, 0.003]]]) if k % 3 == 2 else xy
        settled.update(0.2 + k / 60, lights, np.zeros(len(lights)), np.full(len(lights), 1e-4))
        assert not settled.seen[12]


def test_a_swap_heals_without_help(settled):
    settled._exchange(11, 12)
    settled._exchange(3, 8)
    feed(settled, rest_lattice(), 0.2, 30)
    assert np.allclose(settled.xy, rest_lattice())


def test_a_row_that_is_off_by_one_heals_without_help(settled):
    for a in range(5, 9):
        settled._exchange(a, a + 1)
    assert folds(settled.xy, settled.seen) > 0
    feed(settled, rest_lattice(), 0.2, 60)
    assert np.allclose(settled.xy, rest_lattice())


@pytest.mark.parametrize(('blind_s', 'ambiguous'), [(0.2, False), (2.0, True)])
def test_quarter_turn_is_declared_open_only_where_time_allows_it(settled, blind_s, ambiguous):
    feed(settled, np.zeros((0, 2)), 0.2, round(blind_s * 60))
    assert settled.state == LOST
    assert not settled.seen.any()
    feed(settled, rest_lattice(), 0.2 + blind_s, 10)
    assert settled.state == TRACKING
    assert settled.ambiguous == ambiguous
    assert np.allclose(settled.xy, rest_lattice())


def test_turning_the_ids_settles_it(settled):
    feed(settled, np.zeros((0, 2)), 0.2, 120)
    # in the dark, the rim was turned by a right angle: to the camera nothing has changed
    feed(settled, rest_lattice(), 2.2, 10)
    assert settled.ambiguous
    settled.turn_ids(1)
    assert not settled.ambiguous
    feed(settled, rest_lattice(), 2.4, 5)
    assert np.allclose(settled.xy, turned(rest_lattice(), np.pi / 2))
    assert np.allclose(settled.yaw, np.pi / 2)


def test_yaw_is_unwrapped_through_a_whole_turn(settled):
    for k in range(361):
        angle = np.radians(k)
        settled.update(
            0.2 + k / 60, turned(rest_lattice(), angle), square(angle, 25), np.full(25, 1e-4)
        )
    assert np.allclose(settled.yaw, 2 * np.pi)
    assert np.allclose(settled.xy, rest_lattice(), atol=1e-9)


def test_a_clock_that_runs_backwards_does_not_mix_the_blocks(settled):
    feed(settled, rest_lattice(), -5.0, 5)
    feed(settled, rest_lattice(), 1e9, 5)
    assert np.allclose(settled.xy, rest_lattice())
    assert settled.seen.all()


def test_keeps_every_identity_under_arms():
    table, onlooker = Table(5, 60.0), Onlooker(5, losses_per_hour=0.0)
    lattice = Lattice()
    wrong = shown = got = ghosts = 0
    for _ in range(1800):
        moment = table.step()
        seen = onlooker.look(moment)
        lattice.update(moment.stamp_s, seen.xy, seen.yaw, seen.sigma)
        blocks = np.flatnonzero(lattice.index >= 0)
        names = seen.true[lattice.index[blocks]]
        wrong += int((names != blocks).sum())
        ghosts += int((names < 0).sum())
        shown += int((seen.true >= 0).sum())
        got += len(blocks)
    assert shown < 0.92 * 25 * 1800  # the arms did lie over blocks
    assert got > 0.97 * shown
    assert wrong == 0
    assert ghosts == 0


def test_same_input_same_output_to_the_bit():
    def run():
        table, onlooker, lattice = Table(9, 60.0), Onlooker(9, losses_per_hour=600.0), Lattice()
        out = []
        for _ in range(300):
            seen = onlooker.look(moment := table.step())
            lattice.update(moment.stamp_s, seen.xy, seen.yaw, seen.sigma)
            out.append(np.concatenate([lattice.xy.ravel(), lattice.yaw, lattice.sigma]))
        return np.array(out)

    assert run().tobytes() == run().tobytes()


def test_a_plane_is_fitted_as_numpy_fits_it():
    random = np.random.default_rng(2)
    at, to, use = random.normal(0, 1, (25, 2)), random.normal(0, 1, (25, 2)), np.arange(25) % 3 > 0
    basis = np.column_stack([np.ones(25), at])[use]
    wanted = np.linalg.lstsq(basis, to[use], rcond=None)[0]
    assert np.allclose(affine(at, to, use), wanted, atol=1e-8)
    assert not affine(at, to, np.zeros(25, bool)).any()


def lamp_and_lattice(lattice, lamp, images, hidden=()):
    """Move the lattice by 0.5 mm an image beside a lamp that stays; some blocks hidden."""
    for k in range(images):
        moved = rest_lattice() + [0.0005 * k, 0.0]
        xy = np.concatenate([np.delete(moved, list(hidden), axis=0), [lamp]])
        lattice.update(0.2 + k / 60, xy, np.zeros(len(xy)), np.full(len(xy), 1e-4))
    return moved


def test_a_light_that_stands_while_blocks_move_is_no_block_ever(settled):
    lamp = np.array([0.06, 0.10])
    lamp_and_lattice(settled, lamp, 90)
    assert settled.lamps.count == 1
    assert np.allclose(settled.lamps.place[0], lamp)
    here = rest_lattice() + [0.0445, 0.0]
    place = here[12] + [0.005, 0.005]
    settled.lamps.place[0] = place  # now it stands where a hidden block might be
    shown = np.concatenate([np.delete(here, 12, axis=0), [place]])
    feed(settled, shown, 1.8, 120)
    assert not settled.seen[12]
    assert settled.seen.sum() == 24


def test_a_light_that_was_given_its_name_late_keeps_it(settled):
    out = rest_lattice()
    feed(settled, np.delete(out, 12, axis=0), 10 / 60, 10)
    out[12] += 0.07  # thrown under an arm, so far that nobody takes it for itself
    feed(settled, out, 20 / 60, 20)
    assert settled.index[12] == -1
    assert settled.rename(39 / 60, np.arange(25), out, np.zeros(25), np.full(25, 1e-4))
    for k in range(20):
        feed(settled, out, (40 + k) / 60, 1)
        assert settled.index[12] == 12


def test_a_light_from_before_darkness_is_no_lamp_after_it(settled):
    rest, between = rest_lattice(), np.array([0.087, 0.087])
    feed(settled, np.concatenate([rest, [rest[12] + between]]), 10 / 60, 20)
    for k in range(6):
        settled.break_off((30 + k) / 60)  # black images
    assert settled.state == LOST
    for k in range(20):  # block 12 stands where the light was
        feed(settled, rest + between, (36 + k) / 60, 1)
        assert k < 3 or (settled.index == np.arange(25)).all()


def test_a_block_over_a_lamp_is_still_a_block(settled):
    settled.lamps._add(0.1, rest_lattice()[12] + [0.0005, 0.0])
    feed(settled, rest_lattice(), 0.2, 60)
    assert settled.seen.all()
    assert settled.index[12] == 12


def test_a_block_that_stops_beside_a_lamp_is_not_taken_for_it(settled):
    lamp, block = rest_lattice()[12] + [0.0203, 0.0], 12
    settled.lamps._add(0.1, lamp)
    for k in range(90):
        xy = rest_lattice()
        xy[block, 0] += min(0.0042 * k, 0.021)  # 0.25 m/s, until a neighbour or a hand stops it
        xy = np.concatenate([xy, [lamp]])  # 0.7 mm from where it stops
        settled.update(0.2 + k / 60, xy, np.zeros(26), np.full(26, 1e-4))
        assert settled.index[block] == block


def test_a_block_that_stops_over_a_lamp_and_covers_it_is_not_taken_for_it(settled):
    settled.lamps._add(0.1, rest_lattice()[12] + [0.0203, 0.0])
    for k in range(90):
        xy = rest_lattice()
        xy[12, 0] += min(0.0042 * k, 0.021)
        feed(settled, xy, 0.2 + k / 60, 1)
        assert settled.index[12] == 12


@pytest.mark.parametrize('sound', [False, True])
def test_a_block_that_comes_out_over_a_lamp_is_known_by_a_sound_outline(settled, sound):
    xy = rest_lattice()
    settled.lamps._add(0.1, xy[12] + [0.006, 0.0])
    for k in range(20):
        shown(settled, 0.2 + k / 60, np.delete(xy, 12, axis=0), np.full(24, sound))
    xy[12, 0] += 0.006  # it has slipped under the arm, and the lamp is below it now
    for k in range(20, 60):
        shown(settled, 0.2 + k / 60, xy, np.full(25, sound))
    assert settled.seen[12] == sound


def test_a_block_that_all_others_turn_about_is_no_lamp(settled):
    for k in range(90):
        angle = 0.003 * k
        xy = turned(rest_lattice(), angle)
        if k < 2:
            xy = np.delete(xy, 12, axis=0)  # it comes back as a light that nobody knows yet
        settled.update(0.2 + k / 60, xy, square(angle, len(xy)), np.full(len(xy), 1e-4))
    assert settled.lamps.count == 0
    light = np.full((32, 2), np.nan)
    light[0] = 0.0
    born = np.full(32, np.inf)
    born[0] = 1.0
    for k in range(60):
        xy = turned(rest_lattice(), 0.01 * k)
        settled.lamps.learn(1.0 + k / 60, xy, np.ones(25, bool), light, born)
    assert settled.lamps.count == 0


def shown(lattice, stamp_s, xy, sound):
    lattice.update(stamp_s, xy, np.zeros(len(xy)), np.full(len(xy), 1e-4), sound=sound)


@pytest.mark.parametrize(('off_m', 'plain'), [(0.0, 3), (0.03, 5)])
def test_a_light_that_can_be_nothing_but_a_block_is_believed_at_once(settled, off_m, plain):
    rest = rest_lattice()
    without = np.delete(rest, 12, axis=0)
    back = np.concatenate([without, [rest[12] + [off_m, 0.0]]])
    for sound, images in ((False, plain), (True, 1)):
        settled = Lattice()
        feed(settled, rest, 0.0, 10)
        feed(settled, without, 0.2, 10)
        for k in range(images):
            assert not settled.seen[12]
            shown(settled, 0.4 + k / 60, back, np.arange(25) < (25 if sound else 24))
        assert settled.seen[12]


def test_a_light_between_two_hidden_blocks_is_not_believed_at_once(settled):
    rest = rest_lattice()
    without = np.delete(rest, [12, 13], axis=0)
    feed(settled, without, 0.2, 10)
    light = 0.55 * rest[12] + 0.45 * rest[13]
    for k in range(10):
        shown(settled, 0.4 + k / 60, np.concatenate([without, [light]]), np.ones(24, bool))
        assert not settled.seen[[12, 13]].any()


@pytest.mark.parametrize('quarters', range(4))
def test_a_lattice_that_arms_cut_to_pieces_is_read(quarters):
    cells = [0, 1, 2, 4, 5, 6, 9, 12, 13, 15, 18, 19, 21, 22]  # five pieces, five blocks at most
    rest = rest_lattice() + np.random.default_rng(3).normal(0, 0.006, (25, 2))
    xy = turned(rest[[rotate_cell(b, quarters) for b in cells]], 0.1)
    index, angle, sure = read_lattice(xy, square(0.1, len(xy)), rest, False)
    assert sure
    assert angle == pytest.approx(0.1, abs=1e-6)
    wanted = np.full(N_BLOCKS, -1)
    wanted[[rotate_cell(b, quarters) for b in cells]] = np.arange(len(cells))
    assert np.array_equal(index, wanted)

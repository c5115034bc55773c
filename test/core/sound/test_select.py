# SPDX-License-Identifier: Apache-2.0
"""The selector against a second reading of the same rule, block by block and grain by grain."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from support.paper import rest_lattice
from support.quiet_settings import GRAINS

from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.select import FORGET_S, NOISE_SIGMAS, Selector, chance
from eol_ros.core.table import Table

FPS = 60.0
STILL = replace(
    GRAINS,
    rate_jitter_st=0,
    edge_jitter=0,
    crossfade_s=0,
    block_cap=1000,
    total_cap=10000,
    refractory_s=0,
)
EVERYONE = np.ones(25, bool)


def space(places, duration_s=0.25):
    grains = np.zeros(len(places), GRAIN)
    grains['x'], grains['y'] = np.asarray(places, float).T
    grains['duration_s'] = duration_s
    return Corpus((Source('a.wav', 48000, 99.0, ''),), grains)


def two_sounds(places, random):
    """The same of two sounds in turn, with descriptors, one of which is missing in places."""
    corpus = space(places)
    grains, n = corpus.grains, len(places)
    grains['file'] = np.arange(n) % 2
    grains['start_s'] = 0.25 * random.permutation(n)
    grains['loudness_lufs'] = random.normal(-30, 8, n).round()
    grains['pitch_hz'] = np.where(random.random(n) < 0.3, np.nan, random.uniform(40, 4000, n))
    return Corpus((*corpus.sources, Source('b/c d.wav', 48000, 99.0, '')), grains)


class Oracle:
    """The rule as the docstring of `select` tells it, with no array, no cleverness."""

    def __init__(self, settings, corpus):
        self.s, self.corpus = settings, corpus
        half = settings.space_m / 2
        places = zip(corpus.grains['x'].tolist(), corpus.grains['y'].tolist(), strict=True)
        self.grains = [(2 * half * x - half, 2 * half * y - half) for x, y in places]
        self.begun = [-math.inf] * 25
        self.played = [None] * 25  # (time, grain)
        self.before = -math.inf
        self.last = [None] * 25  # (time, x, y) of the image in which the block was last seen
        self.moving = [False] * 25
        self.fast = [-math.inf] * 25
        self.bow = [-math.inf] * 25
        self.speed = [0.0] * 25
        self.disarmed = set()
        self.sounded = {}
        self.history = []
        self.capped = 0

    def image(self, t, x, y, seen, sigma):
        s = self.s
        for b in range(25):
            speed = step = 0.0
            measured = False
            if seen[b]:
                if self.last[b] is not None and t - self.last[b][0] <= FORGET_S:
                    step = math.hypot(x[b] - self.last[b][1], y[b] - self.last[b][2])
                    speed = step / (t - self.last[b][0])
                    measured = True
                self.last[b] = (t, x[b], y[b])
            was = self.moving[b]
            if was:
                fast = measured and speed >= s.stop_mps
            else:
                noise = NOISE_SIGMAS * math.sqrt(2) * sigma[b]
                fast = measured and speed >= s.start_mps and step >= noise
            if fast:
                self.fast[b] = t
            if seen[b]:
                self.speed[b] = speed
            self.moving[b] = fast or (was and t - self.fast[b] < s.rest_s)
            if self.moving[b] and not was:
                self.bow[b] = self.begun[b] = t
            if was and not self.moving[b] and s.rearm_at_rest:
                self.disarmed = {(k, g) for k, g in self.disarmed if k != b}
        out = []
        candidates = []
        beat = math.floor(t / s.beat_period_s)
        on_beat = self.before == -math.inf or beat > math.floor(self.before / s.beat_period_s)
        self.before = t
        for b in range(25):
            if not (self.moving[b] and seen[b]):
                continue
            half = s.space_m / 2
            at = [min(max(v, -half), half) for v in (x[b], y[b])]
            far = [math.sqrt((gx - at[0]) ** 2 + (gy - at[1]) ** 2) for gx, gy in self.grains]
            for g, d in enumerate(far):
                if d > s.radius * s.rearm_ratio:
                    self.disarmed.discard((b, g))
            here = [g for g in range(len(far)) if self.present(b, g)]
            if s.match:
                here = [g for g in here if far[g] <= s.radius]
                like = self.likeness(b, x[b], y[b], here)
                order = sorted(here, key=lambda g: (like[g], g))
            else:
                order = sorted(here, key=lambda g: (far[g], g))
            order = order[: {'all': len(far), 'nearest': 1, 'k': s.k}[s.choose]]
            near = [g for g in order if far[g] <= s.radius]
            if s.mode == 'fence':
                candidates += [(far[g], b, g) for g in near if (b, g) not in self.disarmed]
            elif on_beat if s.mode == 'beat' else t >= self.bow[b]:
                ready = sorted(g for g in near if self.rested(t, g))
                u, v = chance(s.seed, t, b, 0, np.arange(2))
                g = self.following(t, b) if s.mode == 'continue' else None
                if g is None and ready:
                    g = ready[int(v * len(ready))]
                if g is not None:
                    self.bow[b] = t + s.bow_period_s * (1 + s.bow_jitter * (2 * u - 1))
                    if s.mode != 'bow':
                        self.bow[b] = t + 0.25 / s.playback_rate
                    if self.allowed(t, b):
                        out.append((b, g))
                        self.sounded[g] = t
        for _, b, g in sorted(candidates):
            if self.rested(t, g):
                self.disarmed.add((b, g))
                if self.allowed(t, b):
                    out.append((b, g))
                    self.sounded[g] = t
        for b, g in out:
            self.played[b] = t, g
        return out

    @functools.cache  # noqa: B019
    def present(self, b, g):
        share = {'a': 1.0, 'c d': 1.0}
        for line in self.s.weights:
            *name, weight = line.split()
            share[' '.join(name)] = float(weight)
        name = ['a', 'c d'][self.corpus.grains['file'][g]]
        return chance(self.s.seed, 0.0, b, g, 8)[0] < share[name]

    def likeness(self, b, x, y, here):
        s, found = self.s, {}
        for g in here:
            found[g] = 0.0
            for line in s.match:
                name, weight, source = line.split()
                side = s.space_m
                target = {'x': (x + side / 2) / side, 'y': (y + side / 2) / side}.get(source)
                if source == 'speed':
                    target = self.speed[b] / s.full_mps
                if source == 'last':
                    if self.played[b] is None:
                        continue
                    target = self.rank(name, self.played[b][1])
                target = min(max(target, 0.0), 1.0)
                found[g] += float(weight) * (self.rank(name, g) - target) ** 2
        return found

    @functools.cache  # noqa: B019
    def rank(self, name, g):
        values = self.corpus.grains[name].tolist()
        mine, known = values[g], [v for v in values if v == v]
        if mine != mine:
            return 0.5
        if len(known) == 1:
            return 0.5
        below, same = sum(v < mine for v in known), known.count(mine)
        return (2 * below + same - 1) / (2 * (len(known) - 1))

    def following(self, t, b):
        if self.played[b] is None or self.played[b][0] < self.begun[b]:
            return None
        grains = self.corpus.grains
        g = self.played[b][1]
        later = [
            (grains['start_s'][h], h)
            for h in range(len(grains))
            if grains['file'][h] == grains['file'][g]
            and grains['start_s'][h] > grains['start_s'][g]
        ]
        follower = min(later)[1] if later else None
        good = follower is not None and self.present(b, follower) and self.rested(t, follower)
        return int(follower) if good else None

    def rested(self, t, g):
        return g not in self.sounded or t - self.sounded[g] >= self.s.refractory_s

    def allowed(self, t, b):
        second = [k for when, k in self.history if t - when < 1.0]
        if len(second) >= self.s.total_cap or second.count(b) >= self.s.block_cap:
            self.capped += 1
            return False
        self.history.append((t, b))
        return True


def walk(random, images):
    """Positions (images, 25, 2): rests, slips, drifts and jumps, of all sizes that matter."""
    pace = random.choice([0, 0, 1e-5, 3e-4, 2e-3, 2e-2], (images, 25, 1))
    steps = pace * random.standard_normal((images, 25, 2))
    drift = np.repeat(random.normal(0, 0.004, (1, 25, 2)), images, axis=0)
    drift[random.random((images, 25)) < 0.5] = 0
    return random.uniform(-0.5, 0.5, (25, 2)) + np.cumsum(steps + drift, axis=0)


def catart(random):
    """Settings of several sounds, of likeness, and of the modes that keep a block sounding."""
    lines = ('loudness_lufs 1 speed', 'pitch_hz .5 x', 'loudness_lufs 2 last', 'flatness 1 y')
    return {
        'mode': str(random.choice(['fence', 'beat', 'chain', 'continue'])),
        'match': lines[: int(random.integers(0, 5))],
        'weights': [(), ('a 0.4',), ('c d 0', 'a .7')][int(random.integers(0, 3))],
        'beat_period_s': float(random.choice([0.05, 0.13])),
        'playback_rate': float(random.choice([1.0, 4.0])),
    }


def compare(seed, images, n_grains, further=False):
    """Run both over one random scene of 25 trajectories; return how many triggers there were."""
    random = np.random.default_rng(seed)
    settings = replace(
        GRAINS,
        mode=str(random.choice(['fence', 'fence', 'bow'])),
        choose=str(random.choice(['all', 'nearest', 'k'])),
        k=int(random.integers(1, 5)),
        radius=float(random.uniform(0.02, 0.4)),
        rearm_ratio=float(random.choice([1.0, 1.2, 2.0])),
        rearm_at_rest=bool(random.random() < 0.5),
        refractory_s=float(random.choice([0.0, 0.05, 0.3])),
        block_cap=int(random.choice([0, 1, 3, 1000])),
        total_cap=int(random.choice([5, 40, 10000])),
        rest_s=float(random.choice([0.0, 0.02, 0.08])),
        bow_period_s=float(random.choice([0.02, 0.06])),
        seed=int(seed % 7),
    )
    places = random.random((n_grains, 2))
    corpus = space(places)
    if further:
        settings = replace(settings, **catart(random))
        corpus = two_sounds(places, random)
    selector, oracle = Selector(settings, corpus), Oracle(settings, corpus)
    xy = walk(random, images)
    stamps = np.cumsum(random.choice([1 / FPS, 2 / FPS, 0.3], images, p=[0.9, 0.08, 0.02]))
    seen = random.random((images, 25)) < random.choice([1.0, 0.8])
    sigma = random.choice([0.0, 2e-5, 1e-3], 25)
    count = 0
    for i, (t, at, there) in enumerate(zip(stamps, xy, seen, strict=True)):
        if i == images // 2:  # settings are live
            live = {'choose': 'k', 'k': 2, 'radius': 0.3, 'block_cap': 2, 'total_cap': 30}
            live = {'weights': ('a 0.7',), 'radius': 0.3} if further else live
            oracle.present.cache_clear()
            selector.settings = oracle.s = replace(settings, **live)
        x, y = at.T
        found = selector.update(float(t), x, y, there, sigma)
        expected = oracle.image(float(t), x.tolist(), y.tolist(), there.tolist(), sigma.tolist())
        got = list(zip(found['block'].tolist(), found['grain'].tolist(), strict=True))
        assert got == expected and selector.capped == oracle.capped, (seed, settings, t)
        count += len(got)
    return count


@pytest.mark.parametrize(
    ('seeds', 'images', 'n_grains', 'further', 'least'),
    [
        (range(16), 25, 12, False, 80),
        (range(500, 524), 20, 8, True, 80),
        pytest.param(range(1000, 1160), 6, 4, False, 200, marks=pytest.mark.slow),
        pytest.param(range(1000, 9000), 6, 4, False, 10_000, marks=pytest.mark.soak),
    ],
)
def test_agrees_with_the_oracle(seeds, images, n_grains, further, least):
    """On trajectories of 25 blocks; `further`: several sounds, likeness and every mode."""
    assert sum(compare(seed, images, n_grains, further) for seed in seeds) > least


def run(settings, places, path, duration_s=0.25):
    """Move one block along `path` (n, 2); return its triggers."""
    return passed(Selector(settings, space(places, duration_s)), path)


def passed(selector, path, start_s=0.0, told=1, sigma_m=0.0):
    at = rest_lattice() + 5.0  # the others are far away
    found = []
    for i, place in enumerate(path):
        at[12] = place
        for _ in range(told):
            image = start_s + i / FPS, *at.T.copy(), EVERYONE, np.full(25, sigma_m)
            found.append(selector.update(*image))
    return np.concatenate(found)


def test_a_block_of_unknown_sigma_sounds_as_an_exact_one():
    exact, unknown = (
        passed(Selector(STILL, space(CENTRE)), THROUGH, sigma_m=sigma) for sigma in (0.0, np.nan)
    )
    assert len(exact) and exact.tobytes() == unknown.tobytes()


def circling(selector, images, begin=0):
    """All blocks go about their places; yield number and triggers of each image."""
    for i in range(begin, begin + images):
        at = rest_lattice() + 0.1 * np.array([np.sin(i / 20), np.cos(i / 17)])
        yield i, selector.update(1 + i / FPS, *at.T, EVERYONE, np.zeros(25))


def line(start, end, images):
    return np.linspace(start, end, images)


CENTRE = [(0.5, 0.5)]
THROUGH = line((-0.1, 0), (0.1, 0), 30)


def test_faster_is_louder_and_place_is_pan():
    slow, fast = (run(STILL, CENTRE, line((-0.1, 0), (0.1, 0), n))['gain'][0] for n in (100, 20))
    assert STILL.gain_floor <= slow < fast <= 1
    speed = 0.2 / 99 * FPS
    assert slow == pytest.approx((speed / STILL.full_mps) ** STILL.gain_curve, rel=1e-5)
    right = run(STILL, [(0.75, 0.5)], line((0.2, 0), (0.4, 0), 30))
    assert right['pan'][0] == pytest.approx(
        STILL.pan_width * right_x(right) / (STILL.space_m / 2), abs=1e-6
    )


def right_x(found):
    return 0.2 + 0.2 / 29 * round(found['time_s'][0] * FPS)


def test_jitter_stays_in_its_range_and_comes_from_the_seed():
    settings = replace(
        STILL, rate_jitter_st=2, edge_jitter=0.5, playback_rate=1.5, radius=0.3, release_s=0.06
    )
    places = np.random.default_rng(4).random((300, 2))
    path = line((-0.5, 0), (0.5, 0.1), 120)
    found = run(settings, places, path)
    assert len(found) > 50
    octaves = np.log2(found['rate'] / 1.5)
    assert np.abs(octaves).max() <= 2 / 12 + 1e-6 and np.abs(octaves).max() > 1.5 / 12
    assert abs(octaves.mean()) < 0.03
    attack = found['attack_s'] / settings.attack_s
    assert 0.5 - 1e-5 <= attack.min() < 0.7 and 1.3 < attack.max() <= 1.5 + 1e-5
    np.testing.assert_array_equal(found, run(settings, places, path))
    other = run(replace(settings, seed=2), places, path)
    assert (other['rate'] != found['rate']).any()
    np.testing.assert_array_equal(other['grain'], found['grain'])


def test_another_table_covers_the_space_alike():
    """Blocks at the same shares of what they reach sound the same grains at the same places."""
    wide = Table(rows=3, columns=4, block_side_m=0.05, platform_m=(2.0, 0.8))
    reach = [np.array(t.platform_m) - 2 * (t.rim_width_m + t.gap_m) for t in (Table(), wide)]
    corpus, found = space(np.random.default_rng(3).random((200, 2))), []
    path = np.cumsum(np.random.default_rng(4).normal(0, 0.03, (60, 2)), axis=0)
    for table, scale in ((Table(), 1.0), (wide, reach[1] / reach[0])):
        selector = Selector(replace(STILL, gain_floor=1.0), corpus, table)
        at = np.full((table.cells, 2), 5.0)
        for k, place in enumerate(path):
            at[7] = place * scale
            still = np.zeros(table.cells)
            found.append(selector.update(k / FPS, *at.T.copy(), still == 0, still))
    first, second = np.concatenate(found[:60]), np.concatenate(found[60:])
    assert len(first) > 30
    assert first['grain'].tolist() == second['grain'].tolist()
    np.testing.assert_allclose(first['pan'], second['pan'], atol=1e-6)
    assert selector.bounds == pytest.approx(
        [s * 0.5 * r for s in (-1, 1) for r in reach[1] / reach[0]]
    )


def test_a_bag_that_begins_again_gives_the_same_again():
    places = np.random.default_rng(8).random((50, 2))
    selector = Selector(replace(GRAINS, radius=0.1), space(places))
    rounds = []
    for _ in range(2):
        rounds.append(np.concatenate([found for _, found in circling(selector, 100)]))
    assert len(rounds[0]) > 20
    np.testing.assert_array_equal(*rounds)


def test_a_first_corpus_is_there_at_once_and_a_later_one_in_time():
    selector = Selector(STILL)
    assert not len(passed(selector, THROUGH))
    assert Selector(STILL).load(space(CENTRE), lead_s=1.0) == -np.inf
    selector = Selector(STILL, space(CENTRE))
    assert len(passed(selector, THROUGH, 100.0, told=2)) == 1  # an image told twice counts once
    selector.load(space([(0.9, 0.9)]), lead_s=1e-9)
    assert not len(passed(selector, THROUGH, 5.0))  # the stamps began again: no wait until 100 s


def test_silent_grains_are_never_reached():
    found = run(STILL, [(np.nan, np.nan), (0.5, 0.5)], THROUGH)
    assert found['grain'].tolist() == [1]


@pytest.mark.parametrize(
    ('envelope', 'attack_s', 'release_s'),
    [
        ('edges', 0.005, 0.2),
        ('hann', 0.125, 0.125),
        ('percussive', 0.005, 0.245),
        ('swell', 0.05, 0.2),
    ],
)
def test_envelopes_fill_the_grain_as_they_say(envelope, attack_s, release_s):
    settings = replace(STILL, envelope=envelope)
    found = run(settings, CENTRE, THROUGH)
    assert found['attack_s'] == pytest.approx(attack_s)
    assert found['release_s'] == pytest.approx(release_s)


def test_blocks_play_along_drawn_paths():
    """A block that moves from the left edge to the right plays the grains of the path in order."""
    path = [(0.1, 0.1), (0.5, 0.1), (0.5, 0.9), (0.9, 0.9)]  # lengths 0.4, 0.8, 0.4
    apart = [(0.9, 0.1), (0.1, 0.9), (0.5, 0.0)]
    settings = replace(STILL, paths=(' '.join(f'{x},{y}' for x, y in path),), radius=0.01)

    def heard(paths, y):
        selector = Selector(replace(settings, paths=paths), space([*path, *apart]))
        found = []
        for k in range(501):
            x = np.full(25, np.nan)
            x[12] = -0.5 + 0.002 * k
            triggers = selector.update(
                k / FPS, x, np.full(25, y), np.arange(25) == 12, np.zeros(25)
            )
            found += [(int(t['grain']), round(float(x[12]) + 0.5, 3)) for t in triggers]
        return found

    for y in (-0.3, 0.0, 0.5):  # one path: only x counts
        found = heard(settings.paths, y)
        assert [grain for grain, _ in found] == [0, 1, 2, 3]
        passed = [share for _, share in found[1:]]
        assert passed == pytest.approx([0.25, 0.75, 1.0], abs=0.01)
    # two paths, at the near and the far edge: as without any; in the middle: half-way between
    edges = ('0,0 1,0', '0,1 1,1')
    assert heard(edges, 0.4) == heard((), 0.4) != []
    assert [grain for grain, _ in heard(('0,0.2 1,0.2', '0,1 1,1'), -0.5 + 0.875)] == [5, 2, 3]

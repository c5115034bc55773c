# SPDX-License-Identifier: Apache-2.0
"""Live and offline agree to the bit only if no answer depends on where arrays lie in memory.

The compiler asks at run time whether two arrays may overlap, and where it is in doubt takes a slow
way through a loop; sums then end in other last bits. Here every array is put somewhere else.
"""

import hashlib
import random

import numpy as np
import pytest
from support.paper import rest_lattice
from support.sound_reference import score

from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.lab import presets
from eol_ros.lab.choose import simulate
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow
FIELD, OPEN = 1 << 16, 8  # bytes of a field of arrays; fields that are filled at once
MAKERS = ('zeros', 'empty', 'ones', 'full', 'array', 'column_stack', 'ascontiguousarray')


class Scatter:
    """Makes numpy put new arrays of up to 64 kB anywhere in memory, in any order."""

    def __init__(self, monkeypatch):
        self.monkeypatch = monkeypatch
        self.made = {name: getattr(np, name) for name in MAKERS}

    def deal(self, seed):
        """Deal from a new pack."""
        self.rng = random.Random(seed)
        self.closed: list = []
        self.open = [(None, 0, 0)] * OPEN
        for name, make in self.made.items():
            self.monkeypatch.setattr(np, name, self.wrapped(make))

    def wrapped(self, make):
        def scattered(*args, **kwargs):
            made = make(*args, **kwargs)
            if not made.flags.c_contiguous or made.dtype.hasobject or not 0 < made.nbytes <= FIELD:
                return made
            place = self.place(made.nbytes).view(made.dtype).reshape(made.shape)
            place[...] = made
            return place

        return scattered

    def place(self, size):
        """Return room for `size` bytes somewhere in one of the open fields."""
        k = self.rng.randrange(OPEN)
        arena, at, end = self.open[k]
        at += 16 * self.rng.randrange(5)
        if at + size > end:
            if not self.closed:
                arena = np.frombuffer(bytearray(64 * FIELD), np.uint8)
                self.closed = [(arena, i * FIELD, (i + 1) * FIELD) for i in range(64)]
                self.rng.shuffle(self.closed)
            arena, at, end = self.closed.pop()
        self.open[k] = arena, (at + size + 15) // 16 * 16, end
        return arena[at : at + size]


@pytest.fixture
def places(monkeypatch):
    """Return f(work): the digests of what `work()` yields, one for each of some placements."""

    def digests(work):
        scatter, seen = Scatter(monkeypatch), set()
        for seed in range(5):
            if seed:  # the first time as it comes, so that all is compiled
                scatter.deal(seed)
            digest = hashlib.sha256()
            for array in work():
                digest.update(np.asarray(array).tobytes())
            seen.add(digest.hexdigest())
        return seen

    return digests


def film():
    """Yield images of the live table, with an arm over it, straight from the renderer."""
    renderer, play = Renderer(RenderOptions(), Calibration.ideal(), 5), Play(5)
    table = play.table
    for k in range(40):
        play.advance(1 / 60)
        yield renderer.render(table.x, table.y, table.yaw, k, velocity=table.velocity)


@pytest.fixture(scope='module')
def resting():
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 5)
    x, y = rest_lattice().T
    return [renderer.render(x, y, np.full(25, 0.01), k).copy() for k in range(30)]


@pytest.mark.parametrize('calibration', [None, Calibration.ideal()], ids=['by itself', 'given'])
def test_tracking(places, resting, calibration):
    def track():
        tracker = Tracker(TrackerSettings(), calibration)
        for k, image in enumerate(resting):
            if k > 25:
                image = image.copy()
                image[200:500, 300:700] = 60
            tracker.update(k / 60, image)
            yield tracker.follower.blocks
            yield tracker.follower.found
        yield tracker.follower.faces.light

    assert len(places(track)) == 1


def test_rendering_and_the_live_table(places):
    assert len(places(film)) == 1


@pytest.mark.parametrize('name', ['S3L', 'S3G', 'S4L'])
def test_simulation(places, name):
    scene = from_mapping({**presets.scene(name), 'T': 3.0})

    def run():
        done = simulate(scene)
        return done.t, done.u, done.v, done.event_t, done.event_block

    assert len(places(run)) == 1


def test_sound(places):
    def sound():
        rng = np.random.default_rng(3)
        sounds = [rng.standard_normal(48000).astype('f4') * 0.1 for _ in range(2)]
        bank = Bank(sounds, [0, 1] * 10, np.linspace(0, 0.7, 20), np.full(20, 0.25), 48000)
        triggers = score(rng, 200, 0.8, len(bank), rate=rng.uniform(0.3, 3, 200), gain=4.0)
        mixer = Mixer(48000, max_voices=20, loudness_lufs=-40)
        yield render_all(mixer, triggers, bank, 48000)

    assert len(places(sound)) == 1

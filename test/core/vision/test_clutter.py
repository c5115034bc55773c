# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from support.clutter import LEVELS, Cluttered
from support.paper import rest_lattice

from eol_ros.core.table import Table
from eol_ros.core.vision.background.model import BackgroundLearner, BackgroundModel
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow  # the first run compiles


def lit(seed=1, **changes):
    level = dataclasses.replace(
        LEVELS['clean'],
        **{
            'reflections': 60,
            'reflection_level': (30, 55),
            'reflection_px': (4, 10),
            'hot_pixels': 100,
            'gradient': 20,
            **changes,
        },
    )
    return Cluttered(level, None, seed)


def learn(renderer, images=15, ir=0.0):
    learner, xy = BackgroundLearner(Table()), rest_lattice()
    for k in range(images):
        learner.add(renderer.render(*xy.T, np.zeros(25), k, ir=np.full(25, ir)))
    return learner


def test_lamps_are_learnt_and_taken_off():
    renderer = lit()
    clutter = learn(renderer).result()
    platform = lit(reflections=0, hot_pixels=0).scenery.static
    lamps = renderer.scenery.static - platform
    dark = renderer.scenery.static - np.quantile(renderer.scenery.static, 0.3)
    off = np.abs(clutter.light - np.maximum(dark, 0))[lamps < 200]
    assert np.quantile(off, 0.99) < 2.5
    rms = {}
    for name, used in (('with', clutter), ('without', None)):
        left = []
        for k in range(8):
            tracker = Tracker(TrackerSettings(), renderer.calibration)
            tracker.background = used
            xy = rest_lattice() + np.random.default_rng(k).normal(0, 0.01, (25, 2))
            found = tracker.update(0.0, renderer.render(*xy.T, np.full(25, 0.1), 100 + k))
            assert found.seen.sum() > 22
            left.append(545 * np.hypot(*(found.world - xy)[found.seen].T))
            assert left[-1].max() < 2
        rms[name] = np.sqrt((np.concatenate(left) ** 2).mean())
    assert rms['with'] < 0.7 * rms['without']


def test_what_cannot_be_a_map():
    with pytest.raises(ConfigError, match='0 dark images were taken'):
        BackgroundLearner(Table()).result()
    with pytest.raises(ConfigError, match='8-bit'):
        BackgroundModel(np.zeros((4, 4)))
    with pytest.raises(ConfigError, match='learn it again'):
        BackgroundModel(np.zeros((40, 60), np.uint8)).remove(np.zeros((80, 120), np.uint8))


def test_a_full_sensor_stays_full():
    image = np.full((10, 10), 255, np.uint8)
    image[0] = 100
    clean = BackgroundModel(np.full((10, 10), 30, np.uint8)).remove(image)
    assert (clean[0] == 70).all()
    assert (clean[1:] == 255).all()

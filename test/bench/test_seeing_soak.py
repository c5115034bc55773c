# SPDX-License-Identifier: Apache-2.0
"""The long runs of the vision benchmark; minutes to hours each."""

import numpy as np
import pytest

from benchmarks import identity, motion, twin_slips
from benchmarks.vision_scenes import RATE_HZ, run_film
from eol_ros.core.physics.twin.live import SOFT, Coupling

pytestmark = pytest.mark.soak


@pytest.mark.timeout(14400)
def test_an_hour_of_arms_brings_no_wrong_name_that_was_not_told():
    figures = identity.measure(['eol_ros'], 1.0, 60.0, 21, textured=False)['eol_ros']
    assert figures['undeclared_per_hour'] == 0
    assert figures['lasting_failures_per_hour'] <= 1
    assert figures['switches_per_hour'] <= 50
    assert figures['mislabelled_percent'] <= 0.02


def test_a_minute_of_hard_film_loses_no_block_and_invents_none():
    ours = run_film('hard', 'L2', 11, round(60 * RATE_HZ), peers=False)['eol_ros']
    assert ours['coverage'] >= 0.995
    assert ours['false_per_image'] == 0
    assert ours['hidden_reported'] == 0
    assert ours['rms_partly_px'] < 0.25


@pytest.mark.timeout(7200)
def test_ten_minutes_of_brutal_film_report_few_hidden_blocks():
    films = [run_film('brutal', 'L2', seed, round(60 * RATE_HZ), peers=False)['eol_ros']
             for seed in range(1, 11)]  # fmt: skip
    assert np.mean([film['coverage'] for film in films]) >= 0.995
    assert np.mean([film['false_per_image'] for film in films]) <= 0.003
    assert sum(film['hidden_reported'] for film in films) <= 3


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ('coupling', 'fps', 'start_ms'),
    [(SOFT, 60.0, 1.7), (SOFT, 120.0, 1.0), (Coupling(), 60.0, 1.7), (Coupling(), 120.0, 1.2)],
)
def test_ten_minutes_of_visitors_lose_no_slip(coupling, fps, start_ms):
    ours, peer = twin_slips.measure(fps, 600.0, 3, coupling=coupling)
    assert ours['slips'] > 3000
    assert ours['recall'] >= 0.995 and ours['precision'] >= 0.995
    assert ours['start_rms_ms'] <= start_ms < peer['start_rms_ms']


@pytest.mark.timeout(3600)
@pytest.mark.parametrize('fps', [60.0, 120.0])
def test_a_rendered_table_that_slides_loses_no_slip(fps):
    ours, _ = twin_slips.measure(fps, 20.0, 3, 'sliding', True)
    assert ours['slips'] > 300
    assert ours['recall'] >= 0.99 and ours['precision'] >= 0.99


@pytest.mark.parametrize(('fps', 'stop_ms'), [(60.0, 1.2), (120.0, 1.0)])
def test_onsets_of_a_stick_slip_table(fps, stop_ms):
    quiet = motion.measure(fps, 0.007 / motion.PX_PER_M, 60.0, 3)
    assert quiet['onset_rms'] <= stop_ms
    noisy = motion.measure(fps, 0.035 / motion.PX_PER_M, 60.0, 3)
    assert (noisy['recall'], noisy['precision']) == (1.0, 1.0)


def test_ten_hours_of_rest_bring_the_stated_false_alarms():
    assert 1 / 1.5 < motion.false_alarms(10.0, 20.0, 60.0, 3)['ratio'] < 1.5

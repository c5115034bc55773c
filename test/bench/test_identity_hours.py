# SPDX-License-Identifier: Apache-2.0
"""Hours of names by several seeds, and what is counted of each."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.stick_slip import Onlooker, Table

from benchmarks import identity


def half_an_hour(lasting, seed=0):
    """What a seed shows in half an hour with so many lasting failures."""
    return {
        'eol_ros': {'lasting_failures_per_hour': lasting / 0.5, 'switches_per_hour': 2.0 * seed}
    }


def test_hours_of_several_seeds_add_up():
    lasting = {3: 0, 4: 2, 5: 1}
    found = identity.measure_seeds(lambda s: half_an_hour(lasting[s], s), range(3, 6), 0.5)
    found = found['eol_ros']
    assert found['hours'] == 1.5 and found['lasting_failures'] == 3
    assert found['lasting_failures_per_hour'] == pytest.approx(2.0)
    assert found['switches_per_hour'] == pytest.approx(8.0)
    assert found['switches_per_hour_most'] == 10.0


def test_without_a_failure_the_rule_of_three_holds():
    found = identity.together([half_an_hour(0)] * 200, 0.5)['eol_ros']
    assert found['hours'] == 100.0
    assert found['lasting_per_hour_below_95'] == pytest.approx(0.03, rel=2e-3)


def test_an_arm_hides_what_lies_under_it():
    """By the distance of each block from a thousand points of the arm."""
    onlooker, moment = Onlooker(3), Table(3, 60.0).step()
    arm = (9.0, np.array([0.9, 0.1]), np.array([-0.2, -0.1]), np.zeros(2), 0.05)
    onlooker.arms, onlooker.arm_rate = [arm], 0.0
    hidden, touched = onlooker._arms(moment)
    points = arm[1] + np.linspace(0, 1, 1000)[:, None] * (arm[2] - arm[1])
    near = np.hypot(*(moment.xy[:, None] - points[None]).transpose(2, 0, 1)).min(axis=1)

    assert 2 < hidden.sum() < touched.sum() < 15
    assert (hidden == (near < 0.07)).all() and (touched == (near < 0.11)).all()


def test_names_are_counted_as_they_are():
    score, true = identity.Score(), np.array([2, -1, 0, 1])
    index = np.full(25, -1)
    index[[0, 1, 2]] = [2, 3, 0]
    assert not score.add(0.0, true, index, False)
    assert (score.shown, score.hidden, score.missed, score.wrong) == (3, 22, 0, 0)
    index[[0, 1, 5]] = [3, 2, 1]  # two are exchanged, and a false light has a name
    assert not score.add(1.0, true, index, True)
    assert (score.wrong, score.switches, score.ghosts, score.sure_wrong) == (2, 2, 1, 0)
    index[:] = -1
    assert not score.add(3.0, true, index, False)
    assert score.missed == 3 and score.switches == 2
    assert score.add(3.01, true, index, False)  # 2.01 s without the right name
    assert score.lasting == score.undeclared == 1


def test_the_places_of_occluded_blocks_are_compared_while_their_names_were_right():
    score = identity.Score()
    xy = np.arange(50.0).reshape(25, 2)
    moment, believed = SimpleNamespace(xy=xy), xy + (0.003, 0.004)
    true, index = np.arange(25), np.arange(25)
    index[[7, 8]] = [8, 7]  # exchanged
    score.compare_occluded(moment, true, index, believed)
    index[[3, 7]] = -1
    for _ in range(6):
        score.compare_occluded(moment, true, index, believed)
    assert score.occluded_m[1] == score.occluded_m[6] == [pytest.approx(0.005)]
    assert score.occluded_m[30] == []
    score.add(0.0, true, index, False)
    figures = score.figures(1.0, 7)
    assert figures['occluded_6_images_median_mm'] == pytest.approx(5.0)
    assert figures['occluded_30_images_99_percent_mm'] is None
    pieces = [{'eol_ros': figures | {'occluded_30_images_median_mm': far}} for far in (None, 4.0)]
    found = identity.together(pieces, 1.0)['eol_ros']
    assert found['occluded_30_images_median_mm'] == 4.0
    assert found['occluded_30_images_99_percent_mm'] is None


@pytest.mark.slow
def test_the_command_adds_seeds_up(capsys):
    import argparse
    import json

    parser = argparse.ArgumentParser()
    identity.add_arguments(parser)
    line = '--hours 0.0005 --seeds 2 --methods eol_ros --json'
    assert identity.run(parser.parse_args(line.split())) == 0
    both = json.loads(capsys.readouterr().out)['eol_ros']
    alone = [
        identity.measure(['eol_ros'], 0.0005, 60.0, seed, askew_rad=np.radians(2.9))['eol_ros']
        for seed in (1, 2)
    ]
    for key in ('missed_percent', 'hidden_percent', 'switches_per_hour'):
        assert both[key] == pytest.approx(np.mean([one[key] for one in alone]))
    assert both['hours'] == 0.001


@pytest.mark.slow
def test_images_show_what_the_detections_do():
    onlooker, table = Onlooker(3, permanent=2), Table(3, 60.0)
    ours = identity.make('eol_ros', onlooker)
    ours.begin(table.xy)
    for _ in range(60):
        moment = table.step()
        seen = onlooker.look(moment)
        image = ours.image(moment, seen)
        index = ours.update(moment, seen)
    camera = ours.renderer.calibration
    at = np.rint(camera.to_pixels(seen.xy)).astype(int)
    inside = (at >= 0).all(axis=1) & (at < [1280, 800]).all(axis=1)
    assert inside.sum() > 20 and (seen.true[inside] < 0).any()
    assert image[at[inside, 1], at[inside, 0]].min() > 100
    held = index >= 0
    assert held.sum() > 15 and (seen.true[index[held]] == np.flatnonzero(held)).all()

# SPDX-License-Identifier: Apache-2.0
"""Every row of `eol bench extremes` ends as it must: never NaN, never unbounded, never silent."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.physics_oracles import ORACLES

from benchmarks import extreme_parts, extremes
from benchmarks.extreme_scenes import cases
from eol_ros.core.physics import builders
from eol_ros.core.physics.result import Limits
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import ConfigError
from eol_ros.lab import presets
from eol_ros.lab.choose import simulate

ALL = cases()


@pytest.mark.parametrize(
    'case',
    [
        pytest.param(c, id=f'{c.where} {c.name}', marks=[pytest.mark.soak] if c.long else [])
        for c in ALL
    ],
)
def test_status_of(case):
    run, wrong = extremes.ended(case, ledger=True)
    assert wrong == []
    assert run.status != 'ok' or abs(run.energy.residual_J) <= 1e-5 * largest(run.energy)


def largest(energy):
    return max(1.0, abs(energy.work_J), abs(energy.friction_J), abs(energy.elastic_J))


def test_rows_have_names_references_and_peers_that_there_are():
    assert len({(c.where, c.name) for c in ALL}) == len(ALL)
    assert {c.oracle for c in ALL} - {''} == set(ORACLES)
    assert {c.peer for c in ALL} - {''} == set(extremes.PEERS)


def test_the_judge_finds_what_is_wrong():
    scene, limits = from_mapping(presets.scene('S3L')), Limits(steps=50)
    run = simulate(scene, limits=limits)
    assert extremes.judge(run, scene.duration_s, limits) == []
    assert 'samples of what was not reached' in extremes.judge(
        simulate(scene, limits=limits), 0.5 * run.t_reached, limits
    ) or extremes.judge(run, 0.5 * run.t_reached, limits)
    run.notes.clear()
    assert extremes.judge(run, scene.duration_s, limits) == [
        'ends early and does not say what would let it go on'
    ]
    run.u[0, 0, 0] = np.nan
    assert 'u is not finite' in extremes.judge(run, scene.duration_s, limits)
    run.status = 'ok'
    assert 'ok, but not at its end' in extremes.judge(run, scene.duration_s, limits)
    assert extremes.judge(run, scene.duration_s, Limits(steps=10))[1].startswith('50 steps')


def test_work_that_takes_too_long_is_ended_wherever_it_is():
    def slow():
        return solve_ivp(lambda t, y: -1e9 * y, (0, 1e6), np.ones(2), 'DOP853').y

    assert extremes.patiently(slow, 0.5) == (None, 500.0)
    found, _ = extremes.patiently(lambda: np.arange(3.0), 20.0)
    assert found.tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(RuntimeError, match='ended with exit code'):
        extremes.patiently(lambda: np.ones(2)[5], 20.0)


def test_no_block_is_refused_in_one_line():
    with pytest.raises(ConfigError, match='n is 0: 1 to'):
        from_mapping(builders.single(presets.PULL, 1.0) | {'n': 0})


@pytest.mark.parametrize('name', ['hands', '8 kHz', '192 kHz'])
def test_live_parts_stay_finite(name):
    row = extreme_parts.PARTS[name]()
    assert row['status'] == 'ok'
    assert row.get('snr_db', 200) > 120
    assert row.get('faults', 0) == 0


def test_a_flood_of_triggers_is_counted_to_the_last():
    row = extreme_parts.trigger_flood(200_000)
    assert row['status'] == 'ok'
    assert 'dropped' in row['notes']


def test_a_day_of_the_live_clock():
    """In steps of a second; `eol bench extremes` takes those of a camera."""
    assert extreme_parts.live_day(24.0, 1.0)['status'] == 'ok'


@pytest.mark.parametrize('spread, status', [(0.02, 'refused'), (0.06, 'ok'), (0.2, 'ok')])
def test_five_points_in_a_line(spread, status):
    """Refused, or as wrong as it is told to be."""
    row = extreme_parts.collinear(spread)
    assert row['status'] == status
    assert row['notes'] if status == 'refused' else row['worst_mm'] < 3 * row['told_mm']


@pytest.mark.parametrize('degrees', [40.0, 60.0])
def test_a_camera_at_the_side_reports_no_block_where_it_is_not(degrees):
    row = extreme_parts.steep_camera(degrees, 12)
    assert row['seen'] == 0.0 or row['rms_mm'] < 0.5
    assert (row['status'] == 'ok') == (row['seen'] > 0.99)


def test_each_reference_covers_a_fifth_of_its_run():
    for case in ALL:
        if case.oracle and case.stretch_s and case.ends == 'ok':
            share = case.stretch_s / case.build()['T']
            assert round(share, 9) >= extremes.SHARE, case.name


def test_a_row_says_what_share_of_the_run_its_error_covers_and_that_no_peer_ran():
    row = {
        'where': 'line', 'case': 'made up', 'path': 'exact', 'status': 'ok', 'duration_s': 10.0,
        't_reached': 10.0, 'events': 1, 'steps': 2, 'ms': 1.0, 'error_m': 1e-9,
        'against': 'a formula', 'residual_J': 0.0, 'of_J': 1.0, 'notes': '', 'stretch_s': 2.5,
        'times_ordinary': 0.3,
    }  # fmt: skip
    cells = extremes.markdown({'rows': [row]}).splitlines()[-1].split(' | ')
    assert cells[4:] == ['0.3', '1e-09', 'a formula', '25%', 'none |']
    none = extremes.markdown({'rows': [{k: v for k, v in row.items() if k != 'error_m'}]})
    assert none.splitlines()[-1].split(' | ')[7] == '-'
    at_once = extremes.markdown({'rows': [row | {'t_reached': 0.0, 'stretch_s': 0.0}]})
    assert at_once.splitlines()[-1].split(' | ')[7] == '100%'

# SPDX-License-Identifier: Apache-2.0
"""Every row of `eol bench extremes` ends as it must: never NaN, never unbounded, never silent."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks import extreme_parts, extremes
from benchmarks.extreme_scenes import cases
from eol_ros import cli
from eol_ros.core.physics.result import Limits
from eol_ros.core.physics.scene import from_mapping
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


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        ('extremes --with list.json', 78, '--with list.json: the output of eol bench extremes'),
        ('extremes --with bytes.json', 78, '--with bytes.json: the output of eol bench extremes'),
        ('extremes --case clock --hours nan', 2, '--hours: nan is outside 0 to 1000'),
        ('physics --part live --plots .', 2, '--plots: live has no picture'),
    ],
)
def test_what_cannot_be_measured_is_one_line(words, code, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'list.json').write_text('[]')
    (tmp_path / 'bytes.json').write_bytes(bytes(range(256)))
    assert cli.main(['bench', *words.split()]) == code
    shown = capsys.readouterr()
    assert said in shown.err and shown.err.count('\n') == 1 and not shown.out


def test_work_that_takes_too_long_is_ended_wherever_it_is():
    def slow():
        return solve_ivp(lambda t, y: -1e9 * y, (0, 1e6), np.ones(2), 'DOP853').y

    assert extremes.patiently(slow, 0.5) == (None, 500.0)
    found, _ = extremes.patiently(lambda: np.arange(3.0), 20.0)
    assert found.tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(RuntimeError, match='ended with exit code'):
        extremes.patiently(lambda: np.ones(2)[5], 20.0)


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

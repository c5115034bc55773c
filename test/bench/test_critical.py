# SPDX-License-Identifier: Apache-2.0
"""The map of `eol bench critical`: a cell is critical where samples of a known law are, only."""

import numpy as np
import pytest

from benchmarks import critical
from eol_ros import cli
from eol_ros.analysis.sweeps import spec, table
from eol_ros.core.science import powerlaw
from eol_ros.errors import ConfigError


def starts(b, cut=None, count=4000, seeds=4, side=8, ratio=1.0):
    """Rows of a sweep whose areas are drawn from A^-(b + 1), cut off exponentially at `cut`."""
    top = side * side
    support = np.arange(1, top + 1)
    weight = support ** -(b + 1.0) * (1.0 if cut is None else np.exp(-support / cut))
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        areas = rng.choice(support, count, p=weight / weight.sum())
        fits = [powerlaw.fit(powerlaw.histogram(areas), 1, top // 2)]
        tested = powerlaw.goodness(areas, fits, rng, repeats=100)
        yield {
            'model': 'table', 'drive': 'pull', 'rows': side, 'columns': 0, 'speed_mps': 1e-3,
            'disorder': 0.0, 'stiffness_ratio': ratio, 'friction_drop': 0.28, 'fit_from': 1,
            'fit_to': 0, 'cascades': count, 'system_wide': 0.0, 'b_value': fits[0].b_value,
            'tau_error': tested.error, 'p_value': tested.p_value, 'slips_slope': 1.0 + 0.1 * seed,
            'slips_one_over_f': 'yes' if seed == 2 else 'no', 'sound_slope': None,
            'sound_one_over_f': None,
        }  # fmt: skip


@pytest.mark.slow
def test_a_cell_is_critical_with_such_a_law_over_more_than_a_decade(tmp_path):
    rows = [
        *starts(1.0, ratio=1.0), *starts(0.4, ratio=2.0), *starts(0.7, cut=8, ratio=3.0),
        *starts(1.0, side=3, ratio=4.0),
    ]  # fmt: skip
    whole, flat, bent, small = sorted(critical.cells(rows), key=lambda c: c['stiffness_ratio'])

    assert whole['critical'] and whole['b_low'] < 1.0 < whole['b_high'] and whole['starts'] == 4
    assert not flat['in_range'] and not flat['critical']
    assert bent['in_range'] and not bent['critical'] and bent['p'] < 0.05
    assert small['in_range'] and not small['critical'] and small['decades'] < 1
    assert whole['slips_one_over_f'] == 1 and whole['sound_one_over_f'] == 0
    assert whole['slips_slope'] == pytest.approx(1.15) and whole['sound_slope'] is None
    told = {'cells': critical.cells(rows), 'tasks': 16, 'in_range': 3, 'critical': 1, 'parts': [],
            'processor_s': 90.0}  # fmt: skip
    words = critical.table_of(told)
    assert words.count('| table, pull |') == 3 and '; 90 s of processor' in words
    critical.draw(critical.cells(rows), tmp_path)
    assert (tmp_path / 'critical.png').stat().st_size > 1000


def test_what_is_predicted_of_a_table_holds_its_own_runs(tmp_path):
    """Areas drawn from one law: the band covers its N(>= A), and narrows with more cascades."""
    support = np.arange(1, 26)
    weight = support**-1.6 / (support**-1.6).sum()
    truth = weight[::-1].cumsum()[::-1]

    def runs(ratio, count):
        for seed in range(40):
            areas = np.random.default_rng(seed).choice(support, count, p=weight)
            some = np.bincount(areas)
            yield {
                'model': 'table', 'drive': 'pull', 'speed_mps': 1e-3, 'rows': 5,
                'stiffness_ratio': ratio, 'friction_drop': 0.28, 'rate_hz': 0.5, 'b_value': 0.6,
                'p_value': 0.01 if seed else 0.5,
                'areas': ' '.join(f'{a}:{some[a]}' for a in np.flatnonzero(some)),
            }  # fmt: skip

    few, many = critical.predicted([*runs(0.25, 200), *runs(1.0, 5000)])
    for one in (few, many):
        low, high = np.array(one['low']), np.array(one['high'])
        assert ((low <= truth + 1e-12) & (truth <= high + 1e-12)).mean() > 0.9
        assert one['runs'] == 40 and one['cascades_per_m'] == 500 and one['share'][0] == 1
    assert few['high'][9] - few['low'][9] > 2 * (many['high'][9] - many['low'][9])
    assert few['rejected'] == 39
    told = {'cells': [], 'tasks': 80, 'in_range': 0, 'critical': 0, 'parts': [few, many],
            'processor_s': None}  # fmt: skip
    assert '| ratio 0.25, pull 1 mm/s | 40 | 500 | 100 (' in critical.table_of(told)
    critical.draw_parts([few, many], tmp_path)
    assert (tmp_path / 'parts.png').stat().st_size > 1000


def test_the_time_of_tables_is_that_of_all_runs_that_computed_them(tmp_path):
    assert critical.spent_s(tmp_path) is None
    for _ in range(2):
        before_s, used_s = critical.spent_s(tmp_path) or 0.0, critical._processor_s()
        with critical._counted(tmp_path):
            while critical._processor_s() < used_s + 0.3:
                pass
            (tmp_path / 'table.csv').touch()
        assert critical.spent_s(tmp_path) >= before_s + 0.29
    (tmp_path / critical.SPENT).unlink()  # tables that nobody counted for
    with critical._counted(tmp_path):
        pass
    assert critical.spent_s(tmp_path) is None


def test_what_has_no_place_on_the_map_is_refused(tmp_path, capsys):
    words = ['bench', 'critical', '--sweeps', str(tmp_path)]
    assert cli.main(words) == 2
    assert 'no sweep files' in capsys.readouterr().err
    (tmp_path / 'one.yaml').write_text('model: train\nvary: {seed: [1, 2]}\n')
    assert cli.main(words) == 2
    assert 'one.yaml: model train has no place on the map' in capsys.readouterr().err


def test_the_sweeps_of_the_map_are_right():
    found = {file.stem: spec.load(file) for file in critical.SWEEPS.glob('*.yaml')}
    assert set(found) == {'table', 'plate', 'table_hands', 'plate_hands'}
    assert all(one.model in critical.MODELS for one in found.values())
    parts = [spec.load(file) for file in critical.PARTS.glob('*.yaml')]
    assert len(parts) == 4 and all(one.model == 'table' for one in parts)


def test_rows_come_back_as_they_were_computed(tmp_path):
    made = table.Table(tmp_path / 'x.csv', 'table', {'eol_ros': '1'})
    row = dict.fromkeys(table.columns('table')) | {'task': 'ab' * 12, 'rows': 5, 'b_value': 0.1}
    filled = {name: 1 if value is None else value for name, value in row.items()}
    for name, column in table.columns('table').items():
        if column.kind is str and name != 'task':
            filled[name] = 'word'
        if column.kind is bool:
            filled[name] = True
    made.add([filled])
    made.close()
    assert list(table.rows_of(tmp_path / 'x.csv')) == [filled]
    (tmp_path / 'y.csv').write_text('a')
    (tmp_path / 'y.csv.json').write_text('{}')
    with pytest.raises(ConfigError, match='y.csv: not the table of a sweep'):
        table.rows_of(tmp_path / 'y.csv')

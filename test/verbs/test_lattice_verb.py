# SPDX-License-Identifier: Apache-2.0
import json
from fractions import Fraction

import numpy as np
import pytest

from eol_ros.cli import main
from eol_ros.lab.automaton.ofc import ExactAutomaton

pytestmark = pytest.mark.slow  # numba


def lattice(capsys, *words):
    code = main(['lattice', *map(str, words)])
    out = capsys.readouterr()
    return code, out.out, out.err


def test_the_json_is_what_was_promised(capsys):
    words = ('--size', 24, '--alpha', 0.2, '--events', 60_000, '--warmup', 100_000, '--json')
    code, out, _ = lattice(capsys, *words)
    report = json.loads(out)

    assert code == 0
    assert {
        'topplings_per_s',
        'events_per_s',
        'mean_size',
        'max_size',
        'ccdf',
        'nearest_tau',
        'tau_error',
    } <= set(report)
    assert report['topplings_per_s'] == pytest.approx(
        report['events_per_s'] * report['mean_size'], rel=1e-6
    )
    assert report['ccdf']['1'] == 1
    falling = list(report['ccdf'].values())
    assert falling == sorted(falling, reverse=True)
    assert falling[-1] > 0 and int(list(report['ccdf'])[-1]) == report['max_size']
    assert report['rejected'] and 'tau' not in report  # a slope of no law has another name
    assert 1.6 < report['nearest_tau'] < 2.2
    assert 0 < report['tau_error'] < 0.1
    assert report['tau_interval'][0] < report['nearest_tau'] < report['tau_interval'][1]


def test_a_fraction_is_taken_exactly(capsys, tmp_path):
    out = tmp_path / 'events.npz'
    words = ('--size', 7, '--alpha', '1/5', '--events', 120, '--seed', 4, '--output', out, '--json')
    code, text, err = lattice(capsys, *words)
    start = np.random.default_rng(4).integers(0, 100_000, (7, 7))
    expected = ExactAutomaton(start, 100_000, Fraction(1, 5)).run(120)

    assert code == 0
    assert '120 events written' in err
    assert json.loads(text)['arithmetic'].startswith('exact')
    with np.load(out) as found:
        for name in ('size', 'area', 'duration', 'first'):
            np.testing.assert_array_equal(found[name], getattr(expected, name))


def test_a_start_file_is_taken_exactly_and_whole(capsys, tmp_path):
    start = np.random.default_rng(9).integers(0, 100_000, (6, 6))
    np.save(tmp_path / 's.npy', start)
    out = tmp_path / 'e.npz'
    words = ('--start', tmp_path / 's.npy', '--alpha', 0.2, '--events', 50, '--output', out)
    code, _, _ = lattice(capsys, *words)

    assert code == 0
    expected = ExactAutomaton(start, 100_000, Fraction(1, 5)).run(50)
    with np.load(out) as found:
        np.testing.assert_array_equal(found['size'], expected.size)


def test_warm_up_is_part_of_the_same_run(capsys, tmp_path):
    sizes = []
    for warmup, events in ((0, 3000), (2000, 1000)):
        out = tmp_path / f'{warmup}.npz'
        lattice(capsys, '--size', 16, '--events', events, '--warmup', warmup, '--output', out)
        with np.load(out) as found:
            sizes.append(found['size'])

    np.testing.assert_array_equal(sizes[0][2000:], sizes[1])


def test_too_few_events_are_told_instead_of_fitted(capsys):
    words = ('--size', 6, '--alpha', '1/5', '--events', 20)
    code, out, _ = lattice(capsys, *words)

    assert code == 0
    assert 'no law: too few events' in out


@pytest.mark.parametrize(
    ('words', 'code', 'message'),
    [
        (('--alpha', 'x'), 2, 'write a number like 0.2, or a fraction like 1/5'),
        (('--alpha', '1/0'), 2, 'write a number'),
        (('--alpha', '0.3'), 78, 'not between 0 and 1/4'),
        (('--size', 0), 2, '--size: 0 is outside 1 to 4096'),
        (('--fit', '2-9'), 2, 'like 2:200'),
        (('--fit', '1:999999999999'), 2, 'up to 10000000'),
        (('--start', 'none.npy'), 69, 'there is no file none.npy'),
        # told before the run, which would not end
        (('--output', '/nowhere/x.npz', '--size', 64, '--events', 10**9), 78, 'No such file'),
    ],
)
def test_mistakes_are_one_line(capsys, words, code, message):
    found, _, err = lattice(capsys, *words)
    line = err.strip().splitlines()[-1]

    assert found == code
    assert line.startswith('eol lattice: ') and message in line


def test_a_start_file_that_is_none(capsys, tmp_path):
    (tmp_path / 'a.npy').write_text('hello')
    np.save(tmp_path / 'b.npy', np.zeros((3, 3)))
    np.save(tmp_path / 'c.npy', np.zeros((3, 4), int))
    np.save(tmp_path / 'd.npy', np.full((3, 3), 100_000))
    for name, message in (
        ('a', 'not a .npy'),
        ('b', 'whole numbers'),
        ('c', 'square'),
        ('d', 'lie in 0..99999'),
    ):
        code, _, err = lattice(capsys, '--start', tmp_path / f'{name}.npy')
        assert code == 78 and message in err, name

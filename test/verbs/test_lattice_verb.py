# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest

from eol_ros.cli import main

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


def test_warm_up_is_part_of_the_same_run(capsys, tmp_path):
    sizes = []
    for warmup, events in ((0, 3000), (2000, 1000)):
        out = tmp_path / f'{warmup}.npz'
        lattice(capsys, '--size', 16, '--events', events, '--warmup', warmup, '--output', out)
        with np.load(out) as found:
            sizes.append(found['size'])

    np.testing.assert_array_equal(sizes[0][2000:], sizes[1])


def test_too_few_events_are_told_instead_of_fitted(capsys):
    words = ('--size', 6, '--events', 20)
    code, out, _ = lattice(capsys, *words)

    assert code == 0
    assert 'no law: too few events' in out


@pytest.mark.parametrize(
    ('words', 'code', 'message'),
    [
        (('--alpha', 'x'), 2, 'is not a number; units are left out'),
        (('--alpha', '0.3'), 2, '--alpha: 0.3 is outside 0 to 0.25'),
        (('--size', 0), 2, '--size: 0 is outside 1 to 4096'),
        (('--fit', '2-9'), 2, 'like 2:200'),
        (('--fit', '1:20001'), 2, 'up to 20000'),
        # told before the run, which would not end
        (('--output', '/nowhere/x.npz', '--size', 64, '--events', 10**9), 78, 'No such file'),
        (('--output', '', '--size', 64, '--events', 10**9), 78, 'Is a directory'),
    ],
)
def test_mistakes_are_one_line(capsys, words, code, message):
    found, _, err = lattice(capsys, *words)
    line = err.strip().splitlines()[-1]

    assert found == code
    assert line.startswith('eol lattice: ') and message in line

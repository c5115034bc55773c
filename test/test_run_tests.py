# SPDX-License-Identifier: Apache-2.0
"""What `make test` calls green, and what its last lines say of tests that were tried again."""

import sys

import pytest
from support.checkout import ROOT

sys.path.insert(0, str(ROOT / 'tools'))

import run_tests


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Run the runner on the failures {test: reason} of the first try, and of the second."""
    monkeypatch.setattr(run_tests, 'RECORD', tmp_path / 'cache' / 'record.json')
    monkeypatch.setattr(run_tests, 'compile_tests', lambda: None)
    tried = []

    def of(first, again=None, words=()):
        def part(selection, paths, given):
            tried.append(paths)
            failed = again if not selection else first if 'not live' in selection[-1] else {}
            left = {'passed': 10, 'failed': len(failed), 'error': 0, 'skipped': 0}
            seconds = {f'test_{n}.py': n for n in range(12)}
            found = {'counts': left, 'skipped': {}, 'failed': failed, 'seconds': seconds}
            return int(bool(failed)), found

        monkeypatch.setattr(run_tests, 'run_part', part)
        monkeypatch.setattr(sys, 'argv', ['run_tests.py', *words])
        code = run_tests.main()
        before, after = capsys.readouterr().out.split('everything was tested\n')
        of.before = before.splitlines()
        return code, after.splitlines()

    of.tried = tried
    return of


def test_the_ten_slowest_files_are_named(run):
    run({'a': 'late'}, {})
    slowest = run.before[run.before.index('the slowest files:') :]
    assert run.before[-len(slowest) - 1] == 'side by side: 0 s; one by one, in real time: 0 s'
    # The two parts are added up, and the second try is left out.
    assert slowest[1] == '     22 s  test_11.py'
    assert slowest[-2:] == ['      4 s  test_2.py', '']


def test_what_passed_when_tried_again_is_named_with_its_reason(run):
    code, lines = run({'a': 'late by 3 s', 'b': 'x', 'c': 'y'}, {})
    assert code == 0
    assert run.tried[-1] == ['a', 'b', 'c']
    assert lines[0] == 'passed only when tried again: a: late by 3 s'
    assert len(lines) == 4


def test_what_fails_again_is_red(run):
    code, lines = run({'a': 'late', 'b': 'x'}, {'b': 'y'})
    assert code == 1
    assert lines == [
        'failed: b: y', 'passed only when tried again: a: late', '30 passed, 1 failed, 0 skipped'
    ]  # fmt: skip


def test_more_than_three_are_not_tried_again(run):
    code, lines = run(dict.fromkeys('abcd', 'late'))
    assert code == 1
    assert len(run.tried) == 2
    assert lines[0] == '4 tests failed: only up to 3 are tried again'
    assert lines[1] == 'failed: a: late'


def test_twice_in_ten_runs_is_a_defect(run):
    said = 'a defect, tried again twice in 10 runs: a'
    assert said not in run({'a': 'late'}, {})[1]
    for _ in range(8):
        run({})
        run({'a': 'late'}, {}, words=['-k', 'a'])  # of a few tests: not remembered
    assert said in run({'a': 'late'}, {})[1]
    for _ in range(9):
        run({})
    assert said not in run({'a': 'late'}, {})[1]

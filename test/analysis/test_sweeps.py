# SPDX-License-Identifier: Apache-2.0
"""Sweep files, tables that are resumed, and workers that are killed."""

import contextlib
import csv
import hashlib
import json
import os
import signal
import subprocess
import sys
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest
from support.sweeps import computed

from eol_ros import cli
from eol_ros.errors import ConfigError, EolError, UsageError
from eol_ros.lab.science import sweep
from eol_ros.lab.sweeps import crews, spec, table, work
from eol_ros.lab.sweeps.run import Counts, run

AUTOMATA = """
model: ofc
fixed: {events: 20000, warmup: 3e3, bootstrap: 20}
vary:
  size: [8, 12]
  alpha: {from: 0.15, to: 0.2, steps: 3}
  seed: {from: 1, to: 4}
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name='sweep.yaml'):
        path = tmp_path / name
        path.write_text(text.replace('3e3', '3000'))
        return path

    return write


def test_every_combination_is_one_task(write):
    found = spec.load(write(AUTOMATA))
    tasks = list(found.tasks())
    defaults = sweep.Ofc()

    assert len(found) == len(tasks) == 24
    assert len({sweep.key('ofc', task) for task in tasks}) == 24
    assert {task['alpha'] for task in tasks} == {0.15, 0.175, 0.2}
    assert {task['seed'] for task in tasks} == {1, 2, 3, 4}
    assert all(task['fit_to'] == defaults.fit_to and task['warmup'] == 3000 for task in tasks)


def test_yaml_takes_some_numbers_for_text_and_the_sweep_does_not(write):
    given = 'model: plate\nfixed: {speed_mps: 5e-4}\nvary: {stiffness_ratio: {from: 1, to: 4, '
    found = spec.load(write(given + 'steps: 3, spacing: log}}'))

    assert found.fixed['speed_mps'] == 5e-4
    assert found.varied['stiffness_ratio'] == pytest.approx([1, 2, 4])


@pytest.mark.parametrize(
    'text, said',
    [
        ('model: plat', "1:8 error model: 'plat' is none. Did you mean plate?"),
        ('fixed: {rows: 3}', '1:1 error model: is missing'),
        ('model: ofc\nvaries: {}', '2:1 error varies: no such key. Did you mean vary?'),
        ('model: ofc\nvary: {sise: [3]}', '2:8 error vary.sise: ofc has no such parameter. Did '),
        ('model: ofc\nfixed:\n  alpha: 0.3', '3:10 error fixed.alpha: 0.3 is out of range (0 to'),
        ('model: ofc\nvary:\n  seed: [1, 1]', '3:9 error vary.seed: a value stands twice'),
        ('model: ofc\nvary:\n  seed: {from: 4}', '3:9 error vary.seed: lacks to'),
        ('model: ofc\nvary:\n  seed: {from: 4, to: 2}', '3:9 error vary.seed: from 4 to 2: rising'),
        ('model: ofc\nvary: {alpha: {from: 0, to: 0.2}}', '2:15 error vary.alpha: lacks steps'),
        ('model: ofc\nvary: {alpha: 0.2}', '2:15 error vary.alpha: a list, or {from: A, to: B}'),
        ('model: table\nfixed: {drive: shove}', "2:16 error fixed.drive: 'shove' is not one of"),
        ('model: table\nfixed: {rows: 2.5}', '2:15 error fixed.rows: 2.5 is not a whole number'),
        ('model: ofc\nfixed: {seed: 1}\nvary: {seed: [2]}', '3:8 error vary.seed: stands under'),
        ('model: ofc\nfixed: [', 'error not YAML'),
        ('- 1', '1:1 error a sweep is a mapping with the keys model, fixed, vary'),
    ],
)
def test_a_mistake_names_its_key_and_its_place(write, text, said):
    path = write(text)
    with pytest.raises(spec.SpecError) as error:
        spec.load(path)

    assert f'{path}:' in str(error.value) and said in str(error.value)


def test_all_mistakes_are_said_at_once(write):
    path = write('model: ofc\nfixed: {alpha: 1}\nvary: {size: [0, x], sede: [1]}')
    with pytest.raises(spec.SpecError) as error:
        spec.load(path)

    assert str(error.value).splitlines()[-1] == '4 errors. Nothing was computed.'


class Here(Executor):
    """Computes in this process, at once; what is done is taken in any order."""

    def submit(self, compute, *given):
        future = Future()
        future.set_result(compute(*given))
        return future


def here(executor=Here):
    return contextlib.nullcontext(crews.Crew(executor(), lambda: 2))


@pytest.fixture(autouse=True)
def one_thread(monkeypatch):
    monkeypatch.setenv(work.THREADS, '1')


@pytest.mark.parametrize('suffix', ['.csv', '\udcff.csv'])
def test_a_table_is_resumed_and_added_to_and_the_same_to_the_bit(
    write, tmp_path, suffix, monkeypatch
):
    monkeypatch.setattr('eol_ros.lab.sweeps.run.BATCH_S', 0.0)  # a batch is one task
    given = spec.load(write(AUTOMATA))
    whole = computed(tmp_path / f'whole{suffix}', given, here())

    path = tmp_path / f'parts{suffix}'

    def stop(count):
        if count >= 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        computed(path, given, here(), stop)
    fewer = spec.load(write(AUTOMATA.replace('to: 4', 'to: 2')))
    computed(path, fewer, here())
    rows = table.Table(path, 'ofc', work.version())
    there = len(rows)
    rows.close()
    again = Counts()
    rows = table.Table(path, 'ofc', work.version())
    with here() as crew:
        assert sum(1 for _ in run(given, rows, crew, again)) == again.done
    rows.close()

    assert 12 <= there < 24 and again.done == 24 - there
    assert hashlib.sha256(path.read_bytes()).hexdigest() == whole


def test_a_killed_sweep_loses_what_was_not_written_yet_and_no_more(write, tmp_path, monkeypatch):
    given = spec.load(write(AUTOMATA))
    whole = computed(tmp_path / 'whole.csv', given, here())
    path = tmp_path / 'killed.csv'
    monkeypatch.setattr(table, 'FLUSH_S', 0.0)
    monkeypatch.setattr('eol_ros.lab.sweeps.run.MOST_IN_BATCH', 4)  # it stops amid the table
    rows = table.Table(path, 'ofc', work.version())
    with here() as crew:
        for count in run(given, rows, crew, Counts()):
            if count == 15:
                break
    rows._file.close()  # as the kernel does for a process that is killed
    with path.open('ab') as file:
        file.write(b'8,0.15,ha')

    later = table.Table(path, 'ofc', work.version())
    kept = len(later)
    later.close()

    assert 15 <= kept < 24
    assert computed(path, given, here()) == whole


@pytest.mark.parametrize('areas', [1, 40_000])
def test_a_table_is_resumed_whatever_its_rows_are_long(tmp_path, areas):
    rows = table.Table(tmp_path / 'a.csv', 'ofc', work.version())
    columns = list(rows._columns)
    row = dict.fromkeys(columns) | {'task': 'one', 'areas': ','.join(map(str, range(areas)))}
    rows._write([[table._text(row[name]) for name in columns]])
    rows.close()
    whole = (tmp_path / 'a.csv').read_bytes()
    for torn in (b'8,0.15,' + b'9,' * 40_000, b''):
        (tmp_path / 'a.csv').write_bytes(whole + torn)
        again = table.Table(tmp_path / 'a.csv', 'ofc', work.version())
        assert again.has('one') and len(again) == 1
        again.close()
        assert (tmp_path / 'a.csv').read_bytes() == whole
    (tmp_path / 'a.csv').write_bytes(whole[:9])  # the disk was full at the header
    again = table.Table(tmp_path / 'a.csv', 'ofc', work.version())
    again.close()
    assert (tmp_path / 'a.csv').read_bytes() == whole.splitlines(keepends=True)[0]
    (tmp_path / 'a.csv').write_bytes(whole + b'8,0\x00\n')
    with pytest.raises(ConfigError, match='damaged'):
        table.Table(tmp_path / 'a.csv', 'ofc', work.version())


def test_two_sweeps_do_not_write_to_one_table(tmp_path):
    first = table.Table(tmp_path / 'a.csv', 'ofc', work.version())
    with pytest.raises(ConfigError, match='another sweep writes to it'):
        table.Table(tmp_path / 'a.csv', 'ofc', work.version())
    first.close()


def test_rows_of_another_version_or_model_are_refused_with_both(write, tmp_path):
    path = tmp_path / 'a.csv'
    few = AUTOMATA.replace('[8, 12]', '[8]').replace('to: 4', 'to: 2')
    computed(path, spec.load(write(few)), here())
    other = work.version() | {'numpy': '1.0.0'}

    with pytest.raises(ConfigError, match=f'numpy {work.version()["numpy"]}, here is numpy 1.0.0'):
        table.Table(path, 'ofc', other)
    with pytest.raises(ConfigError, match='the table of a sweep over ofc; give another file'):
        table.Table(path, 'plate', work.version())
    with pytest.raises(UsageError, match=r'end in \.csv'):
        table.Table(tmp_path / 'a.xls', 'ofc', work.version())
    (tmp_path / 'b.csv').write_text('nonsense')
    with pytest.raises(ConfigError, match=r'b\.csv\.json, which describes it, cannot be read'):
        table.Table(tmp_path / 'b.csv', 'ofc', work.version())


def test_the_file_says_its_units_and_where_it_is_from(write, tmp_path):
    path = tmp_path / 'a.csv'
    given = 'model: train\nfixed: {travel_m: 0.1, blocks: 2}'
    computed(path, spec.load(write(given)), here())
    about = json.loads((tmp_path / 'a.csv.json').read_text())
    with path.open(newline='') as file:
        (row,) = csv.DictReader(file)

    assert about['units']['speed_mps'] == 'm/s' and float(row['travel_m']) == 0.1
    assert about['made_by'] == work.version() and about['model'] == 'train'
    assert list(row) == about['columns'] == list(table.columns('train'))


def test_memory_holds_a_few_batches_whatever_there_is_to_do(write):
    text = 'model: ofc\nfixed: {size: 1, events: 1, warmup: 0}\nvary: {seed: {from: 1, to: 90000}}'
    given = spec.load(write(text))
    in_hand, most = [0], []

    class Counting(Here):
        def submit(self, compute, do, batch, made_by):
            in_hand[0] += len(batch.tasks)
            most.append(in_hand[0])
            row = sweep.Result('ok')
            rows = [table.row_of(k, p, row) for k, p in batch.tasks]
            return super().submit(lambda: (rows, 1e-3 * len(rows)))

    class Sink:
        has = lambda *_: False  # noqa: E731
        __len__ = lambda self: 0  # noqa: E731

        def add(self, rows):
            in_hand[0] -= len(rows)

    with here(Counting) as crew:
        done = sum(1 for _ in run(given, Sink(), crew, Counts()))

    assert done == 90_000
    assert max(most) <= 6 * 1000


@pytest.mark.slow
def test_the_death_of_a_worker_names_a_task_and_the_sweep_can_be_resumed(write, tmp_path):
    given = spec.load(write(AUTOMATA))
    whole = computed(tmp_path / 'whole.csv', given, crews.local(1))
    path = tmp_path / 'killed.csv'
    with crews.local(1) as crew:

        def kill(count):
            if count == 2:
                os.kill(next(iter(crew.executor._processes)), signal.SIGKILL)

        with pytest.raises(EolError, match="a worker process died .*'size': "):
            computed(path, given, contextlib.nullcontext(crew), kill)

    assert len(path.read_text().splitlines()) < 25
    assert computed(path, given, crews.local(2)) == whole


def test_the_command_computes_counts_and_goes_on(write, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    few = AUTOMATA.replace('[8, 12]', '[8]').replace('to: 4', 'to: 2')
    path = write(few)

    assert cli.main(['sweep', str(path), '--count', '--json']) == 0
    assert json.loads(capsys.readouterr().out) == {'tasks': 6}
    assert cli.main(['sweep', str(path), '--workers', '1', '--json']) == 0
    first = json.loads(capsys.readouterr().out)
    assert cli.main(['sweep', str(path), '--json']) == 0
    second = json.loads(capsys.readouterr().out)

    assert first['computed'] == first['rows'] == 6 and first['missing'] == 0
    assert second['computed'] == 0 and second['rows'] == 6
    assert len((tmp_path / 'sweep.csv').read_text().splitlines()) == 7
    assert cli.main(['sweep', str(path), '--workers', '0', '--output', 'b.csv']) == 2
    assert cli.main(['sweep', str(write('model: ofc\nfixed: {sze: 3}'))]) == os.EX_CONFIG
    assert 'sweep.yaml:2:9 error fixed.sze' in capsys.readouterr().err
    assert cli.main(['sweep', '--parameters', 'plate']) == 0
    assert 'stiffness_ratio' in capsys.readouterr().out


def test_sigterm_keeps_what_is_done(write, tmp_path):
    path = write(AUTOMATA.replace('20000', '400000'))
    command = [sys.executable, '-m', 'eol_ros', 'sweep', str(path), '--workers', '1', '--json']
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {'PYTHONPATH': str(Path(__file__).parents[2])},
    ) as process:  # fmt: skip
        assert any('10 %' in line for line in iter(process.stderr.readline, ''))
        process.terminate()
        out, err = process.communicate(timeout=60)
    words = json.loads(out)

    assert process.returncode == 0
    assert words['rows'] == words['computed'] == 24 - words['missing'] > 0
    assert 'the same command goes on' in err

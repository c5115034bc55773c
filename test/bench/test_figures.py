# SPDX-License-Identifier: Apache-2.0
"""`eol bench figures`: what is done is not run again; what is old, lost or interrupted is."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmarks import critical, figures
from eol_ros import cli
from eol_ros.errors import EolError

ROOT = Path(__file__).parents[2]


@pytest.fixture
def places(tmp_path):
    """Where nothing is drawn yet, with a page that has a place for the table."""
    (tmp_path / 'img').mkdir()
    page = tmp_path / 'science.md'
    page.write_text(f'before\n{figures.BEGIN}\nold\n{figures.END}\nafter\n')
    return figures.Places(tmp_path / 'img', page, tmp_path / 'work')


@pytest.fixture
def ran(monkeypatch):
    """Benchmarks that write their figure at once: which ran, and which shall fail."""

    class Ran(list):
        fails: frozenset = frozenset()

    names = Ran()

    def bench(words, stdout, **more):
        name, folder = words[4], Path(words[words.index('--plot') + 1])
        names.append(name)
        if name in names.fails:
            return subprocess.CompletedProcess(words, 1)
        for part in figures.PARTS.values():
            if part.words[0] == name:
                for one in part.draws:
                    (folder / f'{one}.png').write_bytes(name.encode())
        stdout.write(f'table of {name}\n')
        return subprocess.CompletedProcess(words, 0)

    monkeypatch.setattr(figures.subprocess, 'run', bench)
    return names


def todo(places):
    return {n: p for n, p in figures.PARTS.items() if figures.state(n, p, places) != figures.DONE}


def test_a_part_that_is_done_is_not_run_again_and_one_that_failed_is(places, ran):
    ran.fails = frozenset({'mapping'})
    with pytest.raises(EolError, match='^mapping: not drawn'):
        figures.draw(todo(places), places)
    assert len(ran) == len(figures.PARTS)  # the others have run all the same
    assert list(todo(places)) == ['mapping'] and not (places.images / 'mapping.png').exists()

    ran.clear()
    ran.fails = frozenset()
    figures.draw(todo(places), places)
    assert ran == ['mapping'] and not todo(places)
    assert (places.work / 'mapping/printed.txt').read_text() == 'table of mapping\n'
    assert not list(places.work.glob('*.spent'))


def test_other_sources_another_command_or_a_lost_figure_are_told(places, ran, monkeypatch):
    figures.draw(todo(places), places)
    (places.images / 'collapse.png').unlink()
    records = figures.read_records(places)
    records['mapping']['command'] = 'eol bench mapping --seconds 160'
    records['table']['made_by'] |= {'sources': 'others', 'numpy': '1.0'}
    places.records.write_text(json.dumps(records))

    said = {n: figures.state(n, p, places) for n, p in figures.PARTS.items()}
    assert said['sizes'] == 'collapse.png not there'
    assert said['mapping'] == 'drawn by eol bench mapping --seconds 160'
    assert said['table'] == 'drawn with other sources, numpy'
    assert said['definitions'] == said['lyapunov'] == said['critical'] == figures.DONE


def test_a_figure_is_old_when_what_it_rests_on_has_changed(tmp_path):
    """Code that is reached, and files: not comments (`test_source_digests.py` has more)."""
    part = figures.Part(('own',), ('own',), '1', 'none', 1.0, ('eol_ros.core.named',), ('sweeps',))
    files = {
        'eol_ros/core/used.py': 'WIDTH = 1\n', 'eol_ros/core/named.py': 'DEEP = 1\n',
        'eol_ros/core/other.py': 'HIGH = 1\n', 'sweeps/b.yaml': 'seed: 1\n',
        'benchmarks/picture.py': 'FOOT = 1\n',
        'benchmarks/own.py': 'from eol_ros.core.used import WIDTH\nSEEDS = 1\n'
        'def add_arguments(parser): pass\ndef run(args): return SEEDS * WIDTH\n',
    }  # fmt: skip
    for package in ('eol_ros', 'eol_ros/core', 'benchmarks'):
        files[f'{package}/__init__.py'] = ''
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    first = figures.made_by(part, tmp_path)
    for name, text in files.items():
        for changed in (text + '# said\n', text.replace('1', '2')):
            (tmp_path / name).write_text(changed)
            alike = changed.startswith(text) or name == 'eol_ros/core/other.py'
            assert (figures.made_by(part, tmp_path) == first) is alike, (name, changed)
        (tmp_path / name).write_text(text)


def test_vectors_count_where_bodies_rotate_and_the_settings_of_others_never(tmp_path):
    """The two faults that a digest of whole folders had."""
    for name in ('eol_ros', 'benchmarks', 'config', 'examples'):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns('static'))
    table = figures.PARTS['table']
    first = figures.made_by(table, tmp_path)
    for name, before, after, alike in (
        ('eol_ros/settings.py', 'PanelSettings:\n', 'PanelSettings:\n    more: int = 1\n', True),
        ('eol_ros/core/vectors.py', '\nWIDTH = 8', '\nWIDTH = 4', False),
    ):  # fmt: skip
        text = (tmp_path / name).read_text()
        assert before in text
        (tmp_path / name).write_text(text.replace(before, after, 1))
        assert (figures.made_by(table, tmp_path) == first) is alike, name


def test_what_was_spent_before_an_interruption_counts(places, ran, monkeypatch):
    name, part = 'mapping', figures.PARTS['mapping']
    spent = places.work / f'{name}-{figures.made_by(part)["sources"]}.spent'
    places.work.mkdir()
    spent.write_text('600\n')
    figures.draw({name: part}, places)

    assert figures.read_records(places)[name]['processor_s'] >= 600
    row = next(r for r in places.page.read_text().splitlines() if r.startswith('| mapping.png'))
    assert row.endswith('| 10 min |')
    assert places.page.read_text().startswith('before') and 'old' not in places.page.read_text()


def test_of_a_part_that_keeps_its_tables_all_runs_count_or_none(places, ran, monkeypatch):
    part = {'critical': figures.PARTS['critical']}
    for spent_s, words in ((1500.0, '25 min'), (None, '?')):
        monkeypatch.setattr(critical, 'spent_s', lambda spent_s=spent_s: spent_s)
        figures.draw(part, places)
        assert figures.read_records(places)['critical']['processor_s'] == spent_s
        rows = places.page.read_text().splitlines()
        assert next(r for r in rows if r.startswith('| critical.png')).endswith(f'| {words} |')


def test_parts_are_all_figures_of_the_page_and_commands_that_there_are():
    page = (ROOT / 'docs/science.md').read_text()
    drawn = {f'img/{d}.png' for part in figures.PARTS.values() for d in part.draws}
    assert drawn == set(re.findall(r'\((img/[a-z_]+\.png)\)', page))
    for part in figures.PARTS.values():
        assert f'`{part.command}`' in page
        for name in part.files:
            assert (ROOT / name).exists(), name


def test_the_list_runs_nothing(ran, capsys):
    assert cli.main(['bench', 'figures', '--list', '--json']) == 0
    rows = json.loads(capsys.readouterr().out)['parts']
    assert [row['part'] for row in rows] == list(figures.PARTS)
    assert all(row['expected_s'] > 0 and row['state'] for row in rows) and not ran
    assert cli.main(['bench', 'figures', 'nothing']) == 2
    assert 'no such part' in capsys.readouterr().err

# SPDX-License-Identifier: Apache-2.0
"""The generated docs are up to date, and the docs point at what is there."""

import argparse
import dataclasses
import difflib
import functools
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from catkin_pkg.changelog import BulletList, Changelog, populate_changelog_from_rst
from support.checkout import tracked

from assets import sheet
from eol_ros import cli
from eol_ros.settings import NotifySettings, renamed
from eol_ros.streams.graph import NODES, TOPICS

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').rglob('*.md'))]
# `v0.2.0: eol bench X` or a commit's number: a command of that version, which has left since.
COMMAND = r'(?<!v0\.2\.0: )(?<![0-9a-f]{8}: )(?:\beol|-m eol_ros) (\w+)((?: [^\s`|>#]+)*)'
each_page = pytest.mark.parametrize('page', PAGES, ids=lambda p: p.name)


def test_generated_docs_are_up_to_date():
    result = subprocess.run(
        [sys.executable, ROOT / 'tools' / 'generate_docs.py', '--check'],
        capture_output=True,
        text=True,
    )

    assert result.returncode == 0, result.stderr


def test_the_table_of_nodes_says_what_each_does():
    page = (ROOT / 'docs/reference/topics.md').read_text()
    table = page.split('## Nodes')[1].split('## Topics')[0]
    rows = [row.split(' | ') for row in table.strip().splitlines()[2:]]

    assert [row[0].strip('| `') for row in rows] == list(NODES)
    for name, says, *_ in rows:  # a verb comes first: `Records every topic ...`
        assert re.match(r'[A-Z][a-z]+s ', says), f'{name}: {says}'


@functools.cache
def anchors(page):
    """The fragments under which GitHub links the titles of a page."""
    titles = re.findall(r'^#+ (.*)', page.read_text(), re.M)
    return {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}


def test_the_site_builds_without_a_warning_and_asks_no_other_server(tmp_path):
    """Broken links and pages that no menu names are warnings."""
    words = ['-m', 'sphinx', '-q', '-E', '-W', '--keep-going', '-b', 'html']
    done = subprocess.run(
        [sys.executable, *words, ROOT / 'docs', tmp_path], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'searchindex.js').stat().st_size > 100_000
    for page in tmp_path.rglob('*.html'):
        fetched = re.findall(
            r'<(?:script|img|link|iframe)[^>]*?(?:src|href)="([^"]+)"', page.read_text()
        )
        assert not [url for url in fetched if '//' in url], page
    assert sheet.main(tmp_path) == 0
    if sheet.CHROMIUM:
        assert len(re.findall(rb'/Type\s*/Page\b', (tmp_path / 'year.pdf').read_bytes())) == 2
        search = f'{(tmp_path / "search.html").as_uri()}?q=attendant+morning+xylophone'
        found = sheet.browse(search, '--virtual-time-budget=5000', '--dump-dom')
        assert 'href="guides/year.html"' in found.split('id="search-results"')[1]


@each_page
def test_links_lead_somewhere(page):
    for target, _, anchor in re.findall(r'\]\(([^)#]*)(#([^)]*))?\)', page.read_text()):
        if not target.startswith('http'):
            there = page.parent / target if target else page
            assert there.exists(), target
            assert not anchor or anchor in anchors(there), f'{target}#{anchor}'


@each_page
def test_sources_that_are_named_are_there(page):
    for name in re.findall(r'`([\w./]+\.(?:py|c|h))`', page.read_text()):
        if Path(name).stem.lower() != 'name':  # stands for any
            assert any(f'/{path}'.endswith(f'/{name}') for path in tracked(ROOT)), name


RECORDS = sorted((ROOT / 'docs' / 'adr').glob('[0-9]*.md'))


def test_decision_records_are_short_numbered_and_in_the_index():
    index = re.findall(
        r'^- \[(\d+)\. (.*)\]\((.*)\)$', (ROOT / 'docs/adr/README.md').read_text(), re.M
    )

    assert 0 < len(RECORDS) <= 60
    assert [name for *_, name in index] == [record.name for record in RECORDS]
    for count, (record, (number, title, _)) in enumerate(zip(RECORDS, index, strict=True), 1):
        text = record.read_text()
        assert number == f'{count:03}' and record.name.startswith(f'{number}-'), record.name
        assert text.startswith(f'# {number}. {title}\n\nAccepted, 20'), record.name
        assert re.search(
            r'\*\*Context\.\*\*.*\*\*Decision\.\*\*.*\*\*Rejected\.\*\*', text, re.S
        ), record.name
        assert len(text.split()) <= 150, record.name


def test_each_dependency_has_a_line_in_the_decision_records():
    lists = (ROOT / 'setup.py').read_text().partition('RUNTIME = [')[2].partition('COLCON')[0]
    records = '\n'.join(record.read_text() for record in RECORDS)
    for name in re.findall(r"'([\w-]+)[\[><=']", lists):
        assert re.search(rf'^- .*`{name}`', records, re.M), name


@functools.cache
def options(module):
    """The options of a verb or a benchmark, those of its actions too."""
    parsers = [cli.Parser()]
    module.add_arguments(parsers[0])
    for parser in parsers:
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                parsers += action.choices.values()
    return {option for parser in parsers for option in parser._option_string_actions}


@each_page
def test_options_that_are_named_are_understood(page):
    text = re.sub(r'[ \t]*\n(?=\S)', ' ', page.read_text())  # a command may be broken over lines
    for verb, words in re.findall(COMMAND, text):
        words = words.split()
        if verb == 'bench' and words and re.fullmatch(r'[a-z_]+', words[0]):
            module = importlib.import_module(f'benchmarks.{words[0]}')
        elif verb in cli.VERBS and verb not in ('bench', 'run'):  # `run` takes ROS arguments, too
            module = importlib.import_module(f'eol_ros.verbs.{verb}')
        else:
            continue
        named = {
            word.partition('=')[0].rstrip('.,;:)')
            for word in words
            if len(word) > 2 and word[:2] == '--'
        }
        assert named <= options(module), f'eol {verb} {" ".join(words)}'


def test_the_changelog_is_one_line_a_thing_as_catkin_reads_it():
    text = (ROOT / 'CHANGELOG.rst').read_text()
    groups = {'Added', 'Changed', 'Deprecated', 'Removed', 'Fixed', 'Security'}
    assert set(re.findall(r'^\*\*(\w+)\*\*', text, re.M)) <= groups
    assert not re.search(r'^-+\n\* ', text, re.M), 'a line without a group'
    for node, spec in NODES.items():
        for old, new in renamed(spec.settings).items():
            assert f'``{node}.{old}`` -> ``{node}.{new}``' in text
    released = text.replace('Forthcoming\n-----------', f'9.0.0 (2100-01-01)\n{"-" * 18}')
    log = Changelog('eol_ros')
    populate_changelog_from_rst(log, released)
    found = {version: content for version, _, content in log.foreach_version()}
    assert list(found) == re.findall(r'^(\d+\.\d+\.\d+) \(', released, re.M)[::-1]
    for content in found.values():
        lines = [str(i) for part in content if isinstance(part, BulletList) for i in part.bullets]
        assert lines and not [line for line in lines if len(line.split()) > 25]


def test_files_for_the_forge_are_yaml_of_this_version():
    for name in tracked(ROOT):
        if name.startswith('.github/') and name.endswith('.yml'):
            assert isinstance(yaml.safe_load((ROOT / name).read_text()), dict), name
    version = re.search('<version>(.*)</version>', (ROOT / 'package.xml').read_text())[1]
    assert yaml.safe_load((ROOT / 'CITATION.cff').read_text())['version'] == version


def test_the_readme_is_read_in_five_minutes():
    assert len((ROOT / 'README.md').read_text().split()) < 1000


def test_the_snippet_of_the_readme_runs():
    """Word for word, on the bag that ships, in a process without ROS."""
    section = (ROOT / 'README.md').read_text().split('## Read a bag without ROS')[1]
    snippet = re.search(r'```python\n(.*?)```', section, re.S)[1]
    barred = 'import sys\nsys.modules.update(rclpy=None, eol_msgs=None)\n'
    done = subprocess.run(
        [sys.executable, '-c', barred + snippet], cwd=ROOT, capture_output=True, text=True
    )

    assert done.returncode == 0, done.stderr
    found = re.fullmatch(r'(\d+) slips; the longest moved (\d\.\d+) m\n', done.stdout)
    assert found and int(found[1]) > 100 and 0.01 < float(found[2]) < 1


@pytest.mark.parametrize('kind', [*(n.settings for n in NODES.values()), NotifySettings])
def test_the_text_of_a_setting_stands_alone(kind):
    """As `ros2 param describe` shows it: without the settings above and below."""
    for field in dataclasses.fields(kind):
        text = field.metadata['doc']
        assert not re.match(
            r"(of|by|and|with|while|what|how|when|who|whose|which|its?|that|this|so|the same|a"
            r' guess)\b', text), f'{field.name}: {text}'  # fmt: skip
        assert len(text.split()) > 1 and not text.endswith('.'), f'{field.name}: {text}'


FOREIGN = {
    'ROS_LOG_DIR',
    'camera_aravis2',
    'camera_ros',
    'colcon_defaults',
    'dask',
    'dataframe',
    'foxglove_bridge',
    'image_size',
    'llvm.fmuladd',
    'message_lost',
    'output_encoding',
    'pixel_format',
    'pylon_ros2_camera',
    'robot_description',
    'spinnaker_camera_driver',
    'v4l2_camera',
}


@pytest.fixture(scope='module')
def code():
    """The code, and the names of its files."""
    files = [ROOT / path.lstrip('/') for path in tracked(ROOT)]
    prose = ('.md', '.rst', '.svg', '.svgz')
    texts = [f.read_text(errors='ignore') for f in files if f.suffix not in prose and f.is_file()]
    return '\n'.join([*map(str, files), *texts])


@pytest.fixture(scope='module')
def known(code):
    """All words of the code."""
    return {*re.findall(r'[A-Za-z_]\w*', code)} | FOREIGN


@each_page
def test_names_in_back_quotes_are_in_the_code(page, code, known):
    """A dotted name is in the code as written, a setting of a node or a file of an example."""
    for name in re.findall(r'`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\(\))?`', page.read_text()):
        first, _, last = name.rpartition('.')
        if first:
            setting = first in NODES and hasattr(NODES[first].settings, last)
            example = last in ('csv', 'jpg', 'yaml') and known.issuperset(name.split('.'))
            assert name in code or setting or example or name in FOREIGN, name
        elif '_' in name:  # a single word may be plain English
            assert name in known, name


def public_names():
    """Yield the names of topics, nodes, settings, messages, their fields, verbs and options."""
    yield from TOPICS
    for name, node in NODES.items():
        yield name
        yield from (field.name for field in dataclasses.fields(node.settings))
    for path in sorted((ROOT / 'msg_defs').rglob('*.msg')):
        yield re.sub(r'(?<=[a-z])(?=[A-Z])', '_', path.stem)
        yield from re.findall(r'^[\w/]+[\d\[\]<=]* +([a-z]\w*)', path.read_text(), re.M)
    yield from cli.VERBS
    for verb in set(cli.VERBS) - {'bench', 'run'}:  # of benchmarks, of ROS
        module = importlib.import_module(f'eol_ros.verbs.{verb}')
        yield from (option.lstrip('-') for option in options(module))


def test_public_names_are_made_of_words_of_the_glossary():
    known = set(re.findall(r'[a-z]+', (ROOT / 'docs/reference/glossary.md').read_text().lower()))
    for name in public_names():
        for word in re.findall(r'[a-z]+', name.lower()):
            assert {word, word.removesuffix('s')} & known, (
                f'{name}: {word} is not in docs/reference/glossary.md; is it '
                f'{difflib.get_close_matches(word, known, 1, 0)[0]}?'
            )

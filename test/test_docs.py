# SPDX-License-Identifier: Apache-2.0
"""The generated docs are up to date, and the docs point at what is there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from eol_ros.streams.graph import NODES

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]


def test_generated_docs_are_up_to_date():
    result = subprocess.run(
        [sys.executable, ROOT / 'tools' / 'generate_docs.py', '--check'],
        capture_output=True,
        text=True,
    )

    assert result.returncode == 0, result.stderr


def test_the_table_of_nodes_says_what_each_does():
    table = (ROOT / 'README.md').read_text().split('<!-- nodes -->')[1].split('<!-- /nodes')[0]
    rows = [row.split(' | ') for row in table.strip().splitlines()[2:]]

    assert [row[0].strip('| `') for row in rows] == list(NODES)
    for name, says, *_ in rows:  # a verb comes first: `Records every topic ...`
        assert re.match(r'[A-Z][a-z]+s ', says), f'{name}: {says}'


@pytest.mark.parametrize('page', PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r'\]\(([^)#]+)[^)]*\)', page.read_text()):
        if not target.startswith('http'):
            assert (page.parent / target).exists(), target


def test_the_snippet_of_the_readme_runs():
    """Word for word, on the bag that ships, in a process without ROS."""
    section = (ROOT / 'README.md').read_text().split('## Reading a bag without ROS')[1]
    snippet = re.search(r'```python\n(.*?)```', section, re.S)[1]
    barred = 'import sys\nsys.modules.update(rclpy=None, eol_msgs=None)\n'
    done = subprocess.run(
        [sys.executable, '-c', barred + snippet], cwd=ROOT, capture_output=True, text=True
    )

    assert done.returncode == 0, done.stderr
    found = re.fullmatch(r'(\d+) slips; the greatest went (\d\.\d+) m\n', done.stdout)
    assert found and int(found[1]) > 100 and 0.01 < float(found[2]) < 1

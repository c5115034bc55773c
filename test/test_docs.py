# SPDX-License-Identifier: Apache-2.0
"""The generated docs are up to date, and the docs point at what is there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]


def test_generated_docs_are_up_to_date():
    result = subprocess.run(
        [sys.executable, ROOT / 'tools' / 'generate_docs.py', '--check'], capture_output=True,
        text=True,
    )

    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize('page', PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r'\]\(([^)#]+)[^)]*\)', page.read_text()):
        if not target.startswith('http'):
            assert (page.parent / target).exists(), target

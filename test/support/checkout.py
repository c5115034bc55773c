# SPDX-License-Identifier: Apache-2.0
"""The repository as a user gets it, for the tests of packages and workspaces."""

import functools
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GIT = (ROOT / '.git').exists() and shutil.which('git')


def checkout(folder: Path) -> Path:
    """Make `folder` a real clone of the last commit; a copy where this tree is an sdist's."""
    if GIT:
        subprocess.run(['git', 'clone', '--quiet', ROOT, folder], check=True, timeout=60)
    else:
        made = shutil.ignore_patterns('.*', '__pycache__', '*.egg-info', 'build', 'bags')
        shutil.copytree(ROOT, folder, symlinks=True, ignore=made)
    return folder


@functools.cache
def tracked(folder: Path) -> set[str]:
    """Return the files of `checkout(folder)`, as paths within it; links count as files."""
    if not GIT:
        pytest.skip('only git knows which files belong to the repository')
    listed = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=folder, check=True, capture_output=True, text=True
    )
    return set(listed.stdout.split('\0')) - {''}

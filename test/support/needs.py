# SPDX-License-Identifier: Apache-2.0
"""What a test needs of the system: the packages of tools/system_packages.txt, by their probes."""

import ctypes
import os
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / 'tools'))

from run_tests import packages


def there(package):
    """Tell whether a system package, or something in its place, can be used."""
    kind, _, name = packages()[package][1].partition(':')
    if kind == 'command':
        return shutil.which(name) is not None
    if kind == 'library':
        try:
            ctypes.CDLL(name)
        except OSError:
            return False
        return True
    return os.path.isdir(name) and bool(os.listdir(name))


def reason(*names):
    """Return why a test cannot run and how to change that; empty where all packages are there."""
    missing = [name for name in names if not there(name)]
    return f'apt-get install {" ".join(missing)}' if missing else ''


def system(*names):
    """Skip a test where one of these system packages is missing."""
    if why := reason(*names):
        pytest.skip(why)


def marker(*names):
    """Return the mark that skips where one of these system packages is missing."""
    return pytest.mark.skipif(bool(reason(*names)), reason=reason(*names) or 'all there')

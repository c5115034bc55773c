# SPDX-License-Identifier: Apache-2.0
"""The digest of a computation's code changes with the modules that it can reach, and only then."""

import subprocess
import sys

import pytest

from eol_ros.analysis import sources

FILES = {
    'eol_ros/__init__.py': '',
    'eol_ros/own.py': '''
"""What is computed."""
from eol_ros.core import model
from eol_ros.settings import Table
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from eol_ros.core.absent import Absent

def add_arguments(parser):
    parser.add_argument('--seeds', default=3, help='how many')

def run(args):
    # why
    from eol_ros.core.late import late
    return model.solve(Table(), late())
''',
    'eol_ros/core/__init__.py': '',
    'eol_ros/core/model.py': '''
import eol_ros.core.vectors

def solve(table, late):
    """Return it."""
    return eol_ros.core.vectors.length(table.stiffness, late)
''',
    'eol_ros/core/vectors.py': 'def length(x, y):\n    return x + 2 * y\n',
    'eol_ros/core/late.py': 'def late():\n    return 1\n',
    'eol_ros/core/other.py': 'print(1)\n',
    'eol_ros/settings.py': '''
class Table:
    stiffness = setting(40.0, 'of a spring', 'N/m')
''',
}  # fmt: skip


@pytest.fixture
def checkout(tmp_path):
    """Write FILES, with another text in place of one; return their digest."""

    def write(*changes):
        for name, text in FILES.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        for name, before, after in changes:
            text = (tmp_path / name).read_text()
            assert before in text
            (tmp_path / name).write_text(text.replace(before, after, 1))
        return sources.digest(['eol_ros.own'], tmp_path)

    return write


@pytest.mark.parametrize(
    ('name', 'before', 'after'),
    [
        ('eol_ros/own.py', 'default=3', 'default=4'),
        ('eol_ros/core/model.py', 'late)\n', '2 * late)\n'),
        ('eol_ros/core/vectors.py', '2 * y', '3 * y'),
        ('eol_ros/core/late.py', '1', "''"),
        ('eol_ros/core/__init__.py', '', 'import os\nos.nice(1)\n'),
        ('eol_ros/__init__.py', '', 'import os\nos.nice(1)\n'),
        ('eol_ros/settings.py', '40.0', '41.0'),
    ],
)
def test_a_change_of_what_is_computed_changes_it(checkout, name, before, after):
    assert checkout((name, before, after)) != checkout()


@pytest.mark.parametrize(
    ('name', 'before', 'after'),
    [
        ('eol_ros/own.py', 'how many', 'how many starts'),
        ('eol_ros/own.py', '"""What is computed."""', '"""What is computed\n\nhere."""'),
        ('eol_ros/own.py', '# why', '# why not\n'),
        ('eol_ros/own.py', 'absent', 'gone'),
        ('eol_ros/core/model.py', '"""Return it."""', ''),
        ('eol_ros/core/vectors.py', 'x + 2 * y', '(\n        x + 2*y)'),
        ('eol_ros/core/other.py', '1', '2'),
        ('eol_ros/settings.py', 'of a spring', 'of one spring'),
    ],
)
def test_prose_and_what_is_not_reached_do_not(checkout, name, before, after):
    assert checkout((name, before, after)) == checkout()


def test_a_root_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ImportError, match='eol_ros.none: no such module'):
        sources.digest(['eol_ros.none'], tmp_path)


def test_every_module_that_a_sweep_loads_is_among_its_sources():
    """The oracle: what an interpreter imports for three kinds of task."""
    code = (
        'import sys\n'
        'from eol_ros.lab.science import sweep\n'
        "sweep.compute('table', {'travel_m': 0.05}, {})\n"
        "sweep.compute('table', {'drive': 'circle', 'travel_m': 0.002}, {})\n"
        "sweep.compute('ofc', {'events': 100, 'warmup': 10}, {})\n"
        "print(*(m for m in sys.modules if m.split('.')[0] == 'eol_ros'))\n"
    )
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = set(ran.stdout.split())
    assert {'eol_ros.core.physics.event.solver', 'eol_ros.lab.exact.solver'} <= loaded
    assert loaded <= sources.reached(['eol_ros.lab.science.sweep'])

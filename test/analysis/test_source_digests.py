# SPDX-License-Identifier: Apache-2.0
"""What a computation rests on: its digest moves with what it can reach, and with nothing else."""

import subprocess
import sys

import pytest

from eol_ros.analysis import sources

FILES = {
    'benchmarks/__init__.py': '"""Benches."""\n',
    'benchmarks/own.py': '''
"""A bench."""
from eol_ros.core import model
from eol_ros.settings import Table, setting

HELP = 'words'

def add_arguments(parser):
    """Declare."""
    parser.add_argument('--seeds', default=3, help='how many')

def run(args):
    from eol_ros.core.late import late
    return model.solve(Table(), late())
''',
    'eol_ros/__init__.py': '',
    'eol_ros/core/__init__.py': '',
    'eol_ros/core/model.py': '''
from eol_ros.core.vectors import length
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from eol_ros.core.absent import Absent

def solve(table, late):
    # why
    return length(table.stiffness, late)

def other(x):
    return 5 * x
''',
    'eol_ros/core/vectors.py': '''
import math
STEP = 2
try:
    from fast import inverse
except ImportError:
    inverse = None

def length(x, y):
    """Return it."""
    return math.hypot(x, STEP * y)

def unused(x):
    return 3 * x
''',
    'eol_ros/core/late.py': '''
from eol_ros.core.vectors import inverse
def late():
    return inverse or 1
''',
    'eol_ros/core/other.py': 'print(1)\n',
    'eol_ros/settings.py': '''
def setting(default, doc, unit=''):
    return default

KINDS = {}

class Table:
    stiffness = setting(40.0, 'of a spring', 'N/m')

class Panel:
    port = setting(80, 'of the panel')
''',
}  # fmt: skip
ROOTS = ('benchmarks.own.add_arguments', 'benchmarks.own.run')


@pytest.fixture
def checkout(tmp_path):
    """Write FILES, with other text in place of some; return their digest."""

    def write(*changes):
        for name, text in FILES.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        for name, before, after in changes:
            text = (tmp_path / name).read_text()
            assert before in text
            (tmp_path / name).write_text(text.replace(before, after, 1))
        return sources.digest(ROOTS, tmp_path)

    return write


@pytest.mark.parametrize(
    ('name', 'before', 'after'),
    [
        ('benchmarks/own.py', 'default=3', 'default=4'),
        ('eol_ros/core/model.py', 'late)\n', '2 * late)\n'),
        ('eol_ros/core/vectors.py', 'STEP = 2', 'STEP = 3'),
        ('eol_ros/core/vectors.py', 'hypot', 'dist'),
        ('eol_ros/core/vectors.py', 'inverse = None', 'inverse = 2'),
        ('eol_ros/core/vectors.py', 'import math', 'import cmath as math'),
        ('eol_ros/core/late.py', 'or 1', "or ''"),
        ('eol_ros/core/__init__.py', '', 'import os\nos.nice(1)\n'),
        ('eol_ros/settings.py', '40.0', '41.0'),
        ('eol_ros/settings.py', 'return default', 'return 2 * default'),
        ('eol_ros/settings.py', 'KINDS = {}', 'KINDS = {}\nTable.stiffness = 3\n'),
    ],
)  # fmt: skip
def test_a_change_of_what_is_computed_moves_it(checkout, name, before, after):
    assert checkout((name, before, after)) != checkout()


@pytest.mark.parametrize(
    ('name', 'before', 'after'),
    [
        ('benchmarks/own.py', 'how many', 'how many starts'),
        ('benchmarks/own.py', "'words'", "'other words'"),
        ('benchmarks/own.py', '"""A bench."""', '"""A benchmark\n\nof two lines."""'),
        ('eol_ros/core/model.py', '# why', '# why not\n'),
        ('eol_ros/core/model.py', 'absent', 'gone'),
        ('eol_ros/core/vectors.py', '"""Return it."""', '"""Return the length."""'),
        ('eol_ros/core/vectors.py', '"""Return it."""', ''),
        ('eol_ros/core/vectors.py', '3 * x', '4 * x'),
        ('eol_ros/core/model.py', '5 * x', '6 * x'),
        ('eol_ros/core/vectors.py', 'math.hypot(x, STEP * y)', '(math.hypot(\n        x, STEP*y))'),
        ('eol_ros/core/other.py', '1', '2'),
        ('eol_ros/settings.py', 'of a spring', 'of one spring'),
        ('eol_ros/settings.py', '80', '81'),
    ],
)  # fmt: skip
def test_prose_and_what_is_not_reached_do_not(checkout, name, before, after):
    assert checkout((name, before, after)) == checkout()


def test_a_module_that_is_handed_on_or_hidden_counts_whole(checkout):
    """Where it is more than `module.name`, any of its names may be used."""
    for change in (
        ('model.solve(Table', 'vars_of(model).solve(Table'),
        ('import late\n', 'import late\n    model = model or late\n'),
    ):
        one = ('benchmarks/own.py', *change)
        assert checkout(one) != checkout(one, ('eol_ros/core/model.py', '5 * x', '6 * x'))


def test_a_module_that_looks_names_up_counts_whole(checkout):
    dynamic = ('eol_ros/core/vectors.py', 'STEP = 2', "STEP = globals().get('step', 2)")
    assert checkout(dynamic) != checkout(dynamic, ('eol_ros/core/vectors.py', '3 * x', '4 * x'))


def test_what_is_not_there_is_named(checkout, tmp_path):
    with pytest.raises(ImportError, match='eol_ros.core.vectors binds no width'):
        checkout(('eol_ros/core/model.py', 'import length', 'import width as length'))
    with pytest.raises(ImportError, match='benchmarks.none: no such module'):
        sources.digest(['benchmarks.none.run'], tmp_path)


def test_every_module_that_a_sweep_loads_is_among_its_sources():
    """The oracle: what an interpreter imports for three kinds of task."""
    code = (
        'import sys\n'
        'from eol_ros.core.science import sweep\n'
        "sweep.compute('table', {'travel_m': 0.05}, {})\n"
        "sweep.compute('table', {'drive': 'circle', 'travel_m': 0.002}, {})\n"
        "sweep.compute('ofc', {'events': 100, 'warmup': 10}, {})\n"
        "print(*(m for m in sys.modules if m.split('.')[0] == 'eol_ros'))\n"
    )
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = set(ran.stdout.split())
    assert {f'eol_ros.core.{m}' for m in ('vectors', 'physics.exact.solver')} <= loaded
    assert loaded <= set(sources.reached(['eol_ros.core.science.sweep.compute']))

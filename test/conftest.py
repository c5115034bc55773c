# SPDX-License-Identifier: Apache-2.0
"""What all tests share: DDS domains and folders of their own, and no silent skip in CI."""

import collections
import gc
import itertools
import json
import os
import sys
import tempfile
from pathlib import Path

import hypothesis
import pytest
from support.any_stamp import use_any_stamp

from eol_ros.ros import network
from eol_ros.verbs import progress

# Set before any test imports rclpy: every worker process has a domain of its own.
_worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
_SHARE = 20 // int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
_BASE = 1 + _worker * _SHARE  # from 1 to 20, below those that `eol bench` takes for its graphs
_rounds = itertools.cycle(range(1, _SHARE))
os.environ['ROS_DOMAIN_ID'] = str(_BASE)
os.environ['EOL_STATE'] = tempfile.mkdtemp(prefix='eol-test-state-')
for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'NUMBA_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
os.environ['OPENCV_FFMPEG_LOGLEVEL'] = '-8'  # as `devices/camera` sets it before a first video
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'  # assigned values have the types of their fields
os.environ['PYTHONWARNINGS'] = 'error::RuntimeWarning'  # in processes that tests start, too
network.configure('local', images=True)
hypothesis.settings.register_profile(
    'eol', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('eol')  # a busy machine is no fault of the code
progress.SILENT_S = 3600.0  # nor what a command says where it is slow


@pytest.fixture(scope='session')
def python():
    """The interpreter under test."""
    return sys.executable


@pytest.fixture
def ros():
    """rclpy for one test, on another domain than the test before: its last words are not heard."""
    import rclpy

    os.environ['ROS_DOMAIN_ID'] = str(_BASE + next(_rounds))
    rclpy.init()
    yield rclpy
    rclpy.try_shutdown()
    os.environ['ROS_DOMAIN_ID'] = str(_BASE)


@pytest.fixture
def any_stamp(monkeypatch):
    """Nodes of this process use messages of any time: the stamps of the test are of another day."""
    use_any_stamp(monkeypatch)


_HERE = Path(__file__).parent
# Long files late in the alphabet run first; at the end they would run in one process alone.
LONGEST = (
    'scenes/test_cold.py', 'test_packaging.py', 'test_damaged_files.py', 'test_strangers.py',
    'verbs/test_echo_verb.py', 'web/test_state_on_pages.py', 'web/test_wall_pages.py',
)  # fmt: skip


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.path.relative_to(_HERE).as_posix() not in LONGEST)


def pytest_collection_finish():
    """What has been imported stays: no collection of garbage need look at it again."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter):
    """Write counts, reasons of skips, and seconds by file for run_tests.py ($EOL_TEST_OUTCOMES)."""
    path = os.environ.get('EOL_TEST_OUTCOMES')
    if not path:
        return
    stats = terminalreporter.stats
    names = ('passed', 'failed', 'error', 'skipped')
    reasons = collections.Counter(
        str(report.longrepr[2]).removeprefix('Skipped: ') for report in stats.get('skipped', ())
    )
    counts = {name: len(stats.get(name, ())) for name in names}
    failures = [*stats.get('failed', ()), *stats.get('error', ())]
    failed = {report.nodeid: _why(report) for report in failures}
    seconds = collections.Counter()
    for report in itertools.chain(*stats.values()):
        if isinstance(report, pytest.TestReport):
            seconds[report.nodeid.split('::')[0]] += report.duration
    found = {'counts': counts, 'skipped': reasons, 'failed': failed, 'seconds': seconds}
    Path(path).write_text(json.dumps(found))


def _why(report):
    crash = getattr(report.longrepr, 'reprcrash', None)
    return ' '.join((crash.message if crash else str(report.longrepr)).split())[:300]


def pytest_runtest_makereport(item, call):
    """Where EOL_NO_SKIP is set, as in CI, a skipped test counts as a failure."""
    if (
        os.environ.get('EOL_NO_SKIP')
        and call.excinfo
        and call.excinfo.errisinstance(pytest.skip.Exception)
    ):
        reason = str(call.excinfo.value)
        call.excinfo = pytest.ExceptionInfo.from_exc_info(
            _failed(f'skipped where nothing may be skipped: {reason}')
        )


def _failed(text):
    try:
        pytest.fail(text, pytrace=False)
    except BaseException:
        return sys.exc_info()

# SPDX-License-Identifier: Apache-2.0
"""Hours and faults of the soak are summed over runs; silences are found from outside."""

import subprocess
import sys
from pathlib import Path

from benchmarks import soak_total
from benchmarks.soak_observer import SILENT_S, STALE_S, Silences


def test_the_page_publishes_the_sum():
    found = soak_total.total(soak_total.load(soak_total.RESULTS))
    page = (Path(__file__).parents[2] / 'docs/explanation/reliability.md').read_text()

    hours = ' and '.join(f'{hours:g} h of {part}' for part, hours in found['hours'].items())
    assert f'{hours}**, {found["faults"]} faults' in page
    assert f'{found["silences"]} silences in {found["observed_hours"]:g} h' in page


def silences(spans, report=None):
    """A source that stands still from `spans` on; `report` (s): a status says so, or stops."""
    found, ended = Silences(0.0), []
    for tick in range(400):
        now_s = tick / 10
        if report != 'stops' or now_s < 10:
            found.status('recorder', report != now_s, now_s)
        still = any(a <= now_s < b for a, b in spans)
        ended += found.look({'bags': 1000 if still else tick}, now_s)
    return ended + found.close(40.0)


def test_only_a_long_silence_counts_and_a_status_reports_it():
    assert silences([(10.0, 10.0 + SILENT_S - 0.3)]) == []
    (quiet,) = silences([(10.0, 20.0)])
    assert quiet == {'source': 'bags', 'seconds': 10.0, 'reported': False}
    assert silences([(10.0, 20.0)], report=15.0)[0]['reported']
    assert not silences([(10.0, 20.0)], report=25.0)[0]['reported']
    assert silences([(10.0, 20.0)], report='stops')[0]['reported'] and STALE_S < SILENT_S
    assert [one['seconds'] for one in silences([(30.0, 99.0)])] == [10.0]  # it lasts


def test_the_observer_imports_nothing_of_the_project():
    code = (
        'import runpy, sys; runpy.run_path("benchmarks/soak_observer.py", run_name="child"); '
        'sys.exit(any(n.partition(".")[0] in ("eol_ros", "benchmarks") for n in sys.modules))'
    )
    assert subprocess.run([sys.executable, '-P', '-c', code], check=False).returncode == 0

# SPDX-License-Identifier: Apache-2.0
"""The clock of the soak over all runs: each is appended to a file, and the sum is published."""

import json
import os
from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import Any

from eol_ros.errors import EolError
from eol_ros.ros.run_record import versions

RESULTS = Path(__file__).with_name('soak.jsonl')
KEPT = 'eol_ros', 'commit', 'python', 'rclpy', 'numba', 'numpy'  # of the versions


def rows(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what this run of the soak adds to the file, of each part that was run."""
    all_versions = versions()
    return [
        {
            'ended': datetime.now().astimezone().isoformat(timespec='seconds'), 'part': part,
            'versions': {name: all_versions[name] for name in KEPT if name in all_versions},
            'load': round(os.getloadavg()[2], 1),  # of the last 15 min
            'hours': ran['hours'], 'observer': ran.get('observer'), 'faults': ran['faults'],
            'kinds': [{n: kind[n] for n in ('kind', 'count', 'within_10_s', 'worst_s')}
                      for kind in ran.get('kinds', ())],
            'growth_mb': {row['name']: row['growth_mb'] for row in ran.get('growth', ())},
        }
        for part, ran in found.items()
    ]  # fmt: skip


def append(added: list[dict[str, Any]], file: Path) -> None:
    """Add runs to the file."""
    with file.open('a') as out:
        out.writelines(json.dumps(one) + '\n' for one in added)


def load(file: Path) -> list[dict[str, Any]]:
    """Return all runs; none where there is no file. Raises EolError where a line is none."""
    if not file.exists():
        return []
    try:
        return [json.loads(line) for line in file.read_text().splitlines()]
    except ValueError as error:
        raise EolError(f'{file}: a line is no run of the soak: {error}') from None


def total(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the sum of all runs: hours of each part, faults of each kind, versions."""
    hours: Counter[str] = Counter()
    kinds: dict[str, dict[str, Any]] = {}
    for one in runs:
        hours[one['part']] += one['hours']
        for kind in one.get('kinds', ()):
            sums = kinds.setdefault(kind['kind'], {'count': 0, 'within_10_s': 0, 'worst_s': 0.0})
            sums['count'] += kind['count']
            sums['within_10_s'] += kind['within_10_s']
            sums['worst_s'] = max(sums['worst_s'], kind['worst_s'])
    seen = [one['observer'] for one in runs if one.get('observer')]
    return {
        'runs': len(runs),
        'hours': {part: round(h, 3) for part, h in hours.items()},
        'faults': sum(kind['count'] for kind in kinds.values()),
        'not_well': sum(len(one['faults']) for one in runs),
        'observed_hours': round(sum(s['hours'] or 0.0 for s in seen), 3),
        'silences': sum(s['silences'] for s in seen),
        'unreported': sum(len(s['unreported']) for s in seen),
        'kinds': [{'kind': kind, **sums} for kind, sums in sorted(kinds.items())],
        'versions': sorted({json.dumps(one['versions']) for one in runs}),
    }


def text(found: dict[str, Any]) -> str:
    """Return the sum for people, as docs/explanation/reliability.md has it."""
    hours = ', '.join(f'{h:g} h of {part}' for part, h in found['hours'].items()) or '0 h'
    return '\n'.join([
        f'all {found["runs"]} runs: {hours}; {found["faults"]} faults; {found["not_well"]} '
        f'findings; observed from outside for {found["observed_hours"]:g} h: '
        f'{found["silences"]} silences, {found["unreported"]} of them unreported',
        *(f'{k["kind"]:28} {k["count"]:6} {k["within_10_s"]:6} within 10 s, worst '
          f'{k["worst_s"]:.1f} s' for k in found['kinds']),
        *(f'versions: {line}' for line in found['versions']),
    ])  # fmt: skip

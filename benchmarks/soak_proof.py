# SPDX-License-Identifier: Apache-2.0
"""What a soak leaves behind: what its processes held over time, and its bags, proved."""

import contextlib
import json
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import theilslopes
from support.running import Graph

from eol_ros.analysis import open_bag
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.verify import verify
from eol_ros.errors import BagDamaged, EolError

WARM = 0.1  # of the looks, while caches and rings fill
PARTS = 20  # of a run, whose medians show how memory grew


class Held(NamedTuple):
    """What a process holds."""

    open_files: float
    threads: float
    pss_mb: float


def held(graph: Graph) -> dict[str, Held]:
    """Return what each process of the graph holds, by the names of its nodes."""
    result = {}
    for pid, names in graph.pids().items():
        proc = Path('/proc', str(pid))
        with contextlib.suppress(OSError, StopIteration):  # it is gone
            rollup = (proc / 'smaps_rollup').read_text().splitlines()
            pss = next(row for row in rollup if row.startswith('Pss:'))
            result['+'.join(names)] = Held(
                len(list((proc / 'fd').iterdir())),
                len(list((proc / 'task').iterdir())),
                int(pss.split()[1]) / 1024,
            )
    return result


def prove(folder: Path) -> dict[str, Any]:
    """Prove every bag in a folder; count missing messages, and those of them that nobody counted.

    Missing are numbers left out between two messages of one life of their node.
    """
    found: dict[str, Any] = {
        'count': 0, 'unreadable': 0, 'cut': 0, 'missing': 0, 'uncounted': 0, 'faults': []
    }  # fmt: skip
    for path in sorted(p for p in folder.iterdir() if p.is_dir()):
        found['count'] += 1
        try:
            bag, wrong = verify(path)
        except EolError as error:
            found['unreadable'] += 1
            found['faults'].append(f'{path.name}: {error}')
            continue
        whole = not bag.cut_short and 'recovered' not in bag.gaps  # else its counts are lost too
        found['cut'] += not whole
        others = [line for line in wrong if line not in bag.cut_short]
        found['faults'] += [f'{path.name}: {line}' for line in others]
        missing, counted = _missing(path, bag)
        found['missing'] += missing
        if missing > counted and whole:
            found['uncounted'] += missing - counted
            found['faults'].append(f'{path.name}: {missing} triggers missing, {counted} counted')
    return found


def _missing(path: Path, bag: BagReader) -> tuple[int, int]:
    name = bag.name('grain_triggers')
    if name not in bag.topics:
        return 0, 0
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', BagDamaged)
        steps = np.diff(open_bag(path).table(name)['sequence'].astype(np.int64))
    counts = [
        json.loads(bag.gaps[key]) for key in bag.gaps if key.startswith(('lost_', 'dropped_'))
    ]
    return int((steps[steps > 1] - 1).sum()), sum(count.get(name, 0) for count in counts)


def growth(looks: list[dict[str, Held]]) -> list[dict[str, Any]]:
    """Return what each process held at first, once warm, and at last; flat: within 5 %.

    Looks are medians of a tenth of them each, so that one image on its way does not count. Of
    memory 2 MB are allowed beside the 5 %, of open files and threads 2. `growth_mb` is that of
    memory over the run, with its 95 % interval (Theil and Sen, of the medians of 20 parts).
    """
    rows = []
    warm = looks[int(len(looks) * WARM) :]
    tenth = max(len(warm) // 10, 1)
    for name in sorted(warm[-1]) if warm else ():
        first, last = (
            np.median([look[name] for look in part if name in look], axis=0)
            for part in (warm[:tenth], warm[-tenth:])
        )
        grown_mb = _over_run([look[name].pss_mb for look in warm if name in look])
        flat = last[2] <= first[2] * 1.05 + 2 and (last[:2] <= first[:2] + 2).all()
        row = {'name': name, 'flat': bool(flat), 'growth_mb': grown_mb}
        for k, what in enumerate(Held._fields):
            row[what] = [round(float(first[k]), 1), round(float(last[k]), 1)]
        rows.append(row)
    return rows


def _over_run(held_mb: list[float]) -> list[float] | None:
    """Return how memory grew, and the ends of that interval; None of too few looks."""
    if len(held_mb) < PARTS:
        return None
    medians = [np.median(part) for part in np.array_split(held_mb, PARTS)]
    found = theilslopes(medians, np.linspace(0, 1, PARTS))
    return [round(float(mb), 1) for mb in (found.slope, found.low_slope, found.high_slope)]

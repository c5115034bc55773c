# SPDX-License-Identifier: Apache-2.0
"""Runs what is missing of a sweep: batches out to a crew, rows into the table."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

from eol_ros.lab.science import sweep
from eol_ros.lab.sweeps import work
from eol_ros.lab.sweeps.crews import Crew
from eol_ros.lab.sweeps.spec import Spec
from eol_ros.lab.sweeps.table import Table

BATCH_S = 1.0  # of work in one batch: giving it away and its way back cost some milliseconds
MOST_IN_BATCH = 1000
AHEAD = 3  # batches for each worker, so that none waits for the next


@dataclass
class Counts:
    """How far a sweep is: tasks done by this run, and the seconds that they took."""

    done: int = 0
    seconds: float = 0.0  # of the workers, together

    @property
    def each_s(self) -> float:
        """What a task takes; 0 while that is not known."""
        return self.seconds / self.done if self.done else 0.0


def missing(spec: Spec, table: Table) -> int:
    """Return how many tasks of `spec` the table lacks."""
    return len(spec) if not len(table) else sum(1 for _ in _missing(spec, table))


def run(spec: Spec, table: Table, crew: Crew, counts: Counts) -> Iterator[int]:
    """Compute every task of `spec` that `table` lacks; yield the number of each one that is done.

    Only what the workers are about to need is in memory. The table is left open.
    """
    for rows, seconds in crew.work_through(work.Batch.rows, _batches(spec, table, counts), AHEAD):
        table.add(rows)
        counts.seconds += seconds
        for _ in rows:
            counts.done += 1
            yield counts.done


def _batches(spec: Spec, table: Table, counts: Counts) -> Iterator[work.Batch]:
    tasks = _missing(spec, table)
    while some := list(itertools.islice(tasks, _batch_size(counts))):
        yield work.Batch(spec.model, some)


def _batch_size(counts: Counts) -> int:
    if not counts.done:
        return 1
    return max(1, min(MOST_IN_BATCH, int(BATCH_S / max(counts.each_s, 1e-9))))


def _missing(spec: Spec, table: Table) -> Iterator[tuple[str, dict]]:
    for task in spec.tasks():
        key = sweep.key(spec.model, task)
        if not table.has(key):
            yield key, task

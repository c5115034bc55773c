# SPDX-License-Identifier: Apache-2.0
"""Who computes: processes of this machine, or the workers of a Dask cluster.

Both take batches and give back what came of them, in the order in which they are done. What a dead
worker had in hand is computed again by another.
"""

import multiprocessing
import os
import signal
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from importlib import metadata
from typing import Any

from eol_ros import parent_death
from eol_ros.errors import DeviceMissing, EolError, UsageError, pip_install
from eol_ros.lab.sweeps import work

MOST_DEATHS = 3  # of workers over one batch: then it is the batch
REACH_S = 10.0
POLL_S = 0.5
Done = tuple[list[Any], float]


def work_through(crew: 'Crew', batches: Iterable[work.Work], ahead: int) -> Iterator[Done]:
    """Let a crew compute batches; yield what came of them, in the order in which they are done.

    A batch is taken only when some worker is about to need it: each has `ahead` to come.
    """
    for batch in batches:
        crew.give(batch)
        while crew.waiting() >= ahead * max(crew.size(), 1):
            yield from crew.done()
    while crew.waiting():
        yield from crew.done()


def new_pool(workers: int) -> ProcessPoolExecutor:
    """Return processes that leave it to this one what Ctrl-C means; to be ended by `end_pool`."""
    # not forked: this process may have threads, and numba's caches are quick to load
    context = multiprocessing.get_context('spawn')
    return ProcessPoolExecutor(workers, context, _begin, (os.getpid(),))


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent_death.follow(parent)


def end_pool(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool now: what they have in hand may take minutes, and is lost."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join()


class Local:
    """Processes of this machine. One that is killed is replaced."""

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise UsageError(f'--workers {workers}: 1 or more')
        os.environ.setdefault(work.THREADS, '1')  # the workers inherit it
        self._workers = workers
        self._given: dict[Future, work.Work] = {}
        self._deaths: dict[str, int] = {}
        self._pool = new_pool(workers)

    def size(self) -> int:
        """How many workers there are."""
        return self._workers

    def give(self, batch: work.Work) -> None:
        """Let some process compute a batch."""
        try:
            self._given[self._pool.submit(work.compute, batch)] = batch
        except BrokenProcessPool:  # told by the next `done`, with what was given before
            broken: Future = Future()
            broken.set_exception(BrokenProcessPool())
            self._given[broken] = batch

    def waiting(self) -> int:
        """How many batches are given and not done."""
        return len(self._given)

    def done(self) -> Iterator[Done]:
        """Wait, and yield what is done: nothing after POLL_S."""
        ready, _ = wait(self._given, POLL_S, FIRST_COMPLETED)
        died = False
        for future in ready:
            if isinstance(future.exception(), BrokenProcessPool):
                died = True
                continue
            del self._given[future]
            found: Done = future.result()
            yield found
        if died:
            self._replace()

    def _replace(self) -> None:
        """Begin again after the death of a worker: what it and the others had in hand is lost."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        lost = {
            future: batch
            for future, batch in self._given.items()
            if future.cancelled() or isinstance(future.exception(), BrokenProcessPool)
        }
        self._pool = new_pool(self._workers)
        for place, (future, batch) in enumerate(lost.items()):
            del self._given[future]
            name = batch.title
            in_hand = place < self._workers  # the others stood in the queue
            self._deaths[name] = self._deaths.get(name, 0) + in_hand
            if self._deaths[name] > MOST_DEATHS:
                raise EolError(
                    f'workers died {self._deaths[name]} times while they had this in hand (out of '
                    f'memory?): {batch.title}'
                )
            self.give(batch)

    def close(self) -> None:
        """End the processes."""
        end_pool(self._pool)


class Cluster:
    """The workers of a Dask cluster: as many as there are, also those that come later."""

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ModuleNotFoundError:
            raise UsageError(
                f'--scheduler needs Dask: {pip_install("dask", "distributed")}'
            ) from None
        self._address = address
        try:
            self._client = distributed.Client(address, timeout=REACH_S, name='eol sweep')
        except (OSError, ValueError) as error:
            raise DeviceMissing(
                f'--scheduler {address}: no Dask scheduler answers there ({error}); '
                'start one with: dask scheduler'
            ) from None
        self.others: list[str] = []  # processors of workers that are not as here
        self._given: dict[Any, work.Work] = {}
        try:
            self._check()
        except BaseException:
            self._client.close()
            raise

    def _check(self) -> None:
        own = metadata.version('distributed')
        versions: Any = self._client.get_versions()
        found = versions['scheduler']['packages']['distributed']
        work.check({'distributed': own}, {'distributed': found}, f'scheduler {self._address}')
        try:
            there = self._client.run(_identity)
        except ModuleNotFoundError as error:
            raise work.OtherVersion(
                f'a worker of {self._address} has no {error.name}, here is eol_ros '
                f'{work.version()["eol_ros"]}: install the same on both'
            ) from None
        own_where = work.where()
        for address, (version, where) in there.items():
            work.check(work.version(), version, f'worker {address}')
            work.check_threads(where['threads'], f'worker {address}')
            if where['processor'] != own_where['processor']:
                self.others.append(f'{address} ({where["processor"]})')

    def size(self) -> int:
        """How many workers there are now."""
        return len(self._client.nthreads())

    def give(self, batch: work.Work) -> None:
        """Let some worker compute a batch; the scheduler gives it to another if that one dies."""
        self._given[self._client.submit(work.compute, batch, pure=False)] = batch

    def waiting(self) -> int:
        """How many batches are given and not done."""
        return len(self._given)

    def done(self) -> Iterator[Done]:
        """Wait, and yield what is done: nothing after POLL_S."""
        import distributed

        try:
            ready = distributed.wait(list(self._given), POLL_S, 'FIRST_COMPLETED').done
        except (TimeoutError, distributed.TimeoutError):
            if self._client.status not in ('running', 'connecting'):
                raise DeviceMissing(f'--scheduler {self._address}: it has gone') from None
            return
        for future in ready:
            batch = self._given.pop(future)
            if future.status == 'cancelled':
                raise DeviceMissing(f'--scheduler {self._address}: it has gone')
            try:
                found: Done = future.result()
            except distributed.KilledWorker as error:
                raise EolError(f'{error}: {batch.title}') from None
            yield found

    def close(self) -> None:
        """Take back what is not computed, and leave the cluster."""
        if self._client.status == 'running':
            self._client.cancel(list(self._given))
        self._given.clear()
        self._client.close()


Crew = Local | Cluster  # runs batches; returns rows and seconds of finished ones


def _identity() -> tuple[dict[str, str], dict[str, str]]:
    return work.version(), work.where()

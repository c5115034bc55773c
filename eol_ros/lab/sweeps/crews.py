# SPDX-License-Identifier: Apache-2.0
"""Who computes: processes of this machine, or the workers of a Dask cluster.

Both are executors of `concurrent.futures`. The scheduler of a cluster assigns the
tasks of a dead worker to another one. A dead process of this machine ends the sweep, which can be
resumed.
"""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any, TypeVar

from eol_ros import parent_death
from eol_ros.errors import DeviceMissing, EolError, UsageError, pip_install
from eol_ros.lab.sweeps import work

REACH_S = 10.0
POLL_S = 0.5
T = TypeVar('T')
R = TypeVar('R')


@dataclass
class Crew:
    """An executor, its present number of workers, and whether they can be reached."""

    executor: Executor
    size: Callable[[], int]
    reached: Callable[[], bool] = lambda: True
    others: list[str] = field(default_factory=list)  # workers with another processor than this

    def work_through(
        self, do: Callable[[T], R], items: Iterable[T], ahead: int
    ) -> Iterator[tuple[R, float]]:
        """Yield the result of `do` for each item and its seconds, in the order of completion.

        Items are submitted as workers need them: `ahead` items for each worker.
        """
        given: dict[Future[tuple[R, float]], T] = {}
        for item in items:
            try:
                future = self.executor.submit(work.compute, do, item, work.version())
            except BrokenExecutor as error:  # a worker died between two tasks
                future = Future()
                future.set_exception(error)
            given[future] = item
            while len(given) >= ahead * max(self.size(), 1):
                yield from self._done(given)
        while given:
            yield from self._done(given)

    def _done(self, given: dict[Future[tuple[R, float]], T]) -> Iterator[tuple[R, float]]:
        """Wait up to POLL_S, and yield what has been completed."""
        ready, _ = wait(given, POLL_S, FIRST_COMPLETED)
        if not ready and not self.reached():
            raise DeviceMissing('--scheduler: connection lost')
        for future in ready:
            item = given.pop(future)
            try:
                found = future.result()
            except EolError:
                raise
            except CancelledError:
                raise DeviceMissing('--scheduler: connection lost') from None
            except Exception as error:  # of the executor
                what = 'a worker process died (out of memory?); its running or queued task'
                if not isinstance(error, BrokenExecutor):
                    what = f'a task failed ({type(error).__name__})'
                raise EolError(f'{what}: {item} ({error})') from None
            yield found


@contextlib.contextmanager
def local(workers: int) -> Iterator[Crew]:
    """Yield worker processes of this machine; this process alone handles Ctrl-C."""
    os.environ.setdefault(work.THREADS, '1')  # the workers inherit it
    # not forked: this process may have threads, and numba's caches are quick to load
    context = multiprocessing.get_context('spawn')
    pool = ProcessPoolExecutor(workers, context, _begin, (os.getpid(),))
    try:
        yield Crew(pool, lambda: workers)
    finally:  # running tasks may take minutes, and are lost
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent_death.follow(parent)


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Crew]:
    """Yield the workers of a Dask cluster: as many as there are, also those that come later."""
    try:
        import distributed
    except ModuleNotFoundError:
        raise UsageError(f'--scheduler needs Dask: {pip_install("dask", "distributed")}') from None
    try:
        client = distributed.Client(address, timeout=REACH_S, name='eol sweep')
    except (OSError, ValueError) as error:
        raise DeviceMissing(
            f'--scheduler {address}: no Dask scheduler answers there ({error}); '
            'start one with: dask scheduler'
        ) from None
    executor = client.get_executor(pure=False)
    try:
        others = _checked(client, address)
        yield Crew(
            executor, lambda: len(client.nthreads()),
            lambda: client.status in ('running', 'connecting'), others,
        )  # fmt: skip
    finally:
        if client.status == 'running':
            executor.shutdown(wait=False)  # cancels queued tasks
        client.close()


def _checked(client: Any, address: str) -> list[str]:
    """Return workers with another processor; raise OtherVersion where one has another version."""
    own = metadata.version('distributed')
    found = client.get_versions()['scheduler']['packages']['distributed']
    work.check({'distributed': own}, {'distributed': found}, f'scheduler {address}')
    try:
        there = client.run(_identity)
    except ModuleNotFoundError as error:
        raise work.OtherVersion(
            f'a worker of {address} has no {error.name}, here is eol_ros '
            f'{work.version()["eol_ros"]}: install the same on both'
        ) from None
    others, processor = [], work.where()['processor']
    for name, (version, where) in there.items():
        work.check(work.version(), version, f'worker {name}')
        work.check_threads(where['threads'], f'worker {name}')
        if where['processor'] != processor:
            others.append(f'{name} ({where["processor"]})')
    return others


def _identity() -> tuple[dict[str, str], dict[str, str]]:
    return work.version(), work.where()

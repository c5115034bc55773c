# SPDX-License-Identifier: Apache-2.0
"""What a worker of a sweep does, in a process of this machine or of a Dask cluster."""

import functools
import hashlib
import os
import platform
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from eol_ros.errors import ConfigError, EolError

T = TypeVar('T')
R = TypeVar('R')
PACKAGE = Path(__file__).parents[2]
THREADS = 'OPENBLAS_NUM_THREADS'
_ONE_AT_A_TIME = threading.Lock()  # the solvers are no more than one thread's


class OtherVersion(ConfigError):
    """A worker, or rows of a table, of another version than this."""


@dataclass
class Batch:
    """Tasks for one worker: their keys and parameters."""

    model: str
    tasks: list[tuple[str, dict[str, Any]]]

    def __str__(self) -> str:
        more = f' (the first of {len(self.tasks)})' if len(self.tasks) > 1 else ''
        return f'task {self.tasks[0][1]}{more}'

    def rows(self) -> list[Any]:
        """Compute: return a row for each task."""
        from eol_ros.lab.science import sweep
        from eol_ros.lab.sweeps.table import row_of

        rows = []
        for key, parameters in self.tasks:
            try:
                result = sweep.compute(self.model, parameters)
            except Exception as fault:
                # not `from fault`: it may not survive the way to the other process
                raise EolError(f'task {parameters}: {type(fault).__name__}: {fault}') from None
            rows.append(row_of(key, parameters, result))
        return rows


@functools.cache
def version() -> dict[str, str]:
    """Return the versions that must be the same wherever something is computed by this code."""
    try:
        own = metadata.version('eol_ros')
    except metadata.PackageNotFoundError:  # a checkout on the path
        own = 'of no package'
    sources = hashlib.blake2b(digest_size=6)
    for file in sorted(PACKAGE.rglob('*.py')):
        sources.update(f'{file.relative_to(PACKAGE)}\n'.encode() + file.read_bytes())
    found = {'eol_ros': f'{own} (sources {sources.hexdigest()})'}
    return found | {name: metadata.version(name) for name in ('numpy', 'scipy', 'numba')}


def where() -> dict[str, str]:
    """Return what else the last bits depend on: processor, and threads of linear algebra."""
    import llvmlite.binding

    return {
        'processor': llvmlite.binding.get_host_cpu_name(),
        'python': platform.python_version(),
        'threads': os.environ.get(THREADS, 'all'),
    }


def check(wanted: dict[str, str], there: dict[str, str], who: str) -> None:
    """Raise OtherVersion, with both versions, unless they are the same."""
    for name, value in wanted.items():
        if there.get(name) != value:
            raise OtherVersion(
                f'{who} has {name} {there.get(name)}, here is {name} {value}: '
                'install the same on both'
            )


def check_threads(threads: str, who: str) -> None:
    """Raise EolError where several threads solve one system: its last bits are then others."""
    if threads != '1':
        raise EolError(
            f'{who} solves one system in {threads} threads, which changes the last bits of '
            f'results: start it with {THREADS}=1, as a dask worker with its nanny does'
        )


def compute(do: Callable[[T], R], item: T, made_by: dict[str, str]) -> tuple[R, float]:
    """Return what `do` makes of an item, and the seconds that it took."""
    who = f'worker {os.getpid()} on {platform.node()}'
    check(made_by, version(), who)
    check_threads(where()['threads'], who)
    with _ONE_AT_A_TIME:
        begin_s = time.perf_counter()
        return do(item), time.perf_counter() - begin_s

# SPDX-License-Identifier: Apache-2.0
"""A limit of memory for a command: it ends with a message before the kernel kills a process."""

import contextlib
import re
import resource
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """Limit the memory of the body to what is available now; beyond, it gets MemoryError.

    Linux promises more memory than it has, and kills processes that use it. The limit counts
    private memory (RLIMIT_DATA, getrlimit(2)); processes that the body starts inherit it.
    """
    before, hard = resource.getrlimit(resource.RLIMIT_DATA)
    bound = _kilobytes('/proc/self/status', 'VmData') + _kilobytes('/proc/meminfo', 'MemAvailable')
    known = [limit for limit in (before, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([1024 * bound, *known]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, hard))


def _kilobytes(path: str, name: str) -> int:
    found = re.search(rf'^{name}:\s*(\d+) kB', Path(path).read_text(), re.M)
    return int(found[1]) if found else 1 << 40

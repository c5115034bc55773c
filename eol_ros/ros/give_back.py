# SPDX-License-Identifier: Apache-2.0
"""What starting took and running does not need goes back to the system, step by step.

A process that carries knocks may not stand still for it: `/proc/self/smaps` alone, which says in
one piece what each mapping holds, takes 10 ms to make and as long to read.
"""

import contextlib
import ctypes
import mmap
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

LEAST = 4 << 20  # of a mapping, bytes: less is not worth a call
STEP = 16 << 20  # bytes a step
_MADV_DONTNEED = 4  # Linux
_HEAD = re.compile(r'([0-9a-f]+)-([0-9a-f]+) (\S+) \S+ \S+ (\d+)')
# Of a page in /proc/PID/pagemap, see the kernel's pagemap.rst.
_PRESENT, _SWAPPED, _OF_FILE = (np.uint64(1 << bit) for bit in (63, 62, 61))


def give_back() -> Iterator[None]:
    """Return freed memory, and the pages of libraries that only their start has touched.

    It yields after each step of a millisecond or two. Initialising LLVM leaves 70 MB of it in
    memory, loading compiled code afterwards uses 5. Pages of a file that are needed again are
    mapped again, from the system's cache.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    with contextlib.suppress(OSError):  # no pagemap in some sandboxes: what is there stays
        with Path('/proc/self/maps').open() as maps:
            parts = list(of_files(maps))
        yield
        with Path('/proc/self/pagemap').open('rb', buffering=0) as pagemap:
            for begin, end in parts:
                if unchanged(pagemap, begin, end):
                    libc.madvise(
                        ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), _MADV_DONTNEED
                    )
                yield
    if hasattr(libc, 'malloc_trim'):  # only glibc has it
        libc.malloc_trim(0)


def of_files(maps: Iterable[str]) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of the large mappings of files that are read-only, STEP at a time.

    `maps`: the lines of /proc/PID/maps, see proc(5).
    """
    for line in maps:
        head = _HEAD.match(line)
        if head is None or 'w' in head[3] or head[4] == '0':
            continue
        begin, end = int(head[1], 16), int(head[2], 16)
        if end - begin >= LEAST:
            for at in range(begin, end, STEP):
                yield at, min(at + STEP, end)


def unchanged(pagemap: BinaryIO, begin: int, end: int) -> bool:
    """Return whether pages of (begin, end) are in memory, and all are as in their file."""
    pagemap.seek(begin // mmap.PAGESIZE * 8)
    flags = np.frombuffer(pagemap.read((end - begin) // mmap.PAGESIZE * 8), np.uint64)
    there = flags[(flags & _PRESENT) > 0]
    lost = (flags & _SWAPPED).any() or not (there & _OF_FILE).all()
    return len(there) > 0 and not lost

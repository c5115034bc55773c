# SPDX-License-Identifier: Apache-2.0
"""What starting took and running does not need goes back to the system."""

import ctypes
import re
from collections.abc import Iterable
from pathlib import Path

LEAST_KB = 4096  # of a mapping in memory: less is not worth a call
_MADV_DONTNEED = 4  # Linux
_HEAD = re.compile(r'([0-9a-f]+)-([0-9a-f]+) (\S+) \S+ \S+ (\d+)')


def give_back() -> None:
    """Return freed memory, and the pages of libraries that only their start has touched.

    Initialising LLVM leaves 70 MB of it in memory, loading compiled code afterwards uses 5. Pages
    of a file that are needed again are mapped again, from the system's cache.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    with Path('/proc/self/smaps').open() as smaps:
        idle = unchanged(smaps)
    for begin, end in idle:
        libc.madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), _MADV_DONTNEED)
    if hasattr(libc, 'malloc_trim'):  # only glibc has it
        libc.malloc_trim(0)


def unchanged(smaps: Iterable[str]) -> list[tuple[int, int]]:
    """Return (begin, end) of the large mappings whose pages are all as in their file, read-only.

    `smaps`: the lines of /proc/PID/smaps, see proc(5).
    """
    found = []
    begin = end = size_kb = 0
    of_file = False
    for line in smaps:
        head = _HEAD.match(line)
        name, _, rest = line.partition(':')
        if head:
            begin, end = int(head[1], 16), int(head[2], 16)
            of_file = head[4] != '0' and 'w' not in head[3]
        elif name == 'Rss':
            size_kb = int(rest.split()[0])
        elif name == 'Anonymous':  # pages that differ from the file, and would be lost
            changed_kb = int(rest.split()[0])
            if of_file and not changed_kb and size_kb >= LEAST_KB:
                found.append((begin, end))
    return found

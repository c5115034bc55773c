# SPDX-License-Identifier: Apache-2.0
import mmap
import re
from pathlib import Path

import pytest

from eol_ros.ros.give_back import LEAST, STEP, give_back, of_files, unchanged

SIZE = LEAST + 3 * mmap.PAGESIZE


@pytest.fixture
def mapped(tmp_path):
    """A private, read-only mapping of a file, all of which has been read; its address and bytes."""
    import ctypes

    path = tmp_path / 'library'
    path.write_bytes(bytes(range(256)) * (SIZE // 256))
    libc = ctypes.CDLL(None)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long)
    libc.mprotect.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    with path.open('rb') as file:
        at = libc.mmap(None, SIZE, mmap.PROT_READ, mmap.MAP_PRIVATE, file.fileno(), 0)

    def write(offset):
        """Change a byte as a loader does that relocates: writable for a moment only."""
        assert libc.mprotect(at, SIZE, mmap.PROT_READ | mmap.PROT_WRITE) == 0
        ctypes.memset(at + offset, 99, 1)
        assert libc.mprotect(at, SIZE, mmap.PROT_READ) == 0

    read = ctypes.string_at(at, SIZE)
    assert read == path.read_bytes()
    yield at, write, lambda: ctypes.string_at(at, SIZE) == read
    libc.munmap(ctypes.c_void_p(at), ctypes.c_size_t(SIZE))


def rss_kb(at):
    """What smaps says of the mapping at `at`: an independent source."""
    text = Path('/proc/self/smaps').read_text()
    found = re.search(rf'^0*{at:x}-.*?^Rss:\s+(\d+) kB', text, re.M | re.S)
    assert found
    return int(found[1])


def test_pages_that_are_as_in_their_file_are_given_back_and_come_again(mapped):
    at, _, as_before = mapped
    assert rss_kb(at) == SIZE // 1024
    steps = sum(1 for _ in give_back())
    assert steps > 1  # not in one piece
    assert rss_kb(at) == 0
    assert as_before()


def test_what_a_loader_has_changed_is_kept(mapped):
    at, write, as_before = mapped
    write(2 * mmap.PAGESIZE)
    assert not as_before()
    for _ in give_back():
        pass
    assert rss_kb(at) == SIZE // 1024
    assert not as_before()
    with Path('/proc/self/pagemap').open('rb', buffering=0) as pagemap:
        assert not unchanged(pagemap, at, at + SIZE)
        assert unchanged(pagemap, at + 3 * mmap.PAGESIZE, at + SIZE)  # the pages behind it


def test_only_large_read_only_mappings_of_files_are_looked_at():
    maps = (
        f'10000000-{0x10000000 + 2 * STEP + 4096:x} r-xp 00000000 fe:00 77 /usr/lib/big.so',
        f'20000000-{0x20000000 + LEAST:x} rw-p 00000000 fe:00 77 /usr/lib/big.so',
        f'30000000-{0x30000000 + LEAST:x} r--p 00000000 00:00 0',
        f'40000000-{0x40000000 + LEAST - 4096:x} r--p 00000000 fe:00 78 /usr/lib/small.so',
    )
    assert list(of_files(maps)) == [
        (0x10000000, 0x10000000 + STEP),
        (0x10000000 + STEP, 0x10000000 + 2 * STEP),
        (0x10000000 + 2 * STEP, 0x10000000 + 2 * STEP + 4096),
    ]

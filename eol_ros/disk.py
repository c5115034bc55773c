# SPDX-License-Identifier: Apache-2.0
"""Files that are read again later: written whole or not at all, and read without trust.

Bytes that were written are the operating system's until they are synchronised, and so is the name
of a file until its folder is: a power cut may undo either (man 2 fsync). It leaves files that are
empty, cut or filled with zeros. Every file of state, cache, media, corpus and bag folders goes
through `DISK`; a test puts a disk below it that forgets.
"""

import contextlib
import errno
import os
import stat
import sys
import threading
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, TypeVar
from zipfile import BadZipFile

from eol_ros.errors import EolError

T = TypeVar('T')
# What parsers of JSON, YAML, npz and pickles raise on the content of a damaged file.
DAMAGED = (
    OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, OverflowError,
    RecursionError, BadZipFile, zlib.error, EolError,
)  # fmt: skip
MOST_TEXT = 1_000_000  # bytes of a file that people write (chosen); a scene has some thousand
_TOKEN = os.urandom(3).hex()  # thread numbers are not unique across containers
_named: set[Path] = set()


class Disk:
    """The file system; every method may raise OSError."""

    def create(self, path: Path) -> BinaryIO:
        """Return a new file, open for writing."""
        return open(path, 'xb')

    def sync(self, file: BinaryIO) -> None:
        """Return when all that was written to `file` survives a power cut."""
        file.flush()
        os.fdatasync(file.fileno())

    def sync_folder(self, folder: Path) -> None:
        """Return when the names in `folder` survive a power cut."""
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        except OSError as error:  # some network file systems synchronise no folders
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(handle)

    def rename(self, old: Path, new: Path) -> None:
        """Give `old`, which is synchronised, the name `new` for good."""
        os.replace(old, new)
        self.sync_folder(new.parent)

    def write(self, path: Path, content: str | bytes) -> None:
        """Write `content` to `path`, whole or not at all."""
        with _aside(path) as part:
            with self.create(part) as file:
                file.write(
                    content.encode('utf-8', 'surrogateescape')
                    if isinstance(content, str)
                    else content
                )
                self.sync(file)
            self.rename(part, path)

    @contextlib.contextmanager
    def replacing(self, path: Path) -> Iterator[Path]:
        """Yield a path beside `path` for the body to write; the file then takes the name `path`.

        The body leaves the old file as it was if it raises. The ending of the name is the same.
        """
        with _aside(path) as part:
            yield part
            self.sync_path(part)
            self.rename(part, path)

    def sync_path(self, path: Path) -> None:
        """Return when the content of a closed file survives a power cut."""
        with open(path, 'rb') as file:
            os.fsync(file.fileno())


DISK = Disk()


@contextlib.contextmanager
def _aside(path: Path) -> Iterator[Path]:
    part = path.with_name(f'.{threading.get_native_id()}-{_TOKEN}-{path.name[-200:]}')
    try:
        yield part
    finally:
        part.unlink(missing_ok=True)


def regular(path: str, flags: int) -> int:
    """Open a file, for `opener` of open(); raise OSError for a device or a pipe."""
    handle = os.open(path, flags | os.O_NONBLOCK)  # else a pipe that nobody writes holds on
    if not stat.S_ISREG(os.fstat(handle).st_mode) and not stat.S_ISDIR(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, 'a device or pipe, not a file', path)
    return handle


def content(path: str | Path, most: int = MOST_TEXT) -> bytes:
    """Return the content of a file of at most `most` bytes.

    Raises
    ------
    OSError
        It cannot be read, is larger, or is a device or a pipe.
    """
    with open(path, 'rb', opener=regular) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise OSError(errno.EFBIG, f'larger than {most / 1e6:g} MB', str(path))
        return file.read(size)


def read(path: Path, parse: Callable[[bytes], T]) -> T | None:
    """Return `parse(content)`; None if the file is absent or damaged. A damaged one is named once.

    For files that the program has written itself, and writes again.
    """
    try:
        return parse(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except DAMAGED as error:
        if path not in _named:
            _named.add(path)
            why = said(error).removeprefix(f'{path}: ')
            print(f'{path}: damaged, as if absent ({why})', file=sys.stderr, flush=True)
        return None


def said(error: BaseException) -> str:
    """Return an error in one line."""
    text = str(getattr(error, 'strerror', None) or error)
    return ' '.join(text.split())[:300] or type(error).__name__

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

from eol_ros.errors import ConfigError, EolError

T = TypeVar('T')
# What parsers of JSON, YAML, npz and pickles raise on the content of a damaged file.
DAMAGED = (
    OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, OverflowError,
    RecursionError, BadZipFile, zlib.error, EolError,
)  # fmt: skip
MOST_TEXT = 1_000_000  # bytes of a file that people write (chosen); a scene has some thousand
MOST_PIPED = 100_000_000  # bytes taken from a pipe (chosen): it does not say how many it holds
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


def readable(path: str | Path) -> bool:
    """Return whether `content` may read it: `-` for standard input, a file or a pipe."""
    return str(path) == '-' or Path(path).is_file() or Path(path).is_fifo()


def opened(path: str | Path, flags: int) -> int:
    """Open what is read once from front to back, for `opener` of open(); `-` is standard input.

    Raises OSError for a device. A pipe that nobody writes is empty.
    """
    if str(path) == '-':
        return os.dup(0)
    handle = os.open(path, flags | os.O_NONBLOCK)  # else a pipe that nobody writes holds on
    mode = os.fstat(handle).st_mode
    if stat.S_ISFIFO(mode):
        os.set_blocking(handle, True)
    elif not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        os.close(handle)
        raise OSError(errno.EINVAL, 'a device, not a file', str(path))
    return handle


def content(path: str | Path, most: int = MOST_TEXT) -> bytes:
    """Return the content of a file or pipe of at most `most` bytes; `-` is standard input.

    Raises
    ------
    OSError
        It cannot be read, is larger, is a device, or a pipe that nobody writes.
    """
    with open(path, 'rb', opener=opened) as file:
        about = os.fstat(file.fileno())
        if stat.S_ISREG(about.st_mode):
            size = about.st_size
        else:
            size = most = min(most, MOST_PIPED)
        data = b'' if size > most else file.read(size + 1)
        if max(size, len(data)) > most:
            raise OSError(errno.EFBIG, f'larger than {most / 1e6:g} MB', str(path))
        if not data and stat.S_ISFIFO(about.st_mode):
            raise OSError(errno.ENODATA, 'a pipe that nobody writes', str(path))
        return data


def check_file(path: str | Path) -> None:
    """Raise ConfigError for a pipe or a device, where more than one pass or place is read."""
    odd = Path(path).exists() and not Path(path).is_file() and not Path(path).is_dir()
    if odd or str(path) == '-':
        raise ConfigError(f'{path}: a pipe or device; write it to a file, and name that')


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

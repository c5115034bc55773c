# SPDX-License-Identifier: Apache-2.0
"""The cache of compiled loops, without numba: its folder, completeness and stale files.

One folder holds the code compiled with one set of versions for one processor. An object file holds
one function for one set of argument types. Its name contains a digest of everything that it was
made from (`core/compiled.py`), so a name means the same code whichever process wrote it, and
processes share no index. Files appear complete or not at all. They begin with a digest of their
content, and a damaged file is compiled again. If nothing can be stored (a full disk), the process
continues with the code that it has compiled, and logs it.

`eol compile` writes a manifest for each part, with its sources and objects, so that bringup finds
in some milliseconds which parts must be compiled.
"""

import contextlib
import fcntl
import functools
import hashlib
import importlib.metadata
import json
import mmap
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from eol_ros.disk import DISK
from eol_ros.errors import ConfigError

ROOT = Path(__file__).parent
# Nodes with compiled loops; the ice recording, which a scene without a recording needs; and the
# solvers of `eol simulate`.
PARTS = ('tracker', 'twin', 'sound', 'ice', 'simulate')
AT_FIRST = ('tracker', 'twin', 'sound', 'ice')  # what a scene may need
_SOURCES = 'eol_ros.core', 'eol_ros.lab', 'eol_ros.devices', 'eol_ros.verbs.compile'  # of parts
_NO_MATTER = ('NUMBA_CACHE_DIR', 'NUMBA_NUM_THREADS')  # of the settings of numba
_DO = 'set NUMBA_CACHE_DIR to a folder that can be written, where compiled loops are kept'
# Processor features of the target of `core/compiled.py`, as /proc/cpuinfo spells them.
_FLAGS = 'avx2', 'bmi1', 'bmi2', 'f16c', 'fma', 'fsgsbase', 'invpcid', 'abm', 'movbe', 'rdrand'
_MACHINE = ('model name', 'flags', 'Features', 'CPU implementer', 'CPU part')

WAIT_S, POLL_S = 600.0, 0.2  # for another `eol compile`; at a lock

_used: set[str] = set()  # objects that this process has loaded or stored
_unstored: list[str] = []  # why objects of this process are not in the cache


def cold(parts: Iterable[str]) -> list[str]:
    """Return those of `parts` (names of nodes; others need nothing) that must be compiled."""
    wanted = set(parts)
    return [part for part in PARTS if part in wanted and not _is_warm(part)]


@contextlib.contextmanager
def alone(waiting: Callable[[], None]) -> Iterator[None]:
    """Exclude other `eol compile` on the same cache; call `waiting()` first if one runs.

    The lock ends with the process. It only saves work, so a missing folder or a file system without
    locks is no error, and nobody waits for more than WAIT_S.
    """
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError, ConfigError):
            lock = held.enter_context((writable() / 'lock').open('w'))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                waiting()
                end_s = time.monotonic() + WAIT_S
                while time.monotonic() < end_s:
                    with contextlib.suppress(BlockingIOError):
                        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        break
                    time.sleep(POLL_S)
        yield


def load(name: str) -> tuple[bytes, Callable[[], bytes | None]] | None:
    """Return the payload of `name` and a function that reads it again; None if missing or damaged.

    Another process that compiled the same function may replace the file by code with other symbols.
    The mapping keeps the file that was loaded, at no cost in memory.
    """
    for folder in folders():
        try:
            with (folder / name).open('rb') as file:
                kept: bytes | mmap.mmap = file.read()
                if (payload := _checked(kept)) is not None:
                    with contextlib.suppress(OSError):  # a file system that maps no files
                        kept = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
                    _used.add(name)
                    return payload, functools.partial(_checked, kept)
        except OSError:
            continue
        say(f'{folder / name} is damaged; compiling it again')
    return None


def _checked(data: bytes | mmap.mmap) -> bytes | None:
    digest, _, rest = bytes(data).partition(b'\n')
    if digest != _digest(rest).encode():
        return None
    return rest.partition(b'\n')[2]


def store(name: str, sources: Mapping[str, str], payload: bytes) -> None:
    """Store `payload`, made from `sources` (path to digest), or log why it cannot be stored."""
    rest = json.dumps({_relative(path): value for path, value in sources.items()}).encode()
    rest += b'\n' + payload
    try:
        _write(writable() / name, _digest(rest).encode() + b'\n' + rest)
        _used.add(name)
    except (OSError, ConfigError) as error:
        if not _unstored:
            say(f'compiled loops are not stored: {error}')
        _unstored.append(str(error))


def stamp(part: str) -> None:
    """Write the manifest of `part`: the sources and objects of this process."""
    if _unstored:
        raise ConfigError(f'{_unstored[0]}; {_DO}')
    files = [
        file
        for name, module in list(sys.modules.items())
        if name.startswith(_SOURCES) and (file := getattr(module, '__file__', None))
    ]
    manifest = {
        'sources': {_relative(path): content(path) for path in files},
        'objects': sorted(_used),
    }
    try:
        _write(writable() / f'{part}.json', json.dumps(manifest).encode())
    except OSError as error:
        raise ConfigError(f'{error.filename}: {error.strerror}; {_DO}') from None


def _is_warm(part: str) -> bool:
    for folder in folders():
        try:
            manifest = json.loads((folder / f'{part}.json').read_bytes())
            if not _stale(manifest['sources']) and all(map(_is_whole, manifest['objects'])):
                return True
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return False


def _is_whole(name: str) -> bool:
    for folder in folders():
        with contextlib.suppress(OSError):
            if _checked((folder / name).read_bytes()) is not None:
                return True
    return False


def _stale(sources: Mapping[str, str]) -> bool:
    return any(_content(str(ROOT / path)) != digest for path, digest in sources.items())


def forget(everything: bool = False) -> None:
    """Remove objects of changed sources and damaged files; or everything.

    Also removes the files of other versions of numba, NumPy or this package for this Python.
    """
    for folder in folders():
        tag = folder.name.rpartition('-')[0]
        for path in folder.parent.glob(f'{tag}-*/*'):
            if everything or path.parent != folder or not _is_current(path):
                with contextlib.suppress(OSError):
                    path.unlink()
        for other in folder.parent.glob(f'{tag}-*'):
            with contextlib.suppress(OSError):
                other.rmdir()  # if nothing is left in it


def _is_current(path: Path) -> bool:
    try:
        if path.name.startswith('.'):  # being written, or left by a process that was killed
            return time.time() - path.stat().st_mtime < 3600
        if path.suffix != '.object':
            return True
        data = path.read_bytes()
        return _checked(data) is not None and not _stale(json.loads(data.split(b'\n', 2)[1]))
    except OSError:
        return True


def folders() -> list[Path]:
    """Return the possible folders of compiled loops, best first; none needs to exist."""
    name = f'loops-{sys.implementation.cache_tag}-{_version()}'
    shared = f'{ROOT.name}_{hashlib.sha1(str(ROOT).encode()).hexdigest()}'
    if given := os.environ.get('NUMBA_CACHE_DIR'):
        return [Path(given) / shared / name]
    user = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'numba'
    return [ROOT / '__pycache__' / name, user / shared / name]


def writable() -> Path:
    """Return the first writable one of `folders`, created if absent; else raise ConfigError."""
    reasons = []
    for folder in folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reasons.append(f'{folder.parent}: {error.strerror}')
            continue
        if os.access(folder, os.W_OK):
            return folder
        reasons.append(f'{folder}: read-only')
    raise ConfigError(f'{"; ".join(reasons)}; {_DO}')


def check() -> None:
    """Raise ConfigError if there is neither a folder to load from nor one to store in."""
    if not any(map(os.path.isdir, folders())):
        writable()


def numbers() -> Iterator[int]:
    """Yield numbers of 15 digits that no other process yields, forked or not."""
    process, number = 0, 0
    while True:
        if process != os.getpid():
            process, number = os.getpid(), 2**49 + int.from_bytes(os.urandom(6), 'big')
        number += 1
        yield number


def say(line: str) -> None:
    """Print a line for the user, or to the log of a node."""
    print(line, file=sys.stderr, flush=True)


@functools.cache
def content(path: str) -> str:
    """Return the digest of a file as it was at the first call.

    A process runs the sources that it has imported, even if an update replaces the files.
    """
    return _content(path)


def _content(path: str) -> str:
    try:
        return _digest(Path(path).read_bytes())
    except OSError:
        return _digest(path.encode())


def is_lasting(files: Iterable[str]) -> bool:
    """Return whether `content` depends on the code in all `files`: not that of a command line."""
    return all(map(os.path.exists, files))


def _relative(path: str) -> str:
    return os.path.relpath(path, ROOT) if path.startswith(f'{ROOT}{os.sep}') else path


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=20).hexdigest()


def _write(path: Path, data: bytes) -> None:
    """Write a file atomically: it is complete or absent, whenever the process ends."""
    try:
        DISK.write(path, data)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


@functools.cache
def _version() -> str:
    """Return a name for all but the sources that machine code depends on."""
    parts = [sys.implementation.cache_tag, platform.machine()]
    parts += [importlib.metadata.version(name) for name in ('numba', 'llvmlite', 'numpy')]
    parts += sorted(
        f'{k}={v}' for k, v in os.environ.items() if k.startswith('NUMBA_') and k not in _NO_MATTER
    )
    parts += _processor()
    return hashlib.blake2b('\n'.join(map(str, parts)).encode(), digest_size=6).hexdigest()


def _processor() -> list[str]:
    """Return the processor properties that machine code depends on; none if the target is fixed."""
    try:
        first = Path('/proc/cpuinfo').read_text().split('\n\n')[0].splitlines()
    except OSError:
        return [platform.processor()]
    if any(set(line.split()) >= set(_FLAGS) for line in first if line.startswith('flags')):
        return []
    return [line for line in first if line.startswith(_MACHINE)]

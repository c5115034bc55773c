# SPDX-License-Identifier: Apache-2.0
"""Is what numba compiles in its cache? Told in some milliseconds, without numba.

Each cached function knows what it was made from (`core/compiled.py`), but to ask it numba must be
imported, and all that it calls. So `eol compile` writes a stamp beside its cache when it has
compiled a part: what the sources contained, for which processor and which versions, and which files
that made. Where the package's own folders cannot be written, numba uses a folder of the user's, and
so do the stamps.
"""

import contextlib
import fcntl
import hashlib
import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from eol_ros.errors import ConfigError

ROOT = Path(__file__).parent
# What each part is made of, as packages with all below them; all use what stands in `core` itself.
# A part has the name of the node or the command that needs it.
PARTS = {
    'tracker': ('core/vision',),
    'twin': ('core/physics', 'core/vision'),
    'sound': ('core/sound', 'devices/audio'),
    'ice': ('core/sound',),  # no node: the recording that is made where a scene names none
    'simulate': ('core/physics',),  # `eol simulate`: the solvers beside that of the twin
    'stiff': ('core/physics',),  # and what the first scene with stiff springs needs,
    'glide': ('core/physics',),  # or the first in which all blocks vibrate against each other
}
AT_FIRST = ('tracker', 'twin', 'sound', 'ice')  # what a scene may need
_COMMON = 'core'
_FILES = {'devices/audio': 'callback.py'}  # where only one file of a package is compiled
_CALLS = {'devices/audio': ('core/sound',)}  # whose machine code stands in that of the package too
_NO_MATTER = ('NUMBA_CACHE_DIR', 'NUMBA_NUM_THREADS')  # of the settings of numba
_DO = 'set NUMBA_CACHE_DIR to a folder that can be written, where compiled loops are kept'
_MACHINE = ('model name', 'flags', 'Features', 'CPU implementer', 'CPU part')


def cold(parts: Iterable[str]) -> list[str]:
    """Return those of `parts` (names of nodes; others need nothing) that must be compiled."""
    return [part for part in PARTS if part in set(parts) and not _is_warm(part)]


@contextlib.contextmanager
def alone(waiting: Callable[[], None]) -> Iterator[None]:
    """Hold the cache while something is compiled into it; others wait, after `waiting()`.

    So two first starts at once do not compile everything twice, and neither forgets what the other
    has just made. Where no lock can be had they do.
    """
    path = _stamp('lock').with_suffix('.lock')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open('ab')
    except OSError:
        yield
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            waiting()
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def stamp(part: str) -> None:
    """Note that `part` has been compiled from the sources as they are."""
    folders = {
        name: {'sources': _digest(name), 'files': sorted(_cached(name))} for name in PARTS[part]
    }
    path = _stamp(part)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_suffix(f'.{os.getpid()}')
        new.write_text(json.dumps(folders))
        new.replace(path)
    except OSError as error:
        raise ConfigError(f'{path.parent}: {error.strerror}; {_DO}') from None


def explained(error: RuntimeError) -> ConfigError | None:
    """Return what to do where numba finds no folder for machine code; None for other faults."""
    if 'cannot cache function' not in str(error):
        return None
    folders = f'{cache_folder(_COMMON)} and {_user_cache()}'
    return ConfigError(f'{folders}: neither can be written; {_DO}')


def forget(everything: bool = False) -> None:
    """Remove from the cache what was compiled from sources that have changed, or all of it.

    numba names its files by the lines that functions stand in, and would leave those of earlier
    versions for good. What no stamp vouches for goes too.
    """
    names = {name for folders in PARTS.values() for name in folders}
    if not everything:
        known = [_read(part) for part in PARTS]
        names = {
            name
            for name in names
            if all(s.get(name, {}).get('sources') != _digest(name) for s in known)
        }
    for name in names:
        for file in _cached(name):
            folder, _, file = file.rpartition('/')
            (cache_folder(folder) / file).unlink(missing_ok=True)
    if everything:
        for part in PARTS:
            _stamp(part).unlink(missing_ok=True)


def cache_folder(name: str) -> Path:
    """Return where numba keeps what it compiles from folder `name` of this package."""
    source = ROOT / name
    if given := os.environ.get('NUMBA_CACHE_DIR'):
        return Path(given) / _subfolder(source)
    if os.access(source, os.W_OK):
        return source / '__pycache__'
    return _user_cache() / _subfolder(source)


def _subfolder(source: Path) -> str:
    """As numba names it in a folder that many packages share."""
    path = os.path.abspath(source)
    return f'{source.name}_{hashlib.sha1(path.encode()).hexdigest()}'


def _user_cache() -> Path:
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'numba'


def _cached(name: str) -> list[str]:
    """Return what the caches of a package hold for this Python, as `package/file`."""
    found = []
    version = f'.py{sys.version_info[0]}{sys.version_info[1]}'  # as numba names its files
    for folder in _folders(name):
        try:
            files = os.listdir(cache_folder(folder))
        except OSError:
            continue
        found += [f'{folder}/{f}' for f in files if f.endswith(('.nbi', '.nbc')) and version in f]
    return found


def _folders(name: str) -> list[str]:
    """Return a package and all below it, as paths from the root."""
    below = [path.parent for path in (ROOT / name).rglob('__init__.py')]
    return sorted(path.relative_to(ROOT).as_posix() for path in below)


def _stamp(part: str) -> Path:
    return cache_folder(_COMMON) / f'eol-{part}-{_machine()}.json'


def _read(part: str) -> dict[str, dict[str, Any]]:
    try:
        folders = json.loads(_stamp(part).read_text())
        return folders if isinstance(folders, dict) else {}
    except (OSError, ValueError):
        return {}


def _is_warm(part: str) -> bool:
    made = _read(part)
    return all(
        name in made
        and made[name]['sources'] == _digest(name)
        and set(made[name]['files']) <= set(_cached(name))
        for name in PARTS[part]
    )


def _digest(name: str) -> str:
    """Return what the sources of a package, those that it calls and those that all use, contain."""
    digest = hashlib.blake2b(digest_size=12)
    own = (ROOT / name).rglob(_FILES.get(name, '*.py'))
    called = (path for other in _CALLS.get(name, ()) for path in (ROOT / other).rglob('*.py'))
    for path in (*sorted((ROOT / _COMMON).glob('*.py')), *sorted(called), *sorted(own)):
        where = path.relative_to(ROOT).as_posix()
        digest.update(where.encode() + b'\0' + path.read_bytes())
    return digest.hexdigest()


def _machine() -> str:
    """Return a name for all but the sources that machine code depends on."""
    parts = [sys.implementation.cache_tag, platform.machine()]
    parts += [importlib.metadata.version(name) for name in ('numba', 'llvmlite', 'numpy')]
    parts += sorted(
        f'{k}={v}' for k, v in os.environ.items() if k.startswith('NUMBA_') and k not in _NO_MATTER
    )
    try:
        first = Path('/proc/cpuinfo').read_text().split('\n\n')[0].splitlines()
        parts += [line for line in first if line.startswith(_MACHINE)]
    except OSError:
        parts.append(platform.processor())
    return hashlib.blake2b('\n'.join(map(str, parts)).encode(), digest_size=6).hexdigest()

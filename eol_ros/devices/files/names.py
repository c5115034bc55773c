# SPDX-License-Identifier: Apache-2.0
"""Names of files as people mean them: a file is found whatever system its name was written on.

Names are bytes. Macs decompose umlauts, Windows ignores the case, archives of Windows hold names in
its code pages, and sticks of Macs carry a `._NAME` beside each file.
"""

import functools
import os
import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

_CODE_PAGES = ('cp437', 'cp850', 'cp1252', 'gb18030')


def visible(folder: Path) -> list[Path]:
    """Return what is in a folder in natural order, without hidden files; raises OSError."""
    return sorted((p for p in folder.iterdir() if p.name[0] != '.'), key=natural)


def natural(path: Path) -> tuple:
    """Return a sort key by which `image_9` comes before `image_10`."""
    words = re.split(r'(\d+)', unicodedata.normalize('NFC', path.name))
    return tuple((int(w), w) if w.isdecimal() else (-1, w) for w in words), path.name


def is_text(path: str | Path) -> bool:
    """Return whether a name is UTF-8, as messages and libraries need it."""
    try:
        str(path).encode()
        return True
    except UnicodeEncodeError:
        return False


def shown(path: str | Path) -> str:
    """Return a path as text for people and for formats that hold nothing else."""
    return os.fsencode(path).decode('utf-8', 'replace')


def find(folder: Path, name: str) -> Path:
    """Return the file in `folder` that `name` means; `folder / name` if there is none."""
    exact = folder / name
    if os.path.lexists(exact):
        return exact
    here = folder
    for part in PurePosixPath(name).parts:
        there = here / part
        if not os.path.lexists(there):
            try:
                index = _index(here, here.stat().st_mtime_ns)
            except OSError:
                return exact
            there = here / index.get(_key(part), part)
        here = there
    return here if os.path.lexists(here) else exact


@functools.lru_cache(maxsize=32)
def _index(folder: Path, _mtime_ns: int) -> dict[str, str]:
    return {key: path.name for path in reversed(visible(folder)) for key in _keys(path.name)}


def _keys(name: str) -> Iterator[str]:
    if is_text(name):
        yield _key(name)
        return
    for page in _CODE_PAGES:
        try:
            yield _key(os.fsencode(name).decode(page))
        except UnicodeDecodeError:
            continue


def _key(name: str) -> str:
    return unicodedata.normalize('NFC', unicodedata.normalize('NFC', name).casefold())


def stamp(path: str | Path) -> tuple[int, int]:
    """Return time (ns) and size of a file, which change with its content; (0, -1) of no file."""
    try:
        status = os.stat(path)
    except OSError:
        return 0, -1
    return status.st_mtime_ns, status.st_size

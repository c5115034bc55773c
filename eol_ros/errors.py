# SPDX-License-Identifier: Apache-2.0
"""The errors a user can cause or meet: one line that says what, where, and what to do."""

import contextlib
import difflib
import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

FEW_NAMES = 8  # are read at a glance (chosen); of more, only the nearest are named
MOST_SHOWN = 2000  # characters of a line in a message (chosen): it quotes what it found


class EolError(Exception):
    """Root of every expected error; printed as one line, never as a traceback."""

    exit_code = 1


class UsageError(EolError):
    """The command line asks for something that cannot be done."""

    exit_code = 2


class DeviceMissing(EolError):
    """A camera, board, sound card, file or folder that is needed is not there."""

    exit_code = os.EX_UNAVAILABLE


class SupervisorSilent(EolError):
    """A graph runs, but the process that supervises it does not answer."""


class ConfigError(EolError):
    """A scene or another file says something wrong, or names a place that cannot be written."""

    exit_code = os.EX_CONFIG


class BagDamaged(UserWarning):
    """Something of a bag cannot be read and was left out; a command ends with exit code 1."""


@contextlib.contextmanager
def writing(path: str | Path, option: str = '') -> Iterator[None]:
    """Raise ConfigError with the name of `path` where the body raises OSError.

    option: the command's word that named the file, for the message.
    """
    try:
        yield
    except OSError as error:
        where = f'{option} {path}'.lstrip()
        raise ConfigError(f'{where}: cannot be written ({error.strerror or error})') from None


def each(check: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
    """Return `check(item)` of each item; raise one ConfigError that names all refused items."""
    found, wrong = [], []
    for item in items:
        try:
            found.append(check(item))
        except ConfigError as error:
            wrong.append(str(error))
    if wrong:
        raise ConfigError('; '.join(wrong))
    return found


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the sentence that ends a `no such ...`: the names of `known` that are nearest.

    >>> nearest('musem', ['lights', 'museum'])
    'Did you mean museum?'
    """
    names = list(known)
    if near := difflib.get_close_matches(name, names, 1, 0.6):
        return f'Did you mean {near[0]}?'
    if len(names) <= FEW_NAMES:
        return f'There are {", ".join(names)}.' if names else 'There is none.'
    near = difflib.get_close_matches(name, names, 3, 0.0)
    return f'Of {len(names)}, the nearest are {", ".join(near)}.'


def printable(text: str) -> str:
    """Return a text of unknown origin in one line: controls escaped, the middle cut out if long.

    The surrogates for bytes that are not UTF-8 stay.
    """
    half = MOST_SHOWN // 2
    if len(text) > MOST_SHOWN:
        text = f'{text[:half]} ... ({len(text) - 2 * half} more characters) ... {text[-half:]}'
    if text.isprintable():
        return text
    return ''.join(
        c if c.isprintable() or '\udc80' <= c <= '\udcff' else repr(c)[1:-1] for c in text
    )


def pip_install(*packages: str) -> str:
    """Return the command that installs packages where this very Python finds them."""
    return shlex.join([sys.executable, '-m', 'pip', 'install', *packages])


def warning_line(
    message: Warning | str, category: type[Warning], filename: str, lineno: int
) -> str:
    """Return a warning of Python in one line, for a log; Python itself prints the code as well."""
    return f'{category.__name__}: {" ".join(str(message).split())} ({filename}:{lineno})'

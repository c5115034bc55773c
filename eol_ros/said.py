# SPDX-License-Identifier: Apache-2.0
"""Texts with the codes by which pages show them in the reader's language.

`lang` has the text of each code as `said_CODE`, in each language. The graph has code and arguments
beside the English text.
"""

import functools
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

SAID = 'said'  # the key in a DiagnosticStatus under which the parts go, as JSON
LANGUAGES = Path(__file__).parent / 'lang'


class Said(str):
    """An English text that knows its codes: a plain str to all that need no other language.

    `parts` has for each clause [code, places], or a plain str where there is no code.
    """

    parts: list[Any]

    def __str__(self) -> str:
        return self  # so that `str(error)` keeps the codes


@functools.cache
def texts() -> dict[str, str]:
    """Return the English text of each code."""
    words: dict[str, str] = json.loads((LANGUAGES / 'en.json').read_text('utf-8'))
    return {k.removeprefix('said_'): v for k, v in words.items() if k.startswith('said_')}


def said(code: str, /, **places: Any) -> Said:
    """Return the text of `code` with its {places} filled; what fills them may have codes, too.

    >>> text = said('pairs', count=24)
    >>> text, text.parts
    ('24 pairs', [['pairs', {'count': '24'}]])
    """
    places = {name: str(value) for name, value in places.items()}
    parts = {n: v.parts if isinstance(v, Said) else v for n, v in places.items()}
    return _with(texts()[code].format(**places), [[code, parts]])


def clauses(texts: Iterable[str], mark: str = '; ') -> Said:
    """Return texts as one, the empty ones left out; each clause keeps its code.

    >>> clauses([said('asleep'), '', 'no corpus']).parts
    [['asleep', {}], 'no corpus']
    """
    kept = [text for text in texts if text]
    return _with(mark.join(kept), [part for text in kept for part in parts_of(text)])


def parts_of(text: str) -> list[Any]:
    """Return the clauses of a text, those that have a code with it."""
    return text.parts if isinstance(text, Said) else [str(text)]


def code_and_args(text: str) -> tuple[str, dict[str, str]]:
    """Return the code of the first clause and its arguments, as messages have them.

    `why:` is the code of what fills the place `why`, `why:name` an argument of that. Clauses after
    the first are arguments `1`, `2` and so on.

    >>> code_and_args(said('lost', why=said('muted')))
    ('lost', {'why:': 'muted'})
    """
    return _flat(text.parts) if isinstance(text, Said) else ('', {})


def from_message(text: str, code: str, args: Mapping[str, Any]) -> Said:
    """Return a text that knows its codes, by what `code_and_args` gave."""
    return _with(text, _parts(code, args) or [text])


def _with(text: str, parts: list[Any]) -> Said:
    whole = Said(text)
    whole.parts = parts
    return whole


def _flat(parts: list[Any]) -> tuple[str, dict[str, str]]:
    code, args = '', {}
    for k, part in enumerate(parts):
        if k == 0 and isinstance(part, list):
            code, places = part
        else:
            places = {str(k): part if isinstance(part, str) else [part]}
        for name, value in places.items():
            if isinstance(value, str):
                args[name] = value
            else:
                inner, own = _flat(value)
                args |= {f'{name}:': inner} | {f'{name}:{key}': v for key, v in own.items()}
    return code, args


def _parts(code: str, args: Mapping[str, Any]) -> list[Any]:
    places: dict[str, Any] = {}
    for key, value in args.items():
        name, inside, rest = key.partition(':')
        if inside:
            places.setdefault(name, {})[rest] = value
        else:
            places[name] = value
    for name, value in places.items():
        if isinstance(value, dict):
            places[name] = _parts(value.pop('', ''), value)
    clauses = [places.pop(name) for name in sorted(filter(str.isdigit, places), key=int)]
    first = [[code, places]] if code else []
    return first + [p for one in clauses for p in (one if isinstance(one, list) else [one])]

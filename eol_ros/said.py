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

DEEPEST = 8  # texts within each other in a message
LANGUAGES = Path(__file__).parent / 'lang'


class Said(str):
    """An English text that knows its codes: a plain str to all that need no other language.

    `parts` has for each clause [code, places], or a plain str where there is no code.
    """

    parts: list[Any]

    def __str__(self) -> str:
        return self  # so that `str(error)` keeps the codes


@functools.cache
def _words(language: str) -> dict[str, str]:
    return dict(json.loads((LANGUAGES / f'{language}.json').read_text('utf-8')))


def said(code: str, /, **places: Any) -> Said:
    """Return the text of `code` with its {places} filled; what fills them may have codes, too.

    >>> text = said('pairs', count=24)
    >>> text, text.parts
    ('24 pairs', [['pairs', {'count': '24'}]])
    """
    places = {name: str(value) for name, value in places.items()}
    parts = {n: v.parts if isinstance(v, Said) else v for n, v in places.items()}
    return _with(_words('en')[f'said_{code}'].format(**places), [[code, parts]])


def clauses(texts: Iterable[str], mark: str = '; ') -> Said:
    """Return texts as one, the empty ones left out; each clause keeps its code.

    >>> clauses([said('asleep'), '', 'no corpus']).parts
    [['asleep', {}], 'no corpus']
    """
    kept = [text for text in texts if text]
    return _with(mark.join(kept), [part for text in kept for part in parts_of(text)])


def first_clause(text: str) -> Said:
    """Return the first clause alone.

    >>> first_clause(clauses([said('asleep'), 'no corpus'])).parts
    [['asleep', {}]]
    """
    part = parts_of(text)[0]
    return _with(_spoken([part], _words('en')), [part])


def parts_of(text: str) -> list[Any]:
    """Return the clauses of a text, those that have a code with it."""
    return text.parts if isinstance(text, Said) else [str(text)]


def translated(text: str, language: str) -> str:
    """Return a text in `language`; a clause without a code stays as it is.

    >>> translated(said('pairs', count=24), 'zh-Hant')
    '24 組圖像'
    """
    return _spoken(parts_of(text), _words(language))


def _spoken(parts: list[Any], words: Mapping[str, str]) -> str:
    found = []
    for part in parts:
        if isinstance(part, str):
            found.append(part)
        else:
            places = {n: v if isinstance(v, str) else _spoken(v, words) for n, v in part[1].items()}
            found.append(words[f'said_{part[0]}'].format(**places))
    return words['clause_mark'].join(found)


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
    args = {key: value for key, value in args.items() if key.count(':') <= DEEPEST}
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
    within: dict[str, dict[str, Any]] = {}
    for key, value in args.items():
        name, inside, rest = key.partition(':')
        if inside:
            within.setdefault(name, {})[rest] = value
        else:
            places[name] = value
    places |= {name: _parts(found.pop('', ''), found) for name, found in within.items()}
    more = sorted(filter(str.isdecimal, places), key=lambda name: (len(name), name))
    parts = [[code, places]] if code else []
    for clause in map(places.pop, more):
        parts += clause if isinstance(clause, list) else [clause]
    return parts

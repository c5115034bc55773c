# SPDX-License-Identifier: Apache-2.0
"""Gives what nodes answer, refuse and say in English the codes by which pages show it otherwise.

On the graph an answer is a sentence (`RequestResult.reason`), for `ros2 topic echo` and for bags.
Here it is looked up in the English words of the pages, as gettext does, but for its {places}: what
is found goes to the pages as [code, places], the rest as it came.
"""

import functools
import json
import re
from pathlib import Path
from typing import Any

from eol_ros.settings import FORMS
from eol_ros.streams.graph import NODES

LANGUAGE = Path(__file__).parent / 'static' / 'lang' / 'en.json'
PREFIX = 'said_'
OF_NODE = 'of_node'
# Places that hold words with a code of their own.
INNER = ('why', 'day', 'cause', 'what', 'which', 'part', 'span', 'list', 'doing', 'power')
_PLACES = {
    'node': '|'.join(NODES), 'day': '[A-Z][a-z]{2}', 'why': '.+?', 'number': r'\d+',
    'setting': r'\w+', 'shape': '|'.join(FORMS), 'address': r'\S+',
    'doing': 'paused at|playing|standing|over',
    'power': '(?:on|off|cooling down|warming up)(?:, [^;]+)?|(?:was|does|asks|refuses|has) [^;]+',
}  # fmt: skip
_CLAUSE = '(?:(?!; ).)+?'
_PLACE = re.compile(r'\{(\w+)\}')


def recognised(text: str) -> list[Any]:
    """Return the clauses of a text, each as [code, places] or, where none is known, as a str.

    >>> recognised('sound: there is no corpus yet')
    [['of_node', {'node': 'sound', 'why': [['no_corpus', {}]]}]]
    >>> recognised('muted; anything else')
    [['muted', {}], 'anything else']
    """
    clauses = text.split('; ') if text else []
    found: list[Any] = []
    while clauses:
        for count in range(len(clauses), 0, -1):  # some sentences have a semicolon within
            one = _found('; '.join(clauses[:count]))
            if one is not None:
                break
        found.append(clauses[0] if one is None else one)
        del clauses[:count]
    return found


def deepened(parts: list[Any]) -> list[Any]:
    """Return what a node said with its codes, recognised also where it gave English alone.

    >>> deepened([['not_recording', {'why': 'muted'}], 'asleep'])
    [['not_recording', {'why': [['muted', {}]]}], ['asleep', {}]]
    """
    found: list[Any] = []
    for part in parts:
        if isinstance(part, str):
            found += recognised(part)
            continue
        code, places = part
        inner = {name: places[name] for name in INNER if isinstance(places.get(name), str)}
        found.append([code, {**places, **{n: _inner(n, text) for n, text in inner.items()}}])
    return found


def _inner(name: str, text: str) -> list[Any]:
    clauses = text.split(', ') if name == 'power' else [text]  # of a projector are told so
    return [part for clause in clauses for part in recognised(clause)]


def _found(text: str) -> list[Any] | None:
    for code, pattern in _patterns():
        match = pattern.fullmatch(text)
        if match:
            places: dict[str, Any] = match.groupdict()
            inner = {name: _inner(name, places[name]) for name in INNER if name in places}
            return [code, {**places, **inner}]
    return None


@functools.cache
def _patterns() -> list[tuple[str, re.Pattern[str]]]:
    """Return code and pattern of all that is said: a node that speaks, then by the most words."""
    words = json.loads(LANGUAGE.read_text('utf-8'))
    said = {k.removeprefix(PREFIX): v for k, v in words.items() if k.startswith(PREFIX)}
    said = dict(sorted(said.items(), key=lambda one: -len(_PLACE.sub('', one[1]))))
    order = {OF_NODE: said.pop(OF_NODE), **said}
    return [(code, re.compile(_pattern(text), re.DOTALL)) for code, text in order.items()]


def _pattern(text: str) -> str:
    literal = _PLACE.split(text)  # words, place, words, place ... words
    return ''.join(
        f'(?P<{part}>{_PLACES.get(part, _CLAUSE)})' if i % 2 else re.escape(part)
        for i, part in enumerate(literal)
    )

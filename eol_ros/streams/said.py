# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself, with the codes by which pages say it in the reader's language.

The words of a code stand beside it in the code, in English, and in `web/static/lang` as
`said_CODE`, in each language; a test compares them.
"""

from collections.abc import Iterable
from typing import Any

SAID = 'said'  # the key in a DiagnosticStatus under which the parts go, as JSON


class Said(str):
    """An English text that knows its codes: a plain str to all that need no other language.

    `parts` has for each clause [code, places], or a plain str where there is no code.
    """

    parts: list[Any]


def said(code: str, words: str, /, **places: Any) -> Said:
    """Return `words` with its {places} filled, and its code; what fills them may have codes, too.

    >>> text = said('pairs', '{count} pairs', count=24)
    >>> text, text.parts
    ('24 pairs', [['pairs', {'count': '24'}]])
    """
    text = Said(words.format(**places))
    text.parts = [[code, {
        name: value.parts if isinstance(value, Said) else str(value)
        for name, value in places.items()
    }]]  # fmt: skip
    return text


def clauses(texts: Iterable[str]) -> Said:
    """Return texts as one, the empty ones left out; each clause keeps its code.

    >>> clauses([said('asleep', 'asleep'), '', 'no corpus']).parts
    [['asleep', {}], 'no corpus']
    """
    kept = [text for text in texts if text]
    whole = Said('; '.join(kept))
    whole.parts = [part for text in kept for part in parts_of(text)]
    return whole


def parts_of(text: str) -> list[Any]:
    """Return the clauses of a text, those that have a code with it."""
    return text.parts if isinstance(text, Said) else [str(text)]

# SPDX-License-Identifier: Apache-2.0
"""The codes of what `core.vision` says, which gives English text alone; found by its words."""

import functools
import re

from eol_ros.said import Said, clauses, said, texts

CODES = (
    'lamps_learnt', 'no_lattice', 'out_of_sight', 'background_learnt', 'few_dark', 'still_lit',
    'calibrated', 'known_to', 'lens_held', 'not_calibrated', 'no_squares', 'learns_scale',
    'must_rest', 'off_lattice', 'squares_seen', 'not_in_rows', 'few_covers', 'not_grey',
    'other_size', 'black', 'white', 'frozen',
)  # fmt: skip


def recognised(text: str) -> Said:
    """Return a text with the codes of its clauses, of which some hold a semicolon themselves.

    >>> recognised('blocks out of sight; anything else').parts
    [['out_of_sight', {}], 'anything else']
    """
    words, found = text.split('; '), []
    while words:
        ends = range(len(words), 0, -1)
        known = [(end, one) for end in ends if (one := _found('; '.join(words[:end])))]
        end, one = known[0] if known else (1, words[0])
        found.append(one)
        del words[:end]
    return clauses(found)


def _found(text: str) -> str:
    for code, pattern in _patterns().items():
        if match := pattern.fullmatch(text):
            places = match.groupdict()
            if 'why' in places:
                places['why'] = recognised(places['why'])
            return said(code, **places)
    return ''


@functools.cache
def _patterns() -> dict[str, re.Pattern[str]]:
    parts = {code: re.split(r'\{(\w+)\}', texts()[code]) for code in CODES}
    return {
        code: re.compile(
            ''.join(
                f'(?P<{part}>.+?)' if k % 2 else re.escape(part) for k, part in enumerate(found)
            )
        )
        for code, found in parts.items()
    }

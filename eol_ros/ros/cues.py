# SPDX-License-Identifier: Apache-2.0
"""The cues of a scene: requests by name, checked against the nodes that the scene has.

A line is a cue and one of its requests, in the words of `eol call`:

    evening set leds look=embers peak=0.5
    evening recall_preset preset=night over_s=20
"""

import shlex
import unicodedata
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

from eol_ros.core import cue_times
from eol_ros.errors import ConfigError, EolError, nearest
from eol_ros.ros.parameters import checked_live
from eol_ros.ros.request_words import asked_of
from eol_ros.streams.graph import NODES
from eol_ros.streams.requests import CUE, KINDS, SET, Asked

Cues = dict[str, list[tuple[Asked, set[str]]]]  # requests, and the nodes that must answer


def cues_of(lines: Iterable[str], there: Collection[str]) -> Cues:
    """Return the cues of lines; raise ConfigError that quotes the first mistake.

    `there` are the nodes of the scene.
    """
    found: Cues = {}
    for line in lines:
        name, asked = _read(line)
        try:
            found.setdefault(name, []).append((asked, _answering(asked, there)))
        except EolError as error:
            raise ConfigError(f'{line!r}: {error}') from None
    return found


def _read(line: str) -> tuple[str, Asked]:
    try:
        name, _, request = line.partition(' ')
        words = shlex.split(request)
        if not words:
            raise ValueError('give CUE REQUEST, such as evening set leds look=embers')
        name = KINDS[CUE].check({'name': name})['name']
        asked = asked_of(words)
        if asked.kind == CUE:
            raise ValueError('a cue gives no other cue: write the requests of that one')
        if asked.kind == SET:
            kind = NODES[asked.node].settings
            asked = replace(asked, values=checked_live(kind, asked.node, asked.values))
    except (ValueError, EolError) as error:
        raise ConfigError(f'{line!r}: {error}') from None
    return name, asked


def _answering(asked: Asked, there: Collection[str]) -> set[str]:
    kind = KINDS[asked.kind]
    found = set(kind.whom(asked.node)) & set(there)
    needed = {kind.answered_by} - {''}
    if not found or not needed <= set(there):
        names = ' or '.join(needed or ([asked.node] if asked.node else kind.nodes))
        raise ConfigError(f'this scene has no {names}: add it, or leave out this line')
    return needed or found


def mistakes(
    cues: Iterable[str], times: Iterable[str], there: Collection[str]
) -> Iterator[tuple[str, str]]:
    """Yield the setting of each mistake in the lines `cues` and `cue_times`, and what is wrong."""
    known = set()
    for number, line in enumerate(cues):
        known.add(unicodedata.normalize('NFC', line.partition(' ')[0]))
        try:
            cues_of([line], there)
        except ConfigError as error:
            yield f'cues[{number}]', str(error)
    for number, line in enumerate(times):
        try:
            name = cue_times.line(line).cue
            if name not in known:
                raise ConfigError(f'{line!r}: no such cue. {nearest(name, known)}')
        except ConfigError as error:
            yield f'cue_times[{number}]', str(error)

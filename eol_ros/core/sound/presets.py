# SPDX-License-Identifier: Apache-2.0
"""Between two sets of settings: what a sound is on its way from one preset to another."""

import dataclasses
from collections.abc import Mapping
from typing import Any

STEPPED = ('choices', 'path', 'form')  # settings of these kinds have nothing between


def live_values(settings: Any) -> dict[str, Any]:
    """Return the live settings, by name.

    Examples
    --------
    >>> from eol_ros.settings import SoundSettings
    >>> live_values(SoundSettings())['gain_db'], 'device' in live_values(SoundSettings())
    (-4.0, False)
    """
    fields = dataclasses.fields(settings)
    return {f.name: getattr(settings, f.name) for f in fields if f.metadata.get('live')}


def between(
    kind: type,
    start: Mapping[str, Any],
    end: Mapping[str, Any],
    share: float,
    whole: frozenset[str] = frozenset(),
) -> dict[str, Any]:
    """Return the settings of `kind` that lie `share` (0..1) of the way from `start` to `end`.

    Numbers glide: what is a frequency, a speed or a time and above 0 at both ends by its logarithm,
    all else in a straight line, and whole numbers by whole numbers. What cannot glide, and the
    settings named in `whole`, change half-way. Only what differs is returned.

    Examples
    --------
    >>> from eol_ros.settings import GrainsSettings
    >>> there = {'playback_rate': 4.0, 'gain': 0.5, 'mode': 'bow'}
    >>> between(GrainsSettings, {'playback_rate': 1.0, 'gain': 1.0, 'mode': 'fence'}, there, 0.5)
    {'playback_rate': 2.0, 'gain': 0.75, 'mode': 'bow'}
    """
    fields = {f.name: f for f in dataclasses.fields(kind)}
    found = {}
    for name, goal in end.items():
        begin, field = start.get(name, goal), fields[name]
        if begin == goal:
            continue
        number = all(type(v) in (int, float) for v in (begin, goal)) and name not in whole
        if not number or any(field.metadata.get(key) for key in STEPPED):
            found[name] = goal if share >= 0.5 else begin
        elif share <= 0 or share >= 1:
            found[name] = goal if share >= 1 else begin
        else:
            scale = field.metadata.get('unit') in ('Hz', 's') or name.endswith('rate')
            if scale and begin > 0 and goal > 0:
                value = begin ** (1 - share) * goal**share
            else:
                value = begin + share * (goal - begin)
            found[name] = round(value) if field.type is int else value
    return found

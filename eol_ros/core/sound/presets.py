# SPDX-License-Identifier: Apache-2.0
"""Interpolation of settings between two presets."""

import dataclasses
from collections.abc import Mapping
from typing import Any

STEP_S = 0.1  # between two steps of a glide


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
        if not number or field.metadata.get('choices'):
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


class Glide:
    """A glide from one preset to another; each step has only the settings that change.

    kinds: the class of settings of each node; start, end: values by node and name, of the same
    names. What only one of them has stays as it is.
    """

    def __init__(
        self,
        kinds: Mapping[str, type],
        start: Mapping[str, Mapping[str, Any]],
        end: Mapping[str, Mapping[str, Any]],
        over_s: float,
        whole: frozenset[str] = frozenset(),
    ):
        self._kinds = {node: kinds[node] for node in end if node in start}
        self._start, self._end, self._whole = start, end, whole
        self._over_s = over_s
        self.given = {node: dict(values) for node, values in start.items()}
        self.over = False

    def step(self, elapsed_s: float) -> dict[str, dict[str, Any]]:
        """Return what changes by `elapsed_s` after the start, by node; nothing where none does."""
        share = min(elapsed_s / self._over_s, 1.0)
        found = {}
        for node, kind in self._kinds.items():
            now = between(kind, self._start[node], self._end[node], share, self._whole)
            changed = {k: v for k, v in now.items() if v != self.given[node][k]}
            if changed:
                self.given[node] |= changed
                found[node] = changed
        self.over = share >= 1.0
        return found

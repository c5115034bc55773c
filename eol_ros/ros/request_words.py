# SPDX-License-Identifier: Apache-2.0
"""Requests in words, as the command line and the cues of a scene have them."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import yaml

from eol_ros.errors import UsageError
from eol_ros.streams.graph import NODES
from eol_ros.streams.requests import KINDS, SET, Asked, Kind, Word, no_request


def asked_of(words: Sequence[str]) -> Asked:
    """Return the request of `KIND [NODE] [NAME=VALUE ...]`; raise UsageError that names a mistake.

    Examples
    --------
    >>> asked_of(['recall_preset', 'preset=night', 'over_s=10']).values
    {'preset': 'night', 'over_s': 10.0}
    """
    name, *rest = words
    kind = KINDS.get(name)
    if kind is None or kind.internal:
        raise UsageError(no_request(name))
    node = rest.pop(0) if rest and '=' not in rest[0] else ''
    if name == SET and not node:
        raise UsageError('set: the node is missing; write set NODE NAME=VALUE')
    kind.whom(node)
    return Asked(name, node, kind.check(_values(rest, _types(kind, node))))


def value_of(text: str, kind: Any) -> Any:
    """Return what a word says: YAML, but what takes text gets the text.

    So a filter can be `off`, which YAML takes for false, and a name can be empty.
    """
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        return text
    if kind is str and not isinstance(value, str):
        return text
    return float(value) if kind is float and type(value) is int else value


def _types(kind: Kind, node: str) -> dict[str, Any]:
    if kind.name == SET:
        return {f.name: f.type for f in dataclasses.fields(NODES[node].settings)}
    return {item.name: str for item in kind.takes if isinstance(item, Word)}


def _values(words: Iterable[str], types: Mapping[str, Any]) -> dict[str, Any]:
    found = {}
    for word in words:
        name, equals, text = word.partition('=')
        if not equals or not name:
            raise UsageError(f'{word!r} is not NAME=VALUE')
        found[name] = value_of(text, types.get(name))
    return found

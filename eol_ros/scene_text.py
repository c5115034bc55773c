# SPDX-License-Identifier: Apache-2.0
"""Changes settings in a scene file, and leaves all else in it as it was written."""

import dataclasses
import json
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import yaml

from eol_ros import scene
from eol_ros.disk import DISK, check_file, content
from eol_ros.errors import ConfigError, writing
from eol_ros.yaml_text import decoded


def to_write(path: Path, node: str) -> scene.Scene:
    """Return the checked scene in `path`, which is to be changed; raise ConfigError if it may not.

    A scene that ships is not: the next version of eol would bring it back as it was.
    """
    check_file(path)
    if not path.is_file():
        raise ConfigError(f'{path}: no such file; name a scene file of your own to write to')
    if path.resolve() in {shipped.resolve() for shipped in scene.shipped().values()}:
        raise ConfigError(f'{path}: ships with eol: copy it, and name the copy')
    loaded = scene.load(path)
    if node not in loaded.nodes:
        raise ConfigError(
            f'{path}: has no {node} among its nodes, whose settings are to be written'
        )
    return loaded


def write(path: Path, node: str, values: Mapping[str, Any]) -> None:
    """Set `values` of `node` in the scene file `path`; its comments and all else stay.

    The file is replaced whole, once what was written reads as it should. Raises ConfigError.
    """
    path = path.resolve()
    before = to_write(path, node)
    for field in dataclasses.fields(before.nodes[node]):
        if field.name in values:
            try:
                scene.check_value(field, values[field.name])
            except ConfigError as error:
                raise ConfigError(f'{path}: {node}.{field.name}: {error}') from None
    wanted = scene.plain(before)
    wanted['nodes'][node] |= values
    with writing(path), DISK.replacing(path) as part:
        text = changed(decoded(content(path)), node, values)
        part.write_bytes(text.encode())
        part.chmod(path.stat().st_mode)
        if not _says(part, wanted):
            raise ConfigError(
                f'{path}: {node} is written there in a way that cannot be changed: write '
                + ', '.join(f'{name}: {plain(value)}' for name, value in values.items())
            )


def _says(path: Path, wanted: Mapping[str, Any]) -> bool:
    """Return whether the scene in `path` is `wanted`, which may have another name."""
    try:
        found = scene.plain(scene.load(path))
    except scene.SceneError:
        return False
    return found | {'scene': wanted['scene']} == wanted


def changed(text: str, node: str, values: Mapping[str, Any]) -> str:
    """Return the YAML `text` of a scene with `values` of `node` set in it."""
    top = yaml.compose(text, Loader=yaml.SafeLoader)
    nodes = _child(top, 'nodes')
    if not isinstance(nodes, yaml.MappingNode) or not nodes.value:
        return f'{text.rstrip()}\nnodes:\n  {node}: {_flow(values)}\n'
    place = _child(nodes, node)
    if place is None:  # it stands in an included file
        return _added(text, nodes, {node: _flow(values)})
    if not isinstance(place, yaml.MappingNode):  # `twin:` and nothing behind it
        colon = text.index(':', _key(nodes, node).end_mark.index) + 1
        return f'{text[:colon]} {_flow(values)}{text[max(colon, place.end_mark.index) :]}'
    missing = {name: plain(value) for name, value in values.items() if not _child(place, name)}
    if missing:
        text = _added(text, place, missing)
    for name in values:
        if name not in missing:
            # each edit moves what stands behind it
            here = _child(_child(_child(yaml.compose(text), 'nodes'), node), name)
            begin, end = here.start_mark.index, here.end_mark.index
            end = begin + len(text[begin:end].rstrip())  # a list in lines ends at the next key
            text = text[:begin] + plain(values[name]) + text[end:]
    return text


def plain(value: Any) -> str:
    """Return a number as YAML 1.1 reads it: without an exponent; or a list of texts."""
    if isinstance(value, list):
        return json.dumps(value, ensure_ascii=False)
    return format(Decimal(repr(value)), 'f')


def _flow(values: Mapping[str, Any]) -> str:
    return '{' + ', '.join(f'{name}: {plain(value)}' for name, value in values.items()) + '}'


def _added(text: str, mapping: yaml.MappingNode, items: Mapping[str, str]) -> str:
    """Return `text` with `items` as further keys of `mapping`."""
    if mapping.flow_style:
        row = ', '.join(f'{name}: {value}' for name, value in items.items())
        if not mapping.value:
            at = mapping.start_mark.index + 1
            return text[:at] + row + text[at:]
        last = mapping.value[-1][1].end_mark.index
        return f'{text[:last]}, {row}{text[last:]}'
    first = mapping.value[0][0].start_mark
    begin = first.index - first.column
    newline = '\r\n' if '\r\n' in text else '\n'
    rows = ''.join(f'{" " * first.column}{name}: {value}{newline}' for name, value in items.items())
    return text[:begin] + rows + text[begin:]


def _key(mapping: Any, name: str) -> Any:
    return next((key for key, _ in mapping.value if key.value == name), None)


def _child(mapping: Any, name: str) -> Any:
    if not isinstance(mapping, yaml.MappingNode):
        return None
    return next((value for key, value in mapping.value if key.value == name), None)

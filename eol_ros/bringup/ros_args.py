# SPDX-License-Identifier: Apache-2.0
"""`--ros-args` of bringup: namespace and settings go into the scene, the rest to each node.

So a bag says what its nodes were given. Of two values for one parameter the later counts.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from eol_ros import yaml_text
from eol_ros.disk import content
from eol_ros.errors import ConfigError, UsageError
from eol_ros.ros.parameters import checked
from eol_ros.scene import Scene, check_namespace
from eol_ros.settings import renamed
from eol_ros.streams.graph import NODES

REMAP, PARAMETER, FILE = ('-r', '--remap'), ('-p', '--param'), '--params-file'
WITH_VALUE = ('--log-level', '-e', '--enclave', '--log-config-file')
PARAMETERS = 'ros__parameters'


@dataclass
class RosArgs:
    """The scene as the arguments make it, and what each node is given besides.

    parameters: by node, those that are no settings of it, as qos_overrides. others: for all nodes.
    """

    scene: Scene
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    others: tuple[str, ...] = ()

    def of(self, nodes: Sequence[str]) -> list[str]:
        """Return the arguments of a process that runs `nodes`."""
        found = list(self.others)
        for node in nodes:
            for name, value in self.parameters.get(node, {}).items():
                found += ['-p', f'{name}:={json.dumps(value)}']
        return found


def read(scene: Scene, words: Sequence[str]) -> RosArgs:
    """Return what the words behind --ros-args make of a scene.

    Raises UsageError for words that ROS has not, ConfigError for a file or a value that cannot be.
    """
    left = iter(word for word in words if word != '--')
    others: list[str] = []
    given: list[tuple[str, str, Any]] = []  # pattern of nodes, parameter, value
    for word in left:
        value = ''
        if word in (*REMAP, *PARAMETER, *WITH_VALUE, FILE) and not (value := next(left, '')):
            raise UsageError(f'--ros-args {word}: a value must follow')
        if word in REMAP:
            scene = _remapped(scene, word, value, others)
        elif word in PARAMETER:
            given.append(_parameter(word, value, scene))
        elif word == FILE:
            given += _file(Path(value))
        elif word in WITH_VALUE or word.startswith('--'):
            others += [word, value] if value else [word]
        else:
            raise UsageError(f'--ros-args {word}: expected -r RULE, -p NAME:=VALUE or {FILE} FILE')
    return _settle(RosArgs(scene, others=tuple(others)), given)


def _remapped(scene: Scene, word: str, rule: str, others: list[str]) -> Scene:
    name, found, value = rule.partition(':=')
    if not found:
        raise UsageError(f'--ros-args {word} {rule}: not a rule FROM:=TO')
    if name in ('__node', '__name'):
        raise UsageError(f'--ros-args {word} {rule}: nodes of a scene keep their names')
    if name != '__ns':
        others += [word, rule]
        return scene
    try:
        return replace(scene, namespace=check_namespace(value))
    except ConfigError as error:
        raise UsageError(f'--ros-args {word} {rule}: {error}') from None


def _parameter(word: str, rule: str, scene: Scene) -> tuple[str, str, Any]:
    name, found, text = rule.partition(':=')
    node, _, name = name.rpartition(':')
    if not found or not name:
        raise UsageError(f'--ros-args {word} {rule}: not [NODE:]NAME:=VALUE')
    if node and node not in scene.nodes:
        raise UsageError(f'--ros-args {word} {rule}: scene {scene.name} has no node {node}')
    try:
        return node or '/**', name, yaml.safe_load(text) if text else ''
    except yaml.YAMLError:
        raise UsageError(f'--ros-args {word} {rule}: the value is not YAML') from None


def _file(path: Path) -> Iterator[tuple[str, str, Any]]:
    try:
        data = yaml_text.load(yaml_text.decoded(content(path)))
    except FileNotFoundError:
        raise UsageError(f'--ros-args {FILE} {path}: no such file') from None
    except (OSError, UnicodeError, yaml.YAMLError) as error:
        raise ConfigError(f'{path}: cannot be read ({type(error).__name__})') from None
    found = list(_of_nodes(data, ''))
    if not found:
        raise ConfigError(
            f'{path}: no parameters; NODE: {{{PARAMETERS}: {{NAME: VALUE}}}} has some'
        )
    return iter(found)


def _of_nodes(data: Any, pattern: str) -> Iterator[tuple[str, str, Any]]:
    for key, below in data.items() if isinstance(data, dict) else ():
        if key == PARAMETERS:
            yield from ((pattern, name, value) for name, value in _flat(below, ''))
        else:
            yield from _of_nodes(below, f'{pattern}/{str(key).strip("/")}'.removeprefix('/'))


def _flat(values: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items() if isinstance(values, dict) else ():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value


def _matches(pattern: str, node: str, namespace: str) -> bool:
    """Whether a node is meant: by its full name with wildcards, or by its name alone."""
    parts = [
        {'**': '.*', '*': '[^/]*'}.get(part, re.escape(part))
        for part in pattern.strip('/').split('/')
    ]
    full = f'{namespace}/{node}'.strip('/')
    return pattern.strip('/') == node or bool(re.fullmatch('/'.join(parts), full))


def _settle(args: RosArgs, given: Sequence[tuple[str, str, Any]]) -> RosArgs:
    """Put settings into the scene; what no node has as a setting goes to all that are meant."""
    values: dict[str, dict[str, Any]] = {}
    scene = args.scene
    for pattern, name, value in given:
        meant = [node for node in scene.nodes if _matches(pattern, node, scene.namespace)]
        having = []
        for node in meant:
            kind = NODES[node].settings
            known = renamed(kind).get(name, name)
            if known in {f.name for f in fields(kind)}:
                having.append(node)
                values.setdefault(node, {})[known] = value
        for node in () if having else meant:
            args.parameters.setdefault(node, {})[name] = value
    nodes = dict(scene.nodes)
    for node, changes in values.items():
        try:
            nodes[node] = replace(nodes[node], **checked(NODES[node].settings, changes))
        except ConfigError as error:
            raise ConfigError(f'--ros-args: {node}: {error}') from None
    args.scene = replace(scene, nodes=nodes)
    return args

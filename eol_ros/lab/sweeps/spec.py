# SPDX-License-Identifier: Apache-2.0
"""Sweep file to tasks: every mistake at once, with file, line and column.

    model: plate                # table, plate, train, scene, ofc or oslo
    fixed:                      # parameters that are the same in all tasks
      speed_mps: 5.0e-4
    vary:                       # every combination of these is one task
      rows: [3, 5, 8]
      stiffness_ratio: {from: 0.5, to: 4, steps: 7, spacing: log}
      seed: {from: 1, to: 10}   # whole numbers: each of them

What is named in neither has its default.
"""

import dataclasses
import difflib
import hashlib
import itertools
import json
import math
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from eol_ros.devices.files.physics_file import load_scene
from eol_ros.errors import ConfigError, DeviceMissing, EolError
from eol_ros.lab.presets import NAMED
from eol_ros.lab.science.sweep import MODELS, Plain
from eol_ros.scene import check_value

KEYS = ('model', 'fixed', 'vary')
RANGE = ('from', 'to', 'steps', 'spacing')
SPACINGS = ('linear', 'log')
MOST_TASKS = 100_000_000
FILLED_IN = ('scene_digest',)


class SpecError(ConfigError):
    """All mistakes of a sweep file."""


@dataclass(frozen=True)
class Spec:
    """A checked sweep: `varied` are lists of values, of which every combination is a task."""

    model: str
    fixed: Plain
    varied: dict[str, list[Any]]
    scenes: dict[str, Plain] = field(default_factory=dict)  # from files, by digest
    digests: dict[str, str] = field(default_factory=dict)  # by the name in the sweep file
    text: str = ''

    def __len__(self) -> int:
        return math.prod(len(values) for values in self.varied.values())

    def tasks(self) -> Iterator[Plain]:
        """Yield the parameters of each task; the last key of `vary` changes first."""
        names = list(self.varied)
        for values in itertools.product(*self.varied.values()):
            task = {**self.fixed, **dict(zip(names, values, strict=True))}
            if 'scene' in task:
                task['scene_digest'] = self.digests.get(task['scene'], '')
            yield task


def load(path: str | Path) -> Spec:
    """Return the checked sweep of a YAML file.

    Raises DeviceMissing if it cannot be read, SpecError with all its mistakes.
    """
    try:
        text = Path(path).read_text(encoding='utf-8')
    except OSError as error:
        raise DeviceMissing(f'{path}: {error.strerror}') from None
    except UnicodeDecodeError:
        raise SpecError(f'{path}: not a text file in UTF-8') from None
    return _Reader(Path(path), text).spec()


class _Reader:
    def __init__(self, path: Path, text: str) -> None:
        self.path, self.text = path, text
        self.mistakes: list[tuple[int, int, str]] = []

    def wrong(self, node: yaml.Node, what: str) -> None:
        mark = node.start_mark
        self.mistakes.append((mark.line + 1, mark.column + 1, what))

    def fail(self) -> None:
        if self.mistakes:
            rows = sorted(self.mistakes)
            lines = [f'{self.path}:{line}:{column} error {what}' for line, column, what in rows]
            count = f'{len(rows)} error{"s" if len(rows) > 1 else ""}'
            raise SpecError('\n'.join([*lines, f'{count}. Nothing was computed.']))

    def spec(self) -> Spec:
        top = self._top()
        model = self._model(top)
        fields = {f.name: f for f in dataclasses.fields(MODELS[model])}
        fixed = {f.name: f.default for f in fields.values()}
        nodes: dict[str, yaml.Node] = {}
        for name, node in self._mapping(top['fixed'], 'fixed') if 'fixed' in top else ():
            if self._known(name, node[0], model, fields, 'fixed'):
                fixed[name] = self._value(node[1], f'fixed.{name}', fields[name])
                nodes[name] = node[1]
        varied: dict[str, list[Any]] = {}
        for name, node in self._mapping(top['vary'], 'vary') if 'vary' in top else ():
            if name in nodes:
                self.wrong(node[0], f'vary.{name}: stands under fixed, too')
            elif self._known(name, node[0], model, fields, 'vary'):
                varied[name] = self._values(node[1], f'vary.{name}', fields[name])
                nodes[name] = node[1]
        self.fail()
        found = Spec(model, fixed, varied, text=self.text)
        if len(found) > MOST_TASKS:
            self.wrong(top['vary'], f'vary: {len(found)} tasks; {MOST_TASKS} are the most')
        if model == 'scene':
            names = varied.get('scene', [fixed['scene']])
            self._scenes(names, nodes.get('scene', top['model']), found)
        self.fail()
        return found

    def _top(self) -> dict[str, yaml.Node]:
        try:
            tree = yaml.compose(self.text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
            what = f'not YAML: {error.problem or error.context}'
            raise SpecError(f'{self.path}:{line}:{column} error {what}') from None
        except yaml.YAMLError as error:
            raise SpecError(f'{self.path}: not YAML: {str(error).splitlines()[0]}') from None
        if not isinstance(tree, yaml.MappingNode):
            raise SpecError(
                f'{self.path}:1:1 error a sweep is a mapping with the keys {", ".join(KEYS)}'
            )
        top = {}
        for name, (key, value) in self._mapping(tree, ''):
            if name in KEYS:
                top[name] = value
            else:
                self.wrong(key, f'{name}: no such key{_hint(name, KEYS)}')
        if 'model' not in top:
            self.wrong(tree, f'model: is missing; there are {", ".join(MODELS)}')
        self.fail()
        return top

    def _model(self, top: dict[str, yaml.Node]) -> str:
        node = top['model']
        name = node.value if isinstance(node, yaml.ScalarNode) else ''
        if name not in MODELS:
            shown = repr(name) if name else 'this'
            self.wrong(node, f'model: {shown} is none{_hint(name, tuple(MODELS))}')
        self.fail()
        return str(name)

    def _mapping(
        self, node: yaml.Node, where: str
    ) -> list[tuple[str, tuple[yaml.Node, yaml.Node]]]:
        """Return names with their key and value."""
        if isinstance(node, yaml.ScalarNode) and node.tag.endswith(':null'):
            return []  # the key with nothing behind it
        if not isinstance(node, yaml.MappingNode):
            self.wrong(node, f'{where}: a mapping is wanted, name: value')
            return []
        found: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            name = str(key.value) if isinstance(key, yaml.ScalarNode) else '?'
            if name in found:
                self.wrong(key, f'{where}.{name}: stands twice' if where else f'{name}: twice')
            found[name] = key, value
        return list(found.items())

    def _known(
        self, name: str, key: yaml.Node, model: str, fields: dict[str, Any], where: str
    ) -> bool:
        there = tuple(n for n in fields if n not in FILLED_IN)
        if name in there:
            return True
        self.wrong(key, f'{where}.{name}: {model} has no such parameter{_hint(name, there)}')
        return False

    def _values(self, node: yaml.Node, where: str, wanted: Any) -> list[Any]:
        if isinstance(node, yaml.MappingNode):
            values = self._range(node, where, wanted)
        elif isinstance(node, yaml.SequenceNode):
            values = [self._value(item, where, wanted) for item in node.value]
        else:
            self.wrong(node, f'{where}: a list, or {{from: A, to: B}}, is wanted')
            return []
        if not values and not self.mistakes:
            self.wrong(node, f'{where}: no values')
        if len({repr(v) for v in values}) < len(values) and not self.mistakes:
            self.wrong(node, f'{where}: a value stands twice')
        return values

    def _range(self, node: yaml.Node, where: str, wanted: Any) -> list[Any]:
        given = dict(self._mapping(node, where))
        for name, (key, _) in given.items():
            if name not in RANGE:
                self.wrong(key, f'{where}.{name}: no such key{_hint(name, RANGE)}')
        missing = [name for name in RANGE[:2] if name not in given]
        kind = _kind(wanted)
        if missing or kind not in (int, float):
            what = f'lacks {missing[0]}' if missing else 'is no number: a list is wanted'
            self.wrong(node, f'{where}: {what}')
            return []
        ends = [self._value(given[name][1], f'{where}.{name}', wanted) for name in RANGE[:2]]
        spacing = given['spacing'][1].value if 'spacing' in given else SPACINGS[0]
        if spacing not in SPACINGS:
            self.wrong(given['spacing'][1], f'{where}.spacing: {" or ".join(SPACINGS)} is wanted')
        if None in ends or spacing not in SPACINGS:
            return []
        low, high = ends
        if high <= low or (spacing == 'log' and low <= 0):
            above = ' above zero' if spacing == 'log' else ''
            self.wrong(node, f'{where}: from {low:g} to {high:g}: rising ends{above} are wanted')
            return []
        if 'steps' not in given:
            if kind is int and spacing == 'linear':
                if high - low > MOST_TASKS:
                    self.wrong(node, f'{where}: more than {MOST_TASKS} values')
                    return []
                return list(range(low, high + 1))
            self.wrong(node, f'{where}: lacks steps, how many values there are')
            return []
        steps = dataclasses.field(metadata={'min': 2, 'max': MOST_TASKS})
        steps.type = int
        count = self._value(given['steps'][1], f'{where}.steps', steps)
        if count is None:
            return []
        make = np.geomspace if spacing == 'log' else np.linspace
        values = make(low, high, count)
        if kind is int:
            return sorted({round(v) for v in values.tolist()})
        return [low, *values[1:-1].tolist(), high]

    def _value(self, node: yaml.Node, where: str, wanted: Any) -> Any:
        """Return the value of a scalar as the parameter wants it; None where it is wrong."""
        if not isinstance(node, yaml.ScalarNode):
            self.wrong(node, f'{where}: one value is wanted here')
            return None
        value = node.value
        kind = _kind(wanted)
        if kind is not str:
            value = yaml.SafeLoader('').construct_object(node)
            if kind is float and isinstance(value, str):  # YAML 1.1 takes 5e-4 for text
                value = _number(value)
        try:
            return check_value(wanted, value)
        except ConfigError as error:
            self.wrong(node, f'{where}: {error}')
            return None

    def _scenes(self, names: list[str], node: yaml.Node, found: Spec) -> None:
        items = node.value if isinstance(node, yaml.SequenceNode) else [node] * len(names)
        for name, item in zip(names, items, strict=True):
            if name in NAMED:
                continue
            try:
                source = load_scene(self.path.parent / name).source
            except EolError as error:
                self.wrong(item, f'scene: {error} (names are {", ".join(NAMED)})')
                continue
            assert source is not None
            text = json.dumps(source, sort_keys=True).encode()
            digest = hashlib.blake2b(text, digest_size=8).hexdigest()
            found.scenes[digest], found.digests[name] = dict(source), digest


def _kind(wanted: Any) -> Any:
    if isinstance(wanted.type, types.UnionType):
        return next(t for t in typing.get_args(wanted.type) if t is not type(None))
    return wanted.type


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _hint(name: str, there: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(name, there, 1, 0.6)
    return f'. Did you mean {near[0]}?' if near else f'; there are {", ".join(there)}'

# SPDX-License-Identifier: Apache-2.0
"""Sweep file to tasks: every mistake at once, with file, line and column.

    model: plate                # table, plate, train or ofc
    fixed:                      # parameters that are the same in all tasks
      speed_mps: 5.0e-4
    vary:                       # every combination of these is one task
      rows: [3, 5, 8]
      stiffness_ratio: {from: 0.5, to: 4, steps: 7, spacing: log}
      seed: {from: 1, to: 10}   # whole numbers: each of them

What is named in neither has its default.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros import yaml_text
from eol_ros.disk import content
from eol_ros.errors import ConfigError, DeviceMissing, nearest
from eol_ros.lab.science.sweep import MODELS, Plain
from eol_ros.scene import check_value
from eol_ros.yaml_text import Place

KEYS = ('model', 'fixed', 'vary')
RANGE = ('from', 'to', 'steps', 'spacing')
SPACINGS = ('linear', 'log')
MOST_TASKS = 100_000_000
MOST_VALUES = 1_000_000  # of one parameter (chosen): they are held in memory


class SpecError(yaml_text.Mistakes):
    """All mistakes of a sweep file."""


@dataclass(frozen=True)
class Spec:
    """A checked sweep: `varied` are lists of values, of which every combination is a task."""

    model: str
    fixed: Plain
    varied: dict[str, list[Any]]

    def __len__(self) -> int:
        return math.prod(len(values) for values in self.varied.values())

    def tasks(self) -> Iterator[Plain]:
        """Yield the parameters of each task; the last key of `vary` changes first."""
        names = list(self.varied)
        for values in itertools.product(*self.varied.values()):
            yield {**self.fixed, **dict(zip(names, values, strict=True))}


def load(path: str | Path) -> Spec:
    """Return the checked sweep of a YAML file.

    Raises DeviceMissing if it cannot be read, SpecError with all its mistakes.
    """
    try:
        data = content(path)
    except OSError as error:
        raise DeviceMissing(f'{path}: {error.strerror}') from None
    return _Reader(Path(path)).spec(data)


class _Reader(yaml_text.Reader):
    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path, self.text = path, ''

    def fail(self) -> None:
        if self.mistakes:
            lines = [*self.text.splitlines(), '']
            quotes = {m: yaml_text.quoted(lines[m.line - 1], m.column - 1) for m in self.mistakes}
            raise SpecError(self.mistakes, 'Nothing was computed.', quotes)

    def spec(self, data: bytes) -> Spec:
        whole, _, self.text = self.parse(data, str(self.path))
        self.fail()
        top = self._top(whole)
        model = self._model(top['model'])
        fields = {f.name: f for f in dataclasses.fields(MODELS[model])}
        fixed = {f.name: f.default for f in fields.values()}
        given = self._mapping(top, 'fixed')
        for name, place in given.items():
            if self._known(name, top['fixed'].keys[name], model, fields, 'fixed'):
                fixed[name] = self._value(place, f'fixed.{name}', fields[name])
        varied: dict[str, list[Any]] = {}
        for name, place in self._mapping(top, 'vary').items():
            key = top['vary'].keys[name]
            if name in given:
                self.wrong(key, f'vary.{name}', 'stands under fixed, too')
            elif self._known(name, key, model, fields, 'vary'):
                varied[name] = self._values(place, f'vary.{name}', fields[name])
        self.fail()
        found = Spec(model, fixed, varied)
        if len(found) > MOST_TASKS:
            self.wrong(top['vary'], 'vary', f'{len(found)} tasks; {MOST_TASKS} are the most')
        self.fail()
        return found

    def _top(self, whole: Place) -> dict[str, Place]:
        if not isinstance(whole.value, dict):
            self.wrong(whole, '', f'a sweep is a mapping with the keys {", ".join(KEYS)}')
            self.fail()
        for name, key in whole.keys.items():
            if name not in KEYS:
                self.wrong(key, name, f'no such key{_hint(name, KEYS)}')
        if 'model' not in whole.value:
            self.wrong(whole, 'model', f'is missing; there are {", ".join(MODELS)}')
        self.fail()
        return whole.value

    def _model(self, place: Place) -> str:
        if place.text not in MODELS:
            shown = repr(place.text) if place.text else 'this'
            self.wrong(place, 'model', f'{shown} is none{_hint(place.text, MODELS)}')
        self.fail()
        return place.text

    def _mapping(self, top: dict[str, Place], name: str) -> dict[str, Place]:
        """Return what stands below `name`."""
        place = top.get(name)
        if place is None or place.value is None:  # the key with nothing behind it
            return {}
        if not isinstance(place.value, dict):
            self.wrong(place, name, 'a mapping is wanted, name: value')
            return {}
        return place.value

    def _known(self, name: str, key: Place, model: str, fields: dict[str, Any], where: str) -> bool:
        if name in fields:
            return True
        self.wrong(key, f'{where}.{name}', f'{model} has no such parameter{_hint(name, fields)}')
        return False

    def _values(self, place: Place, where: str, wanted: Any) -> list[Any]:
        if isinstance(place.value, dict):
            values = self._range(place, where, wanted)
        elif isinstance(place.value, list):
            values = [self._value(item, where, wanted) for item in place.value]
        else:
            self.wrong(place, where, 'a list, or {from: A, to: B}, is wanted')
            return []
        if not values and not self.mistakes:
            self.wrong(place, where, 'no values')
        if len({repr(v) for v in values}) < len(values) and not self.mistakes:
            self.wrong(place, where, 'a value stands twice')
        return values

    def _range(self, place: Place, where: str, wanted: Any) -> list[Any]:
        given = place.value
        for name, key in place.keys.items():
            if name not in RANGE:
                self.wrong(key, f'{where}.{name}', f'no such key{_hint(name, RANGE)}')
        missing = [name for name in RANGE[:2] if name not in given]
        kind = wanted.type
        if missing or kind not in (int, float):
            what = f'lacks {missing[0]}' if missing else 'is no number: a list is wanted'
            self.wrong(place, where, what)
            return []
        ends = [self._value(given[name], f'{where}.{name}', wanted) for name in RANGE[:2]]
        spacing = given['spacing'].value if 'spacing' in given else SPACINGS[0]
        if spacing not in SPACINGS:
            self.wrong(given['spacing'], f'{where}.spacing', f'{" or ".join(SPACINGS)} is wanted')
        if None in ends or spacing not in SPACINGS:
            return []
        low, high = ends
        if high <= low or (spacing == 'log' and low <= 0):
            above = ' above zero' if spacing == 'log' else ''
            self.wrong(place, where, f'from {low:g} to {high:g}: rising ends{above} are wanted')
            return []
        if 'steps' not in given:
            if kind is int and spacing == 'linear':
                if high - low > MOST_VALUES:
                    self.wrong(place, where, f'more than {MOST_VALUES} values')
                    return []
                return list(range(low, high + 1))
            self.wrong(place, where, 'lacks steps, how many values there are')
            return []
        steps = dataclasses.field(metadata={'min': 2, 'max': MOST_VALUES})
        steps.type = int
        count = self._value(given['steps'], f'{where}.steps', steps)
        if count is None:
            return []
        make = np.geomspace if spacing == 'log' else np.linspace
        values = make(low, high, count)
        if kind is int:
            return sorted({round(v) for v in values.tolist()})
        return [low, *values[1:-1].tolist(), high]

    def _value(self, place: Place, where: str, wanted: Any) -> Any:
        """Return the value of a scalar as the parameter wants it; None where it is wrong."""
        if isinstance(place.value, (dict, list)):
            self.wrong(place, where, 'one value is wanted here')
            return None
        kind, value = wanted.type, place.value
        if kind is str:
            value = place.text
        elif kind is float and isinstance(value, str):  # YAML 1.1 takes 5e-4 for text
            value = _number(value)
        elif how := place.how_to_write:
            self.wrong(place, where, f'{place.text} would be {value}{how}')
            return None
        try:
            return check_value(wanted, value)
        except ConfigError as error:
            self.wrong(place, where, str(error))
            return None


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _hint(name: str, there: Iterable[str]) -> str:
    return f'. {nearest(name, there)}'

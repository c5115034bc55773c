# SPDX-License-Identifier: Apache-2.0
"""YAML that people write: values with file, line and column, and every mistake at once."""

import itertools
import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from eol_ros.errors import ConfigError, printable

MOST_VALUES = 100_000  # of a file with all that it includes
WIDTH = 90  # characters of a line that is quoted: it fits a terminal (chosen)
LONGEST = 1000  # characters of a message: it may quote a value
_NO_BREAK = re.compile(r'^[ \t]*\xa0|^[^#\n"\']*:\xa0', re.M)
_NUMBERS = {  # forms of numbers that YAML 1.1 reads as other numbers, or as text
    r'[-+]?0[0-9_]+': 'a number with a leading 0 is octal in YAML: leave the 0 out',
    r'[-+]?[0-9]+(:[0-9.]+)+': 'digits with a colon are minutes in YAML: write the number in full',
    r'[-+]?[0-9.]+[eE][-+]?[0-9]+': 'YAML wants 1.0e+6 for 1e6: write the number in full',
    r'[-+]?[0-9]+,[0-9]+': 'write a decimal point',
}


def decoded(data: bytes) -> str:
    """Return a text in UTF-8, or UTF-16 with a byte order mark; raises UnicodeDecodeError."""
    return data.decode('utf-16' if data[:2] in (b'\xff\xfe', b'\xfe\xff') else 'utf-8')


def load(text: str | bytes, loader: Any = yaml.SafeLoader) -> Any:
    """Return the first document of a YAML text that holds something; None if none does.

    Raises yaml.YAMLError, also where aliases repeat a part or values nest without end, and where a
    value is none of its kind, such as the date 2026-13-40.
    """
    reader = loader(text)
    try:
        while reader.check_node():
            node = reader.get_node()
            if _count(node, {}) > MOST_VALUES:
                raise yaml.YAMLError(f'aliases make more than {MOST_VALUES} values of it')
            if (found := reader.construct_document(node)) is not None:
                return found
    except (ValueError, RecursionError) as error:
        raise yaml.YAMLError(str(error)) from None
    finally:
        reader.dispose()
    return None


def _count(node: yaml.Node, known: dict[int, float]) -> float:
    """Return how many values a node holds, those that aliases repeat each time."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) not in known:
        known[id(node)] = math.inf  # where it holds itself
        inner = node.value if isinstance(node, yaml.SequenceNode) else itertools.chain(*node.value)
        known[id(node)] = 1 + sum(_count(item, known) for item in inner)
    return known[id(node)]


@dataclass(frozen=True, order=True)
class Mistake:
    """One thing wrong in a file; line and column count from 1."""

    file: str
    line: int
    column: int
    where: str
    what: str

    def __str__(self) -> str:
        where = f'{self.where}: ' if self.where else ''
        return printable(f'{self.file}:{self.line}:{self.column} error {where}{self.what}')


def quoted(line: str, column: int) -> str:
    """Return a line of a file, and below it a caret under the character of index `column`.

    Of a long line only what is about the caret; nothing of an empty one.
    """
    if not line.strip():
        return ''
    first = max(0, column - WIDTH // 2)
    shown = ''.join(c if c.isprintable() else ' ' for c in line[first : first + WIDTH]).rstrip()
    wide = (2 if unicodedata.east_asian_width(c) in 'WF' else 1 for c in line[first:column])
    return f'    {shown}\n    {" " * sum(wide)}^'


@dataclass
class Place:
    """A YAML value with where it stands."""

    value: Any
    file: str
    line: int = 1
    column: int = 1
    keys: dict[str, 'Place'] = field(default_factory=dict)  # of a mapping: where each key stands
    text: str = ''  # of a scalar, as it is written

    @property
    def bare(self) -> Any:
        """The value without places."""
        if isinstance(self.value, list):
            return [item.bare for item in self.value]
        if isinstance(self.value, dict):
            return {key: item.bare for key, item in self.value.items()}
        return self.value

    @property
    def how_to_write(self) -> str:
        """What to do about a number that YAML reads otherwise than people, or nothing."""
        if isinstance(self.value, list):
            return next(filter(None, (item.how_to_write for item in self.value)), '')
        if isinstance(self.value, float) and 'e' in self.text.lower():
            return ''
        forms = (how for form, how in _NUMBERS.items() if re.fullmatch(form, self.text))
        return next((f'; {how}' for how in forms), '')


class Reader:
    """Reads YAML files and gathers their mistakes."""

    def __init__(self) -> None:
        self.mistakes: list[Mistake] = []
        self._count: float = 0

    def wrong(self, place: Place, where: str, what: str) -> None:
        """Note a mistake."""
        what = what if len(what) <= LONGEST else f'{what[:LONGEST]}...'
        self.mistakes.append(Mistake(place.file, place.line, place.column, where, what))

    def parse(self, data: bytes, name: str, merge_hint: str = '') -> tuple[Place, Any, str]:
        """Return the value in a file called `name`, its YAML nodes, and its text.

        Where it is not YAML, that is noted, and the value is an empty mapping without nodes.
        """
        start = Place({}, name)
        text = ''
        try:
            text = decoded(data).replace('\r\n', '\n').replace('\r', '\n')
            if odd := _NO_BREAK.search(text):
                start.line = text.count('\n', 0, odd.end()) + 1
                start.column = odd.end() - text.rfind('\n', 0, odd.end()) - 1
                self.wrong(start, '', 'a no-break space (U+00A0): write an ordinary one')
                return start, None, text
            tree = yaml.compose(text, Loader=yaml.SafeLoader)
            self._count += _count(tree, {}) if tree else 0
            if self._count > MOST_VALUES:  # anchors may stand for each other without end
                raise RecursionError
            return (self._convert(tree, name, merge_hint) if tree else start), tree, text
        except UnicodeDecodeError:
            self.wrong(start, '', 'not a text file in UTF-8')
        except RecursionError:
            self.wrong(start, '', 'one value stands within another without end')
        except yaml.MarkedYAMLError as error:
            if mark := error.problem_mark or error.context_mark:
                start.line, start.column = mark.line + 1, mark.column + 1
            self.wrong(start, '', f'not YAML: {error.problem or error.context}')
        except yaml.YAMLError as error:
            self.wrong(start, '', f'not YAML: {str(error).splitlines()[0]}')
        return start, None, text

    def _convert(self, node: yaml.Node, name: str, merge_hint: str) -> Place:
        place = Place(None, name, node.start_mark.line + 1, node.start_mark.column + 1)
        if isinstance(node, yaml.MappingNode):
            place.value = {}
            for key_node, value_node in node.value:
                if key_node.value == '<<':
                    mark = key_node.start_mark
                    key = Place(None, name, mark.line + 1, mark.column + 1)
                    self.wrong(key, '', f'merge keys are not read here{merge_hint}')
                    continue
                key = self._convert(key_node, name, merge_hint)
                if not isinstance(key.value, str):
                    hint = ''
                    if isinstance(key.value, (int, float)):
                        hint = '; write a decimal point, or text with commas in quotes'
                    self.wrong(key, '', f'key {key.bare!r} is not a name{hint}')
                    continue
                if key.value in place.value:
                    self.wrong(key, key.value, 'stands twice')
                place.value[key.value] = self._convert(value_node, name, merge_hint)
                place.keys[key.value] = key
        elif isinstance(node, yaml.SequenceNode):
            place.value = [self._convert(item, name, merge_hint) for item in node.value]
        else:
            place.text = node.value
            try:
                place.value = yaml.SafeLoader('').construct_object(node)
                if isinstance(place.value, bytes):
                    raise ValueError('binary data, not a text')
            except (yaml.YAMLError, ValueError, OverflowError) as error:
                place.value = node.value
                self.wrong(place, '', f'{str(error).splitlines()[0]}: {node.value!r}')
        return place


class Mistakes(ConfigError):
    """All mistakes of a file, sorted, each with its line; then what was not done."""

    def __init__(self, mistakes: list[Mistake], ending: str, quotes: Mapping[Mistake, str]):
        self.mistakes = sorted(mistakes)
        count = len(mistakes)
        lines = [f'{m}\n{quotes.get(m, "")}'.rstrip() for m in self.mistakes]
        lines.append(f'{count} error{"s" if count > 1 else ""}. {ending}')
        super().__init__('\n'.join(lines))

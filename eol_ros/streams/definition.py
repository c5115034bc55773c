# SPDX-License-Identifier: Apache-2.0
"""Reads message definitions: the text of a .msg file, or the `ros2msg` schema that a bag carries.

Grammar of https://docs.ros.org/en/jazzy/Concepts/Basic/About-Interfaces.html; a schema
(https://mcap.dev/spec/registry#ros2msg) has each further type behind a line of `=` and a line
`MSG: package/Name`.
"""

import re
from typing import NamedTuple

PRIMITIVES = {
    'bool': '?', 'byte': 'u1', 'char': 'u1', 'float32': 'f4', 'float64': 'f8',
    'int8': 'i1', 'uint8': 'u1', 'int16': 'i2', 'uint16': 'u2',
    'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8',
}  # fmt: skip
STRINGS = ('string', 'wstring')
_CODE = re.compile(r'(?:[^#"\']|"[^"]*"|\'[^\']*\')*')  # up to a # that is in no string
_LINE = re.compile(
    r'\s*(?P<type>[A-Za-z]\w*(?:/\w+){0,2})(?:<=\d+)?(?P<array>\[[^\]]*\])?'
    r'\s+(?P<name>[A-Za-z]\w*)\s*(?:=(?P<value>.*))?'
)
_OTHER = re.compile(r'^=+\r?\n^MSG: (\S+)\r?$', re.MULTILINE)
_END = re.compile(r'\r\n|\r|\n')  # of a line; other characters of Unicode end none


class Field(NamedTuple):
    """One field: `length` is None for one value, -1 for a sequence, else that of the array."""

    name: str
    type: str
    length: int | None
    comment: str

    @property
    def plain(self) -> bool:
        """A number or bool, or an array of them."""
        return self.type in PRIMITIVES


class Message(NamedTuple):
    """The fields of one message type, in order of the definition; constants are left out."""

    fields: list[Field]


def short(type_name: str) -> str:
    """Return `package/Name` of `package/msg/Name`, as definitions write it."""
    return type_name.replace('/msg/', '/')


def parse(definition: str, type_name: str) -> dict[str, Message]:
    """Return each type of a definition as `package/Name`, first `type_name` itself."""
    first, *others = _OTHER.split(definition)
    pairs = [(type_name, first), *zip(others[::2], others[1::2], strict=True)]
    return {short(full): _message(text, full.split('/')[0]) for full, text in pairs}


def references(message: Message) -> list[str]:
    """Return the message types of its fields, each once, as `package/msg/Name`."""
    kinds = (f.type for f in message.fields if not f.plain and f.type not in STRINGS)
    return [kind.replace('/', '/msg/') for kind in dict.fromkeys(kinds)]


def _message(text: str, package: str) -> Message:
    message = Message([])
    for line in _END.split(text):
        code = _CODE.match(line)[0]  # type: ignore[index]  # it matches nothing at least
        found = _LINE.match(code)
        if found is None or found['value'] is not None:
            continue
        comment = line[len(code) :].lstrip('#').strip()
        kind = found['type']
        if kind not in PRIMITIVES and kind not in STRINGS:
            parts = kind.split('/')
            kind = f'{parts[0] if len(parts) > 1 else package}/{parts[-1]}'
        length = None
        if found['array'] is not None:
            inside = found['array'][1:-1]
            length = int(inside) if inside.isdigit() else -1
        message.fields.append(Field(found['name'], kind, length, comment))
    return message

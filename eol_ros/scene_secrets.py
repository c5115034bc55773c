# SPDX-License-Identifier: Apache-2.0
"""Masks secrets in the text of a scene, however YAML spells them; comments and layout stay."""

import html
import json
import re
import urllib.parse
from collections.abc import Collection, Iterable, Iterator

import yaml

from eol_ros.settings import MASK

_PROPERTIES = re.compile(r'(?:[&!]\S*\s+)*')  # an anchor or a tag before a scalar
_CARET = '\0'  # no YAML has it
_COMMENT = re.compile(r'(?:^|(?<=\s))#[^\n]*', re.MULTILINE)


class SceneText:
    """The text of one scene file, with the places of all its scalars.

    Parameters
    ----------
    text : str
        The text of the file.
    tree : yaml.Node
        The result of `yaml.compose` for it.
    names : collection of str
        Keys whose values are secret, anywhere in the file.
    """

    def __init__(self, text: str, tree: yaml.Node | None, names: Collection[str]):
        self._text, self._names = text, names
        self._scalars: list[yaml.ScalarNode] = []
        self._secret: list[yaml.ScalarNode] = []
        if tree is not None:
            self._walk(tree, False, set())

    def _walk(self, node: yaml.Node, secret: bool, seen: set[tuple[int, bool]]) -> None:
        if (id(node), secret) in seen:  # an alias
            return
        seen.add((id(node), secret))
        if isinstance(node, yaml.ScalarNode):
            (self._secret if secret else self._scalars).append(node)
        elif isinstance(node, yaml.SequenceNode):
            for item in node.value:
                self._walk(item, secret, seen)
        elif isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                self._walk(key, False, seen)
                named = isinstance(key, yaml.ScalarNode) and key.value in self._names
                self._walk(value, secret or named, seen)

    def secrets(self) -> Iterator[str]:
        """Yield the secrets, parsed and as spelt in the text."""
        for node in self._secret:
            spelt = self._spelt(node)
            yield from (node.value, spelt, spelt[1:-1] if spelt[:1] in ('"', "'") else '')

    def quoted(self, line: int, column: int, secrets: Collection[str]) -> tuple[str, int]:
        """Return a line without its secrets, and the index in it of `column`; both from 1."""
        start = sum(map(len, self._text.splitlines(keepends=True)[: line - 1]))
        before, _, after = self.masked(secrets, start + column - 1).partition(_CARET)
        first = without(before.rpartition('\n')[2], secrets)
        whole = first + without(after.partition('\n')[0], secrets)
        return ('', 0) if any(s in whole for s in secrets) else (whole, len(first))

    def masked(self, secrets: Collection[str], caret: int | None = None) -> str:
        """Return the text with a mask in place of each secret value, and of each of `secrets`.

        A comment that assigns a value to a secret name loses that value. `_CARET` stands at index
        `caret`, or before the mask that covers it.
        """
        hidden = [node for node in self._scalars if any(s in node.value for s in secrets)]
        hidden = [n for n in hidden if not any(s in self._spelt(n) for s in secrets)]
        masks = {self._span(node): f"'{MASK}'" for node in (*self._secret, *hidden)}
        spans = sorted(self._span(node) for node in (*self._scalars, *self._secret))
        assigned = re.compile(rf'\b(?:{"|".join(map(re.escape, self._names))})\s*[:=]\s*')
        for comment in _COMMENT.finditer(self._text):
            if any(begin <= comment.start() < end for begin, end in spans):
                continue  # a part of a text
            if (found := assigned.search(self._text, comment.start(), comment.end())) is not None:
                masks[found.end(), comment.end()] = MASK
        if caret is not None:
            caret = next((b for b, e in masks if b < caret < e), caret)
            masks[caret, caret] = _CARET
        text = self._text
        for (begin, end), mask in sorted(masks.items(), reverse=True):
            text = text[:begin] + mask + text[end:]
        return text

    def _span(self, node: yaml.ScalarNode) -> tuple[int, int]:
        """Return start and end of a scalar, without its properties and the lines after it."""
        begin, end = node.start_mark.index, node.end_mark.index
        found = _PROPERTIES.match(self._text, begin, end)
        begin = found.end() if found else begin
        return begin, begin + len(self._text[begin:end].rstrip())

    def _spelt(self, node: yaml.ScalarNode) -> str:
        begin, end = self._span(node)
        return self._text[begin:end]


def without(text: str, secrets: Iterable[str]) -> str:
    """Return `text` with a mask in place of each of `secrets`, as programs may spell it."""
    spellings = {spelling for secret in secrets for spelling in _spellings(secret)}
    for spelling in sorted(spellings, key=len, reverse=True):
        text = text.replace(spelling, MASK)
    return text


def _spellings(secret: str) -> set[str]:
    found = {
        secret,
        json.dumps(secret)[1:-1],
        json.dumps(secret, ensure_ascii=False)[1:-1],
        repr(secret)[1:-1],
        ascii(secret)[1:-1],
        secret.replace("'", "''"),
        html.escape(secret),
        urllib.parse.quote(secret),
        urllib.parse.quote(secret, safe=''),
    }
    for unicode in (False, True):
        dumped = yaml.safe_dump(secret, allow_unicode=unicode, width=10**9).removesuffix('\n...\n')
        found.add(dumped.strip().strip('\'"'))
    return found - {''}

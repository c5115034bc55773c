# SPDX-License-Identifier: Apache-2.0
"""The artist's folder of images: `pairs.csv` and the files it names, watched for changes.

`pairs.csv` has one pair a line: left, right, caption, credit (the last two may be empty); a header
line with these names is welcome, `;` works as well as `,`. A pair whose image is missing or
broken is skipped and named; the others go on. An image may come in degrees of damage: where the
list says `dam.svg`, `dam.1.svg` to `dam.9.svg`, as many as there are, stand for it, the whole one
first.
"""

import contextlib
import csv
import io
import math
import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from eol_ros.errors import DeviceMissing

LIST = 'pairs.csv'
PICTURES = {
    '.svg': 'image/svg+xml',
    '.png': 'image/png',
    '.jpg': 'image/jpeg',
    '.jpeg': 'image/jpeg',
    '.webp': 'image/webp',
}
_ENDS = {'.jpg': b'\xff\xd9', '.jpeg': b'\xff\xd9', '.png': b'IEND'}  # absent: the file is cut off
DRAWN = Path(__file__).parent / 'walls'  # the pairs that ship, by tools/draw_walls.py


@dataclass(frozen=True)
class Pair:
    """Two images that are shown together, as paths relative to the folder, with `/`."""

    left: str
    right: str
    caption: str = ''
    credit: str = ''
    lefts: tuple[str, ...] = ()  # each image in its degrees of damage; one where it has none
    rights: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, 'lefts', self.lefts or (self.left,))
        object.__setattr__(self, 'rights', self.rights or (self.right,))

    @property
    def images(self) -> tuple[str, ...]:
        """All images that may be shown for this pair."""
        return self.lefts + self.rights


class MediaFolder:
    """Pairs of a folder, read again whenever something in it changes.

    Raises DeviceMissing when at the start there is no folder, no list, or no pair to show.
    """

    def __init__(self, path: str | Path = ''):
        self.path = Path(path) if path else DRAWN
        self.pairs: list[Pair] = []
        self.skipped: list[str] = []
        self._good: dict[tuple[str, int, int], str] = {}
        self._seen: tuple = ()
        self.refresh()
        if not self.pairs:
            why = f': {"; ".join(self.skipped)}' if self.skipped else f' in its {LIST}'
            raise DeviceMissing(f'{self.path}: no pair of images{why}')

    def refresh(self) -> bool:
        """Look at the folder again; return whether the pairs are other ones now.

        An emptied folder keeps the last pairs, so that the walls never go dark for a mistake.
        """
        try:
            listed = _listed(self.path)
        except DeviceMissing as error:
            if not self.pairs:
                raise
            self._seen, self.skipped = (), [str(error)]
            return False
        state = self._state(listed)
        if state == self._seen:
            return False
        self._seen = state
        pairs, skipped = self._read(listed)
        self.skipped = skipped
        if not pairs or pairs == self.pairs:
            return False
        self.pairs = pairs
        return True

    def _state(self, listed: list[Pair]) -> tuple:
        """Return time and size of the list and of everything it names, to notice a change by."""
        names = {LIST, *(n for p in listed for n in p.images)}
        return tuple(sorted((name, *_stamp(os.path.join(self.path, name))) for name in names))

    def _read(self, listed: list[Pair]) -> tuple[list[Pair], list[str]]:
        pairs, skipped = [], []
        for pair in listed:
            wrong = [w for w in map(self._wrong, pair.images) if w]
            skipped += [w for w in wrong if w not in skipped]
            if not wrong:
                pairs.append(pair)
        return pairs, skipped

    def _wrong(self, name: str) -> str:
        """Return what is wrong with an image, or an empty string."""
        if not name:
            return 'a pair lacks its left or right image'
        path = self.path / name
        if why := _forbidden(self.path, name):
            return f'{name}: {why}'
        if not path.is_file():
            return f'{name}: missing'
        key = (name, *_stamp(path))
        if key not in self._good:
            self._good[key] = _broken(path)
        return f'{name}: {self._good[key]}' if self._good[key] else ''


class Pictures:
    """The same folder for who only hands out images, from any thread.

    The list is read when an image is asked for that is not in it, at most once a second, and no
    image is opened: which of them are good is for those to say who choose what is shown.
    """

    def __init__(self, path: str = ''):
        self._path = path
        self._files: dict[str, Path] = {}
        self._looked_s = -math.inf
        self._looking = threading.Lock()

    def file(self, name: str) -> Path | None:
        """Return the file of an image that some pair shows, or None."""
        with self._looking:
            now_s = time.monotonic()
            if name not in self._files and now_s - self._looked_s > 1.0:
                self._looked_s = now_s
                with contextlib.suppress(DeviceMissing):
                    self._files = self._look()
            return self._files.get(name)

    def _look(self) -> dict[str, Path]:
        folder = Path(self._path) if self._path else DRAWN
        names = {name for pair in _listed(folder) for name in pair.images}
        return {name: folder / name for name in names if not _forbidden(folder, name)}


def _listed(folder: Path) -> list[Pair]:
    list_file = folder / LIST
    if not folder.is_dir():
        raise DeviceMissing(f'{folder}: no such folder of images')
    try:
        text = list_file.read_text(encoding='utf-8-sig')
    except FileNotFoundError:
        raise DeviceMissing(
            f'{folder}: no {LIST} in it; write one pair a line: left,right,caption,credit'
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise DeviceMissing(f'{list_file}: not a text file in UTF-8 ({error})') from None
    first = text.partition('\n')[0]
    mark = ';' if first.count(';') > first.count(',') else ','
    table = csv.reader(io.StringIO(text), delimiter=mark)
    rows = [[cell.strip() for cell in row] for row in table]
    rows = [row for row in rows if any(row) and not row[0].startswith('#')]
    if rows and [cell.lower() for cell in rows[0][:2]] == ['left', 'right']:
        rows = rows[1:]
    filled = [(row + ['', '', '', ''])[:4] for row in rows]
    pairs = []
    for row in filled:
        left, right = (name.replace('\\', '/') for name in row[:2])
        degrees = _degrees(folder, left), _degrees(folder, right)
        pairs.append(Pair(left, right, row[2], row[3], *degrees))
    return pairs


def _degrees(folder: Path, name: str) -> tuple[str, ...]:
    """Return the names of an image in its degrees of damage; none where it has none."""
    stem, dot, kind = name.rpartition('.')
    found = []
    for number in range(1, 10):
        one = f'{stem}.{number}{dot}{kind}'
        if not dot or not os.path.isfile(folder / one):
            break
        found.append(one)
    return tuple(found)


def _forbidden(folder: Path, name: str) -> str:
    """Return why a file of this name is not handed out, or an empty string."""
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        return 'outside the folder'
    return '' if path.suffix.lower() in PICTURES else f'not one of {" ".join(PICTURES)}'


def _stamp(path: str | Path) -> tuple[int, int]:
    try:
        status = os.stat(path)
    except OSError:
        return 0, -1
    return status.st_mtime_ns, status.st_size


def _broken(path: Path) -> str:
    """Decode the image once; return what is wrong with it, or an empty string."""
    try:
        data = path.read_bytes()
    except OSError as error:
        return f'cannot be read ({error.strerror})'
    kind = path.suffix.lower()
    if kind == '.svg':
        try:
            root = ElementTree.fromstring(data)
        except ElementTree.ParseError as error:
            return f'not an SVG image ({error})'
        return '' if root.tag.endswith('svg') else 'not an SVG image'
    import cv2  # only for photographs: the drawn set needs none of its memory
    import numpy as np

    if _ENDS.get(kind, b'') not in data[-64:]:
        return 'cut off before its end'
    pixels = np.frombuffer(data, np.uint8)
    image = cv2.imdecode(pixels, cv2.IMREAD_REDUCED_COLOR_8) if len(data) else None
    return '' if image is not None else 'not an image'

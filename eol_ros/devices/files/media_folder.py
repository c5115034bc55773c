# SPDX-License-Identifier: Apache-2.0
"""The artist's images and videos: a folder with `pairs.csv` and what it names, watched for changes.

`pairs.csv` has one pair a line: left, right, caption, credit (the last two may be empty); a header
line with these names is welcome, see `text_table`. With a header there may be further
columns: `caption_zh` (the caption in Chinese), `fit` (cover: fill the wall, or contain: show the
image whole), `focus_left` and `focus_right` (what must be seen of an image that is cut: two numbers
from 0 to 1, from the left and from the top, such as `0.3 0.5`), `play` (how its videos play: one of
PLAYS). A pair whose image is missing or broken is skipped and named; the others go on. An image may
come in degrees of damage: where the list says `dam.svg`, `dam.1.svg` to `dam.9.svg`, as many as
there are, stand for it, the whole one first. A video comes in degrees by itself where its `play` is
damage: then `dam.mp4#33` is what it shows at 33 % of its length. An image of the same name
(`dam.jpg`) is what is shown of a video until that is there.
"""

import contextlib
import gzip
import io
import math
import re
import threading
import time
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from eol_ros.devices.files import text_table, video_file
from eol_ros.devices.files.names import find, stamp
from eol_ros.errors import ConfigError, DeviceMissing, printable

LIST = 'pairs.csv'
FITS = ('cover', 'contain')
PLAYS = ('loop', 'once', 'moving', 'damage')
"""Round and round; once, and then its last image; while anything moves; as far as the damage is."""
WORDS = ('left', 'right', 'caption', 'credit', 'caption_zh', 'fit', 'focus_left', 'focus_right',
         'play')  # fmt: skip
PICTURES = ('.svg', '.svgz', '.png', '.jpg', '.jpeg', '.webp')
VIDEOS = ('.mp4', '.webm', '.gif')  # web/static/film.js knows them too
KINDS = *PICTURES, *VIDEOS
DEGREES = 10  # of a video, from its first image to its last
MAX_SVG_BYTES = 100_000_000  # of an SVG file when unpacked (chosen): limits memory
_PLACED = re.compile(r'(?<=\.mp4|webm|\.gif)#\d+$', re.I)
DRAWN = Path(__file__).parent / 'walls'  # the pairs that ship


@dataclass(frozen=True)
class Pair:
    """Two images that are shown together, as paths relative to the folder, with `/`."""

    left: str
    right: str
    caption: str = ''
    credit: str = ''
    lefts: tuple[str, ...] = ()  # each image in its degrees of damage; one where it has none
    rights: tuple[str, ...] = ()
    caption_zh: str = ''
    fit: str = ''
    focus_left: str = ''
    focus_right: str = ''
    play: str = ''
    posters: tuple[str, str] = ('', '')  # images that stand for the videos until those are there

    def __post_init__(self) -> None:
        object.__setattr__(self, 'lefts', self.lefts or (self.left,))
        object.__setattr__(self, 'rights', self.rights or (self.right,))

    @property
    def images(self) -> tuple[str, ...]:
        """All images that may be shown for this pair."""
        return self.lefts + self.rights

    @property
    def files(self) -> tuple[str, ...]:
        """The files that this takes, each once."""
        return tuple(dict.fromkeys([*map(source, self.images), *filter(None, self.posters)]))


def source(name: str) -> str:
    """Return the file of an image; that of a video may be named with a place in it (`#33`: %)."""
    return _PLACED.sub('', name)


class MediaFolder:
    """Pairs of a folder, read again whenever something in it changes.

    Raises DeviceMissing when at the start there is no folder, no list, or no pair to show.
    """

    def __init__(self, path: str | Path = ''):
        self.path = Path(path) if path else DRAWN
        self.pairs: list[Pair] = []
        self.skipped: list[str] = []
        self._good: dict[tuple[str, bool, int, int], str] = {}
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
        all_ = {LIST, *(n for p in listed for n in p.files)}
        return tuple(sorted((name, *stamp(find(self.path, name))) for name in all_))

    def _read(self, listed: list[Pair]) -> tuple[list[Pair], list[str]]:
        pairs, skipped = [], []
        for pair in listed:
            placed = pair.play == 'damage'
            wrong = [w for name in pair.files if (w := self._wrong(name, placed))]
            skipped += [w for w in [*wrong, *_misfits(pair)] if w not in skipped]
            if not wrong:
                pairs.append(pair)
        return pairs, skipped

    def _wrong(self, name: str, placed: bool) -> str:
        """Return what is wrong with an image or a video, or an empty string."""
        if not name:
            return 'a pair lacks its left or right image'
        path = find(self.path, name)
        said = printable(name)
        if why := _forbidden(self.path, name):
            return f'{said}: {why}'
        if not path.is_file():
            return f'{said}: missing'
        key = (name, placed, *stamp(path))
        if key not in self._good:
            self._good[key] = _broken(path, placed)
        return f'{said}: {self._good[key]}' if self._good[key] else ''


class Pictures:
    """The same folder for who only hands out images, from any thread.

    The list is read when an image is asked for that is not in it, at most once a second, and no
    image is opened: which of them are good is for those to say who choose what is shown.
    """

    def __init__(self, path: str = ''):
        self._path = path
        self._files: dict[str, Path] = {}
        self._pairs: dict[str, list[Pair]] = {}  # that show an image, by its name
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

    def look(self, left: str, names: Iterable[str]) -> dict[str, Any]:
        """Return what a wall must know beside the names: the Chinese caption of the pair whose left
        image is `left`; fit and focus of those of `names` that have any; and how those of them that
        are videos play, with the image that stands for them until they are there."""
        for name in names:
            self.file(source(name))  # looks at the list again where there is a new one
        pairs = self._pairs
        return {
            'caption_zh': next((p.caption_zh for p in pairs.get(left, ())), ''),
            'looks': {
                name: look
                for name in names
                for pair in pairs.get(name, ())[:1]
                if (look := _look_of(pair, name)) != DEFAULT_LOOK
            },
        }

    def _look(self) -> dict[str, Path]:
        folder = Path(self._path) if self._path else DRAWN
        listed = _listed(folder)
        pairs: dict[str, list[Pair]] = {}
        for pair in listed:
            for name in pair.images:
                pairs.setdefault(name, []).append(pair)
        all_ = {name for pair in listed for name in pair.files}
        files = {name: find(folder, name) for name in all_ if not _forbidden(folder, name)}
        for name in [name for name in files if name.endswith('.svgz')]:
            plain = name[:-1]  # as bags of version 0.2 name the drawings that ship
            pairs.setdefault(plain, pairs.get(name, []))
            files.setdefault(plain, files[name])
        self._pairs = pairs
        return files


DEFAULT_LOOK = ['cover', 0.5, 0.5]


def _look_of(pair: Pair, name: str) -> list[Any]:
    """Return fit and focus of an image, of a video also play and poster; what makes no sense is as
    if it were not there."""
    left = name in pair.lefts
    focus = _focus(pair.focus_left if left else pair.focus_right)
    look = [pair.fit if pair.fit in FITS else 'cover', *(focus or DEFAULT_LOOK[1:])]
    if _moves(name):
        look += [pair.play if pair.play in PLAYS else PLAYS[0], pair.posters[0 if left else 1]]
    return look


def _moves(name: str) -> bool:
    return source(name).lower().endswith(VIDEOS)


def _focus(text: str) -> list[float] | None:
    try:
        x, y = (float(word) for word in text.split())
    except ValueError:
        return None
    return [x, y] if 0 <= x <= 1 and 0 <= y <= 1 else None


def _misfits(pair: Pair) -> list[str]:
    """Return what of a pair's fit, focus and play makes no sense."""
    found = []
    if pair.fit and pair.fit not in FITS:
        found.append(f'{pair.left}: fit {pair.fit[:20]!r} is not {" or ".join(FITS)}')
    for name, text in ((pair.left, pair.focus_left), (pair.right, pair.focus_right)):
        if text and _focus(text) is None:
            found.append(f'{name}: focus {text[:20]!r} is not two numbers from 0 to 1')
    if pair.play and pair.play not in PLAYS:
        found.append(f'{pair.left}: play {pair.play[:20]!r} is not one of {" ".join(PLAYS)}')
    elif pair.play and not any(map(_moves, pair.images)):
        found.append(f'{pair.left}: play {pair.play} means videos; this pair has none')
    return found


def _listed(folder: Path) -> list[Pair]:
    if not folder.is_dir():
        raise DeviceMissing(f'{folder}: no such folder of images')
    list_file = find(folder, LIST)
    if not list_file.is_file():
        raise DeviceMissing(
            f'{folder}: no {LIST} in it; write one pair a line: left,right,caption,credit'
        )
    try:
        rows = list(text_table.rows(list_file, WORDS[:4], WORDS[:2], _are_files))
    except ConfigError as error:  # a list that cannot be read is a folder without pairs
        raise DeviceMissing(str(error)) from None
    pairs = []
    for row in rows:
        words = dict.fromkeys(WORDS, '') | row.cells
        left, right = (words[side].replace('\\', '/') for side in ('left', 'right'))
        lefts, rights = (_degrees(folder, name, words['play']) for name in (left, right))
        more = {name: words[name] for name in WORDS[2:]}
        posters = _poster(folder, left), _poster(folder, right)
        pairs.append(Pair(left, right, lefts=lefts, rights=rights, posters=posters, **more))
    return pairs


def _are_files(cells: Sequence[str]) -> bool:
    return any(source(cell).strip().lower().endswith(KINDS) for cell in cells)


def _poster(folder: Path, name: str) -> str:
    """Return the name of the image that stands for a video until it is there, or an empty one."""
    stem = name.rpartition('.')[0]
    found = (f'{stem}{kind}' for kind in PICTURES) if _moves(name) else ()
    return next((one for one in found if find(folder, one).is_file()), '')


def _degrees(folder: Path, name: str, play: str) -> tuple[str, ...]:
    """Return the names of an image in its degrees of damage; none where it has none."""
    if play == 'damage' and _moves(name):
        return tuple(f'{name}#{round(100 * i / (DEGREES - 1))}' for i in range(DEGREES))
    stem, dot, kind = name.rpartition('.')
    found = []
    for number in range(1, 10):
        one = f'{stem}.{number}{dot}{kind}'
        if not dot or not find(folder, one).is_file():
            break
        found.append(one)
    return tuple(found)


def _forbidden(folder: Path, name: str) -> str:
    """Return why a file of this name is not handed out, or an empty string."""
    path = find(folder, name)
    if not path.resolve().is_relative_to(folder.resolve()):
        return 'outside the folder'
    return '' if path.suffix.lower() in KINDS else f'not one of {" ".join(KINDS)}'


def _broken(path: Path, placed: bool) -> str:
    """Decode the image once, or the first of a video; return what is wrong, or an empty string."""
    try:
        if _moves(path.name):
            return video_file.fault(path, placed)
        data = path.read_bytes()
    except OSError as error:
        return f'cannot be read ({error.strerror})'
    kind = path.suffix.lower()
    if kind in ('.svg', '.svgz'):
        try:
            if kind == '.svgz':
                data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(MAX_SVG_BYTES)
            root = ElementTree.fromstring(data)
        except (
            ElementTree.ParseError,
            EOFError,
            OSError,
            zlib.error,
            LookupError,
            ValueError,
        ) as error:
            # the last two of an encoding that is unknown
            return f'not an SVG image ({error})'
        return '' if root.tag.endswith('svg') else 'not an SVG image'
    from eol_ros.devices.files import picture_kind  # the drawn set needs none of its memory

    return picture_kind.fault(data)

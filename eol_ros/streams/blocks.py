# SPDX-License-Identifier: Apache-2.0
"""The blocks of one image: eol_msgs/Blocks as arrays, for 25 message objects an image cost more
than tracking.

An image has a row for each place of the table, in the frame `table` of whichever namespace, so its
messages have one layout. It is worked out from the definition: a template is encoded, and the
values are written and read where they lie in it, without a copy.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eol_ros.core.table import Table
from eol_ros.core.vision.states import STATES, TRACKING
from eol_ros.streams.cdr import NS, Decoder, Fixed, words
from eol_ros.streams.checks import LARGEST

if TYPE_CHECKING:
    from eol_ros.core.vision.tracker import Tracked

TYPE = 'eol_msgs/msg/Blocks'
FRAME_ID = 'table'
KNOWN = 4  # layouts kept
_FRAME = 16  # where the letters of frame_id begin, behind the CDR header, the stamp and a length
BLOCK = np.dtype(
    [('id', 'u1'), ('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'), ('u', 'f8'), ('v', 'f8'),
     ('sigma', 'f4'), ('visibility', 'f4'), ('seen', '?')]
)  # fmt: skip
_NUMBERS = tuple(name for name in BLOCK.names or () if BLOCK[name].kind == 'f')
MEASURED = BLOCK.names[1:]  # type: ignore[index]  # all but the id, which is the row's number


def dtype(cells: int = Table().cells) -> np.dtype:
    """Return a message as the row of a recorded table, with this many blocks."""
    return np.dtype(
        [('stamp', 'M8[ns]'), ('state', 'u1'), ('symmetry_ambiguous', '?'), ('image', 'u4'),
         ('blocks', BLOCK, cells)]
    )  # fmt: skip


@dataclass(frozen=True)
class Blocks:
    """One message; `rows` is (cells,) with the fields MEASURED at least."""

    stamp_ns: int
    state: int
    symmetry_ambiguous: bool
    image: int
    rows: np.ndarray

    @property
    def stamp_s(self) -> float:
        """The stamp in seconds, as core counts time."""
        return self.stamp_ns * 1e-9

    @property
    def known(self) -> np.ndarray:
        """Which blocks, (cells,), were seen in this image while every identity was known."""
        return self.rows['seen'] & (self.state == TRACKING)


def rows_of(tracked: 'Tracked', out: np.ndarray | None = None) -> np.ndarray:
    """Return the rows (cells,) of an answer of the tracker; `out` has the fields MEASURED."""
    if out is None:
        out = np.zeros(len(tracked.seen), BLOCK)
        out['id'] = np.arange(len(out))
    out['x'], out['y'] = tracked.world[:, 0], tracked.world[:, 1]
    out['u'], out['v'] = tracked.px[:, 0], tracked.px[:, 1]
    out['yaw'], out['sigma'] = tracked.yaw, tracked.sigma_m
    out['visibility'], out['seen'] = tracked.visibility, tracked.seen
    return out


def of(stamp_ns: int, tracked: 'Tracked', image: int) -> np.void:
    """Return the row of `dtype` of the answer to the image number `image`."""
    row: np.void = np.zeros(1, dtype(len(tracked.seen)))[0]
    row['stamp'], row['image'], row['state'] = stamp_ns, image, tracked.state
    row['symmetry_ambiguous'] = tracked.symmetry_ambiguous
    row['blocks'] = rows_of(tracked)
    return row


def each(table: np.ndarray) -> Iterator[Blocks]:
    """Yield the messages of a recorded table."""
    names = ('state', 'symmetry_ambiguous', 'image')
    heads = zip(
        table['stamp'].astype('i8').tolist(), *(table[n].tolist() for n in names), strict=True
    )
    for (stamp_ns, state, ambiguous, image), rows in zip(heads, table['blocks'], strict=True):
        yield Blocks(stamp_ns, state, ambiguous, image, rows)


class _Places:
    """Where the values lie in a message of one frame; `raw` is such a message."""

    def __init__(self, definition: str, frame_id: bytes, cells: int):
        decoder = Decoder(TYPE, definition)
        raw = words(0, 0, frame_id.decode(), b'\0\0', 0, cells) + bytes(cells * 2 * BLOCK.itemsize)
        end = decoder.layout(raw).at('blocks', cells - 1, MEASURED[-1])[1] + 1
        self.raw = raw[:end]
        layout = decoder.layout(self.raw)
        for k in range(cells):
            self.raw[layout.at('blocks', k, 'id')[1]] = k
        head = ('header.stamp', 'header.frame_id', 'state', 'symmetry_ambiguous', 'image')
        self._cells, self._other_ids = cells, bytes(range(1, cells))
        self.head = Fixed(layout, head)
        at = [[layout.at('blocks', k, name) for name in MEASURED] for k in range(cells)]
        offsets = np.array([[offset for _, offset, _ in places] for places in at])
        self._start, self._stride = int(offsets[0].min()), int(offsets[1, 0] - offsets[0, 0])
        assert (np.diff(offsets, axis=0) == self._stride).all()  # a whole number of alignments
        names = [[n for n in _NUMBERS if BLOCK[n] == kind] for kind in ('f8', 'f4')]
        self._numbers = []
        for group in names:  # they lie side by side
            start, size = int(offsets[0, MEASURED.index(group[0])]), BLOCK[group[0]].itemsize
            assert offsets[0, MEASURED.index(group[-1])] == start + size * (len(group) - 1)
            self._numbers.append(((cells, len(group)), f'<f{size}', start, (self._stride, size)))
        self._first, second = (layout.at('blocks', k, 'id')[1] for k in range(2))
        self._others = slice(second, None, self._stride)
        self._ambiguous = layout.at('symmetry_ambiguous')[1]
        self._seen = slice(layout.at('blocks', 0, 'seen')[1], None, self._stride)
        self._dtype = np.dtype(
            {
                'names': list(MEASURED),
                'formats': [BLOCK[name].newbyteorder('<') for name in MEASURED],
                'offsets': (offsets[0] - self._start).tolist(),
            }
        )

    def rows(self, raw: bytes | bytearray) -> np.ndarray:
        """Return the blocks of a message, a view of its bytes."""
        return np.ndarray(self._cells, self._dtype, raw, self._start, (self._stride,))

    def tame(self, raw: bytes) -> bool:
        """Return whether no number of a message is too large; what is not known is NaN."""
        return not any(
            np.fmax.reduce(np.abs(np.ndarray(shape, kind, raw, start, strides)), axis=None)
            > LARGEST
            for shape, kind, start, strides in self._numbers
        )

    def ordered(self, raw: bytes) -> bool:
        """Return whether the blocks stand in order of their ids, and flags are 0 or 1."""
        return (
            raw[self._first] == 0
            and raw[self._others][: self._cells - 1] == self._other_ids
            and raw[self._ambiguous] <= 1
            and max(raw[self._seen][: self._cells]) <= 1
        )


class Codec:
    """Writes and reads messages by the definition of eol_msgs/msg/Blocks, a `ros2msg` schema.

    rows: (cells,) with the fields MEASURED, in the very bytes of the next message: what is written
    there first need not be copied by `pack`.
    """

    def __init__(self, definition: str, frame_prefix: str = '', cells: int = Table().cells):
        self._cells = cells
        self._refused = f'blocks: not a little-endian message of {cells} blocks in frame table'
        self._definition, self._frame_id = definition, (frame_prefix + FRAME_ID).encode()
        self._known: dict[bytes, _Places] = {}  # by frame: a graph has one
        places = _Places(definition, self._frame_id, cells)
        self._raw = places.raw
        self._write, self.rows = places.head.writer(self._raw), places.rows(self._raw)

    def pack(
        self, stamp_ns: int, state: int, symmetry_ambiguous: bool, image: int, rows: np.ndarray
    ) -> bytes:
        """Return the CDR bytes of a message; rows: (cells,) with the fields MEASURED."""
        if rows is not self.rows:
            for name in MEASURED:
                self.rows[name] = rows[name]
        stamp = divmod(stamp_ns, NS)
        self._write(stamp, self._frame_id, state, symmetry_ambiguous, image % 2**32)
        return bytes(self._raw)

    def read(self, raw: bytes) -> Blocks:
        """Return a message from its CDR bytes, of which `rows` is a view.

        Raises ValueError when it is not so many blocks in frame `table`, in order of id,
        little-endian, or a number in it is too large. What is not known is NaN, also the place of a
        block that is seen, while the camera is calibrated.
        """
        frame_id = raw[_FRAME : _FRAME + raw[_FRAME - 4] - 1] if len(raw) > _FRAME else b''
        if frame_id not in self._known:
            if frame_id.rpartition(b'/')[2] != FRAME_ID.encode():
                raise ValueError(self._refused)
            if len(self._known) == KNOWN:
                self._known.clear()
            self._known[frame_id] = _Places(self._definition, frame_id, self._cells)
        places = self._known[frame_id]
        values = places.head.values(raw)
        if values is None or values[1] != frame_id or not places.ordered(raw):
            raise ValueError(self._refused)
        (seconds, nanoseconds), _, state, ambiguous, image = values
        if state >= len(STATES):
            raise ValueError(f'blocks: state is {state}')
        found = Blocks(seconds * NS + nanoseconds, state, ambiguous, image, places.rows(raw))
        if not places.tame(raw):
            name = next(n for n in _NUMBERS if (np.abs(found.rows[n]) > LARGEST).any())
            raise ValueError(f'blocks: a number among {name} is too large')
        return found

# SPDX-License-Identifier: Apache-2.0
"""Whether a video file is one that a browser plays: its container, its codec and its first image.

ISO/IEC 14496-12 (boxes of MP4), RFC 8794 and RFC 9559 (elements of WebM, which is Matroska).
"""

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

CODECS = {
    'avc1': 'H.264', 'avc3': 'H.264', 'vp08': 'VP8', 'vp09': 'VP9', 'av01': 'AV1',
    'V_VP8': 'VP8', 'V_VP9': 'VP9', 'V_AV1': 'AV1',
}  # fmt: skip
"""What browsers decode without help of the graphics card, by its name in MP4 and in WebM."""
_PLAYED = 'browsers play H.264, VP8, VP9 and AV1'
_LARGEST_HEAD = 64 << 20  # bytes; of a film of many hours
_PARENTS = {b'moov', b'trak', b'mdia', b'minf', b'stbl'}
_HEADER, _SEGMENT, _INFO, _TRACKS = 0x1A45DFA3, 0x18538067, 0x1549A966, 0x1654AE6B
_DOC_TYPE, _DURATION, _TRACK, _CODEC = 0x4282, 0x4489, 0xAE, 0x86


def fault(path: Path, placed: bool = False) -> str:
    """Return why a browser would not play a video, or an empty string.

    placed: whether it must say how long it is, since time in it means something. Raises OSError.
    """
    try:
        with path.open('rb') as file:
            kind = path.suffix.lower()
            codec, timed = {'.mp4': _mp4, '.webm': _webm, '.gif': _gif}[kind](file)
        if kind == '.gif':
            return _undecoded(path)
        if codec not in CODECS:
            return f'its video is {codec}; {_PLAYED}'
        if placed and not timed:
            return 'does not say how long it is, so there is no place in it for damage'
        # OpenCV's wheels bring no decoder of AV1.
        return '' if CODECS[codec] == 'AV1' else _undecoded(path)
    except (ValueError, IndexError, struct.error) as error:
        return str(error) if type(error) is ValueError else 'not a video, or a broken one'


def _undecoded(path: Path) -> str:
    import cv2  # only for videos: the drawn set needs none of its memory

    from eol_ros.devices.camera.sources import open_video

    capture = open_video(str(path), cv2.CAP_FFMPEG)
    try:
        return '' if capture.read()[0] else 'its first image cannot be decoded'
    finally:
        capture.release()


def _gif(file: BinaryIO) -> tuple[str, bool]:
    """Walk through the blocks of a GIF (GIF89a, appendix A); what follows its trailer is ignored.

    Raises ValueError if there is no trailer.
    """
    head = file.read(13)
    if head[:6] not in (b'GIF87a', b'GIF89a'):
        raise ValueError('not a GIF')
    _skip_colours(file, head[10])
    while (kind := file.read(1)) != b';':
        if kind == b',':
            _skip_colours(file, file.read(9)[8])
        elif kind != b'!':
            raise ValueError('cut off before its end')
        file.seek(1, 1)  # size of the codes, or the sort of the extension
        while size := file.read(1):
            if not size[0]:
                break
            file.seek(size[0], 1)
    return '', True


def _skip_colours(file: BinaryIO, flags: int) -> None:
    if flags & 0x80:
        file.seek(3 << (flags & 7) + 1, 1)


def _mp4(file: BinaryIO) -> tuple[str, bool]:
    """Return the sample entry of the first video track, and whether it says how long it is."""
    codec, timed, video = '', False, False
    for kind, body in _boxes(_movie_box(file)):
        if kind == b'mvhd':
            form, place = ('>II', 12) if body[0] == 0 else ('>IQ', 20)
            units, whole = struct.unpack_from(form, body, place)
            timed = units > 0 and whole > 0
        elif kind == b'hdlr':
            video = body[8:12] == b'vide'
        elif kind == b'stsd' and video and not codec:
            codec = body[12:16].decode('latin-1')
    if not codec:
        raise ValueError('there is no video in it')
    return codec, timed


def _movie_box(file: BinaryIO) -> bytes:
    """Return what the box `moov` holds, empty where there is none; raise if the file is cut off."""
    if file.read(8)[4:] != b'ftyp':
        raise ValueError('not an MP4')
    size, at, head = file.seek(0, 2), 0, b''
    while at < size:
        file.seek(at)
        first = file.read(16)
        kind = first[4:8]
        long, start = struct.unpack('>I', first[:4])[0], 8
        if long == 1:
            long, start = struct.unpack('>Q', first[8:16])[0], 16
        long = long or size - at
        if head and not kind.isalnum():  # phones write more behind the last box
            break
        if long < start or at + long > size:
            raise ValueError('cut off before its end')
        if kind == b'moov':
            if long > _LARGEST_HEAD:
                raise ValueError('not an MP4')
            file.seek(at + start)
            head = file.read(long - start)
        at += long
    return head


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield type and content of each box that holds no other ones, of those that do theirs."""
    at = 0
    while at + 8 <= len(data):
        long, kind = struct.unpack('>I4s', data[at : at + 8])
        if long < 8 or at + long > len(data):
            raise ValueError('not a video, or a broken one')
        body = data[at + 8 : at + long]
        if kind in _PARENTS:
            yield from _boxes(body)
        else:
            yield kind, body
        at += long


def _webm(file: BinaryIO) -> tuple[str, bool]:
    """Return the codec of the first video track, and whether it says how long it is."""
    size = file.seek(0, 2)
    file.seek(0)
    name, long = _element(file)
    if name != _HEADER or not 0 <= long < 4096:
        raise ValueError('not a WebM')
    kinds = dict(_elements(file.read(long)))
    if kinds.get(_DOC_TYPE, b'').rstrip(b'\0') != b'webm':
        raise ValueError('not a WebM')
    name, long = _element(file)
    if name != _SEGMENT:
        raise ValueError('not a WebM')
    if long >= 0 and file.tell() + long > size:
        raise ValueError('cut off before its end')
    codec, timed = '', False
    while file.tell() < size and not (codec and timed):
        name, long = _element(file)
        if long < 0:  # a cluster of a live recording; what describes it comes before
            break
        if name in (_INFO, _TRACKS):
            if long > _LARGEST_HEAD:
                raise ValueError('not a WebM')
            for part, body in _elements(file.read(long)):
                if name == _INFO and part == _DURATION:
                    timed = struct.unpack('>d' if len(body) == 8 else '>f', body)[0] > 0
                elif name == _TRACKS and part == _TRACK and not codec:
                    found = dict(_elements(body)).get(_CODEC, b'').rstrip(b'\0').decode('latin-1')
                    codec = found if found.startswith('V_') else ''
        else:
            file.seek(long, 1)
    if not codec:
        raise ValueError('there is no video in it')
    return codec, timed


def _element(file: BinaryIO) -> tuple[int, int]:
    """Return the id of an element, and how many bytes follow; -1 where it does not say."""
    found = []
    for keep in (True, False):  # the marker bit belongs to an id and not to a size
        first = file.read(1)
        if not first or not first[0]:
            raise ValueError('not a video, or a broken one')
        more = 8 - first[0].bit_length()
        value = int.from_bytes(first + file.read(more), 'big')
        mark = 1 << (7 * (more + 1))
        found.append(value if keep else -1 if value == 2 * mark - 1 else value - mark)
    return found[0], found[1]


def _elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    file = io.BytesIO(data)
    while file.tell() < len(data):
        name, long = _element(file)
        if long < 0:
            raise ValueError('not a video, or a broken one')
        yield name, file.read(long)

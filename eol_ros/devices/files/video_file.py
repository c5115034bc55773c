# SPDX-License-Identifier: Apache-2.0
"""Check that a browser can play a video file: complete, known codec, first image decodable.

ISO/IEC 14496-12 (boxes of MP4), RFC 8794 and RFC 9559 (elements of WebM, which is Matroska).
"""

import os
import struct
from pathlib import Path
from typing import BinaryIO

CODECS = ('H264', 'AVC1', 'VP80', 'VP90')  # as FFmpeg names them: H.264, VP8, VP9
AV1 = b'av01', b'V_AV1'  # in the head or the end of MP4, in the head of WebM
_PLAYED = 'browsers play H.264, VP8, VP9 and AV1'
_HEAD = 1 << 20  # bytes at either end in which the codec is named
_EBML, _SEGMENT = b'\x1a\x45\xdf\xa3', b'\x18\x53\x80\x67'


def fault(path: Path, placed: bool = False) -> str:
    """Return why a browser would not play a video, or an empty string.

    placed: whether it must say how long it is, since time in it means something. Raises OSError.
    """
    try:
        with path.open('rb') as file:
            {'.mp4': _mp4, '.webm': _webm, '.gif': _gif}[path.suffix.lower()](file)
            file.seek(0)
            ends = file.read(_HEAD)
            file.seek(max(file.seek(0, os.SEEK_END) - _HEAD, 0))
            ends += file.read()
    except (ValueError, IndexError, struct.error) as error:
        return str(error) if type(error) is ValueError else 'not a video, or a broken one'
    import cv2  # only for videos: the drawn set needs none of its memory

    from eol_ros.devices.camera.sources import open_video

    capture = open_video(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():  # OpenCV's wheels bring no decoder of AV1
            known = any(name in ends for name in AV1)
            return '' if known else f'not a video that can be read; {_PLAYED}'
        codec = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, 'little').decode('latin-1')
        if codec.upper() not in (*CODECS, 'GIF '):
            return f'its video is {codec}; {_PLAYED}'
        if placed and capture.get(cv2.CAP_PROP_FRAME_COUNT) <= 0:
            return 'does not say how long it is, so there is no place in it for damage'
        return '' if capture.read()[0] else 'its first image cannot be decoded'
    finally:
        capture.release()


def _gif(file: BinaryIO) -> None:
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


def _skip_colours(file: BinaryIO, flags: int) -> None:
    if flags & 0x80:
        file.seek(3 << (flags & 7) + 1, 1)


def _mp4(file: BinaryIO) -> None:
    """Walk through the outermost boxes of an MP4; raise ValueError if one goes beyond the end."""
    if file.read(8)[4:] != b'ftyp':
        raise ValueError('not an MP4')
    size, at, kinds = file.seek(0, os.SEEK_END), 0, set()
    while at < size:
        file.seek(at)
        first = file.read(16)
        kind, long = first[4:8], struct.unpack('>I', first[:4])[0]
        if b'moov' in kinds and not kind.isalnum():  # phones write more behind the last box
            return
        long = struct.unpack('>Q', first[8:16])[0] if long == 1 else long or size - at
        if long < 8 or at + long > size:
            raise ValueError('cut off before its end')
        kinds.add(kind)
        at += long


def _webm(file: BinaryIO) -> None:
    """Raise ValueError if the segment of a WebM, where it says how long it is, is not whole."""
    head = file.read(4096)
    at = head.find(_SEGMENT) + 4
    if not head.startswith(_EBML) or b'webm' not in head[:64] or at < 4:
        raise ValueError('not a WebM')
    more = 8 - head[at].bit_length()
    mark = 1 << 7 * (more + 1)
    size = int.from_bytes(head[at : at + 1 + more], 'big') - mark
    if size < mark - 1 and at + 1 + more + size > file.seek(0, os.SEEK_END):
        raise ValueError('cut off before its end')

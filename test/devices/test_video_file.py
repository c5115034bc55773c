# SPDX-License-Identifier: Apache-2.0
"""Videos that a browser plays, and those that it does not, made by FFmpeg's writers and by hand."""

import cv2
import numpy as np
import pytest
from PIL import Image

from eol_ros.devices.files.media_folder import LIST, MediaFolder, Pictures
from eol_ros.devices.files.video_file import fault

BROKEN = ('not a', 'cut off before its end')


@pytest.fixture(scope='module')
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp('videos')
    for name, code in (
        ('vp8.webm', 'VP80'),
        ('vp9.webm', 'VP90'),
        ('vp9.mp4', 'vp09'),
        ('old.mp4', 'mp4v'),
    ):
        out = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*code), 25, (64, 36))
        for i in range(10):
            out.write(np.full((36, 64, 3), 20 * i, np.uint8))
        out.release()
    images = [Image.fromarray(np.full((9, 16), 20 * i, np.uint8)) for i in range(10)]
    images[0].save(folder / 'lean.gif', save_all=True, append_images=images[1:], duration=40)
    Image.fromarray(np.full((9, 16), 90, np.uint8)).save(folder / 'vp9.jpg')
    return folder


@pytest.mark.parametrize('name', ['vp8.webm', 'vp9.webm', 'vp9.mp4', 'lean.gif'])
def test_videos_that_browsers_play(videos, name, tmp_path):
    assert fault(videos / name, placed=True) == ''
    whole = (videos / name).read_bytes()
    part = tmp_path / name
    for share in (0, 0.1, 0.5, 0.99):
        part.write_bytes(whole[: int(share * len(whole))])
        assert fault(part).startswith(BROKEN)
    part.write_bytes(whole[::-1])
    assert fault(part).startswith(BROKEN)


def test_videos_that_browsers_do_not_play(videos, tmp_path):
    assert fault(videos / 'old.mp4') == ('its video is FMP4; browsers play H.264, VP8, VP9 and AV1')
    whole = (videos / 'vp9.webm').read_bytes()
    film = tmp_path / 'film.webm'
    film.write_bytes(whole.replace(b'V_VP9', b'V_XYZ'))
    assert fault(film).startswith('not a video')
    film.write_bytes(whole.replace(b'V_VP9', b'V_AV1'))
    assert fault(film) == ''  # nothing here decodes it
    film.write_bytes(whole.replace(b'\x44\x89\x88', b'\x44\x88\x88'))  # no Duration
    assert fault(film) == ''
    assert fault(film, placed=True).startswith('does not say how long it is')
    # Its cluster (RFC 9559: 0x1F43B675) holds zeros in place of images.
    start = whole.index(b'\x1f\x43\xb6\x75') + 30
    film.write_bytes(whole[:start] + bytes(len(whole) - start))
    assert fault(film) == 'its first image cannot be decoded'


def test_pairs_of_videos(videos):
    text = 'left,right,caption,credit,play,fit\n'
    text += 'vp8.webm,vp9.mp4,Dam,Ann,damage,contain\nlean.gif,vp9.jpg,,,once,\n'
    (videos / LIST).write_text(
        text + 'old.mp4,gone.webm\nvp9.jpg,vp9.jpg,,,loop\nlean.gif,vp9.jpg,,,x\n'
    )
    media = MediaFolder(videos)
    dam, lean, *rest = media.pairs
    assert len(rest) == 2 and media.skipped == [
        'old.mp4: its video is FMP4; browsers play H.264, VP8, VP9 and AV1', 'gone.webm: missing',
        'vp9.jpg: play loop means videos; this pair has none',
        "lean.gif: play 'x' is not one of loop once moving damage",
    ]  # fmt: skip
    assert dam.lefts[0] == 'vp8.webm#0' and dam.lefts[-1] == 'vp8.webm#100'
    assert len(dam.lefts) == len(dam.rights) == 10
    assert dam.files == ('vp8.webm', 'vp9.mp4', 'vp9.jpg')
    assert lean.images == ('lean.gif', 'vp9.jpg')
    pictures = Pictures(str(videos))
    assert pictures.look('vp8.webm#33', ['vp8.webm#33', 'vp9.mp4#33', 'lean.gif', 'vp9.jpg'])[
        'looks'
    ] == {
        'vp8.webm#33': ['contain', 0.5, 0.5, 'damage', ''],
        'vp9.mp4#33': ['contain', 0.5, 0.5, 'damage', 'vp9.jpg'],
        'lean.gif': ['cover', 0.5, 0.5, 'once', ''],
    }
    for name in dam.files:
        assert pictures.file(name) == videos / name

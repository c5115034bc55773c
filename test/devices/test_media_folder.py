# SPDX-License-Identifier: Apache-2.0
"""The folder of pictures, with everything wrong in it that artists' folders have."""

import gzip
import os
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from eol_ros.devices.files import media_folder
from eol_ros.devices.files.media_folder import LIST, MAX_SVG_BYTES, MediaFolder, Pair, Pictures
from eol_ros.errors import DeviceMissing

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"><rect width="4" height="3"/></svg>'


def picture(path, shade=90):
    cv2.imwrite(str(path), np.full((60, 80, 3), shade, np.uint8))


@pytest.fixture
def folder(tmp_path):
    for name in ('a.jpg', 'b.png', 'c.webp', 'd.JPG'):
        picture(tmp_path / name)
    (tmp_path / 'e.svg').write_text(SVG)
    (tmp_path / LIST).write_text('left,right,caption,credit\na.jpg,b.png,One,Ann\nc.webp,e.svg\n')
    return tmp_path


def touch_list(folder, text):
    (folder / LIST).write_text(text)
    os.utime(folder / LIST, ns=(1, 1 + len(text)))  # another time even within the clock's step


def test_reads_pairs_in_order(folder):
    media = MediaFolder(folder)
    assert media.pairs == [Pair('a.jpg', 'b.png', 'One', 'Ann'), Pair('c.webp', 'e.svg')]
    assert media.skipped == []
    assert media.refresh() is False


@pytest.mark.parametrize(
    'text',
    [
        'a.jpg,b.png\n',
        'Left;Right;Caption\na.jpg;b.png;x, y\n',
        '\ufeffleft,right\r\na.jpg,b.png\r\n\r\n',
        '# mine\na.jpg , b.png\n',
    ],
)
def test_reads_what_spreadsheets_write(folder, text):
    touch_list(folder, text)
    assert [(p.left, p.right) for p in MediaFolder(folder).pairs] == [('a.jpg', 'b.png')]


def test_skips_and_names_what_is_wrong(folder):
    whole, packed = (folder / 'a.jpg').read_bytes(), gzip.compress(SVG.encode())
    wrong = {
        'gone.jpg': (None, 'missing'),
        'cut.jpg': (whole[: len(whole) // 2], 'cut off'),
        'cut.png': ((folder / 'b.png').read_bytes()[:-20], 'cut off'),
        'words.png': (b'not an image IEND', 'not an image'),
        'bad.svg': (b'<svg><rect></svg>', 'not an SVG'),
        'plain.svgz': (SVG.encode(), 'not an SVG'),
        'short.svgz': (packed[:-9], 'not an SVG'),
        'mixed.svgz': (packed[:20] + b'zzzz' + packed[24:], 'not an SVG'),
        'bomb.svgz': (gzip.compress(b' ' * (MAX_SVG_BYTES + 1)), 'not an SVG'),
        'empty.jpg': (b'', 'empty'),
        'film.avi': (b'x', 'not one of'),
        '../secret.png': ((folder / 'b.png').read_bytes(), 'outside the folder'),
        '/etc/passwd.png': (None, 'outside the folder'),
    }
    for name, (data, _) in wrong.items():
        if data is not None:
            (folder / name).write_bytes(data)
    touch_list(folder, 'a.jpg,b.png\n' + ''.join(f'a.jpg,{name}\n' for name in (*wrong, '')))
    media = MediaFolder(folder)
    assert len(media.pairs) == 1
    assert media.skipped[-1] == 'a pair lacks its left or right image'
    for (name, (_, why)), skipped in zip(wrong.items(), media.skipped[:-1], strict=True):
        assert skipped.startswith(f'{name}: {why}')
    pictures = Pictures(str(folder))
    assert pictures.file('a.jpg') == folder / 'a.jpg'
    for name in ('../secret.png', '/etc/passwd.png', 'film.avi', 'c.webp', LIST, ''):
        assert pictures.file(name) is None


def test_many_who_ask_at_once_cost_one_look_at_the_list(folder, monkeypatch):
    looks = []
    listed = media_folder._listed
    monkeypatch.setattr(media_folder, '_listed', lambda f: looks.append(f) or listed(f))
    pictures = Pictures(str(folder))
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(pictures.file, ['a.jpg', 'b.png', 'c.webp', 'e.svg'] * 50))
    assert found == [folder / name for name in ('a.jpg', 'b.png', 'c.webp', 'e.svg')] * 50
    assert len(looks) == 1
    (folder / LIST).unlink()
    pictures._looked_s = -1e9
    assert pictures.file('no.png') is None and pictures.file('a.jpg')  # the last list holds


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda f: f / 'nowhere', 'no such folder'),
        (lambda f: (f / LIST).unlink() or f, 'write one pair a line'),
        (lambda f: touch_list(f, '') or f, 'no pair of images'),
        (lambda f: touch_list(f, 'x.jpg,y.jpg') or f, 'x.jpg: missing; y.jpg: missing'),
        (lambda f: (f / LIST).write_bytes(b'a.jpg,\xe4.jpg') and f, '1:7: byte 0xE4 is not UTF-8'),
    ],
)
def test_nothing_to_show_is_one_clear_line(folder, make, words):
    with pytest.raises(DeviceMissing, match=words) as caught:
        MediaFolder(make(folder))
    assert caught.value.exit_code == 69 and '\n' not in str(caught.value)


def test_an_image_may_come_in_degrees_of_damage(tmp_path):
    for name in ('dam.1.png', 'dam.2.png', 'dam.4.png', 'wall.png', 'wall.1.PNG'):
        picture(tmp_path / name)
    (tmp_path / 'pairs.csv').write_text('dam.png,wall.png\n')
    folder = MediaFolder(tmp_path)
    (pair,) = folder.pairs  # dam.png itself need not be there; without a third there is no fourth
    assert (pair.left, pair.lefts, pair.rights) == (
        'dam.png', ('dam.1.png', 'dam.2.png'), ('wall.1.png',),
    )  # fmt: skip
    assert Pictures(str(tmp_path)).file('dam.2.png') == tmp_path / 'dam.2.png'
    assert Pictures(str(tmp_path)).file('dam.4.png') is None
    picture(tmp_path / 'dam.3.png')
    assert folder.refresh() and len(folder.pairs[0].lefts) == 4
    (tmp_path / 'dam.2.png').write_bytes(b'broken')
    folder.refresh()
    assert folder.skipped and 'dam.2.png' in folder.skipped[0]


def test_a_list_with_a_header_may_say_more(folder):
    touch_list(folder, 'caption,right,left\nDam,a.jpg,b.png\n')  # in any order
    assert MediaFolder(folder).pairs == [Pair('b.png', 'a.jpg', 'Dam')]
    touch_list(
        folder,
        'left,right,credit,fit,focus_left,focus_right,caption_zh,caption\n'
        'a.jpg,b.png,Ann,contain,0.2 1,,大壩,Dam\n'
        'c.webp,e.svg,,fill,0.5 1.5,left,,\n',
    )
    media, pictures = MediaFolder(folder), Pictures(str(folder))
    first, second = media.pairs  # what makes no sense is named, and the pair is shown all the same
    assert (first.caption, first.caption_zh, first.credit) == ('Dam', '大壩', 'Ann')
    assert media.skipped == [
        "c.webp: fit 'fill' is not cover or contain",
        "c.webp: focus '0.5 1.5' is not two numbers from 0 to 1",
        "e.svg: focus 'left' is not two numbers from 0 to 1",
    ]
    assert pictures.look('a.jpg', ['a.jpg', 'b.png', 'c.webp', 'e.svg', 'gone.png']) == {
        'caption_zh': '大壩',
        'looks': {'a.jpg': ['contain', 0.2, 1.0], 'b.png': ['contain', 0.5, 0.5]},
    }
    assert pictures.look('', []) == {'caption_zh': '', 'looks': {}}
    assert second.fit == 'fill'


def test_hot_reload_takes_new_repaired_and_removed_pictures(folder):
    media = MediaFolder(folder)
    touch_list(folder, 'a.jpg,b.png\na.jpg,new.png\n')
    assert media.refresh() is True and media.skipped == ['new.png: missing']
    assert len(media.pairs) == 1
    picture(folder / 'new.png')
    assert media.refresh() is True and len(media.pairs) == 2 and media.skipped == []
    (folder / 'b.png').unlink()
    assert media.refresh() is True and media.pairs == [Pair('a.jpg', 'new.png')]
    touch_list(folder, '')
    assert media.refresh() is False and media.pairs == [Pair('a.jpg', 'new.png')]
    (folder / LIST).unlink()
    assert media.refresh() is False and 'no pairs.csv' in media.skipped[0]


def test_the_set_that_ships_is_whole():
    media = MediaFolder()
    assert len(media.pairs) >= 24 and media.skipped == []
    assert all(pair.caption and pair.credit for pair in media.pairs)
    assert all(len(pair.rights) == 4 for pair in media.pairs)
    shown = {name for pair in media.pairs for name in pair.images}
    assert shown | {LIST} == {path.name for path in media.path.iterdir()}
    pictures = Pictures()
    for name in ('00-left.svg', '00-left.svgz'):  # the first as bags of version 0.2 have it
        assert pictures.file(name) == media.path / '00-left.svgz'
        assert pictures.look(name, [name])['caption_zh'] == media.pairs[0].caption_zh
    files = [media.path / name for name in shown]
    assert sum(file.stat().st_size for file in files) < 3e6
    for file in files:  # images, nothing that acts or loads
        text = gzip.decompress(file.read_bytes())
        assert b'script' not in text and b'href' not in text

# SPDX-License-Identifier: Apache-2.0
"""Images and sounds of phones, browsers and recorders: judged by what is in them."""

import io
import os
import struct
import subprocess
import sys
import wave

import numpy as np
import pytest
import soundfile
from PIL import Image, PngImagePlugin

from eol_ros import cli
from eol_ros.devices.audio import audio_file
from eol_ros.devices.audio.bank import load_bank
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.devices.corpus.corpus_file import Options
from eol_ros.devices.files import picture_kind, video_file
from eol_ros.devices.files.media_folder import MediaFolder
from eol_ros.errors import EolError

NOISE = Image.fromarray(np.random.default_rng(1).integers(0, 255, (90, 120, 3)).astype(np.uint8))


def packed(kind, **options):
    file = io.BytesIO()
    NOISE.save(file, kind, **options)
    return file.getvalue()


TEXT, TURNED = PngImagePlugin.PngInfo(), Image.Exif()
TEXT.add_itxt('project of an editor', 'x' * 2_000_000, zip=True)
TURNED[0x112] = 6
JPEG, PNG, WEBP, GIF = packed('JPEG'), packed('PNG'), packed('WEBP'), packed('GIF')
GIFS = packed('GIF', save_all=True, append_images=[NOISE.rotate(k) for k in (90, 180)])


@pytest.mark.parametrize(
    'data',
    [
        JPEG, PNG, WEBP, GIF, packed('JPEG', progressive=True), packed('JPEG', exif=b'Exif\0\0MM'),
        JPEG + b'\0\0\0\x18ftypmp42' + bytes(999),  # a motion photo
        JPEG + b'\0' * 5000, JPEG + JPEG, PNG + b'trailer of a phone', JPEG[:-2] + b'\xff\xd9\r\n',
        packed('MPO', save_all=True, append_images=[NOISE]), packed('AVIF'),
        packed('PNG', pnginfo=None, compress_level=0), packed('PNG', pnginfo=TEXT),
        packed('JPEG', exif=TURNED), packed('PNG', save_all=True, append_images=[NOISE]),
    ],
)  # fmt: skip
def test_images_that_browsers_show_are_good(data):
    assert picture_kind.fault(data) == ''


@pytest.mark.parametrize(
    ('data', 'told'),
    [
        (b'', 'empty'),
        (bytes(5000), 'only zero bytes'),
        (JPEG[: len(JPEG) // 2], 'cut off'),
        (PNG[: len(PNG) // 2], 'cut off'),
        (PNG[:-16], 'cut off'),
        (WEBP[: len(WEBP) // 2], 'cut off'),
        (packed('TIFF'), 'not an image that browsers show (TIFF)'),
        (b'\0\0\0\x18ftypheic' + bytes(99), 'not an image that browsers show (HEIC)'),
        (JPEG[:20], 'damaged, or of a rare kind (JPEG)'),
        (PNG[:16] + bytes(4) + PNG[20:], 'damaged, or of a rare kind (PNG)'),
        (PNG[:16] + b'\x7f' + PNG[17:], 'damaged'),
        (packed('AVIF')[:300], 'damaged, or of a rare kind (AVIF)'),
        (b'<html>404</html>', "begins with b'<html>404"),
    ],
)
def test_the_first_fact_is_named(data, told):
    assert told in picture_kind.fault(data)


@pytest.mark.parametrize('encoding', ['klingon', 'utf-7', 'utf-16', 'idna'])
def test_an_svg_of_an_unknown_encoding_costs_no_other(tmp_path, encoding):
    (tmp_path / 'a.svg').write_bytes(f'<?xml version="1.0" encoding="{encoding}"?><svg/>'.encode())
    (tmp_path / 'b.jpg').write_bytes(JPEG)
    (tmp_path / 'pairs.csv').write_text('b.jpg,b.jpg\na.svg,b.jpg\n')
    media = MediaFolder(tmp_path)
    assert len(media.pairs) == 1 and 'a.svg: not an SVG image (' in media.skipped[0]


def test_a_bomb_is_refused_before_it_is_unpacked():
    file = io.BytesIO()
    Image.new('L', (12000, 12000)).save(file, 'PNG')
    assert 'too large: 12000 x 12000' in picture_kind.fault(file.getvalue())


@pytest.mark.parametrize(
    ('data', 'told'),
    [(GIFS, ''), (GIFS + b'trailer', ''), (GIFS + bytes(9), ''), (GIFS[:-3], 'cut off')],
)
def test_gifs(tmp_path, data, told):
    (tmp_path / 'a.gif').write_bytes(data)
    assert told in video_file.fault(tmp_path / 'a.gif') and bool(told) == bool(
        video_file.fault(tmp_path / 'a.gif')
    )


def tone(count=16000):
    return (0.3 * np.sin(np.arange(count) / 5)).astype('f4')


@pytest.fixture
def halved(tmp_path):
    """Return a function that writes a sound of 4 s and half of its bytes."""

    def write(name):
        audio_file.write(tmp_path / name, np.random.default_rng(1).uniform(-0.1, 0.1, 64000), 16000)
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
        return tmp_path / name

    return write


@pytest.mark.parametrize(
    ('name', 'told'),
    [('a.wav', ' of 4.00 s'), ('a.aiff', ' of 4.00 s'), ('a.flac', ' of 4.00 s'), ('a.ogg', ';')],
)
def test_a_halved_sound_says_where_it_breaks_off(halved, name, told):
    heard = audio_file.read_mono(halved(name))
    assert 0.5 < heard.duration_s < 2.01
    assert f'{name}: breaks off after {heard.duration_s:.2f} s{told}' in heard.notes[0]


def test_an_mp3_goes_on_behind_damage(tmp_path):
    audio_file.write(tmp_path / 'a.mp3', tone(48000), 16000)
    data = (tmp_path / 'a.mp3').read_bytes()
    (tmp_path / 'a.mp3').write_bytes(data[:4000] + bytes(3000) + data[7000:])
    heard = audio_file.read_mono(tmp_path / 'a.mp3')
    assert 2.5 < heard.duration_s < 3
    assert f'a.mp3: can be decoded for {heard.duration_s:.2f} s of 3.00 s' in heard.notes[0]


def test_lines_of_libraries_do_not_reach_the_terminal(tmp_path, capfd):
    audio_file.write(tmp_path / 'a.mp3', tone(), 16000)
    tag = b'ID3\3\0\0\0\0\0\x10COMM\0\0\0\6\0\0\1eng\xff\xfe'
    (tmp_path / 'a.mp3').write_bytes(tag + (tmp_path / 'a.mp3').read_bytes())
    audio_file.read_mono(tmp_path / 'a.mp3')
    assert 'libmpg123' in capfd.readouterr().err
    words = ['corpus', str(tmp_path / 'a.mp3')]
    assert cli.main(words) == 0
    assert subprocess.run([sys.executable, '-m', 'eol_ros', *words], stderr=2).returncode == 0
    os.write(2, b'goes on\n')
    error = capfd.readouterr().err
    assert error.count(' s of sound in ') == 2 and error.endswith('goes on\n')
    assert 'mpg123' not in error


def test_mp3_is_read_in_pieces_as_in_one(tmp_path, monkeypatch):
    audio_file.write(tmp_path / 'a.mp3', tone(96000), 16000)
    whole = audio_file.read_mono(tmp_path / 'a.mp3').samples
    monkeypatch.setattr(audio_file, 'BLOCK', 1000)
    np.testing.assert_array_equal(audio_file.read_mono(tmp_path / 'a.mp3').samples, whole)


@pytest.mark.parametrize(('rate', 'to'), [(44100, 48000), (48000, 44100), (1000, 8000)])
def test_pieces_are_resampled_to_the_same_bits(rate, to, monkeypatch):
    whole = list(audio_file.resampled([tone(30001)], rate, to))
    monkeypatch.setattr(audio_file, 'BLOCK', 500)
    pieces = list(audio_file.resampled([tone(30001)], rate, to))
    assert len(pieces) > len(whole)
    np.testing.assert_array_equal(np.concatenate(pieces), np.concatenate(whole))


@pytest.mark.parametrize('name', ['a.wav', 'a.mp3', 'a.flac', 'a.ogg', 'a.raw', 'a.aif'])
@pytest.mark.parametrize(
    ('data', 'told'),
    [(b'', 'it is empty'), (bytes(5000), 'only zero bytes'), (b'<html>404', "b'<html>404'")],
)
def test_the_first_fact_about_a_file_that_is_no_sound(tmp_path, name, data, told):
    (tmp_path / name).write_bytes(data)
    if name == 'a.raw' and data[:1] == b'<':
        told = 'samples without a header'
    with pytest.raises(EolError) as caught:
        audio_file.read_mono(tmp_path / name)
    assert f'({told}' in str(caught.value).replace('it begins with ', '')


@pytest.mark.parametrize('rate', [1, 7, 999, 2**31 - 1])
def test_a_rate_that_cannot_be_meant_is_left_out(sounds, rate):
    soundfile.write(sounds / 'odd.wav', tone(), rate)
    corpus = corpus_build.build([sounds / 'good.wav', sounds / 'odd.wav'], Options())
    assert len(corpus.sources) == 1
    assert f'odd.wav: its header says {rate} samples a second' in corpus.notes[0]


def test_a_long_sound_in_a_small_file_is_refused_by_its_length(tmp_path, monkeypatch):
    monkeypatch.setattr(audio_file, 'ROOM', 1e6)
    soundfile.write(tmp_path / 'a.flac', np.zeros(60 * 16000), 16000)
    with pytest.raises(EolError, match='1 min of sound take 4 MB of memory when decoded'):
        audio_file.read_mono(tmp_path / 'a.flac')
    soundfile.write(tmp_path / 'a.wav', np.zeros(60 * 16000), 16000)  # as large as its file says
    assert audio_file.read_mono(tmp_path / 'a.wav').duration_s == 60


def odd_samples(path, value, count):
    samples = tone()
    samples[1000 : 1000 + count] = value
    soundfile.write(path, samples, 16000, subtype='FLOAT')


@pytest.mark.parametrize('value', [1e10, -3e38, np.inf, np.nan, 100.0])
def test_samples_that_cannot_be_meant_are_silent_and_told(tmp_path, value):
    odd_samples(tmp_path / 'a.wav', value, 10)
    heard = audio_file.read_mono(tmp_path / 'a.wav')
    assert np.abs(heard.samples).max() < 0.31
    assert '10 samples are not numbers or beyond' in heard.notes[0]


def test_whole_numbers_in_floats_are_refused_with_the_cause(tmp_path):
    soundfile.write(tmp_path / 'a.wav', tone() * 32768, 16000, subtype='FLOAT')
    with pytest.raises(EolError, match='whole numbers in a file of floats'):
        audio_file.read_mono(tmp_path / 'a.wav')


def test_a_wav_whose_header_was_never_finished_is_to_be_mended(tmp_path):
    with wave.open(str(tmp_path / 'a.wav'), 'wb') as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(16000)
        file.writeframes((tone() * 32767).astype('<i2').tobytes())
    data = bytearray((tmp_path / 'a.wav').read_bytes())
    struct.pack_into('<I', data, 40, 0xFFFFFFFF)  # of a stream: it is read to its end
    (tmp_path / 'a.wav').write_bytes(data)
    heard = audio_file.read_mono(tmp_path / 'a.wav')
    np.testing.assert_allclose(heard.samples, tone(), atol=1e-4)
    struct.pack_into('<I', data, 40, 0)
    (tmp_path / 'a.wav').write_bytes(data)
    with pytest.raises(EolError, match='0 samples .* repair its header: ffmpeg -i'):
        audio_file.read_mono(tmp_path / 'a.wav')


@pytest.fixture
def sounds(tmp_path):
    """A folder with one good sound and one of every bad sort."""
    audio_file.write(tmp_path / 'good.wav', tone(), 16000)
    whole = (tmp_path / 'good.wav').read_bytes()
    odd_samples(tmp_path / 'loud.wav', 1e10, 9000)
    for name, data in {
        'empty.wav': b'', 'zeros.wav': bytes(9000), 'head.wav': whole[:44], 'words.wav': b'sound',
        'short.wav': whole[:60], 'photo.wav': JPEG, '._good.wav': b'\0\5\x16\7',
    }.items():  # fmt: skip
        (tmp_path / name).write_bytes(data)
    (tmp_path / 'dir.wav').mkdir()
    return tmp_path


@pytest.mark.parametrize('way', ['folder', 'more_sounds', 'files'])
def test_bad_sounds_of_many_are_left_out_by_name(sounds, way, monkeypatch):
    monkeypatch.setenv('EOL_CACHE', str(sounds / 'cache'))
    bad = sorted(p.name for p in sounds.glob('*.wav') if p.name[0] != '.' and p.stem != 'good')
    more, sound = (), str(sounds)
    if way != 'folder':
        sound = str(sounds / 'good.wav')
        named = [str(sounds / name) for name in (*bad, 'gone.wav')]
        more = tuple(named) if way == 'files' else (str(sounds), str(sounds / 'nowhere'))
    options = Options(more_sounds=more, regions=('empty left',) if way == 'folder' else ())
    corpus = corpus_build.apart(sound, options)
    assert {source.name for source in corpus.sources} == {'good'}
    for name in bad if way != 'files' else set(bad) - {'dir.wav'}:  # may be filled later
        assert sum(f'/{name}: ' in note for note in corpus.notes) >= 1, name
    again = corpus_build.ready(sound, options)
    assert again is not None and again.digest == corpus.digest


def test_a_bank_goes_on_without_a_sound_that_went_bad(sounds):
    audio_file.write(sounds / 'other.wav', tone(), 16000)
    paths = [sounds / 'good.wav', sounds / 'other.wav']
    corpus = corpus_build.build(paths, Options())
    (sounds / 'other.wav').write_bytes(b'')
    told, grains = [], corpus.grains
    cut = [grains[name] for name in ('file', 'start_s', 'duration_s')]
    bank = load_bank([str(path) for path in paths], *cut, 16000, left_out=told.append)
    assert len(bank) == len(grains) and 'other.wav' in str(told[0])
    (sounds / 'good.wav').write_bytes(b'')
    with pytest.raises(EolError, match='good.wav'):
        load_bank([str(path) for path in paths], *cut, 16000)


def test_a_corpus_goes_on_without_a_sound_that_has_gone(sounds):
    audio_file.write(sounds / 'other.wav', tone(), 16000)
    corpus = corpus_build.build([sounds / 'good.wav', sounds / 'other.wav'], Options())
    corpus_file.save(corpus, sounds / 'c.json')
    (sounds / 'other.wav').unlink()
    again = corpus_file.load(sounds / 'c.json')
    assert again.placed.sum() == 4 and 'other.wav: is gone' in again.notes[0]

# SPDX-License-Identifier: Apache-2.0
"""The film that the README opens with, as it is shipped."""

import itertools

import cv2
import numpy as np
import soundfile
from PIL import Image
from support.checkout import ROOT

FILM, SOUND = ROOT / 'docs/img/film.webp', ROOT / 'docs/img/film.ogg'


def test_the_readme_opens_with_it_and_names_its_sound():
    first = (ROOT / 'README.md').read_text().split('\n## ')[0]
    assert first.index('](docs/img/film.webp)') < first.index('(docs/img/film.ogg)')
    assert FILM.stat().st_size <= 4e6 and SOUND.stat().st_size <= 2e6


def test_film_and_sound_are_of_one_length_and_go_from_calm_to_rupture():
    with Image.open(FILM) as film:
        spans, walls, table = [], [], []
        for i in range(film.n_frames):
            film.seek(i)
            film.load()  # before that it does not know how long it is shown
            spans.append(film.info['duration'] / 1e3)
            small = cv2.resize(np.asarray(film.convert('L')), (96, 60), cv2.INTER_AREA)
            walls.append(small[:28].astype(float))
            table.append(small[33:54, 12:48].mean())
    assert 10 <= sum(spans) <= 15
    sound, rate = soundfile.read(SOUND)
    assert abs(len(sound) / rate - sum(spans)) < 0.1
    assert max(table) > 2 * min(table)  # light
    changes = [np.abs(a - b).mean() > 4 for a, b in itertools.pairwise(walls)]
    assert 4 <= sum(changes) <= 3 * sum(spans)  # pairs; never more than three a second
    loud = np.sqrt(np.square(sound).mean(axis=1).reshape(-1, rate // 4).mean(axis=1))
    assert loud.max() > 8 * np.median(loud[: len(loud) // 4])

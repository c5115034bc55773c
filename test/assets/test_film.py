# SPDX-License-Identifier: Apache-2.0
"""The film that the README opens with, as it is shipped."""

from support.checkout import ROOT

FILM, SOUND = ROOT / 'docs/img/film.webp', ROOT / 'docs/img/film.ogg'


def test_the_readme_opens_with_it_and_names_its_sound():
    first = (ROOT / 'README.md').read_text().split('\n## ')[0]
    assert first.index('](docs/img/film.webp)') < first.index('(docs/img/film.ogg)')
    assert FILM.stat().st_size <= 4e6 and SOUND.stat().st_size <= 2e6

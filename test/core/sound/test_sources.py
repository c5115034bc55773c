# SPDX-License-Identifier: Apache-2.0
"""Several sounds in one corpus: which is meant, how much of it sounds, where it lies."""

import re

import pytest

from eol_ros.core.sound.corpus import Source
from eol_ros.core.sound.sources import absent, regions, weights
from eol_ros.errors import ConfigError
from eol_ros.settings import FORMS

SOURCES = (Source('/a/ice-2-1.wav', 48000, 99.0), Source('/b/low tide.flac', 48000, 99.0))
NAMES = [source.name for source in SOURCES]


def test_names_are_those_of_the_files():
    assert NAMES == ['ice', 'low tide']


def test_weights_and_regions_by_name():
    assert weights(('low tide 0.25',), NAMES).tolist() == [1.0, 0.25]
    assert weights(('gone 0',), NAMES).tolist() == [1.0, 1.0]  # of a sound that may come yet
    assert regions(('low tide far', 'ice 0,0,.5,.25'), NAMES) == [(0, 0, 0.5, 0.25), (0, 0.5, 1, 1)]


def test_a_folder_stands_for_its_sounds():
    takes = (Source('/r/voices/take-1.wav', 48000, 1.0), Source('/r/voices/take-2.wav', 48000, 1.0))
    sources = (*SOURCES, *takes)
    names, folders = [x.name for x in sources], [x.folder for x in sources]
    assert folders == ['a', 'b', 'voices', 'voices']
    lines = ('voices 0.5', 'take-2 0.25')  # the sound's own counts first
    assert weights(lines, names, folders).tolist() == [1.0, 1.0, 0.5, 0.25]
    near, whole = (0.0, 0.0, 1.0, 0.5), (0.0, 0.0, 1.0, 1.0)
    found = regions(('voices near', 'take-1 left'), names, folders)
    assert found == [whole, whole, (0.0, 0.0, 0.5, 1.0), near]
    # one that is empty yet is no mistake; another is, and the takes are not listed one by one
    assert regions(('voices near',), NAMES, ['a', 'b'], ['voices']) == [whole, whole]
    with pytest.raises(ConfigError, match='there are ice, low tide, voices$'):
        regions(('choir near',), names, folders, ['voices'])
    told = ["'choir 0.5': no sound of this name; there are ice, low tide, voices"]
    assert absent(('take-2 0', 'choir 0.5', 'voices 1'), names, folders, ['voices']) == told
    assert absent(('voices 1',), NAMES, ['a', 'b'], ['voices']) == []


@pytest.mark.parametrize('line', ['gone left', 'ice 0.5,0,0.5,1', 'ice 0,1,1,0'])
def test_a_region_that_cannot_be_is_refused(line):
    with pytest.raises(ConfigError, match='regions'):
        regions((line,), NAMES)


@pytest.mark.parametrize(
    ('form', 'good', 'bad'),
    [
        ('NAME WEIGHT', ['ice 0', 'low tide .5', 'a 1', 'a 0.25'], ['ice', 'a 2', 'a -1', 'a x']),
        (
            'X,Y X,Y ... (2 to 100 points in 0..1)',
            ['0,0 1,1', '.1,.2 0.3,0.4 1,0'],
            ['0,0', '0,0 1', '0,0 2,1', '0,0  1,1', '.\u0665,0 1,1'],  # pages read ASCII digits
        ),
        ('NAME REGION', ['ice left', 'low tide 0,0,0.5,1'], ['ice', 'ice up', 'ice 0,0,2,1']),
        (
            'DESCRIPTOR WEIGHT SOURCE',
            ['flatness 1 x', 'pitch_hz 0.5 last', 'rms_db 2e-1 speed'],
            ['flat 1 x', 'flatness x', 'flatness 1 z'],
        ),
    ],
)
def test_forms(form, good, bad):
    assert all(re.fullmatch(FORMS[form], line) for line in good)
    assert not any(re.fullmatch(FORMS[form], line) for line in bad)

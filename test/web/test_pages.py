# SPDX-License-Identifier: Apache-2.0
"""The static pages: both languages whole, nothing from elsewhere, nothing the policy forbids."""

import ast
import dataclasses
import datetime
import json
import re

import numpy as np
import pytest

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.opening_hours import Door, OpeningHours
from eol_ros.core.vision import image_health
from eol_ros.devices import ports
from eol_ros.devices.audio import outputs
from eol_ros.devices.board import lights
from eol_ros.errors import DeviceMissing, UsageError
from eol_ros.said import LANGUAGES, clauses, parts_of, said
from eol_ros.settings import DESCRIPTORS
from eol_ros.web.controls import CONTROLS
from eol_ros.web.routes import STATIC

WORDS = {p.stem: json.loads(p.read_text('utf-8')) for p in LANGUAGES.glob('*.json')}
BUILT = (
    'level_', 'tracker_', 'descriptor_', 'where_', 'caption_', 'playing_', 'corner_',
    'edge_', 'said_', 'mode_', 'filter_', 'by_', 'region_',
)  # fmt: skip
PLACE = re.compile(r'\{(\w+)\}')
TEXTS = {p.name: p.read_text('utf-8') for p in STATIC.glob('*.*')}


def test_languages_match_key_by_key_and_place_by_place():
    assert set(WORDS) == {'en', 'zh-Hant'}
    english, chinese = WORDS['en'], WORDS['zh-Hant']
    assert list(english) == list(chinese)
    for key, text in english.items():
        places = sorted(re.findall(r'\{(\w+)\}', text))
        assert places == sorted(re.findall(r'\{(\w+)\}', chinese[key])), key
        assert text.strip() and chinese[key].strip()


def test_every_word_said_is_in_the_list_and_every_word_listed_is_said():
    pages = ''.join(text for name, text in TEXTS.items() if name.endswith('.html'))
    scripts = ''.join(text for name, text in TEXTS.items() if name.endswith('.js'))
    in_pages = set(re.findall(r'data-(?:say|label)="(\w+)"', pages))
    shown = set(re.findall(r'data-say="(\w+)"', pages))
    assert [key for key in shown if WORDS['en'][key] == WORDS['zh-Hant'][key]] == []
    in_scripts = set(re.findall(r"say\(\s*'(\w+)'", scripts))
    listed = set(WORDS['en'])
    assert in_pages | in_scripts <= listed
    # Said by a choice or by the name of a state or of a control:
    quoted = set(re.findall(r"'(\w+)'", scripts))
    assert {f'descriptor_{name}' for name in DESCRIPTORS} <= listed
    built = {w for w in listed if w.startswith(BUILT)}
    assert listed - in_pages - in_scripts - quoted - built == set()


@pytest.mark.parametrize('name', sorted(n for n in TEXTS if n.endswith(('.html', '.css', '.js'))))
def test_nothing_comes_from_elsewhere_and_no_inline_code(name):
    text = TEXTS[name]
    assert not re.search(r'https?://|//cdn|@import|url\(', text)
    if name.endswith('.html'):
        assert not re.search(r'<script(?![^>]*\bsrc=)', text)
        assert not re.search(r'\son\w+=|\sstyle=|javascript:', text)
        for path in re.findall(r'(?:src|href)="/static/([^"]+)"', text):
            assert (STATIC / path).is_file()
    if name.endswith('.js'):
        assert 'innerHTML' not in text and 'eval(' not in text
        for path in re.findall(r"from '\./([^']+)'", text):
            assert (STATIC / path).is_file()


def test_every_code_has_a_text_and_every_text_a_code_in_both_languages():
    given, constants = {}, set()
    for path in STATIC.parents[1].rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text('utf-8'))):
            if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'said':
                if isinstance(node.args[0], ast.Constant):
                    places = {keyword.arg for keyword in node.keywords}
                    given.setdefault(node.args[0].value, []).append(places)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                constants.add(node.value)
    for words in WORDS.values():
        listed = {k.removeprefix('said_'): v for k, v in words.items() if k.startswith('said_')}
        assert given.keys() <= listed.keys() <= constants
        for code, calls in given.items():
            for places in calls:  # None: from a dict
                assert places == set(PLACE.findall(listed[code])) or None in places, code


def spoken(parts):
    """Return the clauses that stand in the language of the page, and those that do not."""
    return [p for p in parts if isinstance(p, list)], [p for p in parts if isinstance(p, str)]


def board_says(flags, millivolts=0):
    status = protocol.BlockStatus(*(0 for _ in dataclasses.fields(protocol.BlockStatus)))
    return lights.faults({
        3: dataclasses.replace(status, flags=flags, millivolts=millivolts),
        protocol.BRIDGE: dataclasses.replace(status, flags=protocol.LINKED | flags),
    })  # fmt: skip


def card_says(monkeypatch, wanted, there):
    monkeypatch.setattr(outputs, 'cards', lambda: there)
    monkeypatch.setattr(outputs, 'portaudio', lambda: None)
    with pytest.raises(DeviceMissing) as missing:
        outputs.find(wanted, 8)
    return str(missing.value)


def port_says(wanted, there):
    with pytest.raises(DeviceMissing) as missing:
        ports.find('camera', wanted, [ports.Port(name, name, '') for name in there])
    return str(missing.value)


def test_what_goes_wrong_has_a_code(monkeypatch):
    card = {'name': 'Scarlett', 'channels': 2, 'index': 0}
    found = [
        *board_says(0), *board_says(protocol.RADIO_DEAD),
        *board_says(protocol.LINKED | protocol.TWICE | protocol.SENSOR_DEAD, 1000),
        card_says(monkeypatch, 'auto', []), card_says(monkeypatch, 'USB', [card]),
        card_says(monkeypatch, 'Scarlett', [card]),
        port_says('auto', []), port_says('Basler', []), port_says('/dev/eol-none', []),
    ]  # fmt: skip
    image = np.zeros((40, 40), np.uint8)
    for wrong in (image.astype(float), image, image + 255):
        watch = image_health.Watch(None)
        faults = [watch.fault(k / 60, wrong) for k in range(600)]
        found += [faults[-1]] * bool(faults[-1])
    assert len(found) > 10
    for text in found:
        codes, english = spoken(clauses([text, said('again', seconds=5)]).parts)
        assert len(codes) == 2 and not english, text


@pytest.mark.parametrize(
    ('control', 'body'),
    [
        ('radius', {}),
        ('radius', {'value': None}),
        ('move', {'grain': 1, 'x': 9, 'y': 0}),
        ('move', {'grain': 'many', 'x': 0, 'y': 0}),
        ('radius', {'value': 0.1, 'more': 1}),
        ('play', {'grain': 0.5}),
        ('axes', {'x': 'a b', 'y': 'loudness'}),
    ],
)
def test_each_refusal_of_a_control_has_a_code(control, body):
    with pytest.raises(UsageError) as refused:
        CONTROLS[control].read(body, 'test')
    ((code, _),) = parts_of(str(refused.value))
    assert f'said_{code}' in WORDS['zh-Hant']


@pytest.mark.parametrize('line', ['Mon-Sun 10:00-18:00', '2026-12-24 closed', 'Mon-Sun closed'])
@pytest.mark.parametrize('asleep', [False, True])
@pytest.mark.parametrize('hour', [3, 12])
def test_what_the_hours_say_has_a_code(line, asleep, hour):
    zone = datetime.timezone.utc
    door = Door(OpeningHours([line], zone))
    door.look(datetime.datetime(2026, 11, 28, hour, tzinfo=zone).timestamp())
    ((code, places),) = parts_of(door.words(asleep))
    assert f'said_{code}' in WORDS['zh-Hant']
    assert all(isinstance(part, list) for part in places.get('day', []))


def luminance(colour):
    if len(colour) == 4:
        colour = '#' + ''.join(c * 2 for c in colour[1:])
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    parts = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]


def test_contrast_is_at_least_four_and_a_half():
    """WCAG 2.1, 1.4.3, for each colour of words on each ground of the panel."""
    colours = dict(re.findall(r'--(\w+): (#\w{6});', TEXTS['style.css']))
    for ground in (colours['ground'], colours['card'], '#1a2027'):
        for word in ('ink', 'quiet', 'thread', 'move', 'water', 'ok', 'warn', 'error'):
            light, dark = luminance(colours[word]), luminance(ground)
            assert (max(light, dark) + 0.05) / (min(light, dark) + 0.05) >= 4.5, (word, ground)
    assert (luminance('#ffffff') + 0.05) / (luminance('#55595c') + 0.05) >= 4.5  # the stale bar

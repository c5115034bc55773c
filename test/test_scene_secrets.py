# SPDX-License-Identifier: Apache-2.0
"""What is secret in a scene: in no text that is kept or shown, however YAML spells it."""

import json
import re

import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st
from support.bag_samples import T0, TEXT, text

from eol_ros import scene as scenes
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.ros.run_record import about
from eol_ros.scene_secrets import without

HEAD = 'network: lan  # for all\nnodes:\n  panel:\n    host: 0.0.0.0   # open\n    pin: '
TAIL = '\n    # below the secret\n    port: 0\n'
SPELLINGS = {
    'hexadecimal': (r'"\x37\x37even\x20keys"', '77even keys'),
    'unicode': (r'"gr\u00fc\u00dfe\U0001F512"', 'grüße🔒'),
    'quoted hash': ('\'seven # keys "x"\'', 'seven # keys "x"'),
    'tab': (r'"seven\tkeys"', 'seven\tkeys'),
    'continued': ('"seven\\\n      \\ keys\\\n      -long"', 'seven keys-long'),
    'in two lines': ('"seven\n      keys long"', 'seven keys long'),
    'plain in two lines': ('seven\n      keys long', 'seven keys long'),
    'folded': ('>-\n      seven\n      keys long', 'seven keys long'),
    'folded, with a comment': ('>-  # the key\n      seven\n      keys', 'seven keys'),
    'anchored': ('&key "\\x37\\x37even"', '77even'),
}


def loaded(tmp_path, spelling, head=HEAD, tail=TAIL):
    path = tmp_path / 'museum.yaml'
    path.write_text(head + spelling + tail, encoding='utf-8')
    return scenes.load(path)


def scalars(node):
    if isinstance(node, dict):
        return [s for pair in node.items() for part in pair for s in scalars(part)]
    if isinstance(node, list):
        return [s for part in node for s in scalars(part)]
    return [str(node)]


def shows(kept, value, spelling):
    """Return where a secret stands in a text, decoded or as it was spelt."""
    core = spelling.split('\n')[-1].strip().strip('\'"')
    found = [s for s in (value, spelling, spelling[1:-1], core) if len(s) > 3 and s in kept]
    return found + [s for s in scalars(yaml.safe_load(kept)) if value in s]


@pytest.mark.parametrize('name', SPELLINGS)
def test_no_spelling_of_a_pin_stands_in_text_settings_or_bag(tmp_path, name):
    spelling, value = SPELLINGS[name]
    scene = loaded(tmp_path, spelling)
    assert scene.nodes['panel'].pin == value
    kept = scenes.public(scene).text
    assert not shows(kept, value, spelling)
    for line in ('network: lan  # for all', '    host: 0.0.0.0   # open', *TAIL.splitlines()):
        assert f'{line}\n' in kept + '\n'  # comments and layout stay
    assert yaml.safe_load(kept)['nodes']['panel']['pin'] == '***'
    record = about(scene)
    writer = BagWriter(tmp_path / 'bag', [TEXT], record)
    writer.write(TEXT.name, text('x'), T0, T0)
    writer.close()
    metadata = (tmp_path / 'bag' / 'metadata.yaml').read_text('utf-8')
    assert not shows(metadata, value, spelling)
    for words in BagReader(tmp_path / 'bag').about.values():
        assert value not in words and spelling not in words


@pytest.mark.parametrize('name', SPELLINGS)
def test_no_spelling_of_a_pin_stays_in_what_others_print(tmp_path, name):
    """Logs, statuses and crash reports, as a bundle has them."""
    spelling, value = SPELLINGS[name]
    scene = loaded(tmp_path, spelling)
    told = '\n'.join([
        value, spelling, json.dumps(value), json.dumps(value, ensure_ascii=False), repr(value),
        yaml.safe_dump({'pin': value}), yaml.safe_dump({'pin': value}, allow_unicode=True),
    ])  # fmt: skip
    kept = scenes.without_secrets(scene, f'begin\n{told}\nend')
    assert value not in kept and spelling not in kept
    assert json.dumps(value)[1:-1] not in kept and repr(value)[1:-1] not in kept
    assert kept.startswith('begin\n') and kept.endswith('\nend')


def test_secrets_of_included_files_and_of_comments_are_hidden(tmp_path):
    (tmp_path / 'site.yaml').write_text(
        'nodes:\n  projectors: {addresses: [10.0.0.5], password: "j\\x75mping"}  # old\n'
        "  panel: {pin: 'over''ridden'}  # pin: yester-day\n"
    )
    scene = loaded(tmp_path, '"ne\\x77est" # was pin = "f\\x6frmer"', tail='\ninclude: site.yaml\n')
    assert scene.nodes['projectors'].password == 'jumping'
    kept = scenes.public(scene).text
    secret = ('jumping', r'j\x75mping', "over'ridden", "over''ridden", 'yester-day', 'newest')
    assert not [s for s in (*secret, r'ne\x77est', 'former', r'f\x6frmer') if s in kept]
    assert 'addresses: [10.0.0.5]' in kept and '# old' in kept


def test_a_secret_that_stands_elsewhere_in_another_spelling_is_hidden(tmp_path):
    scene = loaded(tmp_path, 'seven-keys', head=f'scene: "s\\x65ven-keys"\n{HEAD}')
    assert r's\x65ven' not in scenes.public(scene).text


def test_a_mistake_shows_no_secret_and_says_what_to_hide(tmp_path):
    with pytest.raises(scenes.SceneError) as error:
        loaded(tmp_path, '["s\\x65ven keys", {a: other-keys}]')
    assert 'panel.pin: *** is not text' in str(error.value)
    told = 'seven keys, other-keys, ' + r's\x65ven keys'
    assert without(told, error.value.scene.hidden) == '***, ***, ***'


def escaped(value):
    """Return spellings of `value` in YAML: quoted, escaped, folded, and as a program writes it."""
    one = "'" + value.replace("'", "''") + "'"
    two = json.dumps(value, ensure_ascii=False)
    codes = '"' + ''.join(f'\\u{ord(c):04x}' for c in value) + '"'
    some = '"' + ''.join(c if c.isalpha() else f'\\x{ord(c):02x}' for c in value) + '"'
    folded = '>-\n      ' + re.sub(r'(?<=\S) (?=\S)', '\n      ', value)
    literal = f'|-\n      {value}'
    return [value, one, two, json.dumps(value), codes, some, folded, literal, f'!!str {one}']


@given(st.data())
def test_any_secret_in_any_spelling_is_hidden(tmp_path_factory, data):
    value = data.draw(st.text('aZ7 \'"#äß\\:,{-', min_size=8, max_size=24))
    spelling = data.draw(st.sampled_from(escaped(value)))
    assume(len(set(value)) > 4)
    try:
        scene = loaded(tmp_path_factory.getbasetemp(), spelling)
    except scenes.SceneError:
        assume(False)
    assume(scene.nodes['panel'].pin == value)
    kept = scenes.public(scene).text
    assert not shows(kept, value, spelling), (value, spelling, kept)
    assert yaml.safe_load(kept)['nodes']['panel'] == {'host': '0.0.0.0', 'pin': '***', 'port': 0}
    assert '# below the secret' in kept and '# open' in kept

# SPDX-License-Identifier: Apache-2.0
"""What nodes say, with the codes by which pages say it in other languages."""

import copy
import json
import pickle
import re

import pytest

from eol_ros.devices.board.fake import TABLE
from eol_ros.said import Said, clauses, code_and_args, from_message, parts_of, said, translated


def test_it_is_its_english_text_for_whoever_needs_no_other():
    text = said('pairs', count=24)
    assert text == '24 pairs' and json.dumps({'text': text}) == '{"text": "24 pairs"}'
    assert parts_of(text) == [['pairs', {'count': '24'}]]
    assert parts_of('plain') == ['plain']
    assert parts_of(copy.deepcopy(text)) == parts_of(pickle.loads(pickle.dumps(text)))


def test_clauses_keep_their_codes():
    whole = clauses(['', said('muted'), 'no corpus', clauses([said('too_slow'), ''])])
    assert isinstance(whole, Said) and whole == 'muted; no corpus; disk or processor too slow'
    assert parts_of(whole) == [['muted', {}], 'no corpus', ['too_slow', {}]]
    assert clauses([]) == ''


def test_what_fills_a_place_keeps_its_code():
    text = said('lost', why=said('muted'))
    assert text == 'lost: muted'
    assert parts_of(text) == [['lost', {'why': [['muted', {}]]}]]


@pytest.mark.parametrize(
    'text',
    [
        said('nothing_of', what=said('images'), seconds=5),
        said('nothing_of', what=said('blocks_data'), seconds=5),
        said('no_image_from', name='video0', span=said('half_second')),
        said('no_image_from', name='video0', span=said('image_times', count=30)),
        said('block_mute', part=said('one_block', number=3)),
        said('board', path=TABLE, name='twin', count=25),
        said('is_not_there', what=said('serial_port'), wanted='/dev/ttyUSB0'),
    ],
)
def test_chinese_text_is_spaced_only_around_numbers(text):
    chinese = translated(text, 'zh-Hant')
    assert not re.search('[\u3000-\u9fff\uff00-\uffef] +[\u3000-\u9fff\uff00-\uffef]', chinese)
    assert not re.search('[\u4e00-\u9fff][0-9a-z/]|[0-9a-z][\u4e00-\u9fff]', chinese)


@pytest.mark.parametrize(
    'text',
    [
        '',
        'plain; text',
        said('pairs', count=24),
        clauses([said('lost', why=said('no_board', why=said('muted'))), said('pairs', count=1)]),
        clauses(['plain', said('lost', why=clauses([said('muted'), 'more'])), 'end']),
        said('lost', why=clauses(['plain', said('pairs', count=2)])),
    ],
)
def test_a_message_carries_text_and_codes(text):
    found = from_message(str(text), *code_and_args(text))
    assert found == text and found.parts == parts_of(text)


def test_arguments_that_nobody_should_send_do_no_harm():
    args = {'why:' * 9999: 'lost', 'why': 1, 'why:': 'muted', '9' * 9999: 'plain', ':': '', '': ()}
    assert from_message('text', 'lost', args).parts[0][0] == 'lost'

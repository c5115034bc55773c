# SPDX-License-Identifier: Apache-2.0
"""What nodes say, with the codes by which pages say it in other languages."""

import copy
import json
import pickle

import pytest

from eol_ros.said import Said, clauses, code_and_args, from_message, parts_of, said


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

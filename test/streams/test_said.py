# SPDX-License-Identifier: Apache-2.0
"""What nodes say, with the codes by which pages say it in other languages."""

import copy
import json
import pickle

from eol_ros.streams.said import Said, clauses, parts_of, said


def test_it_is_its_english_text_for_whoever_needs_no_other():
    text = said('pairs', '{count} pairs', count=24)
    assert text == '24 pairs' and json.dumps({'text': text}) == '{"text": "24 pairs"}'
    assert parts_of(text) == [['pairs', {'count': '24'}]]
    assert parts_of('plain') == ['plain']
    assert parts_of(copy.deepcopy(text)) == parts_of(pickle.loads(pickle.dumps(text)))


def test_clauses_keep_their_codes():
    whole = clauses(['', said('muted', 'muted'), 'no corpus', clauses([said('full', 'full'), ''])])
    assert isinstance(whole, Said) and whole == 'muted; no corpus; full'
    assert parts_of(whole) == [['muted', {}], 'no corpus', ['full', {}]]
    assert clauses([]) == ''


def test_what_fills_a_place_keeps_its_code():
    text = said('twin', 'hands: {hands}', hands=said('hands_nobody', 'nobody'))
    assert text == 'hands: nobody'
    assert parts_of(text) == [['twin', {'hands': [['hands_nobody', {}]]}]]

# SPDX-License-Identifier: Apache-2.0
"""The check of prose finds long texts where they are, and nothing in code or tables."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / 'tools'))
import check_words


def sentence(words):
    return 'Word' + ' word' * (words - 1) + '.'


@pytest.mark.parametrize(
    ('text', 'line', 'fault'),
    [
        (f'# Title\n\n{sentence(36)}', 3, 'sentence of 36 words'),
        (f'First.\n\nSecond. {sentence(36)}', 3, 'sentence of 36 words'),
        (f'- one\n- two {sentence(36)}', 2, 'sentence of 37 words'),
        (f'| a | b |\n| --- | --- |\n| short | {sentence(36)} |', 3, 'sentence of 36 words'),
        (f'{sentence(20)}\n' * 7, 1, 'paragraph of 140 words'),
        ('The node\nis told of it.', 1, "'is told'"),
        ('## Limits\n\nText.\n\n## limits', 5, 'heading twice: limits'),
    ],
)
def test_a_fault_is_found_at_its_line(text, line, fault):
    [(number, found)] = check_words.prose_faults(text)

    assert number == line and found.startswith(fault)


@pytest.mark.parametrize(
    'text',
    [
        sentence(35),
        f'{sentence(30)} {sentence(30)} `Code.` {sentence(30)}',
        f'```\n{sentence(99)} is told\n```',
        f'    {sentence(99)}',
        f'| {sentence(30)} | {sentence(30)} |\n| {sentence(30)} | {sentence(30)} |\n' * 2,
        f'- {sentence(30)}\n- {sentence(30)}\n' * 3,
        f'[{sentence(34)}](a/page.md#with-a-long-title) `{sentence(40)}`',
        f'<!-- {sentence(99)} -->',
        f'{sentence(20)}\n\n' * 9,
    ],
)
def test_what_is_short_or_no_prose_passes(text):
    assert check_words.prose_faults(text) == []

# SPDX-License-Identifier: Apache-2.0
"""Inputs that no verb expects: each ends in one line, in bounded time and memory.

The tables are generated: every option that takes a number meets hostile numbers.
"""

import argparse
import importlib

import pytest

from eol_ros import cli

NUMBERS = ['nan', 'inf', '-inf', '1e400', '-1e300', '', '1,5', '0x10', '9' * 400]


def options():
    """Yield (words before it, option, count of values) for each option that takes a number."""
    for verb in cli.VERBS:
        parser = cli.Parser(prog=verb)
        importlib.import_module(f'eol_ros.verbs.{verb}').add_arguments(parser)
        yield from _options([verb], parser)


def _options(words, parser):
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                yield from _options([*words, name], sub)
        elif action.type and action.option_strings:
            yield words, action.option_strings[-1], action.nargs or 1


OPTIONS = [(w, o, n if isinstance(n, int) else 1) for w, o, n in options()]


@pytest.mark.parametrize(
    ('words', 'option', 'count'), OPTIONS, ids=[' '.join([*w, o]) for w, o, _ in OPTIONS]
)
def test_every_number_of_a_command_line_has_a_range(words, option, count, capsys):
    for number in NUMBERS:
        assert cli.main([*words, f'{option}={number}', *[number] * (count - 1)]) == 2, number
        error = capsys.readouterr().err
        assert error.count('\n') == 1 and option in error and len(error) < 2500

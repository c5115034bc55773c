# SPDX-License-Identifier: Apache-2.0
"""Seeds drawn at the run stand beside those that were looked at, and are told."""

import json

from benchmarks import held_out

NOW_NS = 1_800_000_123_456_789_000


def told(seeds_from_time, as_json, capsys):
    asked = []

    def one(first):
        asked.append(first)
        return {'figure': 2 * first}

    held_out.measure(
        seeds_from_time, 41, one, as_json, lambda found: f'figure {found["figure"]}', lambda: NOW_NS
    )
    return asked, capsys.readouterr()


def test_without_the_option_nothing_is_drawn(capsys):
    asked, (out, err) = told(False, True, capsys)
    assert asked == [41]
    assert json.loads(out)['figure'] == 82
    assert not err


def test_a_block_drawn_from_the_time_stands_beside_the_other(capsys):
    drawn = NOW_NS // 10**6 % 10**9
    asked, (out, err) = told(True, False, capsys)
    assert asked == [41, drawn]
    assert f'from {drawn} on' in err
    lines = out.splitlines()
    first, second = (
        lines.index(f'seeds {name}') for name in ('developed on, from 41', f'drawn, from {drawn}')
    )
    assert lines[first + 1] == 'figure 82'
    assert lines[second + 1] == f'figure {2 * drawn}'

# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from eol_ros import cli


@pytest.mark.slow
def test_each_way_sends_to_all(capsys):
    assert cli.main(['bench', 'web_frames', '--viewers', '2', '--seconds', '0.2', '--json']) == 0
    ways = json.loads(capsys.readouterr().out)['ways']
    assert [way['way'] for way in ways] == ['hub', 'aiohttp', 'aiohttp, in a row']
    assert all(way['percent_of_a_core'] > 0 for way in ways)

# SPDX-License-Identifier: Apache-2.0
"""The log of triggers: what it has, and what becomes of sound where it cannot be written."""

import pytest

from eol_ros.devices.files.trigger_log import TriggerLog
from eol_ros.errors import ConfigError


def test_rows_are_in_the_file_at_once(tmp_path):
    log = TriggerLog(tmp_path / 'log.csv')
    log.write(1, 100, 3, 7, 109, 110, 0.25)
    _, row = log.path.read_text().splitlines()
    assert row == '1,100,3,7,109,110,0.25'
    log.close()
    assert log.trouble == ''


def test_a_file_that_cannot_be_made_is_one_line(tmp_path):
    path = tmp_path / 'missing' / 'log.csv'
    with pytest.raises(ConfigError) as caught:
        TriggerLog(path)
    assert f'trigger_log: {path}: No such file or directory; give a file' in str(caught.value)


def test_a_full_disk_ends_the_log_and_nothing_else():
    log = TriggerLog('/dev/full')
    log.write(1, 100, 3, 7, 109, 110, 0.25)
    log.close()
    assert log.trouble == 'trigger_log ends: /dev/full: No space left on device'

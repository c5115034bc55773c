# SPDX-License-Identifier: Apache-2.0
"""Logs on a disk that is full or may not be written: the run goes on, and says so."""

import pytest

from eol_ros.bringup.event_log import EventLog


def folder_of_a_file(path):
    path.write_text('')
    return path / 'state'


def log_that_is_a_folder(path):
    (path / 'eol.log').mkdir(parents=True)
    return path


@pytest.mark.parametrize('make', [folder_of_a_file, log_that_is_a_folder])
def test_where_no_log_can_be_opened_lines_go_to_the_terminal(tmp_path, make):
    said, where = [], make(tmp_path / 'here')
    with EventLog(where, said.append) as events:
        assert events.trouble.startswith(f'{where}: ') and 'set EOL_STATE' in events.trouble
        events.line('twin: printed')
        events.line('twin: for people', shown=True)
        events.entry('noted')
    assert said == ['twin: printed']


def test_a_full_disk_loses_lines_counts_them_and_prints_no_traceback(tmp_path, capfd):
    said = []
    for name in ('eol.log', 'events.log'):
        (tmp_path / name).symlink_to('/dev/full')
    with EventLog(tmp_path, said.append) as events:
        for k in range(3):
            events.line(f'line {k}')
        events.entry('noted')
        [handler] = events._log.handlers
        assert handler.lost == 4
        (tmp_path / 'eol.log').unlink()  # there is room again
        events.line('line 4')
        events.line('line 5')
    told = capfd.readouterr()
    assert told.err == told.out == '' and not said
    lines = [line.split(' ', 2)[2] for line in (tmp_path / 'eol.log').read_text().splitlines()]
    assert lines == ['line 4', '(4 lines could not be written)', 'line 5']

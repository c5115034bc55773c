# SPDX-License-Identifier: Apache-2.0
"""Long work says what it is before anybody wonders."""

import time

from eol_ros.verbs import progress


def test_work_without_a_share_says_what_it_is(monkeypatch, capsys):
    monkeypatch.setattr(progress, 'SILENT_S', 0.01)
    with progress.Progress('reading') as shown:
        shown._timer.join(5.0)
    assert capsys.readouterr().err == 'reading ...\n'


def test_work_that_is_done_or_tells_its_share_says_no_more(monkeypatch, capsys):
    monkeypatch.setattr(progress, 'SILENT_S', 0.05)
    with progress.Progress('reading'):
        pass
    with progress.Progress('writing', quiet_s=0.0) as shown:
        shown(0.5)
        time.sleep(0.1)
    assert capsys.readouterr().err == 'writing: 50 %\n'


def test_of_two_the_inner_one_speaks(monkeypatch, capsys):
    monkeypatch.setattr(progress, 'SILENT_S', 0.05)
    with progress.Progress('checking') as outer:
        with progress.Progress('reading') as inner:
            inner._timer.join(5.0)
        outer._timer.join(5.0)
    assert capsys.readouterr().err == 'reading ...\nchecking ...\n'

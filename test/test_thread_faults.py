# SPDX-License-Identifier: Apache-2.0
"""A thread that ends by an exception: one line and an exit code for its process."""

import re
import threading

import pytest

from eol_ros import thread_faults
from eol_ros.errors import DeviceMissing, EolError


@pytest.fixture
def hook():
    before, ended = threading.excepthook, []
    thread_faults.install('above', lambda: ended.append(threading.current_thread().name))
    yield ended
    thread_faults.install()
    threading.excepthook = before


def run(work):
    thread = threading.Thread(target=work, name='worker')
    thread.start()
    thread.join()


def test_the_line_names_the_thread_the_exception_and_the_place(hook, capfd):
    thread_faults.check()
    run(lambda: {}['two\nlines'])
    with pytest.raises(EolError) as raised:
        thread_faults.check()
    file = 'test_thread_faults.py'
    line = rf"thread worker failed with KeyError: 'two\nlines' ({file}:NN); its traceback is above"
    assert re.sub(r':\d+\)', ':NN)', str(raised.value)) == line and raised.value.exit_code == 1
    assert hook == ['worker']
    assert 'Traceback' in capfd.readouterr().err


def test_an_expected_error_keeps_its_words_and_its_exit_code(hook):
    def fail():
        raise DeviceMissing('no such camera')

    run(fail)
    run(lambda: 1 / 0)  # the first one counts
    with pytest.raises(DeviceMissing, match='^no such camera$'):
        thread_faults.check()


def test_a_thread_that_ends_as_it_should_is_no_fault(hook):
    def leave():
        raise SystemExit

    run(leave)
    run(lambda: None)
    thread_faults.check()
    assert not hook

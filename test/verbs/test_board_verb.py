# SPDX-License-Identifier: Apache-2.0
import json
import threading

import pytest
from support.fake_board import FakeBoard
from support.waiting import wait_until

from eol_ros import cli
from eol_ros.core import serial_protocol as protocol
from eol_ros.core.clock_sync import HostTime
from eol_ros.devices.board.board import TapReport
from eol_ros.verbs import board

VERSION = '.'.join(map(str, protocol.FIRMWARE))


@pytest.fixture
def fake():
    with FakeBoard() as made:
        yield made


def greeted(fake):
    """Whether the board is ready for knocks: it has been told what its blocks are to be like."""
    return any(arrival.kind == 'Detector' for arrival in fake.log)


def beside(act):
    thread = threading.Thread(target=act)
    thread.start()
    return thread


def test_lists_the_blocks(fake, capsys):
    assert cli.main(['board', '--port', fake.port]) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert len(lines) == 26
    assert lines[7].split() == ['7', '3.90', 'V', '24', 'C', 'firmware', VERSION]
    assert lines[25].split() == ['bridge', '-', '-', 'firmware', VERSION]
    assert 'board fake' in err


def test_says_what_is_wrong(fake, capsys, monkeypatch):
    report = fake.report
    wrong = {3: (3000, protocol.LINKED), 4: (3900, 0), 5: (3900, protocol.LINKED | protocol.ASLEEP)}

    def of(block, *rest):
        report(block, *(wrong.get(block, rest)))

    monkeypatch.setattr(fake, 'report', of)
    assert cli.main(['board', '--port', fake.port, '--json']) == 1
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert len(told['blocks']) == 26
    assert told['blocks'][3]['millivolts'] == 3000
    assert len(told['faults']) == 2  # who sleeps is well
    assert 'the battery of block 3 is at 3.0 V: charge it' in err
    assert 'block 4 does not answer' in err


def test_lets_one_block_flash(fake, capsys):
    lit = []
    fake._on_message = lambda m, _: lit.append(m.mask) if isinstance(m, protocol.Light) else None
    assert cli.main(['board', '--port', fake.port, '--blink', '7', '--seconds', '1.2']) == 0
    assert lit == [1 << 7] * len(lit)
    assert 1 <= len(lit) <= 3  # never more than two a second


@pytest.mark.parametrize('option', ['--blink', '--self-test'])
def test_a_number_that_the_board_lacks_is_one_line(fake, capsys, option):
    assert cli.main(['board', '--port', fake.port, option, '25']) == 2
    assert f'{option} 25: blocks are 0 to 24' in capsys.readouterr().err


def test_names_what_was_knocked_on_and_what_was_not(capsys):
    felt = [TapReport(b, 2.5, HostTime(0.0, 0.0), 0, 0.0011 if b else None) for b in range(24)]
    assert board._knocks(felt, 1e-3, as_json=False, count=25) == 1
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert lines[7].split() == ['block', '7', '2.50', 'm/s^2', 'lit', 'after', '1.1', 'ms']
    assert lines[0].endswith('not lit')
    assert 'no knock from: 24' in err


def test_ends_when_all_were_knocked_on(fake, capsys):
    def knock():
        wait_until(lambda: greeted(fake))
        for block in range(25):
            fake.knock(block, 2.5, lit_s=0.0011)

    thread = beside(knock)
    assert cli.main(['board', '--port', fake.port, '--knocks', '--seconds', '3600', '--json']) == 0
    thread.join()
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {row['block'] for row in rows} == set(range(25))
    assert rows[0]['lit_s'] == pytest.approx(1.1e-3)


def test_blocks_test_themselves(fake, capsys, monkeypatch):
    monkeypatch.setattr(board, 'TESTED_S', 0.2)
    fake.self_tests = {3: (protocol.ANSWERS, 20, 400, 400, 0, 0, 3290), 5: None, 6: (0,) * 7}
    assert cli.main(['board', '--port', fake.port, '--self-test']) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 26
    assert [n for n, line in enumerate(lines[:-1]) if not line.endswith('all well')] == [3, 5, 6]
    assert lines[-1].startswith('poor: repair these blocks') and 'failed: 3, 5, 6;' in lines[-1]
    assert 'moves by 20 mg along x' in lines[3]
    assert 'white LED does not conduct' in lines[3]
    assert 'infrared LED does not conduct' in lines[3]
    assert 'no answer' in lines[5]
    assert 'accelerometer does not answer' in lines[6]
    assert cli.main(['board', '--port', fake.port, '--self-test', '7', '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told['block'], told['z_mg'], told['faults']) == (7, 400, [])


def test_old_firmware_is_named(fake, capsys):
    fake.firmware = (2, 0)
    assert cli.main(['board', '--port', fake.port]) == 1
    assert f'firmware of block 0 is 2.0, and {VERSION} is needed' in capsys.readouterr().err


@pytest.mark.parametrize(
    'words, code, said',
    [
        (['--blink', '225'], 2, '--blink: 225 is outside 0 to 224'),
        (['--blink', '3', '--knocks'], 2, 'not several'),
        (['--self-test', '225'], 2, 'blocks are 0 to 224'),
        (['--self-test', 'x'], 2, 'blocks are 0 to 224'),
        (['--seconds', '0'], 2, '0 is outside 0.01 to 3600'),
        (['--port', '/dev/nothing'], 69, '/dev/nothing'),
    ],
)
def test_bad_words_are_one_line(words, code, said, capsys):
    assert cli.main(['board', *words]) == code
    err = capsys.readouterr().err
    assert said in err
    assert 'Traceback' not in err
    assert len(err.splitlines()) == 1

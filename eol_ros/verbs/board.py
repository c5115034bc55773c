# SPDX-License-Identifier: Apache-2.0
"""eol board: how the blocks are, which is which, whether their parts work, and their firmware.

The leds node must not have the port.
"""

import dataclasses
import json
import sys
import time
from collections.abc import Sequence

from eol_ros.cli import within
from eol_ros.core.serial_protocol import MOST_BLOCKS
from eol_ros.core.verdict import Verdict
from eol_ros.errors import DeviceMissing, UsageError

HELP = 'List the blocks with battery and firmware; find and test them.'
EXAMPLES = [
    'eol board',
    'eol board --port /dev/serial/by-id/usb-bridge --json',
    'eol board --blink 7',
    'eol board --knocks --seconds 120',
    'eol board --self-test',
    'eol board --self-test 7',
]
TOLD_S = 5.0  # at most, until all statuses are there
BLINK_S = 0.5  # from flash to flash
TESTED_S = 10.0  # a block that sleeps looks for words every 4 s


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--port', default='auto', help='serial port, as in leds.port of a scene')
    parser.add_argument(
        '--blink',
        type=within(0, MOST_BLOCKS - 1, int),
        metavar='BLOCK',
        help='flash this block, to see where it is',
    )
    parser.add_argument(
        '--knocks', action='store_true',
        help='print the taps that accelerometers report: knock on a block to find and test it',
    )  # fmt: skip
    parser.add_argument(
        '--self-test',
        nargs='?',
        const='all',
        metavar='BLOCK',
        help='let one block, or all, test their LEDs and their accelerometer',
    )
    parser.add_argument(
        '--seconds',
        type=within(0.01, 3600),
        help='duration of --blink (default: 5) or --knocks (default: 60)',
    )
    parser.add_argument('--json', action='store_true', help='print JSON')


def run(args) -> int:
    """Print; 1 where something is wrong with a block."""
    from eol_ros.core.serial_protocol import BY_ITSELF, LIMITED, Detector, Lighting
    from eol_ros.devices.board.board import Board

    if (args.blink is not None) + args.knocks + (args.self_test is not None) > 1:
        raise UsageError('give one of --blink, --knocks and --self-test, not several')
    tested = None if args.self_test in (None, 'all') else _number(args.self_test)
    seconds = args.seconds or (60.0 if args.knocks else 5.0)
    taps: list = []
    board = Board(args.port, taps.append)
    board.configure(Lighting(BY_ITSELF | LIMITED, 255, 350), Detector())
    board.start()
    try:
        _wait(board)
        for option, number in (('--blink', args.blink), ('--self-test', tested)):
            if number is not None and number >= board.count:
                raise UsageError(f'{option} {number}: {_known(board.count)}')
        if args.blink is not None:
            _blink(board, args.blink, seconds)
            return 0
        if args.knocks:
            return _knocks(taps, seconds, args.json, board.count)
        blocks = _blocks(board)
        if args.self_test:
            numbers = range(board.count) if tested is None else [tested]
            return _self_test(board, blocks, numbers, args.json)
    finally:
        board.close()
    return _list(blocks, args.json)


def _wait(board) -> None:
    """Wait for the bridge; DeviceMissing where it is not there."""
    while not board.ready:
        if board.state.text.count('trying again'):
            raise DeviceMissing(board.state.text.rpartition(';')[0])
        time.sleep(0.01)
    print(board.state.text, file=sys.stderr)


def _blocks(board) -> dict:
    """Wait for what the bridge tells of the blocks; return it by block."""
    end = time.monotonic() + TOLD_S
    while len(board.blocks) <= board.count and time.monotonic() < end:
        time.sleep(0.01)
    return dict(sorted(board.blocks.items()))


def _list(blocks: dict, as_json: bool) -> int:
    from eol_ros.devices.board.lights import faults

    wrong = faults(blocks)
    if as_json:
        rows = [dataclasses.asdict(block) for block in blocks.values()]
        print(json.dumps({'blocks': rows, 'faults': wrong}))
    else:
        for block in blocks.values():
            print(_line(block))
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0


def _number(text: str) -> int:
    if not text.isdecimal() or int(text) >= MOST_BLOCKS:
        raise UsageError(f'--self-test {text}: {_known(MOST_BLOCKS)}')
    return int(text)


def _known(count: int) -> str:
    return f'blocks are 0 to {count - 1}'


def _self_test(board, blocks, tested: Sequence[int], as_json: bool) -> int:
    from eol_ros.core.serial_protocol import LINKED
    from eol_ros.devices.board.self_test import faults

    poor: list[int] = []
    for number in tested:
        status, found, wrong = blocks.get(number), None, []
        if status is None or not status.flags & LINKED:
            wrong = ['it is not heard: look at its battery, and at the radio']
        else:
            board.self_test(number)
            end = time.monotonic() + TESTED_S
            while (found := board.tests.get(number)) is None and time.monotonic() < end:
                time.sleep(0.01)
            wrong = faults(found) if found else [f'no answer within {TESTED_S:g} s']
        if as_json:
            row = {'block': number, **(dataclasses.asdict(found) if found else {}), 'faults': wrong}
            print(json.dumps(row), flush=True)
        else:
            print(f'block {number:2}  {"; ".join(wrong) or _measured(found)}', flush=True)
        poor += [number] if wrong else []
    if not as_json:
        verdict = Verdict('good', f'{len(tested)} of {len(tested)} blocks passed, none may fail')
        if poor:
            named = f'of {len(tested)} tested, failed: {", ".join(map(str, poor))}; none may fail'
            verdict = Verdict('poor', named, 'repair these blocks as their lines say')
        print(verdict)
    return 1 if poor else 0


def _measured(test) -> str:
    pulled = ', '.join(f'{abs(v)}' for v in (test.x_mg, test.y_mg, test.z_mg))
    return (
        f'accelerometer {pulled} mg, white {test.white_off_mv / 1000:.2f} and '
        f'{test.white_on_mv / 1000:.2f} V, infrared {test.infrared_mv / 1000:.2f} V: all well'
    )


def _line(block) -> str:
    from eol_ros.core.serial_protocol import ASLEEP, BRIDGE, LINKED

    name = 'bridge' if block.block == BRIDGE else f'{block.block:6}'
    if not block.flags & LINKED:
        return f'{name}  not heard'
    battery = f'{block.millivolts / 1000:5.2f} V' if block.millivolts else '      -'
    asleep = '  asleep' if block.flags & ASLEEP else ''
    temperature = f'{block.celsius:4} C' if block.block != BRIDGE else '     -'
    return f'{name}{battery:>9}{temperature}  firmware {block.major}.{block.minor}{asleep}'


def _blink(board, block: int, seconds: float) -> None:
    print(f'block {block} flashes for {seconds:g} s', file=sys.stderr)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        board.light(1 << block, 0)
        time.sleep(BLINK_S)


def _knocks(taps: list, seconds: float, as_json: bool, count: int) -> int:
    print('knock on each block', file=sys.stderr)
    missing = set(range(count))
    end = time.monotonic() + seconds
    while True:
        while taps:
            tap = taps.pop(0)
            missing.discard(tap.block)
            if as_json:
                row = {'block': tap.block, 'strength': tap.strength, 'lit_s': tap.lit_s}
                print(json.dumps(row), flush=True)
            else:
                lit = f'lit after {tap.lit_s * 1e3:.1f} ms' if tap.lit_s is not None else 'not lit'
                print(f'block {tap.block:2}  {tap.strength:6.2f} m/s^2  {lit}', flush=True)
        if not missing or time.monotonic() > end:
            break
        time.sleep(0.01)
    if missing:
        print(f'no knock from: {", ".join(map(str, sorted(missing)))}', file=sys.stderr)
    return 1 if missing else 0

# SPDX-License-Identifier: Apache-2.0
"""eol board: how the blocks are, and which block is which. The leds node must not have the port."""

import dataclasses
import json
import sys
import time

from eol_ros.errors import DeviceMissing, UsageError

HELP = 'List the blocks with battery, temperature and firmware; find them by blinks and knocks.'
EXAMPLES = [
    'eol board',
    'eol board --port /dev/serial/by-id/usb-bridge --json',
    'eol board --blink 7',
    'eol board --knocks --seconds 120',
]
TOLD_S = 5.0  # at most, until all statuses are there
BLINK_S = 0.5  # from flash to flash


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--port', default='auto', help='serial port, as leds.port of a scene')
    parser.add_argument(
        '--blink', type=int, metavar='BLOCK', help='let one flash, to see where it is'
    )
    parser.add_argument(
        '--knocks', action='store_true',
        help='print what blocks feel: knock on each, to see which it is and that it works',
    )  # fmt: skip
    parser.add_argument(
        '--seconds', type=float, help='of blinks (default: 5) or knocks (default: 60)'
    )
    parser.add_argument('--json', action='store_true', help='for programs')


def run(args) -> int:
    """Print; 1 where something is wrong with a block."""
    from eol_ros.core.geometry import N_BLOCKS
    from eol_ros.core.serial_protocol import BY_ITSELF, LIMITED, Detector, Lighting
    from eol_ros.devices.board.board import Board
    from eol_ros.devices.board.lights import faults

    if args.blink is not None and not 0 <= args.blink < N_BLOCKS:
        raise UsageError(f'--blink {args.blink}: blocks are 0 to {N_BLOCKS - 1}')
    if args.blink is not None and args.knocks:
        raise UsageError('give --blink or --knocks, not both')
    seconds = args.seconds if args.seconds is not None else 60.0 if args.knocks else 5.0
    if not 0 < seconds <= 3600:
        raise UsageError(f'--seconds {seconds:g}: give 0 to 3600')
    taps: list = []
    board = Board(args.port, taps.append)
    board.configure(Lighting(BY_ITSELF | LIMITED, 255, 350), Detector())
    board.start()
    try:
        while not board.ready:
            if board.state.text.count('trying again'):
                raise DeviceMissing(board.state.text.rpartition(';')[0])
            time.sleep(0.01)
        print(board.state.text, file=sys.stderr)
        if args.blink is not None:
            _blink(board, args.blink, seconds)
            return 0
        if args.knocks:
            return _knocks(taps, seconds, args.json)
        if board.version == 1:
            print('its protocol version 1 tells nothing of single blocks', file=sys.stderr)
        end = time.monotonic() + TOLD_S
        while len(board.blocks) <= N_BLOCKS and board.version > 1 and time.monotonic() < end:
            time.sleep(0.01)
        blocks = dict(sorted(board.blocks.items()))
    finally:
        board.close()
    wrong = faults(blocks)
    if args.json:
        rows = [dataclasses.asdict(block) for block in blocks.values()]
        print(json.dumps({'blocks': rows, 'faults': wrong}))
    else:
        for block in blocks.values():
            print(_line(block))
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0


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
        if board.version == 1:
            board.flash(block, 255, 300)
        else:
            board.light(1 << block, 0)
        time.sleep(BLINK_S)


def _knocks(taps: list, seconds: float, as_json: bool) -> int:
    from eol_ros.core.geometry import N_BLOCKS

    print('knock on each block', file=sys.stderr)
    missing = set(range(N_BLOCKS))
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

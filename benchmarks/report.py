# SPDX-License-Identifier: Apache-2.0
"""`eol bench report`: how long a day of exhibition takes to report, and in how much memory.

The day is made here: the sample bag's minute again and again, every stamp in it moved by whole
seconds, so that something slips all day long. Each command runs in a process of its own, with one
thread.
"""

import argparse
from pathlib import Path

from eol_ros import parent_death
from eol_ros.errors import UsageError

HELP = 'Report a day of exhibition made of the sample bag: seconds and memory.'
EXAMPLES = [
    'eol bench report --hours 1',
    'eol bench report --hours 10 --whole --json',
    'eol bench report --bags 200 --keep exhibition',
]
SAMPLE = 'bags/sample'
BAGS_A_DAY, BETWEEN_S = 40, 840  # from the start of one to the start of the next: 9.3 h a day


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--hours', type=float, default=10.0, metavar='H', help='of the day (10)')
    parser.add_argument('--bags', type=int, metavar='N', help='N bags of a minute for the one day')
    parser.add_argument('--keep', metavar='DIR', help='leave bags and report there (a new folder)')
    parser.add_argument('--whole', action='store_true', help='also the report of the one bag')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Make the day, report it, print."""
    import contextlib
    import tempfile

    from benchmarks.machine import tell

    if not args.hours > 0:
        raise UsageError('--hours: more than 0')
    if args.bags is not None and (args.bags < 1 or args.whole):
        raise UsageError('--bags: one or more, without --whole')
    with contextlib.ExitStack() as stack:
        if args.keep:
            folder = Path(args.keep)
            if folder.exists():
                raise UsageError(f'{folder}: is there already')
        else:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        if args.bags:
            made = _days(folder, args.bags)
        else:
            made = _day(folder / 'day', args.hours)
        rows = [_measured('exhibition (--all)', [str(folder), '--all'], folder)]
        if args.whole:
            rows.append(_measured('one bag', [str(folder / 'day')], folder))
    tell({**made, 'rows': rows}, args.json, _table)
    return 0


def _days(folder: Path, bags: int) -> dict:
    """Write bags of a minute each, BETWEEN_S apart; return what they hold together."""
    total: dict = {'bags': bags}
    for number in range(bags):
        day, of_day = divmod(number, BAGS_A_DAY)
        later_s = day * 86400 + of_day * BETWEEN_S
        for key, value in _day(folder / f'run_{number:04}', 1 / 60, later_s).items():
            total[key] = total.get(key, 0) + value
    return total


def _day(folder: Path, hours: float, later_s: int = 0) -> dict:
    """Write the sample over and over, later_s later; return the hours, messages and bytes."""
    import struct

    from eol_ros.devices.bag.reader import BagReader
    from eol_ros.devices.bag.writer import SAMPLE as NO_SAMPLE
    from eol_ros.devices.bag.writer import BagWriter
    from eol_ros.verbs.progress import track

    root = Path(__file__).parents[1]
    sample = BagReader(root / SAMPLE)
    first_s, last_s = sample.start_ns // 10**9 - 5, sample.end_ns // 10**9 + 5
    whole_s = -(-(sample.end_ns - sample.start_ns) // 10**9)
    messages = []
    for m in sample.messages():
        words = len(m.data) // 4  # CDR aligns a stamp's seconds to four bytes
        seconds = struct.unpack_from(f'<{words}I', m.data)
        places = [4 * k for k, s in enumerate(seconds) if first_s <= s <= last_s and k]
        messages.append((m, places, [seconds[p // 4] for p in places]))
    about = {name: text for name, text in sample.about.items() if name != NO_SAMPLE}
    bag = BagWriter(folder, list(sample.topics.values()), about)
    rounds = max(1, round(3600 * hours / whole_s))
    for turn in track(range(rounds), 'making the day'):
        more_s = later_s + turn * whole_s
        for m, places, seconds in messages:
            data = bytearray(m.data)
            for place, value in zip(places, seconds, strict=True):
                struct.pack_into('<I', data, place, value + more_s)
            log_ns, publish_ns = m.log_ns + more_s * 10**9, m.publish_ns + more_s * 10**9
            bag.write(m.topic, bytes(data), log_ns, publish_ns)
    bag.close()
    size = sum(p.stat().st_size for p in folder.iterdir())
    return {'hours': rounds * whole_s / 3600, 'messages': rounds * len(messages), 'bytes': size}


def _measured(name: str, words: list[str], folder: Path) -> dict:
    import os
    import subprocess
    import sys
    import time

    environment = os.environ | {
        name: '1' for name in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'NUMBA_NUM_THREADS')
    }
    command = [
        sys.executable,
        '-m',
        'eol_ros',
        'report',
        *words,
        '--output',
        f'{folder}/out',
        '--json',
    ]
    begin_s = time.perf_counter()
    with subprocess.Popen(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        preexec_fn=parent_death.following(),
    ) as process:
        assert process.stdout is not None
        process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return {
        'report': name, 'exit': process.returncode, 'seconds': time.perf_counter() - begin_s,
        'processor_s': used.ru_utime + used.ru_stime, 'peak_MB': used.ru_maxrss / 1e3,
    }  # fmt: skip


def _table(result: dict) -> str:
    size = result['bytes'] / 1e6
    lines = [f'{result["hours"]:.2f} hours, {result["messages"]} messages, {size:.0f} MB']
    for row in result['rows']:
        failed = f', exit {row["exit"]}' if row['exit'] else ''
        lines.append(
            f'{row["report"]:20} {row["seconds"]:7.1f} s ({row["processor_s"]:.1f} s of '
            f'processor), {row["peak_MB"]:.0f} MB{failed}'
        )
    return '\n'.join(lines)

# SPDX-License-Identifier: Apache-2.0
"""eol bench sound: voices per core, error against run time, and real time, beside other engines.

Then the sound in a running graph: from a slip's true onset to its first sample.
"""

import argparse
import itertools
import sys
import tempfile
from pathlib import Path

from eol_ros.errors import UsageError

HELP = 'Voices per core, beside other engines; error; underruns; from a slip to its sound.'
EXAMPLES = [
    'eol bench sound --json',
    'eol bench sound --parts engine,peers --grains 400 --peer scsynth --seconds 3',
    'eol bench sound --parts live --seconds 600',
    'eol bench sound --parts rehearsal --seconds 60',
    'eol bench sound --parts engine,peers --plot docs/img',
]
PARTS = ('engine', 'peers', 'live', 'rehearsal')
BLOCKS = (64, 128, 256, 512)
PEER_BLOCKS = (64, 256)
OVERLAPS = (100, 400)
ERROR_S = 2.0  # of the score that errors are measured on: the reference is slow


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        '--parts', type=_parts, default=PARTS, metavar='NAMES',
        help=f'some of {",".join(PARTS)} (default: all)',
    )  # fmt: skip
    parser.add_argument(
        '--grains', type=_grains, default=OVERLAPS, metavar='NUMBERS',
        help=f'that sound at once, some of {",".join(map(str, OVERLAPS))} (default: all)',
    )  # fmt: skip
    parser.add_argument('--peer', default='', metavar='TEXT', help='only those with it in the name')
    parser.add_argument('--repeats', type=int, default=3, help='the best of so many is taken')
    parser.add_argument('--seconds', type=float, default=10.0, help='of a score or a live run')
    parser.add_argument('--plot', metavar='DIR', help='draw sound_speed.png and sound_error.png')
    parser.add_argument('--json', action='store_true', help='figures on stdout, for a program')


def run(args) -> int:
    """Measure and tell."""
    from benchmarks.machine import tell
    from benchmarks.sound_engine import source

    if args.plot and not {'engine', 'peers'} <= set(args.parts):
        raise UsageError('--plot draws engine and peers: measure both')
    if args.plot and (args.peer or args.grains != OVERLAPS):
        raise UsageError('--plot draws all peers and numbers of grains: leave out --peer, --grains')
    result: dict = {'seconds': args.seconds}
    sound = source()
    if 'engine' in args.parts:
        result['engine'] = _engine(sound, args.seconds, args.grains, args.repeats)
        result['blocks_identical'] = _identical(sound)
    if 'peers' in args.parts:
        result['peers'] = _peers(sound, args.seconds, args.grains, args.repeats, args.peer)
        result['ratios'] = _ratios(result)
    for part in ('live', 'rehearsal'):
        if part in args.parts:
            result[part] = list(_running(part, args.seconds))
    if args.plot:
        from benchmarks.sound_plot import draw

        draw(result, Path(args.plot))
    tell(result, args.json, _lines)
    return 0


def _parts(text: str) -> tuple[str, ...]:
    names = tuple(text.split(','))
    for name in names:
        if name not in PARTS:
            raise argparse.ArgumentTypeError(f'{name!r} is none of {", ".join(PARTS)}')
    return names


def _grains(text: str) -> tuple[int, ...]:
    for number in text.split(','):
        if number not in map(str, OVERLAPS):
            names = ', '.join(map(str, OVERLAPS))
            raise argparse.ArgumentTypeError(f'{number!r} is none of {names}')
    return tuple(map(int, text.split(',')))


def _running(part: str, seconds: float):
    from benchmarks import sound_live, sound_rehearsal

    measure, cases = {
        'live': (lambda case: {**case, **sound_live.measure(case, seconds)}, sound_live.CASES),
        'rehearsal': (lambda case: sound_rehearsal.measure(seconds, case), ('jack', 'wav')),
    }[part]
    for case in cases:
        print(f'{part}: {case}', file=sys.stderr)
        yield measure(case)


def _lines(result: dict) -> str:
    found = _engines(result)
    for name, ratio in result.get('ratios', {}).items():
        found.append(f'{name:60}{ratio:6.2f} x')
    if 'blocks_identical' in result:
        found.append(f'the same bits at any block size: {result["blocks_identical"]}')
    for part, tell_row in (('live', _live), ('rehearsal', _rehearsal)):
        for row in result.get(part, ()):
            words, text = tell_row(row)
            found.append(f'{words}: {row["skipped"] if "skipped" in row else text()}')
    return '\n'.join(found)


def _engines(result: dict) -> list[str]:
    rows = []
    for r in result.get('engine', ()):
        name = f'{"cubic" if r["cubic"] else "linear"}, speed {"0.5-2" if r["varied"] else "1"}'
        rows.append((f'mixer {name}', r, f'{r["error_db"]:10.1f}'))
    skipped = []
    for r in result.get('peers', ()):
        if 'skipped' in r:
            skipped.append(f'{r["name"]:28}{r["skipped"]}')
            continue
        name = f'{r["name"]}, {"0.5-2" if r["varied"] else "1"}'
        error = '   another' if r['error_db'] is None else f'{r["error_db"]:10.1f}'
        rows.append((name, r, error))
    if not rows:
        return skipped
    head = f'{"":28}{"grains":>8}{"block":>7}{"voices/core":>13}{"ns":>7}{"error dB":>10}'
    return [
        head,
        *(
            f'{name:28}{r["overlap"]:8}{r["block"]:7}{r["voices_per_core"]:13.0f}'
            f'{r["ns_per_voice_sample"]:7.2f}{error}'
            for name, r, error in rows
        ),
        *skipped,
    ]


def _live(r: dict):
    how = 'compiled' if r['compiled'] else 'python'
    words = f'real time, {how}, block {r["block"]}, {r["overlap"]} grains, busy {r["busy"]}'
    return (
        words,
        lambda: (
            f'{r["underruns"]} underruns in {r["seconds"]:.0f} s, '
            f'{r["unexplained_underruns"]} of them while the machine ran '
            f'(it stood still {r["machine_stalls"]} times, at most '
            f'{r["machine_stall_worst_ms"]:.1f} ms), {r["frames_per_second"]:.0f}/s, '
            f'load p99 {r["load_p99"]:.2f} worst {r["load_worst"]:.2f}, '
            f'stamp to sample sd {r["stamp_to_sample_sd"]:.2f} '
            f'worst {r["stamp_to_sample_worst"]:.1f} samples'
        ),
    )


def _rehearsal(r: dict):
    def text() -> str:
        ms, onset, trigger = r['latency_ms'], r['onset_to_stamp_ms'], r['stamp_to_trigger_ms']
        seen = r['seen_after_reckoning_ms']
        return (
            f'onset to first sample p50 {ms["p50"]:.1f}, p99 {ms["p99"]:.1f}, '
            f'most {ms["most"]:.1f} ms; {r["slips"]} slips, {100 * r["sounded"]:.1f} % sounded; '
            + ''.join(
                f'{sense} {one["count"]}: p50 {one["p50"]:.1f}, p99 {one["p99"]:.1f} ms; '
                for sense in ('felt', 'seen')
                if (one := r.get(f'{sense}_ms'))
            )
            + (
                f'{one["count"]} felt whose grains might sound: p99 {one["p99"]:.1f} ms; '
                if (one := r.get('felt_not_barred_ms'))
                else ''
            )
            + ''.join(
                f'knock to {topic} p50 {knock["p50"]:.1f}, p99 {knock["p99"]:.1f}, most '
                f'{knock["most"]:.1f} ms; '
                for topic, knock in r['knock_to_ms'].items()
            )
            + ', '.join(f'{r["motion"].get(k, 0)} {k}' for k in ('felt', 'confirmed', 'retracted'))
            + '; '
            f'onset to stamp p99 {onset["p99"]:.1f} ms, stamp to trigger p99 {trigger["p99"]:.1f} '
            f'ms, late {r["late"]} of {r["taken"]} ({r["late_before"]} of them while all was '
            f'starting), {r["underruns"]} underruns, card '
            f'{r["output_ms"]:.1f} ms more; the processors were {r["idle_percent"]:.0f} % idle, '
            f'{r["stolen_percent"]:.1f} % were withheld by the host'
            + (
                f'; {r["seen_alone"]} seen alone, off by {seen["least"]:.2f} to {seen["most"]:.2f} '
                'ms'
                if seen
                else ''
            )
            + ''.join(f'\n  {line}' for line in r['restarts'])
        )

    return f'rehearsal, {r["device"]}', text


def _engine(sound, seconds: float, overlaps: tuple[int, ...], repeats: int) -> list[dict]:
    from benchmarks.sound_engine import FS, error_db, make_score, ours, speed, truth

    rows = []
    for varied in (False, True):
        for cubic in (True, False):
            short = make_score(100, ERROR_S, varied)
            frames = int((ERROR_S + 0.3) * FS)
            wanted = truth(sound, short, cubic, frames)
            best = truth(sound, short, True, frames)
            made = ours(sound, short, cubic, frames, 256)
            errors = {
                'error_db': -error_db(made, wanted),  # against the same reading in float64
                'error_to_cubic_db': -error_db(made, best),
            }
            for overlap in overlaps:
                score = make_score(overlap, seconds, varied)
                for block in BLOCKS:
                    print(f'mixer: {overlap} grains, block {block}', file=sys.stderr)
                    case = {'overlap': overlap, 'block': block, 'cubic': cubic, 'varied': varied}
                    rows.append({**case, **errors, **speed(sound, score, block, cubic, repeats)})
    return rows


def _peers(
    sound, seconds: float, overlaps: tuple[int, ...], repeats: int, wanted: str
) -> list[dict]:
    import soundfile

    from benchmarks.sound_engine import FS, error_db, make_score, truth
    from benchmarks.sound_peers import PEERS

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        soundfile.write(Path(folder) / 'source.wav', sound, FS, subtype='FLOAT')
        for name, (play, exact, cubic, there) in PEERS.items():
            if wanted not in name:
                continue
            if not there():
                rows.append({'name': name, 'skipped': 'not installed'})
                continue
            for varied in (False, True) if exact else (False,):
                error = None
                if exact:
                    short = make_score(100, ERROR_S, varied)
                    frames = int((ERROR_S + 0.3) * FS)
                    made = play(Path(folder), short, 64)[1][:frames, :2]
                    error = -error_db(made, truth(sound, short, cubic, frames, False), 70)
                for overlap, block in itertools.product(overlaps, PEER_BLOCKS):
                    print(f'{name}: {overlap} grains, block {block}', file=sys.stderr)
                    score = make_score(overlap, seconds, varied)
                    spent = min(play(Path(folder), score, block)[0] for _ in range(repeats))
                    rows.append(
                        {
                            'name': name, 'overlap': overlap, 'block': block, 'varied': varied,
                            'cubic': cubic, 'same_score': exact, 'error_db': error,
                            'voices_per_core': score.grain_seconds / spent,
                            'ns_per_voice_sample': spent / (score.grain_seconds * FS) * 1e9,
                        }
                    )  # fmt: skip
    return rows


def _ratios(result) -> dict[str, float]:
    """Return ours at block 256 over theirs, 400 grains, the same speed of reading."""
    ratios = {}
    for peer in result['peers']:
        if peer.get('overlap') != 400 or 'engine' not in result:
            continue
        for mine in result['engine']:
            if (mine['overlap'], mine['block'], mine['varied']) == (400, 256, peer['varied']):
                cubic = 'cubic' if mine['cubic'] else 'linear'
                speed = 'speed 0.5-2' if mine['varied'] else 'speed 1'
                name = f'{cubic} / {peer["name"]} of block {peer["block"]}, {speed}'
                ratios[name] = mine['voices_per_core'] / peer['voices_per_core']
    return ratios


def _identical(sound) -> bool:
    import numpy as np

    from benchmarks.sound_engine import FS, make_score, ours

    score = make_score(100, 1.0, True)
    outs = [ours(sound, score, True, FS, block) for block in (1, 64, 100, 256, 512, 4096)]
    return all(np.array_equal(out, outs[0]) for out in outs[1:])

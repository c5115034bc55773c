# SPDX-License-Identifier: Apache-2.0
"""eol bench sound: voices per core, error against run time, and real time, beside other engines."""

import itertools
import json
import sys
import tempfile
from pathlib import Path

HELP = 'Voices per core of the mixer and of scsynth, csound, pyo; error; underruns in real time.'
EXAMPLES = ['eol bench sound --json', 'eol bench sound --live 600 --plot docs/img']
BLOCKS = (64, 128, 256, 512)
PEER_BLOCKS = (64, 256)
OVERLAPS = (100, 400)
ERROR_S = 2.0  # of the score that errors are measured on: the reference is slow


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=10.0, help='length of the scores')
    parser.add_argument('--live', type=float, default=6.0, help='seconds a real-time case; 0: none')
    parser.add_argument('--no-peers', action='store_true', help='only our own engine')
    parser.add_argument('--plot', metavar='DIR', help='draw sound_speed.png and sound_error.png')
    parser.add_argument('--json', action='store_true', help='figures on stdout, for a program')


def run(args) -> int:
    """Measure and tell."""
    from eol_ros.bench import sound_live
    from eol_ros.bench.sound_engine import source

    sound = source()
    result = {'seconds': args.seconds, 'engine': _engine(sound, args.seconds), 'peers': []}
    if not args.no_peers:
        result['peers'] = _peers(sound, args.seconds)
    result['ratios'] = _ratios(result)
    result['blocks_identical'] = _identical(sound)
    result['live'] = []
    if args.live > 0:
        for case in sound_live.CASES:
            print(f'real time: {case}', file=sys.stderr)
            result['live'].append({**case, **sound_live.measure(case, args.live)})
    if args.plot:
        from eol_ros.bench.sound_plot import draw

        draw(result, Path(args.plot))
    print(json.dumps(result)) if args.json else _tell(result)
    return 0


def _engine(sound, seconds: float) -> list[dict]:
    from eol_ros.bench.sound_engine import FS, error_db, make_score, ours, speed, truth

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
            for overlap in OVERLAPS:
                score = make_score(overlap, seconds, varied)
                for block in BLOCKS:
                    print(f'mixer: {overlap} grains, block {block}', file=sys.stderr)
                    case = {'overlap': overlap, 'block': block, 'cubic': cubic, 'varied': varied}
                    rows.append({**case, **errors, **speed(sound, score, block, cubic)})
    return rows


def _peers(sound, seconds: float) -> list[dict]:
    import soundfile

    from eol_ros.bench.sound_engine import FS, error_db, make_score, truth
    from eol_ros.bench.sound_peers import PEERS

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        soundfile.write(Path(folder) / 'source.wav', sound, FS, subtype='FLOAT')
        for name, (play, exact, cubic, there) in PEERS.items():
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
                for overlap, block in itertools.product(OVERLAPS, PEER_BLOCKS):
                    print(f'{name}: {overlap} grains, block {block}', file=sys.stderr)
                    score = make_score(overlap, seconds, varied)
                    spent = min(play(Path(folder), score, block)[0] for _ in range(2))
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
        if peer.get('overlap') != 400:
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

    from eol_ros.bench.sound_engine import FS, make_score, ours

    score = make_score(100, 1.0, True)
    outs = [ours(sound, score, True, FS, block) for block in (1, 64, 100, 256, 512, 4096)]
    return all(np.array_equal(out, outs[0]) for out in outs[1:])


def _tell(result) -> None:
    print(f'{"":28}{"grains":>8}{"block":>7}{"voices/core":>13}{"ns":>7}{"error dB":>10}')
    for r in result['engine']:
        name = f'{"cubic" if r["cubic"] else "linear"}, speed {"0.5-2" if r["varied"] else "1"}'
        print(
            f'mixer {name:22}{r["overlap"]:8}{r["block"]:7}{r["voices_per_core"]:13.0f}'
            f'{r["ns_per_voice_sample"]:7.2f}{r["error_db"]:10.1f}'
        )
    for r in result['peers']:
        if 'skipped' in r:
            print(f'{r["name"]:28}{r["skipped"]}')
            continue
        name = f'{r["name"]}, {"0.5-2" if r["varied"] else "1"}'
        error = f'{r["error_db"]:10.1f}' if r['error_db'] is not None else '   another'
        print(
            f'{name:28}{r["overlap"]:8}{r["block"]:7}{r["voices_per_core"]:13.0f}'
            f'{r["ns_per_voice_sample"]:7.2f}{error}'
        )
    for name, ratio in result['ratios'].items():
        print(f'{name:60}{ratio:6.2f} x')
    print(f'the same bits at any block size: {result["blocks_identical"]}')
    for r in result['live']:
        how = 'compiled' if r['compiled'] else 'python'
        words = f'real time, {how}, block {r["block"]}, {r["overlap"]} grains, busy {r["busy"]}'
        if 'skipped' in r:
            print(f'{words}: {r["skipped"]}')
            continue
        print(
            f'{words}: {r["underruns"]} underruns in {r["seconds"]:.0f} s, '
            f'{r["frames_per_second"]:.0f}/s, load p99 {r["load_p99"]:.2f}, '
            f'stamp to sample sd {r["stamp_to_sample_sd"]:.2f} '
            f'worst {r["stamp_to_sample_worst"]:.1f} samples'
        )

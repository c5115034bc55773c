# SPDX-License-Identifier: Apache-2.0
"""eol measure: what a table of one's own is like, and its values into a scene, whose twin it is."""

import json
import math
import sys
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eol_ros.errors import DeviceMissing, UsageError
from eol_ros.verbs import reach

HELP = (
    'Measure the stiffness of the springs of your own table with its camera, and write it into\n'
    'a scene, whose twin then is that table; docs/measure.md says what to prepare.'
)
EXAMPLES = [
    'eol measure springs my/rehearsal.yaml --weights 300,600,900,1200,900,600,300',
    'eol measure springs --weights 300,600,900,600,300 --bag bags/2026-11-22 --picture fit.png',
]
SILENT_S = 5.0  # without a message: the graph does not run
HINT_S = 40.0  # after which who waits is told why


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('what', choices=['springs'], help='what to measure')
    parser.add_argument(
        'scene', nargs='?', metavar='SCENE',
        help='a scene file with a twin, into which the values go; its comments stay',
    )  # fmt: skip
    parser.add_argument(
        '--bag', metavar='BAG', help='a recording of it, in place of the running graph'
    )
    parser.add_argument(
        '--weights', metavar='G,G,...',
        help='springs: grams that hang on the thread, one after the other, up and down again',
    )  # fmt: skip
    parser.add_argument(
        '--block', type=int, default=14, metavar='ID',
        help='springs: the block that is pulled, at the rim (default: 14, the middle of the right)',
    )  # fmt: skip
    parser.add_argument(
        '--natural', type=float, metavar='MM',
        help='length of a spring that nothing pulls, by a ruler (default: as in the scene)',
    )  # fmt: skip
    parser.add_argument('--picture', metavar='P.png', help='figure of the fit; .svg and .pdf, too')
    parser.add_argument('--json', action='store_true', help='figures on stdout, for a program')
    reach.add_arguments(parser)


def run(args) -> int:
    """Guide, compute, tell, and write."""
    from eol_ros import scene_text
    from eol_ros.settings import TwinSettings

    twin = TwinSettings()
    if args.scene:
        twin = scene_text.to_write(Path(args.scene), 'twin').nodes['twin']
    values, about, picture = _springs(args, twin)
    if args.json:
        print(json.dumps(about))
    if args.picture:
        from eol_ros.analysis import measured

        measured.save(args.picture, picture)
    if args.scene:
        scene_text.write(Path(args.scene), 'twin', values)
        said = ', '.join(f'{name} {scene_text.plain(value)}' for name, value in values.items())
        _say(f'written into {args.scene}, twin: {said}')
    return 0


def _springs(args, twin) -> tuple[dict[str, float], dict[str, Any], Any]:
    from eol_ros.core.measure import springs

    weights = _weights(args.weights)
    natural_m = _natural(args, twin)
    if not 0 <= args.block < 25:
        raise UsageError(f'--block {args.block}: blocks are 0 to 24')
    out = springs.outwards(args.block)
    side = {(1, 0): 'right', (-1, 0): 'left', (0, 1): 'back', (0, -1): 'front'}[tuple(out)]
    rests = springs.Rests(args.block)
    if not args.bag:
        _say(
            f'Hold the rim in its place. Block {args.block} rolls, and a thread leads from it over'
            f' the {side} edge of the table. Nothing hangs there yet: hands off.'
        )
    asked_s, hinted = math.nan, False
    for stamp_s, places, seen in _images(args):
        asked_s = stamp_s if math.isnan(asked_s) else asked_s
        rest = rests.add(stamp_s, places, seen)
        if rest:
            _tell_rest(args, rests.found, weights, out)
            asked_s, hinted = stamp_s, False
            if len(rests.found) > len(weights) and not args.bag:
                break
        elif stamp_s - asked_s > HINT_S and not hinted and not args.bag:
            hinted = True
            _say(
                f'block {args.block} is not seen whole' if not seen[args.block]
                else f'block {args.block} has not come to rest elsewhere: hang more, and let go'
            )  # fmt: skip
    found = springs.fit(rests.found, weights, args.block, natural_m)
    value, error = _rounded(found.stiffness)
    values = {'stiffness': value, 'stiffness_error': error}
    if args.natural is not None:
        values['spring_natural_m'] = natural_m
    about = values | {
        **_intervals('stiffness', found.stiffness),
        'friction_n': found.friction_n,
        'rests': [
            {'weight_n': w, 'reach_m': r, 'missed_n': m}
            for w, r, m in zip(found.pull, found.reach, found.missed, strict=True)
        ],
    }
    if not args.json:
        print(f'stiffness {_words(found.stiffness, "N/m")}')
    rms = math.sqrt(float(found.missed @ found.missed) / len(found.missed))
    _say(
        f'the block was held by {abs(found.friction_n):.2f} N, and the fit leaves over {rms:.2f} N'
        f' of up to {found.pull.max():.1f} N'
    )
    return values, about, found


def _tell_rest(args, rests, weights, out) -> None:
    moved = 0.0
    if len(rests) > 1:
        block = args.block
        moved = float((rests[-1].places - rests[-2].places)[block, :2] @ out)
    hung = len(rests) - 1
    before = f'at rest, {1e3 * moved:+.2f} mm. ' if hung else 'at rest. '
    if hung > len(weights):
        _say(f'{before}That is one rest more than there are weights')
    elif args.bag:
        _say(f'{before}{"before the weights" if not hung else f"{1e3 * weights[hung - 1]:g} g"}')
    elif hung < len(weights):
        _say(
            f'{before}Weight {hung + 1} of {len(weights)}: let {1e3 * weights[hung]:g} g hang in'
            ' all, lower it by hand, and wait'
        )
    else:
        _say(f'{before}That was the last')


def _weights(text: str | None) -> list[float]:
    """Return kg."""
    if not text:
        raise UsageError('springs: say --weights, such as --weights 300,600,900,1200,900,600,300')
    try:
        grams = [float(part) for part in text.split(',')]
    except ValueError:
        raise UsageError(f'--weights {text}: not grams parted by commas') from None
    wrong = [gram for gram in grams if not 0 <= gram <= 10_000]
    if wrong:
        raise UsageError(f'--weights: {wrong[0]:g} g is not 0 to 10000')
    return [1e-3 * gram for gram in grams]


def _natural(args, twin) -> float:
    """Return m."""
    if args.natural is None:
        return float(twin.spring_natural_m)
    if not 10 <= args.natural <= 88:
        raise UsageError(f'--natural {args.natural:g}: a length in mm, 10 to 88')
    return round(1e-3 * args.natural, 6)


def _images(args) -> Iterator[tuple[float, Any, Any]]:
    """Yield stamp, s, places (25, 3) m, m, rad, and who was seen (25,), recorded or live."""
    import numpy as np

    for blocks in _recorded(args.bag) if args.bag else _live(args):
        rows = blocks.rows
        yield blocks.stamp_s, np.column_stack([rows['x'], rows['y'], rows['yaw']]), blocks.known


def _recorded(path: str) -> Iterator[Any]:
    from eol_ros.analysis.bag import open_bag
    from eol_ros.streams import blocks

    bag = open_bag(path)
    for line in bag.cut_short:
        _say(line)
    return blocks.each(bag.table('blocks'))


def _live(args) -> Iterator[Any]:
    from eol_ros.ros.definitions import definition
    from eol_ros.ros.echo import listen
    from eol_ros.ros.session import session
    from eol_ros.streams import blocks
    from eol_ros.streams.graph import full_name

    network, namespace = reach.of(args)
    codec = blocks.Codec(definition(blocks.TYPE))
    waiting: deque[bytes] = deque()
    topic = full_name('blocks', namespace)
    with session(reach=network, namespace=namespace) as visit:
        listen(visit.node, topic, lambda raw: waiting.append(bytes(raw)), raw=True)
        while visit.run(lambda: bool(waiting), SILENT_S):
            while waiting:
                yield codec.read(waiting.popleft())
        if visit.stopped:
            raise KeyboardInterrupt
    raise DeviceMissing(
        f'{topic}: no message for {SILENT_S:g} s: start the graph with its camera, or name a --bag'
    )


def _rounded(estimate) -> tuple[float, float]:
    """Return value and error, to two digits of the error."""
    digits = 1 - math.floor(math.log10(max(estimate.sigma, 1e-9)))
    return round(estimate.value, digits), round(estimate.sigma, digits)


def _words(estimate, unit: str = '') -> str:
    value, error = _rounded(estimate)
    low, high = estimate.interval(0.95)
    unit = f' {unit}' if unit else ''
    return f'{value:g} +- {error:g}{unit}; 95 %: {low:.4g} to {high:.4g}{unit}'


def _intervals(name: str, estimate) -> dict[str, tuple[float, float]]:
    return {f'{name}_{level}': estimate.interval(0.01 * level) for level in (68, 95)}


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)

# SPDX-License-Identifier: Apache-2.0
"""eol measure: what a table of one's own is like, and its values into a scene, whose twin it is."""

import json
import math
import sys
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eol_ros.cli import within
from eol_ros.core.table import Table, check_same
from eol_ros.core.verdict import Verdict, judged, worst
from eol_ros.errors import ConfigError, DeviceMissing, EolError, UsageError
from eol_ros.verbs import reach

HELP = (
    'Measure springs and friction of your table with its camera, and write them into the scene of\n'
    'its twin. docs/guides/measure.md says what to prepare.'
)
EXAMPLES = [
    'eol measure springs my/rehearsal.yaml --weights 300,600,900,1200,900,600,300',
    'eol measure springs --weights 300,600,900,600,300 --bag bags/2026-11-22',
    'eol measure friction my/rehearsal.yaml --mass 251',
    'eol measure friction --stiffness 81.3 --bag bags/2026-11-22',
]
SILENT_S = 5.0  # without a message: the graph does not run
HINT_S = 40.0  # after which who waits is told why
TELL_S = 5.0  # from line to line of progress
ENOUGH = 8  # slips of each inner block: more make nothing better, for blocks differ
SCALE_KG = 6e-4  # of a kitchen scale that shows grams
# Of a hundred twins, error in the median and at most (docs/guides/measure.md): good and usable.
SPRINGS_PERCENT, FRICTION_PERCENT = (0.7, 3.8), (3.2, 9.7)


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('what', choices=['springs', 'friction'], help='what to measure')
    parser.add_argument(
        'scene', nargs='?', metavar='SCENE',
        help='scene file with a twin to write the values into; its comments stay',
    )  # fmt: skip
    parser.add_argument(
        '--bag', metavar='BAG', help='bag to measure, in place of the running graph'
    )
    parser.add_argument(
        '--weights', metavar='G,G,...',
        help='springs: weights in grams, hung on the thread one after the other, up and down again',
    )  # fmt: skip
    parser.add_argument(
        '--block', type=within(0, 224, int), metavar='ID',
        help='springs: block at the rim that the thread pulls (default: middle of the right side)',
    )  # fmt: skip
    parser.add_argument(
        '--natural', type=within(1, 1000), metavar='MM',
        help='length of a free spring, by a ruler (default: as in the scene)',
    )  # fmt: skip
    parser.add_argument(
        '--mass', type=within(50, 2000), metavar='G',
        help='friction: mass of a block with its cover in grams (default: as in the scene)',
    )  # fmt: skip
    parser.add_argument(
        '--stiffness', type=within(5, 2000), metavar='N/M',
        help='friction: stiffness of a spring, taken as exact (default: as in the scene, with its '
            'error)',
    )  # fmt: skip
    parser.add_argument(
        '--seconds', type=within(5, 3600), default=90.0, metavar='S',
        help='friction: longest measuring time (default: 90)',
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')
    reach.add_arguments(parser)


def run(args) -> int:
    """Guide, compute, tell, and write."""
    from eol_ros import scene_text
    from eol_ros.settings import TwinSettings

    measure = {'springs': _springs, 'friction': _friction}[args.what]
    settings, scene = TwinSettings(), None
    if args.scene:
        loaded = scene_text.to_write(Path(args.scene), 'twin')
        settings, scene = loaded.nodes['twin'], Table.of(loaded.table)
    args.table = _table(args, scene)
    values, about = measure(args, settings)
    verdict = _verdict(args.what, values)
    print(json.dumps(about | {'verdict': verdict._asdict()}) if args.json else verdict)
    if args.scene:
        scene_text.write(Path(args.scene), 'twin', values)
        said = ', '.join(f'{name} {scene_text.plain(value)}' for name, value in values.items())
        _say(f'written into {args.scene}, twin: {said}')
    return 0


def _table(args, scene: Table | None) -> Table:
    """Return the table of the bag, of the scene or of the running graph."""
    if args.bag is not None:
        from eol_ros.analysis.bag import open_bag
        from eol_ros.analysis.recorded_settings import recorded_table

        found = recorded_table(open_bag(args.bag))
    else:
        found = scene or _told(args)
    _agree(args.bag, found, scene or found)
    return found


def _agree(whose: str, found: Table, wanted: Table) -> None:
    """Raise ConfigError if the blocks of two tables differ in size or position."""
    both = [(t.rows, t.columns, t.block_side_m, t.gaps_m, t.ids.tolist()) for t in (found, wanted)]
    if both[0] != both[1]:
        check_same(found, wanted, whose, 'the scene', 'name the scene that it runs with')


def _verdict(what: str, values: dict[str, float]) -> Verdict:
    """Return whether the errors are as small as those of measured twins."""
    names = ['stiffness'] if what == 'springs' else ['mu_static', 'mu_kinetic']
    limits = SPRINGS_PERCENT if what == 'springs' else FRICTION_PERCENT
    do = 'push evenly and longer, until every inner block has slipped often'
    if what == 'springs':
        do = 'put the block on rollers, and hang more weights, up and down again'
    return worst(
        judged(
            f'error of {name}', 100 * values[f'{name}_error'] / values[name], '%', limits,
            'median and largest error of the measured twins', do,
        )
        for name in names
    )  # fmt: skip


def _springs(args, twin) -> tuple[dict[str, float], dict[str, Any]]:
    from eol_ros.core.measure import springs

    weights = _weights(args.weights)
    natural_m, table = _natural(args, twin), args.table
    if args.block is None:
        args.block = springs.usual(table)
    elif args.block >= table.cells:
        raise UsageError(f'--block: {args.block} is outside 0 to {table.cells - 1}')
    elif not table.present[args.block]:
        raise UsageError(f'--block: no block stands in place {args.block}')
    out = springs.outwards(args.block, table)
    side = {(1, 0): 'right', (-1, 0): 'left', (0, 1): 'back', (0, -1): 'front'}[tuple(out)]
    rests = springs.Rests(args.block, table)
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
    found = springs.fit(rests.found, weights, args.block, natural_m, table)
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
    return values, about


def _friction(args, twin) -> tuple[dict[str, float], dict[str, Any]]:
    import numpy as np

    from eol_ros.core.measure import friction
    from eol_ros.core.physics.builders import GRAVITY

    stiffness, mass, natural_m = _stiffness(args, twin), _mass(args, twin), _natural(args, twin)
    inner = friction.inner(args.table)
    if not args.bag:
        far_cm = 100 * min(0.1, *args.table.reach_m)
        _say(
            f'Push the rim to and fro by hand, {far_cm:.0f} cm each way at some 3 cm/s, evenly,'
            ' until the middle of the table slips.'
        )
    images, told_s = [], math.nan
    for image in _images(args):
        images.append(image)
        stamp_s = image[0]
        told_s = stamp_s if math.isnan(told_s) else told_s
        if args.bag or stamp_s - told_s < TELL_S:
            continue
        told_s = stamp_s
        spent_s = stamp_s - images[0][0]
        track = friction.track_of(images, args.table)
        few, words = _so_far(track, stiffness.value, mass.value, natural_m)
        _say(f'{spent_s:.0f} of {args.seconds:g} s: {words}')
        if few >= ENOUGH or spent_s >= args.seconds:
            break
    if not images:
        raise EolError(f'{args.bag}: no image of the blocks')
    track = friction.track_of(images, args.table)
    slips = friction.find_slips(track, stiffness.value, mass.value, natural_m)
    found = friction.fit(slips, track, stiffness, mass, natural_m)
    values: dict[str, float] = {}
    about: dict[str, Any] = {}
    for name, estimate in (('mu_static', found.static), ('mu_kinetic', found.kinetic)):
        values[name], values[f'{name}_error'] = _rounded(estimate)
        about |= _intervals(name, estimate)
        if not args.json:
            print(f'{name} {_words(estimate)}')
    if args.mass is not None:
        values['block_kg'] = mass.value
    if args.natural is not None:
        values['spring_natural_m'] = natural_m
    each = {
        int(block): None if np.isnan(row[0]) else row.tolist()
        for block, row in zip(inner, found.each, strict=True)
    }
    about |= values | {'slips': len(slips), 'blocks': each}
    known = found.each[np.isfinite(found.each[:, 0])]
    spread = known.std(axis=0, ddof=1) / known.mean(axis=0)
    _say(
        f'{len(slips)} slips of {len(known)} blocks, which differ by {100 * spread[0]:.0f} %'
        ' (standard deviation)'
    )
    break_m = found.static.value * mass.value * GRAVITY / stiffness.value
    _say(
        f'one spring moves a block at {1e3 * break_m:.1f} mm: grains.ambience_break_m {break_m:.4f}'
    )
    about['break_m'] = break_m
    return values, about


def _so_far(track, stiffness: float, mass: float, natural_m: float) -> tuple[int, str]:
    """Return how many slips the inner block with fewest has, and words for that."""
    from collections import Counter

    from eol_ros.core.measure import friction

    try:
        slips = friction.find_slips(track, stiffness, mass, natural_m)
    except EolError as error:
        return 0, str(error)
    counts = Counter(slip.block for slip in slips)
    fewest = min(friction.inner(track.table).tolist(), key=lambda block: counts[block])
    few = counts[fewest]
    return (
        few,
        f'{len(slips)} slips in the middle, fewest of block {fewest}: {few} ({ENOUGH} are enough)',
    )


def _stiffness(args, twin) -> Any:
    from eol_ros.core.measure.estimate import Estimate

    if args.stiffness is not None:
        return Estimate(args.stiffness, 0.0)
    if not twin.stiffness_error:
        raise UsageError(
            'friction needs the stiffness of the springs: measure it before, `eol measure springs'
            ' SCENE`, and name the same scene, or say --stiffness'
        )
    return Estimate(twin.stiffness, twin.stiffness_error)


def _mass(args, twin) -> Any:
    from eol_ros.core.measure.estimate import Estimate

    grams = 1e3 * twin.block_kg if args.mass is None else args.mass
    return Estimate(round(1e-3 * grams, 6), SCALE_KG)


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
        raise UsageError(f'--weights {text}: not weights in grams, separated by commas') from None
    wrong = [gram for gram in grams if not 0 <= gram <= 10_000]
    if wrong:
        raise UsageError(f'--weights: {wrong[0]:g} g is not 0 to 10000')
    return [1e-3 * gram for gram in grams]


def _natural(args, twin) -> float:
    """Return m."""
    if args.natural is None:
        return float(twin.spring_natural_m)
    gap_mm = 1e3 * min(args.table.gaps_m)
    if not gap_mm / 9 <= args.natural <= gap_mm - 2:
        raise UsageError(f'--natural: {args.natural:g} is outside {gap_mm / 9:g} to {gap_mm - 2:g}')
    return round(1e-3 * args.natural, 6)


def _images(args) -> Iterator[tuple[float, Any, Any]]:
    """Yield stamp, s, places (cells, 3) m, m, rad, and who was seen (cells,), recorded or live."""
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
    """Yield the blocks of each image."""
    from eol_ros.ros.definitions import definition
    from eol_ros.ros.echo import listen
    from eol_ros.ros.session import session
    from eol_ros.streams import blocks
    from eol_ros.streams.graph import full_name
    from eol_ros.streams.tables import table as table_of

    network, namespace = reach.running(args)
    codec = blocks.Codec(definition(blocks.TYPE), cells=args.table.cells)
    waiting: deque[bytes] = deque()
    tables: deque[Any] = deque()
    topic = full_name('blocks', namespace)
    with session(reach=network, namespace=namespace) as visit:
        listen(visit.node, topic, lambda raw: waiting.append(bytes(raw)), raw=True)
        listen(visit.node, full_name('table', namespace), tables.append)
        while visit.run(lambda: bool(waiting), SILENT_S):
            while tables:
                _agree(topic, table_of(tables.popleft()), args.table)
            while waiting:
                yield _read(codec, waiting.popleft(), topic, args.table)
        if visit.stopped:
            raise KeyboardInterrupt
    raise _silent(topic)


def _read(codec: Any, raw: bytes, topic: str, table: Table) -> Any:
    try:
        return codec.read(raw)
    except ValueError as error:
        raise ConfigError(
            f'{topic}: {error}. Name the scene that the graph runs with, whose table this is'
        ) from None


def _told(args) -> Table:
    """Return the table that the tracker of the running graph publishes."""
    from eol_ros.ros.echo import listen
    from eol_ros.ros.session import session
    from eol_ros.streams.graph import full_name
    from eol_ros.streams.tables import table as table_of

    network, namespace = reach.running(args)
    topic, found = full_name('table', namespace), deque[Any]()
    with session(reach=network, namespace=namespace) as visit:
        listen(visit.node, topic, found.append)
        if visit.run(lambda: bool(found), SILENT_S):
            return table_of(found[0])
        if visit.stopped:
            raise KeyboardInterrupt
    raise _silent(topic)


def _silent(topic: str) -> DeviceMissing:
    return DeviceMissing(
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

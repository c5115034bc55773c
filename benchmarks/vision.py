# SPDX-License-Identifier: Apache-2.0
"""eol bench vision: error against run time of the tracker and of its peers, on the same images."""

import sys
from pathlib import Path

from benchmarks import held_out
from eol_ros.errors import UsageError

HELP = 'Measure position error and run time, beside tuned peers and the Cramer-Rao bound.'
EXAMPLES = [
    'eol bench vision',
    'eol bench vision --json > vision.json',
    'eol bench vision --levels hard --seconds 60 --no-peers',
    'eol bench vision --plots docs/img',
    'eol bench vision --films relief',
    'eol bench vision --films my_films --images 200 --json',
    'eol bench vision --truth film1 film2',
    'eol bench vision --hard all --seconds 10 --seeds 3',
    'eol bench vision --hard sleeves --seconds 60 --json',
    'eol bench vision --arms all --seconds 20 --seeds 6 --seeds-from-time --json',
]
CLUTTER = ('ordinary', 'hard', 'brutal')


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=4.0, help='duration of each video')
    parser.add_argument('--images', type=int, default=40, help='clean images of each noise level')
    parser.add_argument('--levels', default=','.join(CLUTTER), help='clutter levels, with commas')
    parser.add_argument('--seeds', type=int, default=2, help='videos of each clutter level')
    parser.add_argument('--no-peers', action='store_true', help='leave the peers out')
    parser.add_argument('--no-clean', action='store_true', help='leave the noise levels out')
    parser.add_argument('--plots', metavar='FOLDER', help='draw vision_*.png there')
    parser.add_argument(
        '--films',
        metavar='FOLDER',
        help='only path-traced covers: `relief`, which is shipped, or a folder of `make films`',
    )
    parser.add_argument(
        '--hard',
        metavar='KINDS',
        help='only hard videos, of flat and path-traced covers: `all`, or clutter levels, dropped,'
        ' doubled, exposure, focus and sleeves, with commas; --seconds and --seeds of each',
    )
    parser.add_argument(
        '--arms',
        metavar='KINDS',
        help='only arms that sweep over resting covers, and what motion takes for slips: `all`, or'
        ' none, slow, brisk, rough, bright, dark, sleeves, hard and brutal, with commas; --seconds'
        ' and --seeds of each',
    )
    parser.add_argument(
        '--truth',
        metavar='FOLDER',
        nargs='+',
        help='only films of another renderer: folders with frames.npy, truth.npz and'
        ' calibration.yaml',
    )
    parser.add_argument('--surfaces', default='flat,relief', help='covers of --hard and --arms')
    parser.add_argument(
        '--first-seed', type=int, default=41, help='first of --seeds (--hard, --arms)'
    )
    held_out.add_argument(parser)
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args) -> int:
    """Measure, then print."""
    import cv2
    from support.clutter import LEVELS
    from support.vision_bound import position_bound_px

    from benchmarks.machine import tell
    from benchmarks.vision_scenes import RATE_HZ, run_clean, run_film
    from eol_ros.core.vision.render.renderer import NOISE_LEVELS
    from eol_ros.verbs.progress import track

    cv2.setNumThreads(1)
    if args.plots and (args.seeds_from_time or args.films or args.truth or args.hard or args.arms):
        raise UsageError('--plots draws noise levels and clutter alone')
    if args.films:
        from support.relief.films import FOLDER

        from benchmarks import vision_relief

        folder = FOLDER if args.films == 'relief' else Path(args.films)
        figures = vision_relief.measure(folder, args.images)
        tell(figures, args.json, vision_relief.table)
        return 0
    if args.truth:
        from benchmarks import vision_truth

        tell(vision_truth.measure(args.truth), args.json, vision_truth.table)
        return 0
    if args.hard or args.arms:
        from benchmarks import vision_arms, vision_hard

        videos, option = (vision_hard, '--hard') if args.hard else (vision_arms, '--arms')
        kinds = _named(option, args.hard or args.arms, videos.KINDS)
        surfaces = _named('--surfaces', args.surfaces, vision_hard.SURFACES)

        def hard(first: int) -> dict:
            return videos.measure(kinds, surfaces, args.seconds, args.seeds, first)

        held_out.measure(args.seeds_from_time, args.first_seed, hard, args.json, videos.table)
        return 0
    levels = _named('--levels', args.levels, LEVELS)

    def one(first: int) -> dict:
        result: dict = {'noise': {}, 'clutter': {}}
        if not args.no_clean:
            for noise in track([n for n in NOISE_LEVELS if n != 'none'], 'noise levels'):
                bound = position_bound_px(*NOISE_LEVELS[noise])
                result['noise'][noise] = {
                    'bound_px': bound,
                    'methods': run_clean(noise, args.images, bound, first),
                }
        films = [(level, first + 10 + seed) for level in levels for seed in range(args.seeds)]
        for level, seed in track(films, 'films'):
            result['clutter'].setdefault(level, {})[f'seed {seed}'] = run_film(
                level, 'L2', seed, round(args.seconds * RATE_HZ), not args.no_peers, every=2
            )
        if args.plots:
            from benchmarks.vision_plots import draw

            for path in draw(result, args.plots):
                print(f'drawn {path}', file=sys.stderr)
        return result

    held_out.measure(args.seeds_from_time, 1, one, args.json, _table)
    return 0


def _named(option, given, known) -> list[str]:
    """Return what `given` names, with commas, of those that are `known`; `all` names all."""
    names = list(known) if given == 'all' else [name for name in given.split(',') if name]
    for name in names:
        if name not in known:
            raise UsageError(f'{option} {name}: not one of {", ".join(known)}')
    return names


def _table(result) -> str:
    from benchmarks.vision_scenes import number

    lines = []
    for noise, entry in result['noise'].items():
        lines.append(f'clean, {noise}: bound {entry["bound_px"]:.4f} px')
        for name, f in entry['methods'].items():
            lines.append(
                f'  {name:24s} {number(f["rms_px"], 4)} px'
                f'  {number(f["times_bound"], 2)} x bound  {f["ms_median"]:7.2f} ms'
                f'  coverage {f["coverage"]:.4f}  false {f["false_per_image"]:.2f}'
            )
    for level, films in result['clutter'].items():
        for film, methods in films.items():
            lines.append(f'{level}, {film}')
            for name, f in methods.items():
                lines.append(
                    f'  {name:24s} whole {number(f["rms_px"], 3)} px {number(f["coverage"], 4)}'
                    f'  partly {number(f["rms_partly_px"], 3)} px'
                    f' {number(f["coverage_partly"], 3)} of {f["partly"]}'
                    f'  hidden {f["hidden_reported"]}/{f["hidden"]}'
                    f'  false {f["false_per_image"]:.3f}'
                    f'  {f["ms_median"]:.2f} ms p99 {f["ms_p99"]:.2f}'
                )
    return '\n'.join(lines)

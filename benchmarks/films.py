# SPDX-License-Identifier: Apache-2.0
"""eol bench films: path-traced images of printed covers, with their truth."""

import sys
import time

HELP = 'Path-trace images of printed covers for `eol bench vision --films`; needs Mitsuba 3.'
EXAMPLES = [
    'eol bench films --output films',
    'eol bench films --output films --images 200 --seed 3',
    'eol bench films --small --output test/support/relief/films',
    'eol bench films --turned --output test/support/relief/turned',
    'eol bench films --stirred --output test/support/relief/stirred',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        '-o', '--output', metavar='FOLDER', required=True, help='for images and truth'
    )
    parser.add_argument('--small', action='store_true', help='the set that is shipped')
    parser.add_argument(
        '--turned', action='store_true', help='the set by which names are known again, also shipped'
    )
    parser.add_argument(
        '--stirred', action='store_true', help='the set by which cameras calibrate, also shipped'
    )
    parser.add_argument('--images', type=int, default=40, help='how many')
    parser.add_argument('--seed', type=int, default=1, help='of cameras, poses and brightness')
    parser.add_argument('--strata', type=int, default=8, help='of a pixel each way; squared: rays')
    parser.add_argument('--samples', type=int, default=512, help='paths of a point of a cover')
    parser.add_argument('--threads', type=int, default=1, help='of the path tracer')


def run(args) -> int:
    """Draw the set; images that are there already are drawn again."""
    from support.relief import films, path_tracer

    from eol_ros import folders
    from eol_ros.errors import UsageError
    from eol_ros.verbs.progress import track

    for name, most in (('images', 10000), ('strata', 64), ('samples', 1 << 20), ('threads', 256)):
        if not 1 <= getattr(args, name) <= most:
            raise UsageError(f'--{name} {getattr(args, name)}: 1 to {most}')
    out = folders.made(args.output, '--output')
    path_tracer.mitsuba(args.threads)
    if args.small:
        shots = films.small_set()
    elif args.turned:
        shots = films.turned_set()
    elif args.stirred:
        shots = films.stirred_set()
    else:
        shots = films.large_set(args.images, args.seed)
    began = time.process_time()
    lights: dict = {}
    truth = {}
    for seed, shot in enumerate(track(shots, 'films')):
        key = shot.relief_mm, shot.landscape
        if key not in lights:
            lights[key] = path_tracer.covers_light(shot, args.samples)
        image, low = path_tracer.render(shot, lights[key], args.strata, seed)
        truth[shot.name] = films.save(out, shot, image, low)
    # what is left of the path tracer's noise: one image with another seed
    again, _ = path_tracer.render(shots[0], lights[shots[0].relief_mm, 1], args.strata, 10**6)
    first, _ = path_tracer.render(shots[0], lights[shots[0].relief_mm, 1], args.strata, 0)
    noise = float((again - first).std() / 2**0.5)
    films.save_truth(
        out,
        {
            'strata': args.strata,
            'samples': args.samples,
            'noise_grey': round(noise, 4),
            'films': truth,
        },
    )
    size = sum(file.stat().st_size for file in out.iterdir()) / 1e6
    print(
        f'{len(shots)} images, {size:.1f} MB, in {out}; {args.strata**2} rays a pixel leave '
        f'{noise:.3f} grey levels of noise; {time.process_time() - began:.0f} s of processor time',
        file=sys.stderr,
    )
    return 0

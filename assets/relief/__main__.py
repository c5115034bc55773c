# SPDX-License-Identifier: Apache-2.0
"""Path-traced images of printed covers with their truth, for `eol bench vision --films`.

    make films                                                    40 images, drawn by seed
    python -m assets.relief --output films --images 200 --seed 3
    python -m assets.relief --output test/support/relief/films    the sets that tests see: `films`,
                            --set small                           `turned` and `stirred`

Needs Mitsuba 3.
"""

import argparse
import sys
import time

from assets.relief import path_tracer, shots
from eol_ros import folders
from eol_ros.errors import EolError, UsageError
from eol_ros.verbs.progress import track

SETS = {'small': shots.small_set, 'turned': shots.turned_set, 'stirred': shots.stirred_set}


def parsed() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(description='path-trace images of printed covers')
    parser.add_argument(
        '-o', '--output', metavar='FOLDER', required=True, help='for images and truth'
    )
    parser.add_argument('--set', choices=SETS, help='one of the sets that tests see')
    parser.add_argument('--images', type=int, default=40, help='how many')
    parser.add_argument('--seed', type=int, default=1, help='of cameras, poses and brightness')
    parser.add_argument('--strata', type=int, default=8, help='of a pixel each way; squared: rays')
    parser.add_argument('--samples', type=int, default=512, help='paths of a point of a cover')
    parser.add_argument('--threads', type=int, default=1, help='of the path tracer')
    return parser.parse_args()


def draw(args: argparse.Namespace) -> None:
    """Draw the set; images that are there already are drawn again."""
    for name, most in (('images', 10000), ('strata', 64), ('samples', 1 << 20), ('threads', 256)):
        if not 1 <= getattr(args, name) <= most:
            raise UsageError(f'--{name} {getattr(args, name)}: 1 to {most}')
    out = folders.made(args.output, '--output')
    path_tracer.mitsuba(args.threads)
    drawn = SETS[args.set]() if args.set else shots.large_set(args.images, args.seed)
    began = time.process_time()
    lights: dict = {}
    truth = {}
    for seed, shot in enumerate(track(drawn, 'films')):
        key = shot.relief_mm, shot.landscape
        if key not in lights:
            lights[key] = path_tracer.covers_light(shot, args.samples)
        image, low = path_tracer.render(shot, lights[key], args.strata, seed)
        truth[shot.name] = shots.save(out, shot, image, low)
    # what is left of the path tracer's noise: one image with another seed
    again, _ = path_tracer.render(drawn[0], lights[drawn[0].relief_mm, 1], args.strata, 10**6)
    first, _ = path_tracer.render(drawn[0], lights[drawn[0].relief_mm, 1], args.strata, 0)
    noise = float((again - first).std() / 2**0.5)
    shots.save_truth(
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
        f'{len(drawn)} images, {size:.1f} MB, in {out}; {args.strata**2} rays a pixel leave '
        f'{noise:.3f} grey levels of noise; {time.process_time() - began:.0f} s of processor time',
        file=sys.stderr,
    )


if __name__ == '__main__':
    try:
        draw(parsed())
    except EolError as error:
        sys.exit(f'assets.relief: {error}')

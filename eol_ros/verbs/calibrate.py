# SPDX-License-Identifier: Apache-2.0
"""eol calibrate: from images of the table to the file that turns pixels into metres."""

import datetime
import itertools
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from eol_ros import scene as scenes
from eol_ros.cli import within
from eol_ros.core.table import Table, check_same
from eol_ros.devices.bag.reader import table_in
from eol_ros.errors import ConfigError, EolError, UsageError

HELP = 'Calibrate the camera on the resting blocks, on known points, or on a ChArUco board.'
EXAMPLES = [
    'eol calibrate blocks still.png --output table.yaml',
    'eol calibrate blocks bags/2026-11-21 --lens camera_info.yaml --output table.yaml',
    'eol calibrate points corners.csv --size 1280x800 --output table.yaml',
    'eol calibrate board flat.png held1.png held2.png held3.png held4.png --output table.yaml',
    'eol calibrate blocks still.png --mirror --output table.yaml',
    'eol calibrate points corners.csv --size 1280x800 --covers covers --cover-height 0.013',
    'eol calibrate print board.png --board 9x7',
]
MOST_M = 5.0  # from the middle of the table: a point farther away is in mm or cm
_VIEWS = 8  # images taken out of a long source


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'way',
        choices=['blocks', 'points', 'board', 'print'],
        help='source of the calibration; `print` writes the image of a board (.png) for printing',
    )
    parser.add_argument(
        'sources',
        nargs='+',
        metavar='FILE',
        help='images, a video, a .npy stack, a folder or a bag; for `points` a '
        'CSV of u,v,x,y a line: pixels, then metres (x right, y away)',
    )
    parser.add_argument('-o', '--output', metavar='C.yaml', help='calibration file to write')
    parser.add_argument('--lens', metavar='YAML', help='camera_info file with the lens')
    parser.add_argument(
        '--focal',
        type=within(10, 1e6),
        metavar='PX',
        help='focal length in px, without --lens',
    )
    parser.add_argument(
        '--mirror',
        action='store_true',
        help='the camera sees the table in a mirror: left and right are exchanged',
    )
    parser.add_argument(
        '--cover-height',
        type=within(0, 0.5),
        default=0.0,
        metavar='M',
        help='height of the covers above the platform, in metres',
    )
    parser.add_argument(
        '--covers',
        metavar='FOLDER',
        help='folder with the STL files of `python -m assets.covers`, whose relief shifts the '
        'visible outline of a block',
    )
    parser.add_argument(
        '--cover-gap',
        type=within(0, 0.5),
        default=0.001,
        metavar='M',
        help='height of the lower rims of these covers above the platform, in metres',
    )
    parser.add_argument('--size', metavar='WxH', help='image size, for points without --lens')
    parser.add_argument(
        '--board', default='11x8', metavar='CxR', help='number of squares of the board'
    )
    side = within(1e-3, 2)
    parser.add_argument('--square', type=side, default=0.06, metavar='M', help='side of a square')
    parser.add_argument('--marker', type=side, default=0.045, metavar='M', help='side of a marker')
    parser.add_argument(
        '--dictionary', default='DICT_4X4_100', help='ArUco dictionary of the board'
    )
    parser.add_argument(
        '--at',
        type=within(-MOST_M, MOST_M),
        nargs=2,
        default=(0.0, 0.0),
        metavar=('X', 'Y'),
        help="the board's centre on the table in the first image, in metres",
    )
    parser.add_argument(
        '--scene', metavar='SCENE', help='scene with the table (default: of the bag, or 5 x 5)'
    )
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args) -> int:
    """Solve, tell, and write what is good."""
    from eol_ros.devices.files.calibration_file import LEFT_HANDED

    if args.way == 'print':
        return _print(args)
    args.table = Table.of(scenes.load(args.scene).table) if args.scene else Table()
    if args.way == 'points':
        solution = _points(args)
    else:
        images, about = _images(args.sources)
        if recorded := table_in(about.get('settings', '')):
            wanted = args.table if args.scene else recorded
            check_same(recorded, wanted, args.sources[0], args.scene, 'leave out --scene')
            args.table = Table.of(wanted)
        solution = (_blocks if args.way == 'blocks' else _board)(args, images)
    if solution.calibration.mirrored and not args.mirror:
        raise ConfigError(
            f'{LEFT_HANDED} add --mirror; else y is counted downwards: let it point '
            'away, to the top of the image'
        )
    if args.mirror and not solution.calibration.mirrored:
        raise ConfigError(
            'there is no mirror in these points: leave out --mirror, or exchange left and right'
        )
    done = replace(
        solution.calibration, date=datetime.date.today().isoformat(), covers=_covers(args)
    )
    solution = replace(solution, calibration=done)
    _tell(args, solution)
    if solution.note:
        print(solution.note, file=sys.stderr)
    refusal = solution.refusal()
    if refusal:
        raise ConfigError(f'calibration refused, poor: {refusal}')
    if not args.json:
        print(solution.verdict())
    if args.output:
        from eol_ros.devices.files import calibration_file

        calibration_file.save(args.output, solution.calibration)
        print(f'written to {args.output}', file=sys.stderr)
    return 0


def _blocks(args, images):
    from eol_ros.core.vision.calibration.calibrate import from_images
    from eol_ros.verbs import compile
    from eol_ros.verbs.progress import track

    compile.ensure(['tracker'])
    return from_images(
        track(_usable(images), 'finding blocks'),
        _start(args, images[0].shape),
        args.cover_height,
        _covers(args),
        args.mirror,
        lens=not args.lens,
    )


def _usable(images):
    """Return images (h, w) that differ, and say which ones are saturated or frozen."""
    from eol_ros.core.vision.lens import FULL_SHARE, light

    found: list[np.ndarray] = []
    for image in images:
        if not any(np.array_equal(image, other) for other in found):
            found.append(image)
    if len(found) < len(images):
        print(
            f'{len(images) - len(found)} of {len(images)} images are the same as another to the '
            'last bit and are left out: a frozen camera, or one file named twice',
            file=sys.stderr,
        )
    seen = [light(image) for image in found]
    full = [one.saturated for one in seen if one.saturated > FULL_SHARE and one.level > one.dark]
    if full:
        print(
            f'{len(full)} of {len(found)} images are saturated, up to {max(full):.0%} of what is '
            'bright: blocks look larger than they are, and lengths are wrong; expose less',
            file=sys.stderr,
        )
    return found


def _covers(args):
    """Return the outlines of the covers that `--covers` names, or None."""
    if not args.covers:
        return None
    from eol_ros.core.vision.calibration.covers import CoverOutlines
    from eol_ros.devices.files import stl_file

    files = sorted(Path(args.covers).glob('cover-*.stl'))
    cells = args.table.cells
    if len(files) != cells:
        raise ConfigError(
            f'--covers {args.covers}: has {len(files)} files cover-*.stl, not {cells}; '
            f'`python -m assets.covers --output {args.covers}` in a clone makes them'
        )
    meshes = [stl_file.load(file) for file in files]
    return CoverOutlines.of_meshes(meshes, 1e3 * args.cover_gap, args.table.block_side_m)


def _board(args, images):
    from eol_ros.core.vision.calibration.charuco import from_board

    return from_board(
        images, _board_of(args), args.cover_height, args.focal, args.mirror, args.table
    )


def _board_of(args):
    from eol_ros.core.vision.calibration.charuco import Board

    columns, rows = _pair(args.board, '--board')
    return Board(columns, rows, args.square, args.marker, args.dictionary, *args.at)


def _print(args) -> int:
    from eol_ros.devices.files import picture_file

    path = Path(args.sources[0])
    if path.suffix.lower() != '.png':
        raise UsageError(f'{path}: a board is written as .png')
    picture_file.save(path, _board_of(args).picture())
    print(
        'print it, measure a square and a marker, and give both to `eol calibrate board` in metres '
        'as --square and --marker',
        file=sys.stderr,
    )
    return 0


def _points(args):
    from eol_ros.core.vision.calibration.calibrate import from_points, platform_corners
    from eol_ros.devices.files import text_table

    if not args.lens and not args.size:
        raise UsageError('points need the image size: --size 1280x800 or --lens camera_info.yaml')
    start = _start(args, _pair(args.size, '--size')[::-1] if args.size else None)
    width, height = start.image_width, start.image_height
    metres = -MOST_M, MOST_M, ': in metres from the middle of the table, not mm or cm'
    image = ': outside the image'
    ranges = {'u': (-0.5, width, image), 'v': (-0.5, height, image), 'x': metres, 'y': metres}
    path, names = args.sources[0], tuple(ranges)
    rows = np.array([
        [row.number(name, None, *ranges[name]) for name in names]
        for row in text_table.rows(path, names, names)
    ]).reshape(-1, 4)  # fmt: skip
    solution = from_points(rows[:, :2], rows[:, 2:], start, args.cover_height)
    corners = platform_corners(args.table)
    seen = np.ptp(solution.calibration.to_pixels(corners), axis=0)
    if len(rows) and not 0.05 < float((seen / (width, height)).max()) < 50:
        raise ConfigError(
            f'{path}: a platform of {2 * corners.max():g} m would be {seen.max():.0f} px '
            'in the image: are x and y in metres, not mm or cm?'
        )
    return solution


def _start(args, shape):
    """Return a calibration of that image size with what is known of the lens."""
    from eol_ros.core.vision.calibration.calibrate import nominal
    from eol_ros.devices.files.calibration_file import load_lens

    if not args.lens:
        return nominal(shape[1], shape[0], args.focal, args.table)
    width, height, camera, lens = load_lens(args.lens)
    if shape is not None and shape != (height, width):
        raise ConfigError(
            f'{args.lens}: is for images of {width}x{height}, these are '
            f'{shape[1]}x{shape[0]}: use the lens of this camera at this size'
        )
    return replace(
        nominal(width, height, table=args.table), camera_matrix=camera, distortion_coefficients=lens
    )


def _images(sources) -> tuple[list[np.ndarray], dict[str, str]]:
    """Return up to _VIEWS grey images out of all sources, evenly spread, and what a bag says."""
    from eol_ros.devices.camera.image_sequence import PICTURES, open_source
    from eol_ros.devices.files import picture_file

    images: list[np.ndarray] = []
    about: dict[str, str] = {}
    for path in sources:
        try:
            if Path(path).suffix.lower() in PICTURES:
                images.append(picture_file.load_grey(path, picture_file.GREY))
                continue
            source = open_source(path)
            about = about or source.about
            every = max(source.count // _VIEWS, 1)
            views = itertools.islice(source.read(), 0, every * _VIEWS, every)
            images += [image.copy() for _, image in views]
        except EolError as error:
            if len(sources) == 1:
                raise
            print(f'{error}; left out', file=sys.stderr)
    if not images:
        raise ConfigError('no image in ' + ', '.join(sources))
    if len({image.shape for image in images}) > 1:
        raise ConfigError('the images differ in size: use images of one camera')
    return images, about


def _pair(text, name) -> tuple[int, int]:
    parts = text.lower().split('x')
    if len(parts) != 2 or not all(p.isdecimal() and len(p) < 6 and int(p) > 2 for p in parts):
        raise UsageError(f'{name} {text}: two numbers like 1280x800 are needed')
    return int(parts[0]), int(parts[1])


def _or_none(value) -> float | None:
    return None if np.isnan(value) else float(value)


def _tell(args, solution) -> None:
    """Residuals to stdout as JSON, or to a person as a few lines."""
    done = solution.calibration
    each = solution.by_name()
    if args.json:
        print(
            json.dumps(
                {
                    'residual_px': done.residual_px,
                    'residual_mm': done.residual_mm,
                    'refused': solution.refusal(),
                    'note': solution.note,
                    'verdict': solution.verdict()._asdict(),
                    'points': len(solution.px),
                    'mirror': done.mirrored,
                    'corner_sigma_mm': [_or_none(s) for s in solution.corner_mm],
                    'platform_sigma_mm': _or_none(solution.platform_mm),
                    'each': {name: {'px': px, 'mm': mm} for name, (px, mm) in each.items()},
                }
            )
        )
        return
    print(
        f'residual {done.residual_px:.3f} px = {done.residual_mm:.3f} mm RMS per axis, '
        f'{len(solution.px)} points'
    )
    worst = sorted(each.items(), key=lambda item: -item[1][0])[:5]
    print('worst: ' + ', '.join(f'{n} {px:.3f} px {mm:.3f} mm' for n, (px, mm) in worst))
    if np.isfinite(solution.corner_mm).any():
        print(
            "platform's corners known to "
            + ', '.join(f'{s:.2f}' for s in solution.corner_mm)
            + ' mm'
        )
        if np.isfinite(solution.platform_mm):
            print(
                f'places on the platform known to {solution.platform_mm:.2f} mm RMS, but for where '
                'the frame lies and how it is turned'
            )

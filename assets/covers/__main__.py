# SPDX-License-Identifier: Apache-2.0
"""Covers and bodies of the blocks, to print: python -m assets.covers --output DIR."""

import json
import sys
from typing import Any

from assets.covers import mesh
from assets.covers.body import BodyShape, body_mesh
from assets.covers.mesh import CoverShape
from eol_ros import cli, folders
from eol_ros import scene as scenes
from eol_ros.cli import within
from eol_ros.core.table import Table
from eol_ros.core.terrain import landscape
from eol_ros.devices.files import picture_file
from eol_ros.verbs.progress import track

HELP = 'Cut one continuous landscape into covers for blocks, and make their body (STL, mm).'
EXAMPLES = [
    'python -m assets.covers --output covers',
    'python -m assets.covers --output covers --seed 7 --relief 40 --wall 2',
    'python -m assets.covers --output covers --scene small      # for the table of that scene',
    'python -m assets.covers --output covers --clearance 0.3   # the lip is too tight',
    'python -m assets.covers --output covers --heightmap island.png --json',
]
SIZES = CoverShape(lip_mm=6.0)


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('-o', '--output', metavar='DIR', required=True, help='folder for the files')
    parser.add_argument(
        '--seed', type=within(0, 1e18, int), default=1, help='seed of the landscape (panel: 1)'
    )
    parser.add_argument(
        '--scene', metavar='SCENE', help='scene with the table (default: 5 x 5 blocks of 84 mm)'
    )
    parser.add_argument('--heightmap', metavar='FILE', help='grey image, white is high')
    parser.add_argument(
        '--cells', type=within(1, 512, int), default=84, help='squares along a side (84: 1 mm)'
    )
    mm = within(0, 1000)
    parser.add_argument('--wall', type=mm, default=SIZES.wall_mm, help='thickness, mm')
    parser.add_argument('--skirt', type=mm, default=SIZES.skirt_mm, help='skirt height, mm')
    parser.add_argument('--relief', type=mm, default=SIZES.relief_mm, help='land height, mm')
    parser.add_argument(
        '--lip', type=mm, default=SIZES.lip_mm, help='depth of the lip, mm; 0: no lip'
    )
    parser.add_argument('--body', type=mm, default=SIZES.body_mm, help='walls of the body, mm')
    parser.add_argument(
        '--clearance', type=mm, default=SIZES.clearance_mm, help='lip gap on each side, mm'
    )
    parser.add_argument('--json', action='store_true', help='list the files on stdout')


def run(args):
    """Write the covers and an image of the whole; name them on stdout."""
    table = Table.of(scenes.load(args.scene).table) if args.scene else Table()
    shape = CoverShape(
        1e3 * table.block_side_m,
        args.wall,
        args.skirt,
        args.relief,
        args.lip,
        args.body,
        args.clearance,
    ).check()
    height_mm = 1e3 * table.body_height_m
    below = BodyShape(shape.side_mm, height_mm, wall_mm=shape.body_mm, lip_mm=shape.lip_mm)
    if shape.lip_mm:
        below.check()
    out = folders.made(args.output, '--output')
    if args.heightmap:
        heights = mesh.fit(
            picture_file.load_grey(args.heightmap), table.rows, table.columns, args.cells
        )
    else:
        heights = landscape(args.seed, table.rows, table.columns, args.cells)
    covers: list[dict[str, Any]] = []
    digits = max(2, len(str(table.cells - 1)))  # names in order of the ids
    for block in track(range(table.cells), 'covers'):
        row, col = divmod(block, table.columns)
        cover = mesh.cover_mesh(mesh.tile(heights, row, col, args.cells), shape)
        path = out / f'cover-{block:0{digits}d}.stl'
        mesh.save(path, cover, f'Echoes of the Land, row {row}, column {col}')
        covers.append(
            {
                'file': str(path),
                'row': row,
                'column': col,
                'facets': len(cover),
                'plastic_cm3': round(mesh.volume_mm3(cover) / 1e3, 2),
            }
        )
    body = out / 'body.stl'
    if shape.lip_mm:
        mesh.save(body, body_mesh(below), f'Echoes of the Land, body of {table.count} blocks')
    else:
        body.unlink(missing_ok=True)
    picture = out / 'covers.png'
    picture_file.save(picture, mesh.hillshade(heights))
    if args.json:
        told = {'picture': str(picture), 'covers': covers}
        print(json.dumps(told | ({'body': str(body)} if shape.lip_mm else {}), indent=2))
    else:
        files = [*(cover['file'] for cover in covers), *([body] if shape.lip_mm else [])]
        print(*files, picture, sep='\n')
    plastic = sum(cover['plastic_cm3'] for cover in covers)
    print(
        f'{len(covers)} covers of {shape.side_mm:g} mm, {plastic:.0f} cm3 of plastic',
        file=sys.stderr,
    )
    gap = f' --cover-gap {1e-3 * below.height_mm:g}' if shape.lip_mm else ''
    print(f'the camera must know them: eol calibrate ... --covers {out}{gap}', file=sys.stderr)
    return 0


if __name__ == '__main__':
    sys.exit(cli.run_verb(sys.modules[__name__], 'assets.covers', sys.argv[1:]))

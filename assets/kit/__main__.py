# SPDX-License-Identifier: Apache-2.0
"""Writes the generated files of docs/build: schematics, tables and drawings.

python -m assets.kit                                write them (make kit)
python -m assets.kit --check                        exit 1 when they are not up to date
python -m assets.kit --scene SCENE --output DIR     drawings and parts.md of the scene's table
"""

import argparse
import sys
from pathlib import Path

from assets.kit import netlist, schematic
from assets.kit.drawings import Kit
from eol_ros import folders, scene
from eol_ros.core.table import Table
from eol_ros.errors import EolError, writing

FOLDER = Path(__file__).resolve().parents[2] / 'docs' / 'build'


def page(text: str, tables: dict[str, list[str]]) -> str:
    """Return a page with its marked tables replaced."""
    for mark, rows in tables.items():
        begin, end = f'<!-- {mark} -->', f'<!-- /{mark} -->'
        before, rest = text.split(begin)
        text = before + '\n'.join([begin, *rows, end]) + rest.split(end)[1]
    return text


def made() -> dict[str, str]:
    """Return the text of every generated file."""
    kit, circuit, bridge = Kit(), netlist.load(), netlist.load(netlist.BRIDGE)
    tables = {
        'materials': netlist.materials(circuit, kit.table.count, 'blocks'),
        'wiring': netlist.wiring(circuit),
        'bridge-materials': netlist.materials(bridge, 1, 'bridge'),
        'bridge-wiring': netlist.wiring(bridge),
        'fuses': netlist.fuses(circuit),
        'masses': kit.mass_table(circuit),
    }
    files = {
        'README.md': page((FOLDER / 'README.md').read_text(), tables),
        'circuit.svg': schematic.draw(circuit),
        'bridge.svg': schematic.draw(bridge),
    }
    return files | drawn(kit)


def drawn(kit: Kit) -> dict[str, str]:
    """Return the text of every drawing."""
    files = {}
    for name, sheet in kit.sheets().items():
        files |= {f'{name}.svg': sheet.svg(), f'{name}.dxf': sheet.dxf()}
    return files


def of_scene(name: str) -> dict[str, str]:
    """Return the text of the drawings and of the parts list for the table of a scene."""
    found = scene.load(name)
    kit = Kit(Table.of(found.table), found.settings('twin'))
    circuit, bridge = netlist.load(), netlist.load(netlist.BRIDGE)
    parts = [
        f'# Parts for the table of scene {found.name}', '', *kit.parts(), '', '## Mass', '',
        *kit.mass_table(circuit), '', '## Circuits', '',
        *netlist.materials(circuit, kit.table.count, 'blocks'), '', '## Bridge', '',
        *netlist.materials(bridge, 1, 'bridge'), '',
    ]  # fmt: skip
    return drawn(kit) | {'parts.md': '\n'.join(parts)}


def same(name: str, was: str, now: str) -> bool:
    """Compare two files; ezdxf writes some sections in no fixed order."""
    if name.endswith('.dxf'):
        return sorted(was.splitlines()) == sorted(now.splitlines())
    return was == now


def main(words: list[str] | None = None) -> int:
    """Write, or compare."""
    parser = argparse.ArgumentParser(prog='assets.kit')
    parser.add_argument('--check', action='store_true', help='exit 1 where a file is out of date')
    parser.add_argument('--scene', help='scene with the table (default: that of docs/build)')
    parser.add_argument('--output', metavar='DIR', help='folder for the files of --scene')
    args = parser.parse_args(words)
    if bool(args.scene) != bool(args.output):
        parser.error('--scene and --output go together')
    if args.scene:
        try:
            files, out = of_scene(args.scene), folders.made(args.output, '--output')
            with writing(out):
                for name, text in files.items():
                    (out / name).write_text(text)
        except EolError as error:
            print(error, file=sys.stderr)
            return error.exit_code
        print(*(out / name for name in sorted(files)), sep='\n')
        return 0
    stale = False
    for name, text in made().items():
        path = FOLDER / name
        if path.exists() and same(name, path.read_text(), text):
            continue
        stale = True
        if not args.check:
            path.write_text(text)
        print(f'docs/build/{name}', 'is not up to date: make kit' if args.check else '')
    return int(stale and args.check)


if __name__ == '__main__':
    sys.exit(main())

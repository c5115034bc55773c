# SPDX-License-Identifier: Apache-2.0
"""Writes the generated files of docs/build: schematics, tables and drawings.

python -m assets.kit            write them (make kit)
python -m assets.kit --check    exit 1 when they are not up to date
"""

import sys
from pathlib import Path

from assets.kit import drawings, netlist, schematic

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
    circuit, bridge = netlist.load(), netlist.load(netlist.BRIDGE)
    tables = {
        'materials': netlist.materials(circuit, drawings.TABLE.count, 'blocks'),
        'wiring': netlist.wiring(circuit),
        'bridge-materials': netlist.materials(bridge, 1, 'bridge'),
        'bridge-wiring': netlist.wiring(bridge),
        'fuses': netlist.fuses(circuit),
        'masses': drawings.mass_table(circuit),
    }
    files = {
        'README.md': page((FOLDER / 'README.md').read_text(), tables),
        'circuit.svg': schematic.draw(circuit),
        'bridge.svg': schematic.draw(bridge),
    }
    for name, draw in drawings.SHEETS.items():
        sheet = draw()
        files |= {f'{name}.svg': sheet.svg(), f'{name}.dxf': sheet.dxf()}
    return files


def same(name: str, was: str, now: str) -> bool:
    """Compare two files; ezdxf writes some sections in no fixed order."""
    if name.endswith('.dxf'):
        return sorted(was.splitlines()) == sorted(now.splitlines())
    return was == now


def main() -> int:
    """Write, or compare."""
    check, stale = '--check' in sys.argv, False
    for name, text in made().items():
        path = FOLDER / name
        if path.exists() and same(name, path.read_text(), text):
            continue
        stale = True
        if not check:
            path.write_text(text)
        print(f'docs/build/{name}', 'is not up to date: make kit' if check else '')
    return int(stale and check)


if __name__ == '__main__':
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Writes what of docs/build is made: schematic, tables, drawings, pictures of the assembly.

python tools/draw_kit.py            write them (make kit)
python tools/draw_kit.py --check    exit 1 when they are not up to date
"""

import sys
from pathlib import Path

from kit import drawings, netlist, schematic, steps

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'docs' / 'build'
BLOCKS = 25


def page(name: str, tables: dict[str, list[str]]) -> str:
    """Return a page with its marked tables made again."""
    text = (FOLDER / name).read_text()
    for mark, rows in tables.items():
        begin, end = f'<!-- {mark} -->', f'<!-- /{mark} -->'
        before, rest = text.split(begin)
        text = before + '\n'.join([begin, *rows, end]) + rest.split(end)[1]
    return text


def made() -> dict[str, str]:
    """Return the text of every file that is made."""
    circuit, bridge = netlist.load(), netlist.load(netlist.BRIDGE)
    tables = {
        'materials': netlist.materials(circuit, BLOCKS, 'blocks'),
        'wiring': netlist.wiring(circuit),
        'bridge-materials': netlist.materials(bridge, 1, 'bridge'),
        'bridge-wiring': netlist.wiring(bridge),
        'fuses': netlist.fuses(circuit),
        'masses': drawings.mass_table(circuit),
    }
    files = {
        'README.md': page('README.md', tables),
        'circuit.svg': schematic.draw(circuit),
        'bridge.svg': schematic.draw(bridge),
    }
    for name, draw in drawings.SHEETS.items():
        sheet = draw()
        files[f'{name}.svg'], files[f'{name}.dxf'] = sheet.svg(), sheet.dxf()
    return files | {f'{name}.svg': draw() for name, draw in steps.STEPS.items()}


def same(name: str, was: str, now: str) -> bool:
    """Tell whether two files are alike; ezdxf writes some sections in no fixed order."""
    if name.endswith('.dxf'):
        return sorted(was.splitlines()) == sorted(now.splitlines())
    return was == now


def main() -> int:
    """Write, or compare."""
    stale = 0
    for name, text in made().items():
        path = FOLDER / name
        if path.exists() and same(name, path.read_text(), text):
            continue
        stale += 1
        if '--check' in sys.argv:
            print(f'docs/build/{name} is not up to date: make kit', file=sys.stderr)
        else:
            path.write_text(text)
            print(f'docs/build/{name}')
    return 1 if stale and '--check' in sys.argv else 0


if __name__ == '__main__':
    sys.exit(main())

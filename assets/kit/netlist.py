# SPDX-License-Identifier: Apache-2.0
"""The circuits of a block and of the bridge: docs/build/*.yaml, read and checked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

FILE = Path(__file__).resolve().parents[2] / 'docs' / 'build' / 'block.yaml'
BRIDGE = FILE.with_name('bridge.yaml')
TWO_PINS = {'resistor', 'capacitor'}


class NetlistError(ValueError):
    """A pin in two nets or in none, or one that its part does not have."""


@dataclass(frozen=True)
class Part:
    """A component: `pins` are name to numbers, `group` its place in the schematic.

    Where names are printed beside the pins there are no numbers: empty lists.
    """

    ref: str
    what: str
    name: str  # part number, or value of a resistor or capacitor
    group: str
    pins: dict[str, list[int]]
    maker: str = ''
    alternatives: tuple[str, ...] = ()
    mass_g: float = 0.1


@dataclass(frozen=True)
class Circuit:
    """Parts by their reference, nets as lists of (reference, pin), fuses of the controller."""

    parts: dict[str, Part]
    nets: dict[str, list[tuple[str, str]]]
    fuses: dict[str, dict[str, Any]]

    def net(self, ref: str, pin: str) -> str:
        """Return the net that a pin is in; '' for one that is left open."""
        return next((name for name, pins in self.nets.items() if (ref, pin) in pins), '')


def _part(ref: str, raw: dict[str, Any]) -> Part:
    pins = raw.get('pins', {1: 1, 2: 2})
    if isinstance(pins, list):
        pins = {name: [] for name in pins}
    return Part(
        ref,
        raw['what'],
        str(raw.get('part') or raw['value']),
        raw['group'],
        {str(name): n if isinstance(n, list) else [n] for name, n in pins.items()},
        raw.get('maker', ''),
        tuple(raw.get('alternatives', ())),
        raw.get('mass_g', 0.1),
    )


def load(path: Path = FILE) -> Circuit:
    """Return the circuit; raises NetlistError where a pin is not in exactly one place."""
    raw = yaml.safe_load(path.read_text())
    parts = {ref: _part(ref, part) for ref, part in raw['parts'].items()}
    nets = {name: [tuple(pin.split('.', 1)) for pin in pins] for name, pins in raw['nets'].items()}
    unused = [tuple(pin.split('.', 1)) for pin in raw['unused']]
    seen: dict[tuple[str, str], str] = {}
    for name, pins in [*nets.items(), ('unused', unused)]:
        for ref, pin in pins:
            if ref not in parts or pin not in parts[ref].pins:
                raise NetlistError(f'{path.name}: {name}: there is no pin {ref}.{pin}')
            if (ref, pin) in seen:
                raise NetlistError(f'{path.name}: {ref}.{pin} is in {seen[ref, pin]} and in {name}')
            seen[ref, pin] = name
    for part in parts.values():
        for pin in part.pins:
            if (part.ref, pin) not in seen:
                raise NetlistError(f'{path.name}: {part.ref}.{pin} is in no net, nor unused')
    return Circuit(parts, nets, raw.get('fuses', {}))


def materials(circuit: Circuit, count: int, of: str) -> list[str]:
    """Return the bill of materials of so many `of` as rows of a Markdown table."""
    rows = [
        f'| reference | what | part | maker | for {count} {of} | instead |',
        '| --- | --- | --- | --- | --- | --- |',
    ]
    alike: dict[tuple[str, str], list[Part]] = {}
    for part in circuit.parts.values():
        alike.setdefault((part.what, part.name), []).append(part)
    for (what, name), parts in alike.items():
        refs = ', '.join(part.ref for part in parts)
        more = '; '.join(parts[0].alternatives) or '-'
        maker = parts[0].maker or 'any'
        rows.append(f'| {refs} | {what} | {name} | {maker} | {count * len(parts)} | {more} |')
    return rows


def wiring(circuit: Circuit) -> list[str]:
    """Return which pins each net joins, with the numbers on the parts, as rows of a table."""
    rows = ['| net | joins |', '| --- | --- |']
    for name, pins in circuit.nets.items():
        words = []
        for ref, pin in pins:
            numbers = circuit.parts[ref].pins[pin]
            plain = circuit.parts[ref].what in TWO_PINS
            named = f'{"/".join(map(str, numbers))} ({pin})' if numbers else pin
            words.append(ref if plain else f'{ref} {named}')
        rows.append(f'| `{name}` | {", ".join(words)} |')
    return rows


def fuses(circuit: Circuit) -> list[str]:
    """Return the fuses of the controller as rows of a table."""
    rows = ['| fuse | value | why |', '| --- | --- | --- |']
    return rows + [f'| {n} | 0x{f["value"]:02X} | {f["why"]} |' for n, f in circuit.fuses.items()]

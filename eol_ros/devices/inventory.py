# SPDX-License-Identifier: Apache-2.0
"""What is plugged into this machine, each with the line that names it in a scene."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eol_ros.devices.audio import outputs
from eol_ros.devices.board.ports import list_ports
from eol_ros.devices.camera.ports import list_cameras
from eol_ros.errors import DeviceMissing

DRM = Path('/sys/class/drm')
KINDS = ('camera', 'board', 'sound card', 'screen')


@dataclass(frozen=True)
class Found:
    """One device: what it is, its stable name, a few words, its line for a scene (or none)."""

    kind: str
    name: str
    description: str
    scene_line: str


def find_all() -> tuple[list[Found], list[str]]:
    """Return all devices found, and remarks on what could not be looked at."""
    remarks = []
    found = [
        Found('camera', c.name, c.description, _line('camera', 'device', c.name))
        for c in list_cameras()
    ]
    found += [
        Found('board', p.name, p.description, _line('leds', 'port', p.name)) for p in list_ports()
    ]
    try:
        found += [_sound_card(card) for card in outputs.cards()]
    except DeviceMissing as error:
        remarks.append(f'sound cards: {error}')
    return found + _screens(), remarks


def _line(node: str, key: str, name: str) -> str:
    return f'{node}: {{{key}: {json.dumps(name, ensure_ascii=False)}}}'


def _sound_card(card: dict[str, Any]) -> Found:
    words = f'{card["channels"]} channels, {card["sample_rate"]:.0f} Hz, {card["api"]}'
    return Found('sound card', card['name'], words, _line('sound', 'device', card['name']))


def _screens() -> list[Found]:
    found = []
    for connector in sorted(DRM.glob('card*-*')):
        try:
            connected = (connector / 'status').read_text().strip() == 'connected'
            modes = (connector / 'modes').read_text().split()
        except OSError:
            continue
        if connected:
            name = connector.name.partition('-')[2]
            found.append(Found('screen', name, modes[0] if modes else 'no mode', ''))
    return found

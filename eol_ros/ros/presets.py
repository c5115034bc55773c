# SPDX-License-Identifier: Apache-2.0
"""Presets as files: the live settings of grains and sound by name, a YAML that a scene can include.

nodes: {grains: {radius: 0.05, mode: chain}, sound: {gain_db: -6.0}}
"""

import unicodedata
from pathlib import Path
from typing import Any

import yaml

from eol_ros import folders
from eol_ros.disk import DISK, content
from eol_ros.errors import ConfigError, DeviceMissing, UsageError, writing
from eol_ros.ros.parameters import checked_live
from eol_ros.said import said
from eol_ros.settings import by_today
from eol_ros.streams.graph import INSTRUMENT, NODES
from eol_ros.streams.requests import is_name
from eol_ros.yaml_text import decoded
from eol_ros.yaml_text import load as load_yaml

Preset = dict[str, dict[str, Any]]


def folder() -> Path:
    """Return where presets lie unless somebody says otherwise."""
    return folders.state_path() / 'presets'


def names(where: Path) -> list[str]:
    """Return the names of the presets in a folder, in order."""
    stems = (unicodedata.normalize('NFC', path.stem) for path in where.glob('*.yaml'))
    return sorted({stem for stem in stems if is_name(stem)})


def path_of(name: str, where: Path) -> Path:
    """Return the file of a preset; raise UsageError where that is no name of one.

    A file that another system wrote may have its letters decomposed (Unicode UAX 15).
    """
    name = unicodedata.normalize('NFC', name)
    if not is_name(name):
        raise UsageError(f'{name[:64]!r}: name the preset by letters, digits, - and _')
    forms = [where / f'{unicodedata.normalize(form, name)}.yaml' for form in ('NFC', 'NFD')]
    return next((form for form in forms if form.exists()), forms[0])


def load(path: Path) -> Preset:
    """Return the settings of a preset by node; raises ConfigError where they cannot be."""
    try:
        data = load_yaml(decoded(content(path)))
    except FileNotFoundError:
        raise DeviceMissing(said('no_preset', path=path)) from None
    except (OSError, UnicodeError, yaml.YAMLError) as error:
        raise ConfigError(f'{path}: cannot be read ({type(error).__name__})') from None
    found = data.get('nodes') if isinstance(data, dict) else None
    if not isinstance(found, dict) or not found or not set(found) <= set(INSTRUMENT):
        raise ConfigError(f'{path}: not a preset: no settings of {" and ".join(INSTRUMENT)} in it')
    for node, values in found.items():
        kind = NODES[node].settings
        if not isinstance(values, dict):
            raise ConfigError(f'{path}: {node}: no settings')
        try:
            found[node] = checked_live(kind, node, by_today(kind, values)) if values else {}
        except ConfigError as error:
            raise ConfigError(f'{path}: {node}: {error}') from None
    return found


def save(path: Path, values: Preset) -> None:
    """Write the settings of nodes as a preset, whole or not at all; raises ConfigError."""
    nodes = {
        node: {k: list(v) if isinstance(v, tuple) else v for k, v in of_node.items()}
        for node, of_node in values.items()
    }
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        DISK.write(path, yaml.safe_dump({'nodes': nodes}, sort_keys=False, allow_unicode=True))

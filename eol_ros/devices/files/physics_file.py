# SPDX-License-Identifier: Apache-2.0
"""Physics scenes as JSON files, and their results as npz files."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.core.physics.result import Run
from eol_ros.core.physics.scene import Scene, from_mapping
from eol_ros.disk import content
from eol_ros.errors import ConfigError, DeviceMissing, writing
from eol_ros.yaml_text import decoded


def load_scene(path: str | Path) -> Scene:
    """Return the checked scene of a JSON file.

    Raises DeviceMissing if it cannot be read, ConfigError if it is not JSON or not a scene.
    """
    try:
        text = decoded(content(path))
    except OSError as error:
        raise DeviceMissing(f'{path}: {error.strerror}') from None
    except UnicodeDecodeError:
        raise ConfigError(f'{path}: not a text file; a JSON scene is wanted') from None
    try:
        given = json.loads(text, object_pairs_hook=_no_twice)
    except RecursionError:
        raise ConfigError(f'{path}: lists within lists without end') from None
    except json.JSONDecodeError as error:
        raise ConfigError(f'{path}:{error.lineno}:{error.colno}: not JSON: {error.msg}') from None
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None
    except ValueError:  # of Python, which reads no more digits
        raise ConfigError(f'{path}: a whole number of thousands of digits') from None
    try:
        return from_mapping(given)
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None


def save_run(path: str | Path, run: Run) -> None:
    """Write t, u, v, event_t, event_block, event_start of a run; raises ConfigError.

    Where blocks turn, `yaw` and `spin` as well.
    """
    turns: dict[str, Any] = {} if run.yaw is None else {'yaw': run.yaw, 'spin': run.spin}
    columns = ('t', 'u', 'v', 'event_t', 'event_block', 'event_start')
    with writing(path), open(path, 'wb') as file:
        np.savez_compressed(file, **{name: getattr(run, name) for name in columns}, **turns)


def save_scene(path: str | Path, scene: dict[str, Any]) -> None:
    """Write a scene mapping as JSON; raises ConfigError."""
    with writing(path):
        Path(path).write_text(json.dumps(scene, indent=1) + '\n', encoding='utf-8')


def _no_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f"the key '{twice}' stands twice")
    return found

# SPDX-License-Identifier: Apache-2.0
"""What a bag says about its run: the scene, the versions of everything, the seeds."""

import dataclasses
import importlib.metadata
import platform

import yaml

from eol_ros.scene import Scene, plain

# The distributions that decide what a run computes, and how it is transported and stored.
_DISTRIBUTIONS = (
    'eol_ros', 'eol-msgs', 'numpy', 'scipy', 'numba', 'opencv-python-headless', 'rclpy', 'mcap',
    'zstandard', 'sounddevice', 'soundfile', 'aiohttp',
)  # fmt: skip


def versions() -> dict[str, str]:
    """Return the installed versions, without importing anything."""
    found = {'python': platform.python_version(), 'kernel': platform.release()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def about(scene: Scene) -> dict[str, str]:
    """Return the metadata of a bag as named texts, structured ones in YAML."""
    seeds = {
        name: settings.seed
        for name, settings in scene.nodes.items()
        if any(f.name == 'seed' for f in dataclasses.fields(settings))
    }
    return {
        'scene_name': scene.name,
        'scene': scene.text,
        'settings': yaml.safe_dump(plain(scene), sort_keys=False),
        'seeds': yaml.safe_dump(seeds),
        'versions': yaml.safe_dump(versions()),
    }

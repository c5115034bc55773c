# SPDX-License-Identifier: Apache-2.0
"""What a bag says about its run: the scene, the versions of everything, the seeds."""

import contextlib
import dataclasses
import importlib.metadata
import platform
import subprocess
from pathlib import Path

import yaml

from eol_ros.scene import Scene, plain, public

# The distributions that decide what a run computes, and how it is transported and stored.
_DISTRIBUTIONS = (
    'eol_ros', 'eol-msgs', 'numpy', 'scipy', 'numba', 'opencv-python-headless', 'mcap', 'zstandard',
    'sounddevice', 'soundfile', 'aiohttp', 'ros-fastrtps', 'ros-fastcdr', 'ros-rmw-fastrtps-cpp',
)  # fmt: skip
_RCLPY = ('ros-rclpy', 'rclpy')  # the wheel; what a ROS installation has, and a wheel says wrongly


def versions() -> dict[str, str]:
    """Return the installed versions, without importing anything."""
    found = {'python': platform.python_version(), 'kernel': platform.release()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    for name in _RCLPY:
        if 'rclpy' not in found:
            with contextlib.suppress(importlib.metadata.PackageNotFoundError):
                found['rclpy'] = importlib.metadata.version(name)
    commit = _commit()
    return found | ({'commit': commit} if commit else {})


def _commit() -> str:
    """Return the commit of the checkout that runs, with `-dirty` where it was changed; else ''."""
    root = Path(__file__).resolve().parents[2]
    if not (root / '.git').exists():
        return ''
    command = ['git', '-C', str(root), 'describe', '--always', '--dirty', '--abbrev=12']
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ''
    return done.stdout.strip() if done.returncode == 0 else ''


def about(scene: Scene) -> dict[str, str]:
    """Return the metadata of a bag as named texts, structured ones in YAML; nothing secret."""
    scene = public(scene)
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

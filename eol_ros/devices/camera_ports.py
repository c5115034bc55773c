# SPDX-License-Identifier: Apache-2.0
"""Cameras by names that stay the same when things are plugged in another order."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eol_ros.errors import DeviceMissing

BY_ID = Path('/dev/v4l/by-id')
SYSTEM = Path('/sys/class/video4linux')
LISTED = 'eol devices lists them'


@dataclass(frozen=True)
class CameraPort:
    """One camera: the stable name to write into a scene, and what it says it is."""

    name: str
    path: str
    description: str


def list_cameras(by_id: Path = BY_ID, system: Path = SYSTEM) -> list[CameraPort]:
    """Return the V4L2 cameras of this machine, by stable name where the system gives one.

    A UVC camera has a second device for metadata only; the first, index 0, is the one with
    pictures.
    """
    stable = {os.path.realpath(p): str(p) for p in sorted(by_id.glob('*')) if 'index0' in p.name}
    found = []
    for device in sorted(system.glob('video*')):
        path = f'/dev/{device.name}'
        if _text(device / 'index') not in ('', '0'):
            continue
        name = stable.pop(os.path.realpath(path), path)
        found.append(CameraPort(name, path, _text(device / 'name')))
    found += [CameraPort(name, path, '') for path, name in stable.items()]
    return sorted(found, key=lambda c: c.name)


def find_camera(wanted: str, cameras: Sequence[CameraPort] | None = None) -> str:
    """Return the device path of `wanted`: a path, part of a stable name, or `auto`.

    Raises DeviceMissing where it is not there, or where more than one could be meant.
    """
    if '/' in wanted:
        if not os.path.exists(wanted):
            raise DeviceMissing(f'camera {wanted} is not there: is it plugged in?')
        return wanted
    cameras = list_cameras() if cameras is None else cameras
    fitting = [
        c for c in cameras if wanted == 'auto' or wanted in c.name or wanted in c.description
    ]
    if len(fitting) == 1:
        return fitting[0].name
    if fitting:
        names = ', '.join(c.name for c in fitting)
        raise DeviceMissing(f'camera {wanted}: {len(fitting)} cameras fit ({names}); name one')
    if wanted == 'auto':
        raise DeviceMissing(f'no camera found: plug it in, or name a file ({LISTED})')
    raise DeviceMissing(f'no camera has {wanted!r} in its name ({LISTED})')


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ''

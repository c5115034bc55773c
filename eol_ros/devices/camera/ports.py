# SPDX-License-Identifier: Apache-2.0
"""The V4L2 cameras of this machine."""

import os
from pathlib import Path

from eol_ros.devices import ports
from eol_ros.devices.ports import Port
from eol_ros.said import said

BY_ID = Path('/dev/v4l/by-id')
SYSTEM = Path('/sys/class/video4linux')


def list_cameras() -> list[Port]:
    """Return the cameras, by stable name where the system gives one.

    A UVC camera has a second device for metadata only; the first, index 0, is the one with
    images.
    """
    stable = ports.stable_names(p for p in BY_ID.glob('*') if 'index0' in p.name)
    found = []
    for device in sorted(SYSTEM.glob('video*')):
        path = f'/dev/{device.name}'
        if _text(device / 'index') not in ('', '0'):
            continue
        name = stable.pop(os.path.realpath(path), path)
        found.append(Port(name, path, _text(device / 'name')))
    found += [Port(name, path, '') for path, name in stable.items()]
    return sorted(found, key=lambda c: c.name)


def find_camera(wanted: str) -> str:
    """Return the device path of `wanted`, see `ports.find`; raises DeviceMissing."""
    return ports.find(said('a_camera'), wanted, list_cameras())


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ''

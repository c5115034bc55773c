# SPDX-License-Identifier: Apache-2.0
"""Serial ports by names that stay the same when things are plugged in another order."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eol_ros.errors import DeviceMissing

BY_ID = Path('/dev/serial/by-id')
LISTED = 'eol devices lists them'


@dataclass(frozen=True)
class Port:
    """One serial port: the stable name to write into a scene, and what it says it is."""

    name: str
    path: str
    description: str


def list_ports(by_id: Path = BY_ID) -> list[Port]:
    """Return the USB serial ports of this machine, by stable name where the system gives one."""
    from serial.tools import list_ports as pyserial_ports

    stable = {os.path.realpath(p): str(p) for p in sorted(by_id.glob('*'))}
    found = [
        Port(stable.pop(os.path.realpath(p.device), p.device), p.device, p.description or '')
        for p in pyserial_ports.comports()
        if p.vid is not None or os.path.realpath(p.device) in stable
    ]
    found += [Port(name, path, '') for path, name in stable.items()]
    return sorted(found, key=lambda p: p.name)


def find_port(wanted: str, ports: Sequence[Port] | None = None) -> str:
    """Return the device path of `wanted`: a path, part of a stable name, or `auto`.

    Raises DeviceMissing where it is not there, or where more than one could be meant.
    """
    if '/' in wanted:
        if not os.path.exists(wanted):
            raise DeviceMissing(f'serial port {wanted} is not there: is the board plugged in?')
        return wanted
    ports = list_ports() if ports is None else ports
    fitting = [p for p in ports if wanted == 'auto' or wanted in p.name]
    if len(fitting) == 1:
        return fitting[0].name
    if fitting:
        names = ', '.join(p.name for p in fitting)
        raise DeviceMissing(f'port {wanted}: {len(fitting)} serial ports fit ({names}); name one')
    if wanted == 'auto':
        raise DeviceMissing(f'no serial board found: plug it in, or name its port ({LISTED})')
    raise DeviceMissing(f'no serial port has {wanted!r} in its name ({LISTED})')

# SPDX-License-Identifier: Apache-2.0
"""The USB serial ports of this machine."""

import os
from pathlib import Path

from eol_ros.devices import ports
from eol_ros.devices.ports import Port
from eol_ros.said import said

BY_ID = Path('/dev/serial/by-id')


def list_ports() -> list[Port]:
    """Return the ports, by stable name where the system gives one."""
    from serial.tools import list_ports as pyserial_ports

    stable = ports.stable_names(BY_ID.glob('*'))
    found = [
        Port(stable.pop(os.path.realpath(p.device), p.device), p.device, p.description or '')
        for p in pyserial_ports.comports()
        if p.vid is not None or os.path.realpath(p.device) in stable
    ]
    found += [Port(name, path, '') for path, name in stable.items()]
    return sorted(found, key=lambda p: p.name)


def find_port(wanted: str) -> str:
    """Return the device path of `wanted`, see `ports.find`; raises DeviceMissing."""
    return ports.find(said('serial_port'), wanted, list_ports())

# SPDX-License-Identifier: Apache-2.0
"""Devices by names that stay the same when things are plugged in another order."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from eol_ros.errors import DeviceMissing
from eol_ros.said import said

LISTED = said('listed')


@dataclass(frozen=True)
class Port:
    """A camera or serial port: the stable name to write into a scene, and what it says it is."""

    name: str
    path: str
    description: str


def stable_names(links: Iterable[Path]) -> dict[str, str]:
    """Return device -> name of `links`, such as the system keeps in /dev/serial/by-id."""
    return {os.path.realpath(link): str(link) for link in sorted(links)}


def find(what: str, wanted: str, ports: Sequence[Port]) -> str:
    """Return the name of the one of `ports` that is `wanted`: part of name or words, or `auto`.

    A path counts as it stands. what: as it is called in words, such as 'camera'. Raises
    DeviceMissing where it is not there, or where more than one could be meant.
    """
    if '/' in wanted:
        if not os.path.exists(wanted):
            raise DeviceMissing(said('is_not_there', what=what, wanted=wanted))
        return wanted
    fitting = [p for p in ports if wanted == 'auto' or wanted in p.name or wanted in p.description]
    if len(fitting) == 1:
        return fitting[0].name
    if fitting:
        names = ', '.join(p.name for p in fitting)
        raise DeviceMissing(f'{what} {wanted}: {len(fitting)} fit ({names}); name one')
    if wanted == 'auto':
        raise DeviceMissing(said('none_found', what=what, list=LISTED))
    raise DeviceMissing(said('none_named', what=what, wanted=f'{wanted!r}', list=LISTED))

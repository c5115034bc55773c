# SPDX-License-Identifier: Apache-2.0
"""The time zones that this system knows, by name, and whether its clock was ever set."""

import zoneinfo

from eol_ros.core.opening_hours import CLOCK_SET_S
from eol_ros.errors import ConfigError, nearest, pip_install


def load(name: str) -> zoneinfo.ZoneInfo:
    """Return the time zone called `name`; raise ConfigError where there is none."""
    try:
        return zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        known = zoneinfo.available_timezones()
    if not known:
        raise ConfigError(
            f'{name}: this system knows no time zones: apt install tzdata, or '
            f'{pip_install("tzdata")}'
        )
    if not name:
        raise ConfigError('names no time zone; such as Europe/Vienna')
    raise ConfigError(f'{name!r}: no such time zone. {nearest(name, known)}')


def clock_is_set(now_s: float) -> bool:
    """Return whether somebody has set the clock that shows the system time `now_s`."""
    return now_s >= CLOCK_SET_S

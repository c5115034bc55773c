# SPDX-License-Identifier: Apache-2.0
"""How the picture of each projector lies on its wall: four corners and four soft edges, checked."""

from typing import Any

from eol_ros.errors import UsageError
from eol_ros.said import said

MOST_SCREENS = 16


def checked(value: Any) -> dict[str, Any]:
    """Return `value` where it is the place of a picture; raise UsageError that says what not.

    `corners`: [x, y] from upper left, clockwise, in shares of the window. `edges`: shares of the
    picture over which it fades, left, top, right, bottom.
    """
    if not isinstance(value, dict) or set(value) != {'corners', 'edges'}:
        raise UsageError('a screen is an object of corners and edges')
    corners = value['corners']
    if not (isinstance(corners, list) and len(corners) == 4):
        raise UsageError('corners: four pairs of numbers')
    for corner in corners:
        if not _numbers(corner, 2, -0.5, 1.5):
            raise UsageError('corners: four pairs of numbers from -0.5 to 1.5')
    if not _numbers(value['edges'], 4, 0.0, 0.5):
        raise UsageError('edges: four numbers from 0 to 0.5')
    turns = [_turn(corners[i - 1], corners[i], corners[(i + 1) % 4]) for i in range(4)]
    if min(turns) < 1e-3:
        raise UsageError(said('no_outline'))
    return value


def _numbers(value: Any, count: int, low: float, high: float) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(
            isinstance(v, (int, float)) and not isinstance(v, bool) and low <= v <= high
            for v in value
        )
    )


def _turn(a: list[float], b: list[float], c: list[float]) -> float:
    """Return the cross product of two sides that meet in `b`; positive: the way of the clock."""
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def kept(value: Any) -> dict[str, Any]:
    """Return of what a file holds the screens that make sense."""
    found = {}
    for name, place in value.items() if isinstance(value, dict) else ():
        try:
            found[name] = checked(place)
        except UsageError:
            continue
    return found

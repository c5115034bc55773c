# SPDX-License-Identifier: Apache-2.0
"""Binary STL: 80 bytes of header, a count, then 50 bytes a facet (3D Systems, 1989)."""

from pathlib import Path

import numpy as np

from eol_ros.disk import content
from eol_ros.errors import ConfigError, DeviceMissing

MOST, MOST_MM = 500_000_000, 1e5  # bytes; mm from the origin (chosen)
FACET = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])


def load(path: str | Path) -> np.ndarray:
    """Return the triangles of a binary STL file, shape (n, 3, 3) float32.

    Raises DeviceMissing if it cannot be read, ConfigError if it is none or not whole.
    """
    try:
        data = content(path, MOST)
    except OSError as error:
        raise DeviceMissing(f'{path}: {error.strerror}') from None
    count = int.from_bytes(data[80:84], 'little')
    if len(data) != 84 + count * FACET.itemsize or not count:
        raise ConfigError(f'{path}: not a binary STL file, or cut off: make it again')
    corners = np.frombuffer(data, FACET, count, 84)['corners'].copy()
    if not np.abs(corners).max() < MOST_MM or not corners.any(axis=(1, 2)).all():  # nan, too
        raise ConfigError(f'{path}: facets without a size, or beyond {MOST_MM:g} mm: damaged')
    return corners

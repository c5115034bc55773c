# SPDX-License-Identifier: Apache-2.0
"""Binary STL: 80 bytes of header, a count, then 50 bytes a facet (3D Systems, 1989)."""

from pathlib import Path

import numpy as np

from eol_ros.disk import content
from eol_ros.errors import ConfigError, DeviceMissing

MOST, MOST_MM = 500_000_000, 1e5  # bytes; mm from the origin (chosen)
FACET = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])


def save(path: str | Path, triangles: np.ndarray, name: str = '') -> None:
    """Write triangles (n, 3, 3) to a binary STL file."""
    facets = np.zeros(len(triangles), FACET)
    facets['corners'] = triangles
    a, b, c = (facets['corners'][:, i].astype(float) for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facets['normal'] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    # A header that begins with "solid" would be taken for the text form.
    header = f'binary STL, mm; {name}'.encode('ascii', 'replace')[:80].ljust(80)
    count = len(facets).to_bytes(4, 'little')
    Path(path).write_bytes(header + count + facets.tobytes())


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

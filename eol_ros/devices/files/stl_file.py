# SPDX-License-Identifier: Apache-2.0
"""Binary STL: 80 bytes of header, a count, then 50 bytes a facet (3D Systems, 1989)."""

from pathlib import Path

import numpy as np

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
    """Return the triangles of a binary STL file, shape (n, 3, 3) float32."""
    data = Path(path).read_bytes()
    count = int(np.frombuffer(data, '<u4', 1, 80)[0])
    return np.frombuffer(data, FACET, count, 84)['corners'].copy()

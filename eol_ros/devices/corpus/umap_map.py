# SPDX-License-Identifier: Apache-2.0
"""UMAP, where umap-learn is installed: a map on which what sounds alike lies together."""

import numpy as np

from eol_ros.errors import ConfigError, DeviceMissing, pip_install
from eol_ros.said import said

try:
    from umap import UMAP
except ImportError:  # an extra
    raise DeviceMissing(said('needs_umap', command=pip_install('umap-learn'))) from None

NEIGHBOURS, SEED = 15, 1


def umap(matrix: np.ndarray) -> np.ndarray:
    """Return places (n, 2) of standardised descriptors (n, m); the same each time.

    McInnes, Healy, Melville, "UMAP: uniform manifold approximation and projection for dimension
    reduction", arXiv 1802.03426.
    """
    if len(matrix) < 4:
        raise ConfigError(f'umap_1 and umap_2 need 4 grains at least; there are {len(matrix)}')
    near = min(NEIGHBOURS, len(matrix) - 1)
    reducer = UMAP(n_neighbors=near, n_components=2, random_state=SEED, n_jobs=1, init='pca')
    return np.asarray(reducer.fit_transform(matrix), float)

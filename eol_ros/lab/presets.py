# SPDX-License-Identifier: Apache-2.0
"""The scenes that methods are compared on, described in docs/explanation/numerics/physics.md."""

from collections.abc import Callable

from eol_ros.core.physics import builders
from eol_ros.core.table import Table

PULL = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
CIRCLE = {'kind': 'circle_and_rotation', 'par': [0.06, 0.9, 0.12, 0.7]}
OFFSET_M = 0.005
BLOCKS = Table().count  # of table and plate


def _at(n: int, seed: int, along_x: bool = True) -> list[list[float]]:
    return builders.offsets(n, OFFSET_M, seed, along_x)


NAMED: dict[str, tuple[str, Callable[[], builders.Plain]]] = {
    'S1': ('one block, pulled', lambda: builders.single(PULL, 60.0)),
    'S2': ('train of five', lambda: builders.train(PULL, 20.0, u0=_at(5, 2))),
    'S3L': ('table, pulled, linear', lambda: builders.table(PULL, 10.0, u0=_at(BLOCKS, 3))),
    'S3G': (
        'table, pulled, geometric',
        lambda: builders.table(PULL, 10.0, geometric=True, u0=_at(BLOCKS, 3, False)),
    ),
    'S3E': (
        'table, pulled, mu_s = mu_k',
        lambda: builders.table(PULL, 10.0, mu_s=0.65, mu_k=0.65, u0=_at(BLOCKS, 3)),
    ),
    'S4L': (
        'table, circled and rotated, linear',
        lambda: builders.table(CIRCLE, 10.0, u0=_at(BLOCKS, 4, False)),
    ),
    'S4G': (
        'table, circled and rotated, geometric',
        lambda: builders.table(CIRCLE, 10.0, geometric=True, u0=_at(BLOCKS, 4, False)),
    ),
    'S5': ('Brown plate', lambda: builders.plate(PULL, 10.0, u0=_at(BLOCKS, 5))),
    'S6a': (
        'Brown plate, K_C / K_L = 1e6',
        lambda: builders.plate(
            PULL, 7.0, k_between=2e7, u0=builders.offsets(BLOCKS, 1e-9, 6, True)
        ),
    ),
    'S6b': (
        'train of five, masses x 1e-4',
        lambda: builders.train(PULL, 10.0, mass=2.5e-5, g=9.81e4, u0=_at(5, 6)),
    ),
}


def scene(name: str) -> builders.Plain:
    """Return a named scene as a mapping; raises KeyError."""
    return NAMED[name][1]()

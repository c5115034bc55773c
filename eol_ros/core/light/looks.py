# SPDX-License-Identifier: Apache-2.0
"""Looks: what a slip's light does besides lighting its own block.

With a spread, light runs from the block that slips over the lattice, `delay_s` a block, up to
`blocks` away. Each block is lit to `share` of the level of the block before it. Running light skips
blocks that have been lit within REST_S or shine brighter. So it is seen where a cascade begins, and
takes no flash of the limit from a block's own slips.

With an afterglow, a block that has stayed dark since its slip lights up once more: so a cascade
that is over runs through the blocks again, in the order of its last slips.

With an idle period, dim light runs from the middle over all blocks after each such period without a
slip.
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.serial_protocol import SHARES
from eol_ros.core.table import Table

APART_S = 0.08  # one word carries one level; it is repeated for at most 0.075 s
STEPS = 8  # of stress
REST_S = 1.0
IDLE_SHARE = 0.25  # of the peak


class Look(NamedTuple):
    """Time constant of a flash in s, blocks that light runs on, delay from block to block in s.

    `afterglow_s`: from a slip to the second lighting of its block, at least REST_S; 0: none.
    `share`: light of a block that light runs to, over that of the block before it. `idle_s`: from
    the last slip to dim light over all blocks, at least REST_S; 0: none.
    """

    decay_s: float
    blocks: int
    delay_s: float
    afterglow_s: float = 0.0
    share: float = 1.0
    idle_s: float = 0.0


LOOKS = {
    'lightning': Look(0.06, 3, 0.03, share=0.6),
    'wildfire': Look(0.15, 4, 0.1, share=0.7),
    'embers': Look(0.4, 0, 0.15, idle_s=6.0),
}


def spread(block: int, look: Look, table: Table = Table()) -> list[tuple[float, int, float]]:
    """Return the blocks that a slip of `block` lights besides: after how many s, which, and to
    which share of the peak, a multiple of 1 / SHARES.

    Examples
    --------
    >>> spread(0, Look(0.1, 1, 0.05, share=0.5))
    [(0.05, 1, 0.5), (0.05, 5, 0.5)]
    >>> spread(0, Look(0.1, 0, 0.05, afterglow_s=2.0))
    [(2.0, 0, 1.0)]
    """
    seen, front, share = {block}, [block], 1.0
    found: list[tuple[float, int, float]] = []
    for ring in range(1, look.blocks + 1):
        front = sorted({other for one in front for other in table.neighbours(one)} - seen)
        seen.update(front)
        share *= look.share
        told = max(1, round(share * SHARES)) / SHARES  # as the wire has it
        found += [(ring * look.delay_s, other, told) for other in front]
    return found + [(max(look.afterglow_s, REST_S), block, 1.0)] * (look.afterglow_s > 0)


def idle(look: Look, table: Table = Table()) -> list[tuple[float, int, float]]:
    """Return the blocks that shine while all is still, from the middle on, as `spread` does.

    Examples
    --------
    >>> idle(Look(0.1, 0, 0.05), Table(rows=2, columns=2))
    [(0.0, 2, 0.25), (0.05, 0, 0.25), (0.05, 3, 0.25), (0.1, 1, 0.25)]
    """
    middle = int(table.ids[table.count // 2])
    over_all = spread(middle, Look(look.decay_s, table.cells, look.delay_s), table)
    return [(0.0, middle, IDLE_SHARE), *((late_s, one, IDLE_SHARE) for late_s, one, _ in over_all)]


def stressed(stress: np.ndarray) -> list[tuple[float, int, float]]:
    """Return the idle light of blocks by their `stress`, (cells,), in the form of `spread`.

    The most stressed blocks come first, one of the STEPS levels after the other. NaN counts as 0.

    Examples
    --------
    >>> stressed(np.array([0.5, 0.0, 1.2, np.nan]))
    [(0.32, 0, 0.125), (0.0, 2, 0.25)]
    """
    levels = np.rint(STEPS * np.nan_to_num(stress).clip(0.0, 1.0)).astype(int).tolist()
    return [
        ((STEPS - level) * APART_S, one, IDLE_SHARE * level / STEPS)
        for one, level in enumerate(levels)
        if level
    ]

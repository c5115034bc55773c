# SPDX-License-Identifier: Apache-2.0
"""Looks: what a slip's light does besides lighting its own block.

With a spread, light runs from the block that slips over the lattice, `delay_s` a block, up to
`blocks` away. It lights no block that has been lit within REST_S, so it is seen where a cascade
begins, and takes no flash of the limit from a block's own slips.

With an afterglow, a block that has stayed dark since its slip lights up once more: so a cascade
that is over runs through the blocks again, in the order of its last slips.
"""

from typing import NamedTuple

from eol_ros.core.table import Table

REST_S = 1.0


class Look(NamedTuple):
    """Time constant of a flash in s, blocks that light runs on, delay from block to block in s.

    `afterglow_s`: from a slip to the second lighting of its block, at least REST_S; 0: none.
    """

    decay_s: float
    blocks: int
    delay_s: float
    afterglow_s: float = 0.0


LOOKS = {
    'lightning': Look(0.06, 2, 0.03),
    'wildfire': Look(0.15, 4, 0.1),
    'embers': Look(0.4, 0, 0.1),
}


def spread(block: int, look: Look, table: Table = Table()) -> list[tuple[float, int]]:
    """Return the blocks that a slip of `block` lights besides, and after how many s.

    Examples
    --------
    >>> spread(0, Look(0.1, 1, 0.05))
    [(0.05, 1), (0.05, 5)]
    >>> spread(0, Look(0.1, 0, 0.05, afterglow_s=2.0))
    [(2.0, 0)]
    """
    seen, front, found = {block}, [block], []
    for ring in range(1, look.blocks + 1):
        front = sorted({other for one in front for other in table.neighbours(one)} - seen)
        seen.update(front)
        found += [(ring * look.delay_s, other) for other in front]
    return found + [(max(look.afterglow_s, REST_S), block)] * (look.afterglow_s > 0)

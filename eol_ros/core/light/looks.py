# SPDX-License-Identifier: Apache-2.0
"""Looks: what a slip's light does besides lighting its own block.

With a spread, light runs from the block that slips over the lattice, `delay_s` a block, up to
`blocks` away. It lights no block that has been lit within REST_S, so it is seen where a cascade
begins, and takes no flash of the limit from a block's own slips.
"""

from typing import NamedTuple

from eol_ros.core.geometry import neighbours

REST_S = 1.0


class Look(NamedTuple):
    """Time constant of a flash in s, blocks that light runs on, delay from block to block in s."""

    decay_s: float
    blocks: int
    delay_s: float


LOOKS = {
    'lightning': Look(0.06, 2, 0.03),
    'wildfire': Look(0.15, 4, 0.1),
    'embers': Look(0.4, 0, 0.1),
}


def spread(block: int, look: Look) -> list[tuple[float, int]]:
    """Return the blocks that the light of `block` runs to, and after how many s.

    Examples
    --------
    >>> spread(0, Look(0.1, 1, 0.05))
    [(0.05, 1), (0.05, 5)]
    """
    seen, front, found = {block}, [block], []
    for ring in range(1, look.blocks + 1):
        front = sorted({other for one in front for other in neighbours(one)} - seen)
        seen.update(front)
        found += [(ring * look.delay_s, other) for other in front]
    return found

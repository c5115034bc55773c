# SPDX-License-Identifier: Apache-2.0
"""One grain, told by two senses: where a block felt its slip the knock sounds it, and the images,
which show the slip some 20 ms later, ask for the same grain again. Whichever comes first is played.
"""

SAME_S = 0.15  # from the knock to the image that asks for its grains, at most
MOST = 4096  # grains remembered until those of long ago are forgotten


class FirstSense:
    """Feed it each trigger; nothing else is remembered of them than what was played."""

    def __init__(self) -> None:
        self._played: dict[tuple[int, int, bool], float] = {}

    def plays(self, stamp_s: float, block: int, grain: int, felt: bool) -> bool:
        """Return whether a trigger is played: not if the other sense has played the same one.

        An image asks for it after the knock: what one asked for before was another slip.
        """
        other_s = self._played.get((block, grain, not felt))
        if other_s is not None:
            after_s = other_s - stamp_s if felt else stamp_s - other_s
            if 0.0 <= after_s <= SAME_S:
                return False
        if len(self._played) >= MOST:
            recent = {k: s for k, s in self._played.items() if abs(stamp_s - s) <= SAME_S}
            self._played = recent
        self._played[block, grain, felt] = stamp_s
        return True

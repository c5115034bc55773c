# SPDX-License-Identifier: Apache-2.0
"""First-arrival de-duplication of grains.

A tap of a block triggers a grain; the images show the slip some 20 ms later and trigger the same
grain again. The trigger that arrives first is played.
"""

SAME_S = 0.15  # longest time from a tap to the image that triggers the same grains
MOST = 4096  # grains remembered before old ones are dropped


class FirstSense:
    """Decides which triggers are played; it remembers only the played ones."""

    def __init__(self) -> None:
        self._played: dict[tuple[int, int, bool], float] = {}

    def plays(self, stamp_s: float, block: int, grain: int, felt: bool) -> bool:
        """Return whether a trigger is played: not if the other source has triggered the same grain.

        The trigger of the image follows the tap; an earlier one belongs to another slip.
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


class OnsetToSound:
    """Pairs the first sound of each slip with its onset, whichever is known first.

    A sound belongs to a slip if their stamps, of an image or a tap, differ by at most SAME_S.
    """

    def __init__(self) -> None:
        self._sounds: dict[int, tuple[float, float]] = {}
        self._onsets: dict[int, tuple[float, float]] = {}

    def sounds(self, block: int, stamp_s: float, at_s: float) -> float | None:
        """Note that `block` sounds at `at_s`; return its latency in s if that ends a pair."""
        onset = self._onsets.pop(block, None)
        if onset is not None and abs(onset[0] - stamp_s) <= SAME_S:
            return at_s - onset[1]
        before = self._sounds.get(block)
        if before is None or stamp_s - before[0] > SAME_S:
            self._sounds[block] = stamp_s, at_s
        return None

    def began(self, block: int, stamp_s: float, onset_s: float) -> float | None:
        """Note that a slip of `block` began at `onset_s`, as `sounds`."""
        sound = self._sounds.pop(block, None)
        if sound is not None and abs(sound[0] - stamp_s) <= SAME_S:
            return sound[1] - onset_s
        self._onsets[block] = stamp_s, onset_s
        return None

# SPDX-License-Identifier: Apache-2.0
"""What passes from the selection of grains to the mixer: one row per grain to be sounded."""

import numpy as np

TRIGGER = np.dtype(
    [
        ('time_s', 'f8'),  # stamp of the image that caused it, seconds
        ('grain', 'i4'),  # index into the corpus
        ('gain', 'f4'),  # linear, 1 = as recorded
        ('rate', 'f4'),  # speed of reading, 1 = as recorded, 2 = an octave up; < 0: backwards
        ('pan', 'f4'),  # -1 left, 0 middle, 1 right
        ('attack_s', 'f4'),  # rise of the envelope
        ('release_s', 'f4'),  # fall of the envelope
        ('block', 'i2'),  # id of the block that caused it, -1 for none
    ]
)
COLUMNS = ('time_s', 'grain', 'gain', 'rate', 'pan', 'attack_s', 'release_s')  # of a triggers CSV
MAX_GAIN = 16.0  # +24 dB: above this a number is a mistake
MIN_RATE, MAX_RATE = 1 / 16, 16.0


def playable(triggers: np.ndarray, n_grains: int) -> np.ndarray:
    """Return which of `triggers` (n,) TRIGGER can be sounded, shape (n,) bool.

    A trigger is refused when a number is not finite, its grain is not in the corpus, its gain is
    negative or above `MAX_GAIN`, its rate forwards or backwards is outside `MIN_RATE`..`MAX_RATE`,
    its pan outside -1..1 or an edge of its envelope negative.
    """
    good = (
        (triggers['grain'] >= 0) & (triggers['grain'] < n_grains) & np.isfinite(triggers['time_s'])
    )
    good &= (triggers['gain'] >= 0) & (triggers['gain'] <= MAX_GAIN)
    speed = np.abs(triggers['rate'])
    good &= (speed >= MIN_RATE) & (speed <= MAX_RATE)
    good &= (triggers['pan'] >= -1) & (triggers['pan'] <= 1)
    for edge in ('attack_s', 'release_s'):
        good &= (triggers[edge] >= 0) & np.isfinite(triggers[edge])
    return good

# SPDX-License-Identifier: Apache-2.0
"""What passes from the selection of grains to the mixer: one row per grain to be sounded."""

import numpy as np

TRIGGER = np.dtype(
    [
        ('time_s', 'f8'),  # stamp of the image that caused it, seconds
        ('grain', 'i4'),  # index into the corpus
        ('gain', 'f4'),  # linear, 1 = as recorded
        ('rate', 'f4'),  # playback rate, 1 = as recorded, 2 = an octave up
        ('pan', 'f4'),  # -1 left, 0 middle, 1 right
        ('attack_s', 'f4'),  # rise of the envelope
        ('release_s', 'f4'),  # fall of the envelope
        ('block', 'i2'),  # id of the block that caused it, -1 for none
    ]
)
COLUMNS = ('time_s', 'grain', 'gain', 'rate', 'pan', 'attack_s', 'release_s')  # of a triggers CSV
MAX_GAIN = 16.0  # +24 dB: above this a number is a mistake
MIN_RATE, MAX_RATE = 1 / 16, 16.0

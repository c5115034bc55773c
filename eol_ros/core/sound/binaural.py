# SPDX-License-Identifier: Apache-2.0
"""The ring of loudspeakers for headphones: a spherical head in the middle of the table.

C. P. Brown, R. O. Duda, "A structural model for binaural sound synthesis", IEEE Trans. Speech Audio
Process. 6 (1998) 476: each ear hears a loudspeaker at the angle theta from its own axis later by
the way round the head (eq. 3, after Woodworth) and through the head's shadow, a filter of one pole
and one zero (eq. 4 and 5). No torso, no pinna: left and right are plain, front and back are not.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from eol_ros.core.sound.ring import SOUND_MPS, Speaker

HEAD_M = 0.0875  # radius
LEAST_ALPHA, AWAY_DEG = 0.1, 150.0  # depth of the shadow, and where it is deepest


def way_s(theta: float) -> float:
    """Return when an ear hears a sound `theta` rad off its axis, s after the head's middle would.

    Examples
    --------
    >>> round(1e6 * way_s(0)), round(1e6 * way_s(math.pi))
    (-255, 400)
    """
    if theta < math.pi / 2:
        return -HEAD_M / SOUND_MPS * math.cos(theta)
    return HEAD_M / SOUND_MPS * (theta - math.pi / 2)


def shadow(theta: float, sample_rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the filter b, a (2,) of the head's shadow at `theta` rad off the ear's axis."""
    alpha = (1 + LEAST_ALPHA / 2) + (1 - LEAST_ALPHA / 2) * math.cos(
        theta / math.radians(AWAY_DEG) * math.pi
    )
    turn = SOUND_MPS / HEAD_M  # the pole is at twice that; s = 2 f_s (z - 1) / (z + 1)
    return (
        np.array([turn + alpha * sample_rate, turn - alpha * sample_rate]) / (turn + sample_rate),
        np.array([1.0, (turn - sample_rate) / (turn + sample_rate)]),
    )


class Binaural:
    """Turns what the loudspeakers play into two ears, block by block.

    `speakers` are in order of the channels; of a channel behind them, the sub voice, both ears hear
    the same.
    """

    def __init__(self, speakers: Sequence[Speaker], sample_rate: float):
        self._paths = []
        first = way_s(0.0)
        for speaker in speakers:
            for ear, axis in ((0, 90.0), (1, -90.0)):
                off = abs((speaker.azimuth - axis + 180) % 360 - 180)
                theta = math.radians(off)
                delay = round((way_s(theta) - first) * sample_rate)
                b, a = shadow(theta, sample_rate)
                self._paths.append((ear, delay, b, a))
        self._past = np.zeros((max((p[1] for p in self._paths), default=0), len(speakers)))
        self._states = [np.zeros(1) for _ in self._paths]

    def __call__(self, block: np.ndarray) -> np.ndarray:
        """Return the ears (n, 2) f4 of the next block (n, channels)."""
        n, count = len(block), self._past.shape[1]
        heard = np.concatenate([self._past, block[:, :count]])
        out = np.zeros((n, 2))
        for k, (ear, delay, b, a) in enumerate(self._paths):
            begin = len(self._past) - delay
            row, self._states[k] = lfilter(
                b, a, heard[begin : begin + n, k // 2], zi=self._states[k]
            )
            if abs(self._states[k][0]) < 1e-20:  # silence ends as subnormal numbers, which are slow
                self._states[k][0] = 0.0
            out[:, ear] += row
        out += block[:, count:].sum(axis=1, keepdims=True)
        self._past = heard[len(heard) - len(self._past) :]
        return out.astype(np.float32)

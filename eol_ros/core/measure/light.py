# SPDX-License-Identifier: Apache-2.0
"""How late the camera sees a light, by its own stamps: from the command until an image shows it.

One block's infrared light goes dark for a moment, again and again. Between the last image that
shows it and the first that does not the command has come into effect; where that falls in the time
of an image is chance, so many such intervals tell the delay much finer than one
image. Only the going dark counts: a tracker believes a light that comes back some images later.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import special

from eol_ros.core.measure.estimate import Estimate
from eol_ros.errors import EolError

EARLIEST_S, LATEST_S = -0.005, 0.25  # an image shows what a command did within this time
LEAST_BLINKS = 10
IN_STEP = 0.5  # of the vectors of phase: 1 where all blinks come at the same time of an image


class Light(NamedTuple):
    """What blinks of `block` said: `delay` by stamps, s; (n,) single middles; `heard_s` (n,).

    heard_s: from the command until the image that showed it had been tracked and had arrived here.
    """

    block: int
    delay: Estimate
    middles_s: np.ndarray
    heard_s: np.ndarray


def fit(
    sent_s: np.ndarray,
    stamp_s: np.ndarray,
    heard_s: np.ndarray,
    seen: np.ndarray,
    exposure_s: float,
) -> Light:
    """Return the delay from commands at `sent_s` (m,) and images at `stamp_s` (n,).

    seen: (n, cells). `heard_s` (n,) is when the blocks of an image arrived. An image shows a light
    as dark when it was so for some part of the exposure, nobody knows which: that is in the error.
    Raises EolError where no light blinked, or in step with the camera.
    """
    if len(stamp_s) < 2:
        raise EolError('no images of the blocks: does the tracker see the table?')
    if not len(sent_s):
        raise EolError(_NO_BLINK)
    darkens = seen[:-1] & ~seen[1:]
    found: list[list[int]] = [[] for _ in range(seen.shape[1])]
    causes: list[list[float]] = [[] for _ in range(seen.shape[1])]
    sent_s = np.sort(sent_s)
    for image, block in np.argwhere(darkens):
        k = int(np.searchsorted(sent_s, stamp_s[image + 1] - EARLIEST_S)) - 1
        if k >= 0 and stamp_s[image + 1] - sent_s[k] < LATEST_S:
            found[block].append(image)
            causes[block].append(float(sent_s[k]))
    block = max(range(len(found)), key=lambda b: len(found[b]))
    before, sent = np.array(found[block], int), np.array(causes[block])
    period = float(np.median(np.diff(stamp_s)))
    if len(before):
        alone = (np.diff(stamp_s)[before] / period < 1.5) & (np.append(np.diff(sent), 1.0) > 0)
        before, sent = before[alone], sent[alone]
    if len(before) < LEAST_BLINKS:
        raise EolError(f'{len(before)} blinks seen, {LEAST_BLINKS} are needed. {_NO_BLINK}')
    phase = np.exp(2j * np.pi * (sent - stamp_s[before]) / period)
    if abs(phase.mean()) > IN_STEP:
        raise EolError(
            'the light blinks in step with the camera: set leds.blink_period_s to a time that is no'
            ' whole number of images, such as 2.007'
        )
    middles = 0.5 * (stamp_s[before] + stamp_s[before + 1]) - sent
    near = np.abs(middles - np.median(middles)) < 1.5 * period + exposure_s  # else it was an arm
    middles, before, sent = middles[near], before[near], sent[near]
    ends = stamp_s[before] - sent, stamp_s[before + 1] - sent
    delay = _between(*ends).widened(exposure_s / math.sqrt(12))
    return Light(block, delay, middles, heard_s[before + 1] - sent)


def _between(low_s: np.ndarray, high_s: np.ndarray) -> Estimate:
    """Return the mean of normal times of which each lies between `low_s` and `high_s` (n,).

    Mean and deviation of its posterior, prior even in the mean and in the logarithm of the scatter.
    """
    at = np.linspace(low_s.min(), high_s.max(), 401)
    scatter = np.geomspace(2e-4, 2e-2, 21)[:, None, None]
    inside = [special.ndtr((ends - at[:, None]) / scatter) for ends in (high_s, low_s)]
    log = np.log(np.maximum(inside[0] - inside[1], 1e-12)).sum(axis=2)
    weight = np.exp(log - log.max()).sum(axis=0)
    weight /= weight.sum()
    middle = float(weight @ at)
    return Estimate(middle, math.sqrt(float(weight @ (at - middle) ** 2)))


_NO_BLINK = (
    'Let one block blink: leds.blink_block and tracker.blink_block of the scene, and'
    ' blink_period_s 2.007'
)

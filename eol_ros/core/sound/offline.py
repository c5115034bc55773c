# SPDX-License-Identifier: Apache-2.0
"""A list of triggers to samples, through the same mixer that plays live."""

from collections.abc import Iterator

import numpy as np

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.clock import NEAREST
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.mixer_layout import RING

FEED = RING // 16  # what the mixer takes in one call


def play(
    mixer: Mixer, rows: np.ndarray, frames: int, block_size: int = 512
) -> Iterator[np.ndarray]:
    """Yield `frames` frames in blocks (block_size, channels) f4; the last may be shorter.

    `rows` (n,) VOICE count their time from the first frame; one at t sounds from frame
    round(t * sample_rate) on, exactly. The mixer must be new: its limiter's delay is run in before
    the first frame, so that a live stream and a file have the same samples at the same times.
    """
    rows = rows[np.argsort(rows['time_s'], kind='stable')]
    due = np.floor(rows['time_s'] * mixer.sample_rate + NEAREST) - mixer.look_ahead
    mixer.state['frame'] = -mixer.look_ahead
    fed, done = 0, -mixer.look_ahead
    while done < frames:
        end = min(done + block_size, 0 if done < 0 else frames)
        until = int(np.searchsorted(due, end))
        while until - fed > FEED:  # more at once than it takes in a call: take them without time
            mixer.push(rows[fed : fed + FEED])
            fed += FEED
            mixer.render(0)
        mixer.push(rows[fed:until])
        fed = max(fed, until)
        block = mixer.render(end - done)
        if done >= 0:
            yield block
        done = end


def render_all(
    mixer: Mixer, triggers: np.ndarray, bank: Bank, frames: int, block_size: int = 512
) -> np.ndarray:
    """Play triggers into an array, as the node sound plays them live.

    Parameters
    ----------
    mixer : Mixer
        A new one.
    triggers : ndarray
        (n,) TRIGGER, times from the first frame on; those refused count as dropped.
    bank : Bank
        What their grains are read from.
    frames : int
        How many to render.
    block_size : int
        Frames at a time.

    Returns
    -------
    ndarray
        (frames, channels) float32.

    Examples
    --------
    >>> from eol_ros.core.sound.triggers import TRIGGER
    >>> tone = np.sin(2 * np.pi * 440 * np.arange(12000) / 48000).astype(np.float32)
    >>> trigger = np.zeros(1, TRIGGER)
    >>> trigger['time_s'], trigger['gain'], trigger['rate'] = 0.1, 0.5, 1.0
    >>> bank = Bank([tone], [0], [0.0], [0.25], 48000)
    >>> sound = render_all(Mixer(48000), trigger, bank, 24000)
    >>> int(np.flatnonzero(np.abs(sound[:, 0]) > 1e-4)[0]) // 48  # ms
    100
    """
    rows = voice_rows(triggers, bank, mixer.channels)
    mixer.state['dropped'] += len(triggers) - len(rows)
    blocks = list(play(mixer, rows, frames, block_size))
    return np.concatenate(blocks) if blocks else np.zeros((0, mixer.channels), np.float32)

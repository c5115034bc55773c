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
    """Return (frames, channels) f4 of `triggers` (n,) TRIGGER; those refused count as dropped."""
    rows = voice_rows(triggers, bank, mixer.channels)
    mixer.state['dropped'] += len(triggers) - len(rows)
    blocks = list(play(mixer, rows, frames, block_size))
    return np.concatenate(blocks) if blocks else np.zeros((0, mixer.channels), np.float32)

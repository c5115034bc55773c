# SPDX-License-Identifier: Apache-2.0
"""What a microphone or contact pickup hears, block by block."""

import queue
from collections.abc import Iterator
from typing import Any

import numpy as np

from eol_ros.devices.audio.outputs import portaudio, reason
from eol_ros.errors import DeviceMissing

SILENT_S = 2.0  # an input that gives nothing for so long is gone


def inputs() -> list[str]:
    """Return the names of the inputs that there are."""
    return [d['name'] for d in portaudio().query_devices() if d['max_input_channels'] > 0]


class Microphone:
    """The first channel of input `device`, a name or part of one; auto: the default one.

    Raises DeviceMissing where it cannot be had, with the inputs that there are.
    """

    def __init__(self, device: str):
        sd, names = portaudio(), inputs()
        found = [n for n in names if device.lower() in n.lower()] if device != 'auto' else names
        if not found:
            there = f'there are: {", ".join(names)}' if names else 'there is none'
            raise DeviceMissing(f'sound input {device}: not there; {there}')
        self._blocks: queue.Queue[np.ndarray] = queue.Queue()
        try:
            self._stream: Any = sd.InputStream(
                device=None if device == 'auto' and sd.default.device[0] >= 0 else found[0],
                channels=1,
                dtype='float32',
                callback=self._hear,
            )
            self._stream.start()
        except (sd.PortAudioError, ValueError) as error:
            raise DeviceMissing(f'sound input {device}: {reason(error)}') from None
        self.rate = round(self._stream.samplerate)

    def __enter__(self) -> 'Microphone':
        return self

    def __exit__(self, *_error: Any) -> None:
        self._stream.close()

    def _hear(self, data: np.ndarray, frames: int, time: Any, status: Any) -> None:
        self._blocks.put(data[:, 0].copy())

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield what is heard, (n,) float32, for ever; DeviceMissing when nothing more comes."""
        while True:
            try:
                yield self._blocks.get(timeout=SILENT_S)
            except queue.Empty:
                raise DeviceMissing('the sound input gives nothing any more') from None

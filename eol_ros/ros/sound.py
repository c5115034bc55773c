# SPDX-License-Identifier: Apache-2.0
"""What the sound node publishes of its output: figures and samples."""

from array import array

import numpy as np
from eol_msgs.msg import SoundMeter, SoundSamples

from eol_ros.core.sound.meter import Reading
from eol_ros.core.sound.mixer import Mixer
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import NS, to_msg
from eol_ros.settings import SoundSettings

SAMPLES_HZ = 60.0


def meter_message(
    reading: Reading, epoch_ns: int, state: np.void, device: str, settings: SoundSettings
) -> SoundMeter:
    """Return the message of a reading; `state` is the mixer's."""
    message = SoundMeter(
        device=device,
        sample_rate=settings.sample_rate,
        block_size=settings.block_size,
        latency=settings.latency_s,
        voices=reading.voices,
        load=reading.load,
        peak_dbfs=reading.peak_dbfs,
        rms_dbfs=reading.rms_dbfs,
        limiter_db=reading.limiter_db,
        governor_db=reading.governor_db,
        wave_min=array('f', reading.wave_min.astype(np.float32).tobytes()),
        wave_max=array('f', reading.wave_max.astype(np.float32).tobytes()),
        spectrum_db=array('f', reading.spectrum_db.tobytes()),
        **{k: int(state[k]) for k in ('triggers', 'underruns', 'late', 'dropped', 'stolen')},
    )
    message.header.stamp = to_msg(epoch_ns + round(reading.time_s * 1e9))
    return message


class SampleStream:
    """The output as messages, often enough to be heard at once, and none while nobody listens."""

    def __init__(self, node: EolNode, mixer: Mixer, epoch_ns: int):
        self._mixer, self._epoch_ns = mixer, epoch_ns
        self._publisher = node.publisher('sound_samples')
        self._sent = 0
        self._node = node
        self._timer = node.create_timer(1 / SAMPLES_HZ, self._send, autostart=False)

    @property
    def heard(self) -> bool:
        """Whether somebody listens."""
        return self._publisher.get_subscription_count() > 0

    def look(self) -> None:
        """Begin if somebody listens; to be called now and then."""
        if self._timer.is_canceled() and self.heard:
            self._sent = int(self._mixer.state['frame'][0])
            self._node.resume(self._timer)

    def _send(self) -> None:
        new = int(self._mixer.state['frame'][0]) - self._sent
        if not self.heard:
            self._timer.cancel()
        elif new > 0:
            self._sent += new
            self._publisher.publish(self._message(self._sent, new))

    def _message(self, end: int, count: int) -> SoundSamples:
        mixer = self._mixer
        frames = mixer.recent(count, end)
        first = end - len(frames)
        message = SoundSamples(
            sample_rate=int(mixer.sample_rate),
            channels=mixer.channels,
            first=max(0, first),
            samples=array('f', frames.astype(np.float32).tobytes()),
        )
        message.header.stamp = to_msg(self._epoch_ns + round(mixer.time_of(first) * NS))
        return message

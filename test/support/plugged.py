# SPDX-License-Identifier: Apache-2.0
"""JACK's dummy driver as the sound card of a test."""

import os
import time

import pytest

from eol_ros.errors import DeviceMissing
from support import needs
from support.jack import Jack


def plugged(monkeypatch, here=True, channels=2):
    """Yield a running card for one test; skip where JACK or PortAudio is missing.

    `here`: PortAudio of this process shall see it. It must not, if the card goes during the test.
    """
    needs.system('jackd2', 'libportaudio2')
    import sounddevice as sd

    jack = Jack(f'eol-test-{os.getpid()}-{time.monotonic_ns() % 10**6}', channels=channels)
    for name, value in jack.environment.items():
        monkeypatch.setenv(name, value)
    try:
        jack.start()
    except DeviceMissing as error:
        pytest.skip(str(error))
    if here:
        sd._terminate()
        sd._initialize()
    yield jack
    if here:
        sd._terminate()  # before its server is gone: after that it would abort the process
    jack.stop()
    if here:
        sd._initialize()

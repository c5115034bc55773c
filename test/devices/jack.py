# SPDX-License-Identifier: Apache-2.0
"""A sound card for tests: JACK's dummy driver, which keeps real time and needs no hardware."""

import os
import shutil
import subprocess
import time

import pytest

FS, PERIOD = 48000, 256


class Jack:
    """A JACK server of its own; `start` and `stop` plug the card in and out."""

    def __init__(self, name: str):
        self.name = name
        self.process = None

    def start(self) -> None:
        """Plug the card in."""
        words = ['-n', self.name, '-d', 'dummy', '-r', str(FS), '-p', str(PERIOD)]
        for real_time in (['-R', '-P', '70'], ['-r']):  # the second where that is not allowed
            self.process = subprocess.Popen(
                ['jackd', *real_time, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            deadline = time.monotonic() + 3
            while time.monotonic() < deadline and self.process.poll() is None:
                time.sleep(0.1)
                if self.ready():
                    return
            self.stop()
        pytest.skip('jackd does not start here')

    def ready(self) -> bool:
        """Whether clients can connect."""
        found = subprocess.run(
            ['jack_wait', '-c', '-s', self.name], capture_output=True, text=True, timeout=5
        ) if shutil.which('jack_wait') else None
        return found is None or 'not running' not in found.stdout + found.stderr

    def stop(self) -> None:
        """Pull the card out."""
        if self.process is not None:
            self.process.terminate()  # killed, it would leave its name taken: there are eight
            try:
                self.process.wait(3)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
            self.process = None


def plugged(monkeypatch, here=True):
    """Yield a running card for one test; skip where JACK or PortAudio is missing.

    `here`: PortAudio of this process shall see it. It must not, if the card goes during the test.
    """
    if not shutil.which('jackd'):
        pytest.skip('jackd is not installed (apt-get install jackd2)')
    try:
        import sounddevice as sd
    except OSError:
        pytest.skip('PortAudio is not installed (apt-get install libportaudio2)')
    jack = Jack(f'eol-test-{os.getpid()}-{time.monotonic_ns() % 10**6}')
    monkeypatch.setenv('JACK_DEFAULT_SERVER', jack.name)
    monkeypatch.setenv('JACK_NO_START_SERVER', '1')
    jack.start()
    if here:
        sd._terminate()
        sd._initialize()
    yield jack
    if here:
        sd._terminate()  # before its server is gone: after that it would abort the process
    jack.stop()
    if here:
        sd._initialize()

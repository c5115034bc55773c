# SPDX-License-Identifier: Apache-2.0
"""A sound card to measure and test with: JACK's dummy driver keeps real time, needs no hardware."""

import os
import shutil
import signal
import subprocess
import time

from eol_ros import parent_death
from eol_ros.errors import DeviceMissing

FS, PERIOD = 48000, 256
PATIENCE_S = 10.0  # until a server answers


class Jack:
    """A JACK server of its own; `start` and `stop` plug the card in and out."""

    def __init__(self, name: str, period: int = PERIOD, channels: int = 2):
        self.name, self.period, self.channels = name, period, channels
        self.process: subprocess.Popen | None = None

    @property
    def environment(self) -> dict[str, str]:
        """What a process must be given to find this card and start no other."""
        return {'JACK_DEFAULT_SERVER': self.name, 'JACK_NO_START_SERVER': '1'}

    def start(self) -> None:
        """Plug the card in; raises DeviceMissing where that cannot be."""
        if not shutil.which('jackd'):
            raise DeviceMissing('jackd is not installed; apt-get install jackd2')
        words = ['-n', self.name, '-d', 'dummy', '-r', str(FS), '-p', str(self.period)]
        words += ['-P', str(self.channels)]
        for real_time in (['-R', '-P', '70'], ['-r']):  # the second where that is not allowed
            self.process = subprocess.Popen(
                ['jackd', *real_time, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                preexec_fn=parent_death.following(signal.SIGTERM),
            )  # fmt: skip
            deadline = time.monotonic() + PATIENCE_S
            while time.monotonic() < deadline and self.process.poll() is None:
                time.sleep(0.1)
                if self.ready():
                    return
            self.stop()
        raise DeviceMissing('jackd does not start')

    def ready(self) -> bool:
        """Whether clients can connect, and find its outputs."""
        if not shutil.which('jack_lsp'):
            return True
        try:
            found = subprocess.run(
                ['jack_lsp', '-s', self.name],
                capture_output=True,
                text=True,
                timeout=5,
                env={**os.environ, 'JACK_NO_START_SERVER': '1'},
            )
        except subprocess.TimeoutExpired:
            return False
        return f'playback_{self.channels}' in found.stdout

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


def served(name, monkeypatch):
    """Yield a server for one test, which clients of this process find."""
    jack = Jack(name)
    for variable, value in jack.environment.items():
        monkeypatch.setenv(variable, value)
    jack.start()
    yield jack
    jack.stop()

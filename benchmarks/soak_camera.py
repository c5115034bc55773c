# SPDX-License-Identifier: Apache-2.0
"""The part of the soak's faults in which the camera is pulled out: one with sockets, not the twin.

The museum's scene sees a film through Aravis' simulated GigE Vision camera, which is a process of
its own (test/support/gige.py). Killed it is a cable that was cut, and another camera afterwards;
stopped it is one that hangs, and goes on as if nothing had been. Its status must say so meanwhile.
"""

import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml
from support import gige as simulated
from support.running import Film, Graph, stand_in

from benchmarks.soak_faults import HELD_S, Soak, summary, unreported
from eol_ros import parent_death
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.files import calibration_file
from eol_ros.errors import EolError
from eol_ros.verbs.progress import track

SIZE, FPS = (640, 400), 30.0
FILM_S = 4.0
PAUSE_S = 5.0  # between two faults


class CameraSoak(Soak):
    """The museum before a camera that can be pulled out."""

    def _begin(self) -> None:
        calibration = self.folder / 'camera.yaml'
        calibration_file.save(calibration, Calibration.ideal(*SIZE))
        film = Film(self.folder, FILM_S, FPS, SIZE)
        self.said: list[float | None] = []  # after how long the status told, of each fault
        self._file = film.file()
        self._camera = self.plug_camera()
        self._stack.callback(self.unplug_camera)
        changed: dict[str, dict[str, Any]] = {
            'recorder': {'images': 'none', 'min_free_gb': 0.1}, 'sound': {'device': 'wav'},
            'tracker': {'calibration': str(calibration)},
        }  # fmt: skip
        path = stand_in('museum', self.folder, film, bag=None, changed=changed)
        values = yaml.safe_load(path.read_text())
        values['nodes']['camera'] |= {
            'device': 'genicam:127.0.0.1', 'width': SIZE[0], 'height': SIZE[1], 'fps': FPS,
        }  # fmt: skip
        path.write_text(yaml.safe_dump(values, sort_keys=False))
        self.log = self.folder / 'museum.log'
        self.graph = Graph(path, self.folder / 'bags', watched=('blocks',))
        self._stack.callback(self._end)
        self.graph.wait_until_ok()
        self.await_well()

    def plug_camera(self) -> subprocess.Popen[str]:
        """Put the camera in."""
        camera = subprocess.Popen(
            [sys.executable, simulated.__file__, str(self._file)],
            stdout=subprocess.PIPE, text=True,
            preexec_fn=parent_death.following(),
        )  # fmt: skip
        assert camera.stdout is not None
        if not camera.stdout.readline():
            raise EolError('the simulated camera does not start')
        return camera

    def unplug_camera(self) -> None:
        """Pull the camera out."""
        self._camera.kill()
        self._camera.communicate()

    def pull(self, kind: str) -> None:
        """Kill or stop the camera, let it be so for a while, and bring it back."""

        def out() -> None:
            if kind == 'camera killed':
                self.unplug_camera()
            else:
                os.kill(self._camera.pid, signal.SIGSTOP)
            self._hear()
            if kind == 'camera killed':
                self._camera = self.plug_camera()
            else:
                os.kill(self._camera.pid, signal.SIGCONT)

        self.fault(kind, 'camera', out)

    def _hear(self) -> None:
        """Wait; note since when the status has told that there is no camera."""
        begun, told = time.monotonic(), None
        while time.monotonic() - begun < HELD_S:
            if rows := self.rows():
                now = round(time.monotonic() - begun, 2)
                told = (told or now) if rows['camera']['level'] else None
            time.sleep(0.1)
        self.said.append(told)


KINDS = 'camera killed', 'camera stopped'
PULLS_IN_2_H = 20


def measure(folder: Path, hours: float) -> dict[str, Any]:
    """Pull the camera out as often as `hours` ask for, twice at least; return the figures."""
    folder = Path(tempfile.mkdtemp(prefix='camera-', dir=folder))
    count = max(round(PULLS_IN_2_H * hours / 2), len(KINDS))
    soak = CameraSoak(folder, 0)
    faults: list[str] = []
    begun = time.monotonic()
    try:
        for kind in track(list(itertools.islice(itertools.cycle(KINDS), count)), 'camera'):
            soak.pull(kind)
            time.sleep(PAUSE_S)
    except EolError as error:
        faults.append(str(error))
    try:
        code, bags = soak.prove()
    finally:
        soak.close()
    faults += [f'exit code {code}'] if code else []
    faults += unreported(soak.observed)
    faults += ['a camera that was pulled out is not told' for told in soak.said if told is None]
    return {
        'hours': round((time.monotonic() - begun) / 3600, 4), 'observer': soak.observed,
        'said_s': soak.said, 'bags': bags, **summary(soak.events, faults + bags['faults']),
    }  # fmt: skip

# SPDX-License-Identifier: Apache-2.0
"""The unit of `eol service` under systemd itself, the first process of namespaces of its own.

What is not tried so: PrivateTmp (the clone of a test may lie in /tmp), the journal, and which
devices may be opened.
"""

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from support import needs
from support.checkout import ROOT
from support.waiting import wait_until

from eol_ros import cli

pytestmark = [pytest.mark.soak, pytest.mark.timeout(600), needs.marker('systemd', 'iproute2')]
SYSTEMD = Path('/lib/systemd/systemd')
TARGETS = 'basic', 'sysinit', 'shutdown', 'umount', 'multi-user', 'final', 'exit'
REPLAY = f'replay: {{bag: {ROOT}/bags/sample, loop: true}}'
SCENE = f'nodes: {{{REPLAY}, motion: {{}}, recorder: false}}\n'  # OK where blocks pass between them
BEGIN = """
mount --make-rprivate / && mount -t proc proc /proc && mount -t tmpfs tmpfs /run &&
mount -t tmpfs tmpfs /dev/shm && mount -t cgroup2 cgroup2 /sys/fs/cgroup &&
ip link set lo up && export container=lxc SYSTEMD_UNIT_PATH=$1 &&
exec /lib/systemd/systemd --system --log-target=console
"""


class Systemd:
    """systemd with the unit in `folder`, in a group of its own."""

    def __init__(self, folder):
        roots = [Path('/sys/fs/cgroup/unified'), Path('/sys/fs/cgroup')]
        root = next((r for r in roots if (r / 'cgroup.procs').exists()), None)
        if os.geteuid() or root is None or not SYSTEMD.exists():
            pytest.skip('to run systemd takes root and control groups of version 2')
        self._group = root / f'eol-test-{os.getpid()}'
        self._group.mkdir()
        kinds = ('mount', 'pid', 'net', 'uts', 'ipc', 'cgroup')
        self._log = folder / 'systemd.log'
        with self._log.open('w') as log:
            self._outside = subprocess.Popen(
                ['unshare', '--fork', *(f'--{kind}' for kind in kinds), 'sh', '-c', BEGIN, 'sh',
                 str(folder / 'units')],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                preexec_fn=lambda: (self._group / 'cgroup.procs').write_text('0'),
            )  # fmt: skip
        children = Path(f'/proc/{self._outside.pid}/task/{self._outside.pid}/children')
        self.pid = wait_until(lambda: int((children.read_text().split() or ['0'])[0]))

    def ctl(self, *words):
        command = ['nsenter', '-t', str(self.pid), '-m', '-p', '-n', '-C', 'systemctl', *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=150)
        return done.stdout + done.stderr

    def state(self):
        """Return what the unit's properties are, and the process of bringup, seen from here."""
        text = self.ctl('show', 'eol', '-p', 'ActiveState,SubState,Result,StatusText,NRestarts')
        return dict(line.split('=', 1) for line in text.splitlines() if '=' in line)

    def wait_until(self, condition, seconds):
        """Wait, looking once a second; fail with how it is."""
        wait_until(condition, seconds, turn=lambda: time.sleep(1), why=lambda: str(self.state()))

    def bringup(self):
        """Return the pid, out here, of the unit's main process."""
        main = re.search(r'MainPID=(\d+)', self.ctl('show', 'eol', '-p', 'MainPID'))
        inside = int(main[1]) if main else 0
        for status in Path('/proc').glob('[0-9]*/status'):
            try:
                numbers = re.search(r'NSpid:\t(\d+)\t(\d+)\n', status.read_text())
            except OSError:
                continue
            if inside and numbers and int(numbers[2]) == inside:
                return int(numbers[1])
        return 0

    def close(self):
        os.kill(self.pid, signal.SIGKILL)  # and with it all that is in its namespace
        self._outside.wait(20)
        groups = sorted(self._group.rglob('*/'), reverse=True)
        for group in [*groups, self._group]:
            wait_until(lambda group=group: _gone(group), 20)


def _gone(group):
    try:
        group.rmdir()
    except OSError:
        return not group.exists()
    return True


@pytest.fixture
def unit(tmp_path, monkeypatch):
    """A function that starts systemd with the unit of a scene, which then is another."""
    (tmp_path / 'state').mkdir()
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    systemds = []

    def start(scene, then=None):
        (tmp_path / 'museum.yaml').write_text(scene)
        command = ['service', 'install', str(tmp_path / 'museum.yaml'), '--output', str(tmp_path)]
        assert cli.main(command) == 0
        (tmp_path / 'museum.yaml').write_text(then or scene)
        units = tmp_path / 'units'
        units.mkdir()
        for name in TARGETS:
            shutil.copy(f'/lib/systemd/system/{name}.target', units)
        (units / 'default.target').write_text('[Unit]\nWants=eol.service\n')
        said = tmp_path / 'said.log'
        text = (tmp_path / 'etc/systemd/system/eol.service').read_text()
        text = text.replace('PrivateTmp=yes', 'PrivateTmp=no')
        text = text.replace(
            '[Service]\n',
            f'[Service]\nStandardOutput=append:{said}\nStandardError=append:{said}\n',
        )
        (units / 'eol.service').write_text(text)
        systemds.append(Systemd(tmp_path))
        return systemds[-1]

    yield start
    for systemd in systemds:
        systemd.close()


def test_it_starts_is_started_again_and_stops(unit):
    """Killed; silent for its 30 s; stopped as asked, which is no failure."""
    systemd = unit(SCENE)

    def well(restarts):
        state = systemd.state()
        return (
            (state.get('ActiveState'), state.get('SubState')) == ('active', 'running')
            and 'all OK' in state.get('StatusText', '')
            and int(state['NRestarts']) == restarts
        )

    systemd.wait_until(lambda: well(0), 120)
    os.kill(systemd.bringup(), signal.SIGKILL)
    systemd.wait_until(lambda: well(1), 60)
    os.kill(systemd.bringup(), signal.SIGSTOP)
    systemd.wait_until(lambda: well(2), 120)
    systemd.ctl('stop', 'eol')
    state = systemd.state()
    assert (state['ActiveState'], state['Result']) == ('inactive', 'success'), state


def test_a_wrong_scene_is_not_tried_again(unit):
    systemd = unit(SCENE, then=SCENE.replace('motion: {}', 'motion: {stop_s: -1}'))
    systemd.wait_until(lambda: systemd.state().get('ActiveState') == 'failed', 60)
    state = systemd.state()
    assert (state['Result'], state['NRestarts']) == ('exit-code', '0')

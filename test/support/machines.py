# SPDX-License-Identifier: Apache-2.0
"""Several machines on one cable: network namespaces around a bridge.

The first one is the machine of the work, with this machine's own shared memory; each other has its
own.
"""

import os
import subprocess

import pytest

from support import needs

DOMAIN = '61'


class Machines:
    """Network namespaces; the n-th has the address `net.n` and the name that it is given."""

    def __init__(self, *names):
        self.names = {name: f'eol-{name}-{os.getpid()}' for name in names}
        self.work = names[0]
        self.net = f'192.168.{os.getpid() % 250}'
        self.variables = {}  # of the environment, by machine

    def start(self):
        """Make them; skip the test where that is not permitted."""
        needs.system('iproute2')
        first, *others = self.names.values()
        try:
            ip('netns', 'add', first)
        except subprocess.CalledProcessError as error:
            pytest.skip(f'network namespaces are not permitted here: {error.stderr.strip()}')
        ip('-n', first, 'link', 'add', 'cable', 'type', 'bridge')
        for i, name in enumerate(others):
            ip('netns', 'add', name)
            ip(
                '-n',
                first,
                'link',
                'add',
                f'port{i}',
                'type',
                'veth',
                'peer',
                'cable',
                'netns',
                name,
            )
            ip('-n', first, 'link', 'set', f'port{i}', 'master', 'cable', 'up')
        for i, name in enumerate(self.names.values()):
            ip('-n', name, 'addr', 'add', f'{self.net}.{i + 1}/24', 'dev', 'cable')
            for link in ('lo', 'cable'):
                ip('-n', name, 'link', 'set', link, 'up')

    def stop(self):
        """Remove them, and whatever runs in them."""
        for name in self.names.values():
            pids = subprocess.run(
                ['ip', 'netns', 'pids', name], check=False, capture_output=True, text=True
            ).stdout.split()
            subprocess.run(['kill', '-9', *pids], check=False, capture_output=True)
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)

    def address(self, machine):
        """Return the address of a machine on the cable."""
        return f'{self.net}.{list(self.names).index(machine) + 1}'

    def run(self, machine, *command, **variables):
        """Start a command on a machine; stock transports, unless it sets its own."""
        env = {k: v for k, v in os.environ.items()
               if not k.startswith(('FASTRTPS', 'FASTDDS', 'ROS_', 'RMW_'))}  # fmt: skip
        env |= {'ROS_DOMAIN_ID': DOMAIN, **self.variables.get(machine, {}), **variables}
        if machine != self.work:
            # also of what WireGuard in user space talks through, which is named by its interface
            private = (
                'mkdir -p /var/run/wireguard; mount -t tmpfs tmpfs /var/run/wireguard; '
                'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
            )
            command = ('unshare', '-m', 'sh', '-c', private, 'sh', *command)
        return subprocess.Popen(
            ['ip', 'netns', 'exec', self.names[machine], *command],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env,
        )  # fmt: skip


def ip(*words):
    """Run `ip`."""
    subprocess.run(['ip', *words], check=True, capture_output=True, text=True)


def answer(child, seconds=40):
    """Return what a command said when it has ended well."""
    out, err = child.communicate(timeout=seconds)
    assert child.returncode == 0, err
    return out

# SPDX-License-Identifier: Apache-2.0
"""Several machines on one cable: network namespaces around a bridge.

The first one is the machine of the work, with this machine's own shared memory; each other has its
own.
"""

import contextlib
import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO

import pytest

from eol_ros import folders, parent_death
from eol_ros.bringup import status
from eol_ros.errors import EolError
from support import native

DOMAIN = '61'
SLOW_CABLE = Path(__file__).with_name('slow_cable.c')


class Machines:
    """Network namespaces; the n-th has the address `net.n` on the cable, and a name.

    A context that removes them; it skips the test if they are unavailable. `variables`:
    environment variables of each machine.
    """

    def __init__(self, *names: str):
        self.names = {name: f'eol-{name}-{os.getpid()}' for name in names}
        self.work = names[0]
        self.net = f'192.168.{os.getpid() % 250}'
        self.variables: dict[str, dict[str, str]] = {}

    def __enter__(self) -> 'Machines':
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self.stop()

    def start(self) -> None:
        """Make them."""
        require(['ip'])
        first, *others = self.names.values()
        try:
            ip('netns', 'add', first)
        except subprocess.CalledProcessError as error:
            pytest.skip(f'network namespaces are not permitted: {error.stderr.strip()}')
        ip('-n', first, 'link', 'add', 'cable', 'type', 'bridge')
        for name in others:
            ip('netns', 'add', name)
        for machine, name in self.names.items():
            ip('-n', name, 'link', 'set', 'lo', 'up')
            if machine != self.work:
                self._lay(machine)
            self._connect(machine)

    def port(self, machine: str) -> str:
        """Return the end of the cable of another machine at that of the work."""
        return f'port{list(self.names).index(machine)}'

    def _lay(self, machine: str) -> None:
        cable = [self.port(machine), 'type', 'veth', 'peer', 'cable', 'netns', self.names[machine]]
        ip('-n', self.names[self.work], 'link', 'add', *cable)

    def _connect(self, machine: str) -> None:
        name, number = self.names[machine], list(self.names).index(machine) + 1
        if machine != self.work:
            port = self.port(machine)
            ip('-n', self.names[self.work], 'link', 'set', port, 'master', 'cable', 'up')
        # the same one with another cable: others remember it
        ip('-n', name, 'link', 'set', 'cable', 'address', f'02:00:00:00:00:{number:02x}')
        ip('-n', name, 'addr', 'add', f'{self.address(machine)}/24', 'dev', 'cable')
        ip('-n', name, 'link', 'set', 'cable', 'up')

    def stop(self) -> None:
        """Remove them, and whatever runs in them."""
        for machine, name in self.names.items():
            self.kill(machine)
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)

    def address(self, machine: str) -> str:
        """Return the address of a machine on the cable."""
        return f'{self.net}.{list(self.names).index(machine) + 1}'

    def run(self, machine: str, *command: str, **variables: str) -> subprocess.Popen[str]:
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
            preexec_fn=parent_death.following(),
        )  # fmt: skip

    def eol(self, machine: str, *words: str) -> str:
        """Return what `eol` says there."""
        return answer(self.run(machine, sys.executable, '-m', 'eol_ros', *words))

    def status(self, machine: str) -> dict[str, dict[str, Any]]:
        """Return what the bringup of a machine says of each node; nothing if none answers."""
        network = f'/run/netns/{self.names[machine]}'
        with open('/proc/thread-self/ns/net') as ours, open(network) as at:
            try:
                _enter(at)  # the socket of the status is of this network
                return {row['node']: row for row in status.ask(int(DOMAIN))['nodes']}
            except EolError:
                return {}
            finally:
                _enter(ours)

    @contextlib.contextmanager
    def losing(self, percent: int) -> Iterator[Callable[[], int]]:
        """Lose packets that come over the cable, at random; yield what returns their count."""
        require(['nft'])
        rules = (
            'table ip loss { chain lose { type filter hook input priority 0; '
            f'iifname "cable" numgen random mod 100 < {percent} counter drop; }}; }}'
        )

        def nft(name: str, *words: str) -> str:
            command = ['ip', 'netns', 'exec', name, 'nft', *words]
            return subprocess.run(command, check=True, capture_output=True, text=True).stdout

        def lost() -> int:
            tables = [nft(name, 'list', 'table', 'ip', 'loss') for name in self.names.values()]
            return sum(
                int(count) for text in tables for count in re.findall(r'packets (\d+)', text)
            )

        try:
            for name in self.names.values():
                nft(name, rules)
        except subprocess.CalledProcessError as error:
            if 'Could not process rule' not in error.stderr:  # by a kernel without it
                raise AssertionError(error.stderr) from None
            pytest.skip(f'no packets can be lost here: {error.stderr.strip()}')
        try:
            yield lost
        finally:
            for name in self.names.values():
                nft(name, 'delete', 'table', 'ip', 'loss')

    @contextlib.contextmanager
    def slow(self, machine: str, delay_ms: float, folder: Path) -> Iterator[None]:
        """Let all that goes over the cable of another machine take `delay_ms` each way."""
        native.assert_compiles(folder, '-O2', SLOW_CABLE, '-o', 'slow_cable')
        work, name, port = self.names[self.work], self.names[machine], self.port(machine)
        ip('-n', work, 'link', 'del', port)
        command = [folder / 'slow_cable', work, port, name, 'cable', f'{1e3 * delay_ms:.0f}']
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, preexec_fn=parent_death.following()
        ) as cable:
            assert cable.stdout
            try:
                if not cable.stdout.readline():
                    pytest.skip('no network device can be made here (/dev/net/tun)')
                self._connect(machine)
                yield
            finally:
                cable.kill()
        self._lay(machine)
        self._connect(machine)

    def mesh(self, folder: Path) -> None:
        """Connect all machines with each other by WireGuard, the n-th as 10.77.0.n."""
        require(['wg', 'wg-quick'])

        def wg(what: str, given: str = '') -> str:
            return subprocess.run(
                ['wg', what], input=given, check=True, capture_output=True, text=True
            ).stdout

        private = {name: wg('genkey') for name in self.names}
        numbers = {name: i for i, name in enumerate(self.names, 1)}
        for name, number in numbers.items():
            text = f'[Interface]\nAddress = 10.77.0.{number}/24\nListenPort = 51820\n'
            text += f'PrivateKey = {private[name]}'
            for other in numbers.keys() - {name}:
                text += (
                    f'[Peer]\n# {other}\nPublicKey = {wg("pubkey", private[other])}'
                    f'AllowedIPs = 10.77.0.{numbers[other]}/32\n'
                    f'Endpoint = {self.address(other)}:51820\n'
                )
            config = folder / name / 'eol0.conf'
            config.parent.mkdir()
            config.write_text(text)
            self.variables[name]['EOL_CONFIG'] = str(config.parent)
            self.own_cache(name, 'dds', config.parent / 'cache')  # the DDS profile has its address
            self.up(name)

    def own_cache(self, machine: str, part: str, folder: Path) -> None:
        """Give a machine its own cache, with links to all parts of the one it has but `part`."""
        folder.mkdir()
        before = self.variables[machine].get('EOL_CACHE') or folders.cache_path()
        for entry in Path(before).iterdir():
            if entry.name != part:
                (folder / entry.name).symlink_to(entry)
        self.variables[machine]['EOL_CACHE'] = str(folder)

    def kill(self, machine: str) -> None:
        """End all that runs on a machine, as a power cut does."""
        name = self.names[machine]
        pids = subprocess.run(
            ['ip', 'netns', 'pids', name], check=False, capture_output=True, text=True
        ).stdout.split()
        subprocess.run(['kill', '-9', *pids], check=False, capture_output=True)

    def let_in(self, guest: str, folder: Path) -> None:
        """Give the work keys, let `guest` in, and bring both ends of the tunnel up."""
        require(['wg', 'wg-quick', 'nft'])
        for name in (self.work, guest):
            self.variables.setdefault(name, {})['EOL_CONFIG'] = str(folder / name)
        self.eol(self.work, 'keys', 'make')
        theirs = folder / f'{guest}.conf'
        words = ['keys', 'add', guest, '--endpoint', self.address(self.work)]
        theirs.write_text(self.eol(self.work, *words))
        self.eol(guest, 'keys', 'join', str(theirs))
        for name in (self.work, guest):
            self.up(name)

    def up(self, machine: str) -> None:
        """Bring the tunnel up on a machine."""
        config = f'{self.variables[machine]["EOL_CONFIG"]}/eol0.conf'
        answer(self.run(machine, 'wg-quick', 'up', config))


def _enter(network: TextIO) -> None:
    """Let this thread be of another network namespace (`os.setns` is Python 3.12's)."""
    if ctypes.CDLL(None, use_errno=True).setns(network.fileno(), 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def require(programs: Iterable[str]) -> None:
    """Skip the test where one of the programs is missing."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(
                f'no {program} here: apt-get install iproute2 wireguard-tools wireguard-go nftables'
            )


def ip(*words: str) -> None:
    """Run `ip`."""
    subprocess.run(['ip', *words], check=True, capture_output=True, text=True)


def answer(child: subprocess.Popen[str], seconds: float = 100.0) -> str:
    """Return what a command said when it has ended well."""
    out, err = child.communicate(timeout=seconds)
    assert child.returncode == 0, err
    return out

# SPDX-License-Identifier: Apache-2.0
"""The running graph answers for itself: an abstract Unix socket, one per DDS domain and namespace.

The kernel frees its name when the process ends, however it ends, so it is also the lock that
keeps a second bringup off the same topics.
"""

import contextlib
import json
import re
import socket
import struct
from pathlib import Path
from typing import Any

from eol_ros.errors import ConfigError, DeviceMissing, SupervisorSilent, UsageError
from eol_ros.said import Said, code_and_args
from eol_ros.scene import check_namespace
from eol_ros.streams.graph import NAMESPACE

LATENCIES = ('image_to_blocks', 'onset_to_light', 'onset_to_sound')  # see ros.health
UNIT = Path('/etc/systemd/system/eol.service')  # of `eol service`
WORDS = ('ok', 'WARN', 'ERROR', 'starting', 'down')


def _address(domain: int, namespace: str) -> str:
    return f'\0eol_ros-domain-{domain}/{namespace}'


def namespaces(domain: int) -> list[str]:
    """Return the namespaces of the graphs that were started on `domain` of this machine."""
    prefix = _address(domain, '').replace('\0', '@')
    names = (line.split()[-1] for line in Path('/proc/net/unix').read_text().splitlines())
    return sorted({name.removeprefix(prefix) for name in names if name.startswith(prefix)})


def namespace_of(asked: str | None, domain: int) -> str:
    """Return the namespace that a person means: the one asked for, else that of what runs here.

    Raises UsageError where several run, and none of them in the usual one.
    """
    if asked is not None:
        try:
            return check_namespace(asked)
        except ConfigError as error:
            raise UsageError(f'--namespace {error}') from None
    found = namespaces(domain)
    if len(found) > 1 and NAMESPACE not in found:
        raise UsageError(
            f'{len(found)} graphs run on domain {domain}: say which, --namespace '
            + ' or '.join(found)
        )
    return found[0] if len(found) == 1 else NAMESPACE


def listen(domain: int, namespace: str = NAMESPACE) -> socket.socket:
    """Return the listening socket of a graph; raise UsageError when it runs already."""
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        server.bind(_address(domain, namespace))
    except OSError:
        server.close()
        running, where = '', _where(domain, namespace)
        try:
            status = ask(domain, namespace=namespace)
            running = f' (scene {status["scene"]}, process {status["pid"]})'
        except SupervisorSilent as error:
            raise UsageError(f'a graph runs on {where} already, but {error}') from None
        except DeviceMissing:
            pass
        raise UsageError(
            f'a graph runs on {where} already{running}: stop it, or choose another domain '
            'with ROS_DOMAIN_ID, or another namespace in the scene'
        ) from None
    server.listen(socket.SOMAXCONN)  # those who gave up waiting stay in the queue
    server.setblocking(False)
    return server


def ask(domain: int, timeout_s: float = 2.0, namespace: str = NAMESPACE) -> dict[str, Any]:
    """Return the status of the graph on `domain`.

    Raises DeviceMissing when none runs, SupervisorSilent when its supervisor does not answer.
    """
    pid = 0
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(timeout_s)
        try:
            client.connect(_address(domain, namespace))
            credentials = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
            pid = struct.unpack('3i', credentials)[0]
            parts = []
            while part := client.recv(65536):
                parts.append(part)
        except (TimeoutError, BlockingIOError):  # the latter: even the queue is full
            raise SupervisorSilent(_silent(_where(domain, namespace), pid, timeout_s)) from None
        except OSError:
            parts = []
    if not parts:  # nobody listens, or not any more
        others = ', '.join(namespaces(domain))
        hint = f'--namespace {others}' if others else how_to_start()
        raise DeviceMissing(f'no graph runs on {_where(domain, namespace)}: {hint}')
    return json.loads(b''.join(parts))


def how_to_start() -> str:
    """Return the start that this machine uses: its service where one is installed."""
    try:
        found = re.search(r'^ExecStart=.* -m eol_ros\.bringup (.*)$', UNIT.read_text(), re.M)
    except OSError:
        found = None
    if found:
        return f'`sudo systemctl start {UNIT.stem}` starts scene {found[1]}'
    return '`eol run` starts the rehearsal, `eol run SCENE` another scene'


def _where(domain: int, namespace: str) -> str:
    where = '' if namespace == NAMESPACE else f' in namespace {namespace}'
    return f'domain {domain}{where}'


def _silent(where: str, pid: int, timeout_s: float) -> str:
    """Return what to do about a supervisor that has not answered; pid 0 is not known."""
    who = f'process {pid}' if pid else 'process not known'
    text = f'the supervisor of {where} ({who}) does not answer within {timeout_s:g} s: '
    if not pid:
        return text + 'find it with `pgrep -af eol_ros`'
    with contextlib.suppress(OSError):
        state = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0]
        if state in 'Tt':
            return text + f'it is stopped, `kill -CONT {pid}` lets it go on; its nodes run'
    return text + f'if that lasts, end it and its nodes with `kill -KILL {pid}`, and start again'


def answer(server: socket.socket, status: dict[str, Any]) -> None:
    """Send `status` to everybody who waits."""
    text = json.dumps(status, default=str).encode()
    while True:
        try:
            client, _ = server.accept()
        except BlockingIOError:
            return
        with client, contextlib.suppress(OSError):
            client.settimeout(0.2)
            client.sendall(text)


def of_work(text: Said) -> dict[str, Any]:
    """Return the state of the whole work as plain data."""
    code, args = code_and_args(text)
    return {'text': text, 'code': code, 'args': args}


def state(level: int, text: Said) -> dict[str, Any]:
    """Return the fields of a node's status that bringup sets itself."""
    code, args = code_and_args(text)
    return {'level': level, 'text': text, 'code': code, 'args': args}


def starting(node: str, text: Said, pid: int = 0) -> dict[str, Any]:
    """Return the status of a node that has reported none yet."""
    return {'node': node, 'rate': 0.0, 'pid': pid, 'values': {}, **state(3, text)}


def latencies(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return p50_ms and p99_ms of the last minute, by name, of what the nodes have measured."""
    values = {key: value for row in rows for key, value in row['values'].items()}
    shares = 'p50_ms', 'p99_ms'
    return {
        name: {share: values[f'{name}_{share}'] for share in shares}
        for name in LATENCIES
        if all(f'{name}_{share}' in values for share in shares)
    }


def table(status: dict[str, Any]) -> str:
    """Return the status as a table that stays put."""
    run_s = int(status['running_s'])
    days, rest = divmod(run_s, 86400)
    age = f'{days} d ' if days else ''
    age += f'{rest // 3600:02d}:{rest % 3600 // 60:02d}:{rest % 60:02d}'
    worst = max((row['level'] for row in status['nodes']), default=0)
    words = 'all good' if worst == 0 else f'worst: {WORDS[worst]}'
    wide = max(12, *(len(row['node']) + 2 for row in status['nodes']), 0)
    lines = [
        f'{status["scene"]}: {status["work"]["text"]}',
        f'{status["scene"]} in /{status["namespace"]}  running {age}  '
        f'restarts {status["restarts"]}  {words}',
        f'{"NODE":{wide}}{"STATE":10}{"RATE":>9}  NOTE',
    ]
    for row in status['nodes']:
        rate = f'{row["rate"]:.1f} Hz' if row['rate'] else '-'
        lines.append(f'{row["node"]:{wide}}{WORDS[row["level"]]:10}{rate:>9}  {row["text"]}')
    if found := status.get('latency'):
        told = (
            f'{name.replace("_", " ")} {of["p50_ms"]:.1f} / {of["p99_ms"]:.1f}'
            for name, of in found.items()
        )
        lines.append(f'latency, ms, p50 / p99 of the last minute: {", ".join(told)}')
    return '\n'.join(lines)

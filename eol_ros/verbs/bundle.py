# SPDX-License-Identifier: Apache-2.0
"""eol bundle: all that somebody far away needs to know to help, in one file and without secrets."""

import functools
import json
import os
import shutil
import subprocess
import sys
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

from eol_ros import folders
from eol_ros import scene as scenes
from eol_ros.errors import EolError, SupervisorSilent
from eol_ros.ros.run_record import versions
from eol_ros.scene_secrets import without
from eol_ros.verbs import reach

HELP = (
    'Collect what a maintainer needs to diagnose a fault: versions, machine, scene, state of the '
    'running graph, logs, devices, and metadata of the newest bags. It holds no recorded data, no '
    'images and no PIN.'
)
EXAMPLES = ['eol bundle museum', 'eol bundle my/scene.yaml --output for-support.zip']
NEWEST_BAGS = 5
LOG_BYTES = 5_000_000  # of the end of each log
JOURNAL = ['journalctl', '--no-pager', '--unit', 'eol', '--lines', '5000', '--output', 'short-iso']
COMMAND_S = 20.0  # no program that is asked may take longer


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'scene', nargs='?', default='museum', help='scene file, or name of a shipped scene'
    )
    parser.add_argument(
        '-o', '--output', metavar='FILE', default=time.strftime('eol-bundle-%Y%m%d-%H%M%S.zip'),
        help='the file to write (default: eol-bundle-DATE.zip here)',
    )  # fmt: skip
    parser.add_argument('--namespace', metavar='NAME', help=reach.NAMESPACE_HELP)


def run(args):
    """Write the file; what cannot be gathered is said in it, and stops nothing."""
    path = scenes.find(args.scene)  # a name that was mistyped is for the person who typed it
    try:
        hide = functools.partial(scenes.without_secrets, scenes.load(path))
    except scenes.SceneError as error:
        hide = functools.partial(without, secrets=error.scene.hidden if error.scene else ())
        print(f'eol bundle: {path} has mistakes; check.txt will list them', file=sys.stderr)
    folders.check_writable(args.output, '--output')
    parts: dict[str, Callable[[], str]] = {
        'about.json': lambda: _json(_about()),
        'scene.json': lambda: _json(_scene(args.scene)),
        'check.txt': lambda: _output('check', args.scene, '--devices'),
        'status.json': lambda: _json(_status(args)),
        'devices.json': lambda: _output('devices', '--json'),
        'bags.json': lambda: _json(_bags(args)),
        'journal.txt': _journal,
    }
    parts |= {f'logs/{path.name}': functools.partial(_end_of, path) for path in _logs()}
    try:
        _write(args.output, parts, hide)
    except BaseException:  # also Ctrl-C: half a bundle would pass for a whole one
        if (written := Path(args.output)).is_file():
            written.unlink()
        raise
    print(args.output)
    return 0


def _write(output: str, parts: dict[str, Callable[[], str]], hide: Callable[[str], str]) -> None:
    with zipfile.ZipFile(output, 'w', zipfile.ZIP_DEFLATED) as bundle:
        for name, part in parts.items():
            try:
                text = part()
            except EolError as error:
                text = f'{error}\n'
            except Exception:  # a fault of ours, or a file that may not be read: it helps too
                text = traceback.format_exc()
            bundle.writestr(name, hide(text).encode(errors='backslashreplace'))  # names are bytes
            print(f'eol bundle: {name}', file=sys.stderr)


def _about() -> dict:
    memory = Path('/proc/meminfo').read_text().splitlines()[:3]
    processor = {
        line.partition(':')[2].strip()
        for line in Path('/proc/cpuinfo').read_text().splitlines()
        if line.startswith('model name')
    }
    release = Path('/etc/os-release')
    return {
        'written': time.strftime('%Y-%m-%d %H:%M:%S %z'),
        'versions': versions(),
        'system': release.read_text().splitlines() if release.exists() else [],
        'processor': sorted(processor),
        'cores': len(os.sched_getaffinity(0)),
        'memory': memory,
        'load': os.getloadavg(),
        'up_s': float(Path('/proc/uptime').read_text().split()[0]),
        'groups': os.getgroups(),
        'environment': {
            k: v for k, v in os.environ.items()
            if k.startswith(('EOL_', 'ROS_', 'RMW_', 'FASTRTPS_', 'NUMBA_', 'XDG_')) or k == 'LANG'
        },
    }  # fmt: skip


def _scene(name: str) -> dict:
    scene = scenes.public(scenes.load(name))
    return {'path': str(scene.path), 'text': scene.text, 'settings': scenes.plain(scene)}


def _status(args) -> dict:
    try:
        return reach.status_of(args)
    except SupervisorSilent as error:
        return {'silent': str(error)}


def _output(verb: str, *words: str) -> str:
    """Return what another verb prints, and what it says; a driver that crashes ends it alone."""
    code, text = _asked([sys.executable, '-m', 'eol_ros', verb, *words])
    return text + (f'\nexit code {code}\n' if code else '')


def _folder(args) -> Path:
    """Return where the recorder that runs here writes; else what the scene says."""
    try:
        rows = reach.status_of(args)['nodes']
    except EolError:
        rows = []
    for row in rows:
        if row['node'] == 'recorder' and (bag := row['values'].get('bag')):
            return (Path(f'/proc/{row["pid"]}/cwd').resolve() / bag).parent
    return Path(scenes.load(args.scene).settings('recorder').folder).absolute()


def _bags(args) -> dict:
    from eol_ros.devices.bag.reader import BagReader

    folder = _folder(args)
    disk = shutil.disk_usage(folder) if folder.exists() else None
    newest = sorted(
        (p for p in folder.glob('*/') if any(p.glob('*.mcap*'))),
        key=lambda p: p.stat().st_mtime_ns,
        reverse=True,
    )
    rows = []
    for path in newest[:NEWEST_BAGS]:
        row: dict = {'bag': path.name, 'files': {f.name: f.stat().st_size for f in path.iterdir()}}
        try:
            bag = BagReader(path)
            row |= {
                'start_ns': bag.start_ns, 'duration_s': bag.duration_s, 'messages': bag.counts,
                'gaps': bag.gaps, 'cut_short': bag.cut_short, 'damage': bag.damage,
            }  # fmt: skip
        except EolError as error:
            row['error'] = str(error)
        rows.append(row)
    return {
        'folder': str(folder), 'free_bytes': disk.free if disk else None, 'bags': len(newest),
        'newest': rows,
    }  # fmt: skip


def _journal() -> str:
    if not shutil.which(JOURNAL[0]):
        return 'this machine has no journalctl\n'
    return _asked(JOURNAL)[1]


def _asked(command: list[str]) -> tuple[int, str]:
    """Return the exit code of a program, and all that it wrote."""
    try:
        done = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            encoding='utf-8', errors='replace', timeout=COMMAND_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        written = (late.output or b'').decode('utf-8', 'replace')
        return 1, f'{written}{Path(command[0]).name} did not answer within {COMMAND_S:g} s\n'
    return done.returncode, done.stdout


def _logs() -> Iterator[Path]:
    try:
        names = sorted(folders.state_path().iterdir())
    except OSError:
        return
    yield from (p for p in names if p.is_file() and '.log' in p.name)


def _end_of(path: Path) -> str:
    with path.open('rb') as file:
        file.seek(max(0, path.stat().st_size - LOG_BYTES))
        return file.read().decode(errors='replace')


def _json(answer: dict) -> str:
    return json.dumps(answer, indent=2, default=str)

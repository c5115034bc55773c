# SPDX-License-Identifier: Apache-2.0
"""Prepares `.venv` (or $EOL_VENV): wheels, messages and compiled kernels.

Called by tools/setup_env.sh, with the system's Python and nothing but its standard library. Wheels
and messages are built at the same time. A finished step leaves a stamp in `.venv` and is not
repeated.
"""

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / os.environ.get('EOL_VENV', '.venv')
PYTHON = VENV / 'bin' / 'python'
MESSAGES = ROOT / 'msg_defs' / 'eol_msgs'
LOCKS = ROOT / 'tools' / 'requirements'
BROWSER = LOCKS / 'browser'  # what the tests put into a browser: npm's own list and lock
# Test packages that the tests of the pure core do not need, by the beginning of their names.
NOT_CORE = ('ros-', 'colcon-', 'cmake', 'ninja', 'dask', 'distributed', 'mypy', 'ruff',
            'selenium', 'trio')  # fmt: skip
# Other extras whose wheels suffice for an extra ('' is a run).
ENOUGH = {'': ('test', 'bench'), 'core': ('test', 'bench')}


class SetupFailed(Exception):
    """A step did not succeed; its words are for the person at the terminal."""


def say(text: str) -> None:
    """Print a line for people."""
    print(text, file=sys.stderr, flush=True)


def digest(*paths: Path) -> str:
    """Return a short name of the contents of files."""
    found = hashlib.sha256()
    for path in paths:
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def command(name: str, *words) -> None:
    """Run a command of the step `name`; its output goes to a log in `.venv`.

    Raises SetupFailed with the end of the log.
    """
    log = VENV / f'setup-{name}.log'
    with log.open('a') as file:
        code = subprocess.run(
            [str(w) for w in words], cwd=ROOT, stdout=file, stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL, check=False,
        ).returncode  # fmt: skip
    if code:
        lines = log.read_text(errors='replace').splitlines()
        wrong = [line for line in lines if re.match(r'\s*(ERROR|error|fatal|.* error:)', line)]
        tail = '\n'.join(f'  {line[:200]}' for line in (wrong or lines)[-8:])
        raise SetupFailed(f'{name} failed (all of it: {log}):\n{tail}')


def step(name: str, work, *args) -> None:
    """Do `work`, and print its duration."""
    (VENV / f'setup-{name}.log').write_text('')
    began_s = time.monotonic()
    work(*args)
    say(f'{name}: done in {time.monotonic() - began_s:.0f} s')


def pip(python: Path, verb: str, *words) -> tuple:
    """Return the command line of pip in an environment."""
    options = ('--disable-pip-version-check', verb, '--progress-bar', 'off')
    return (python, '-m', 'pip', *options, *words)


def locked(file: Path) -> tuple:
    """Return what installs the wheels of a list, none but those whose hash stands there."""
    return ('--no-deps', '--require-hashes', '--requirement', file)


def core_list() -> Path:
    """Write the list of packages that the tests of the pure core need; return its path."""
    entries = re.findall(r'^\S.*(?:\n .*)*\n', (LOCKS / 'test.txt').read_text(), re.MULTILINE)
    path = VENV / 'core.txt'
    path.write_text(''.join(entry for entry in entries if not entry.startswith(NOT_CORE)))
    return path


def install_wheels(extra: str) -> None:
    """Install all that this package needs, and the package itself, editable."""
    wheels = core_list() if extra == 'core' else LOCKS / ('test.txt' if extra else 'run.txt')
    command('wheels', *pip(PYTHON, 'install', *locked(wheels)))
    # Without PEP 517 isolation: the build needs nothing but the setuptools just installed.
    command(
        'wheels', *pip(PYTHON, 'install', '--no-build-isolation', '--no-deps', '--editable', '.')
    )
    if extra == 'bench':  # the peers are not locked: whatever version there is shall be measured
        command(
            'wheels', *pip(PYTHON, 'install', '--no-build-isolation', '--editable', '.[ros,bench]')
        )


def install_browser(ready: Path) -> None:
    """Install the JavaScript of the tests, by the hashes of its lock; npm keeps a copy.

    Few tests need it: without npm, or offline before the first time, those are
    skipped and say why.
    """
    folder = ready.parent.resolve()  # npm takes no prefix that is a link
    folder.mkdir(exist_ok=True)
    for name in ('package.json', 'package-lock.json'):
        shutil.copy(BROWSER / name, folder)
    quiet = ('--no-audit', '--no-fund', '--no-update-notifier')
    try:
        words = ('npm', 'ci', '--prefer-offline', '--ignore-scripts', *quiet, '--prefix', folder)
        command('browser', *words)
    except SetupFailed as error:
        say(f'{error}\ngoing on without: accessibility and a TUIO client of others are not tested')
    else:
        ready.touch()


def message_wheel_folder(messages: str) -> Path:
    """Return where the wheel of these message definitions is kept for this Python."""
    cache = os.environ.get('EOL_CACHE') or os.path.join(
        os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache'), 'eol_ros'
    )
    tag = f'{sys.implementation.cache_tag}-{platform.machine()}'
    return Path(cache) / 'wheels' / f'{messages}-{tag}'


def build_messages(folder: Path) -> None:
    """Compile the messages into a wheel, kept by content beyond this checkout."""
    if not shutil.which('c++'):
        raise SetupFailed('no C++ compiler: sudo apt-get install g++ make')
    headers = Path(sysconfig.get_path('include'))
    if not (headers / 'Python.h').exists():
        raise SetupFailed(f'no Python headers in {headers}: sudo apt-get install python3-dev')
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as place:
        made, python = Path(place, 'wheels'), Path(place, 'tools', 'bin', 'python')
        command('messages', sys.executable, '-m', 'venv', python.parents[1])
        command('messages', *pip(python, 'install', *locked(LOCKS / 'messages.txt')))
        words = ('--verbose', '--no-deps', '--no-build-isolation', '--wheel-dir', made, MESSAGES)
        command('messages', *pip(python, 'wheel', *words))
        if not folder.exists():  # another checkout may have been quicker
            shutil.copytree(made, folder.with_suffix('.part'), dirs_exist_ok=True)
            folder.with_suffix('.part').rename(folder)


def setup(extra: str) -> None:
    """Do what is not done yet; raises SetupFailed."""
    firmware = ROOT / 'firmware'
    block = (firmware / 'link.h', *sorted((firmware / 'block').glob('*.[ch]')))
    key = digest(ROOT / 'setup.py', *block, *sorted(LOCKS.glob('*.txt')), Path(__file__))
    stamps = [VENV / f'.ready-{key}-{name}' for name in (extra, *ENOUGH.get(extra, ()))]
    ready = next((stamp for stamp in stamps if stamp.exists()), stamps[0])
    messages = digest(*sorted(path for path in MESSAGES.rglob('*.*') if path.is_file()))
    messages_ready = VENV / f'.messages-{messages}'
    if not PYTHON.exists():
        say(f'making {VENV.name} with Python {platform.python_version()}')
        subprocess.run([sys.executable, '-m', 'venv', VENV], check=True)

    steps: list[tuple] = []
    # `pip install .` in this environment replaces the link by a copy that becomes outdated
    if not (ready.exists() and any(VENV.glob('lib/*/site-packages/__editable__*eol_ros*'))):
        say('installing the wheels (about a minute, once)')
        steps.append(('wheels', install_wheels, extra))
    browser_ready = VENV / 'browser' / f'.ready-{digest(*sorted(BROWSER.glob("*.json")))}'
    core = extra == 'core'  # its tests need no ROS, and compile their own kernels
    if extra and not core and not browser_ready.exists() and shutil.which('npm'):
        steps.append(('browser', install_browser, browser_ready))
    wheels = message_wheel_folder(messages)
    if not core and not messages_ready.exists() and not wheels.exists():
        say('compiling the messages (about a minute, once)')
        steps.append(('messages', build_messages, wheels))
    with ThreadPoolExecutor() as pool:
        for done in [pool.submit(step, *words) for words in steps]:
            done.result()
    if core:
        ready.touch()
        return
    if not messages_ready.exists():
        words = ('install', '--force-reinstall', '--no-deps', *wheels.glob('*.whl'))
        command('messages', *pip(PYTHON, *words))
        for old in VENV.glob('.messages-*'):
            old.unlink()
        messages_ready.touch()
    ready.touch()
    # Prints its progress, or nothing if the cache is complete for this version.
    parts = ['--parts', 'tracker,twin,sound,ice,simulate'] if extra else []
    subprocess.run([PYTHON, '-m', 'eol_ros', 'compile', *parts], cwd=ROOT, check=True)


def main() -> int:
    """Run the set-up; return the exit code."""
    try:
        setup(sys.argv[1] if len(sys.argv) > 1 else '')
    except SetupFailed as error:
        say(f'set-up: {error}')
        return 1
    except subprocess.CalledProcessError as error:
        say(f'set-up: {" ".join(map(str, error.cmd))} ended with exit code {error.returncode}')
        return 1
    except KeyboardInterrupt:
        say('set-up: stopped; it goes on where it was when started again')
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())

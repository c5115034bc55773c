# SPDX-License-Identifier: Apache-2.0
"""Prepares `.venv` (or $EOL_VENV): wheels, messages and compiled kernels.

Called by tools/setup_env.sh, with the system's Python and nothing but its standard library. Wheels
and messages are made at the same time, and a line says every few seconds how far they are. What is
done leaves a stamp in `.venv`, so that nothing is done twice.
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
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / os.environ.get('EOL_VENV', '.venv')
PYTHON = VENV / 'bin' / 'python'
MESSAGES = ROOT / 'msg_defs' / 'eol_msgs'
LOCKS = ROOT / 'tools' / 'requirements'
BROWSER = LOCKS / 'browser'  # what the tests put into a browser: npm's own list and lock
# Test packages that the tests of the pure core do not need, by the beginning of their names.
NOT_CORE = ('ros-', 'colcon-', 'cmake', 'ninja', 'dask', 'distributed', 'mypy', 'pyarrow', 'ruff',
            'selenium', 'trio')  # fmt: skip
# Other extras whose wheels suffice for an extra ('' is a run).
ENOUGH = {'': ('test', 'bench'), 'core': ('test', 'bench')}
TELL_S = 4.0  # between two lines that say how far a step is
WIDTH = 100


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


class Step:
    """One command after the other in a thread; what they print goes to a log in `.venv`.

    A step that was done within `quiet_s` is not told of.
    """

    def __init__(self, name: str, work, *args, quiet_s: float = 0.0):
        self.name, self.error, self.quiet_s = name, None, quiet_s
        self.log = VENV / f'setup-{name}.log'
        self.log.write_text('')
        self._began_s = time.monotonic()
        self._ended_s = 0.0
        self._thread = threading.Thread(target=self._run, args=(work, args), daemon=True)
        self._thread.start()

    def _run(self, work, args) -> None:
        try:
            work(self, *args)
        except (SetupFailed, OSError) as error:
            self.error = error
        self._ended_s = time.monotonic()

    def command(self, *words) -> None:
        """Run a command; raises SetupFailed with the end of what it printed."""
        with self.log.open('a') as log:
            code = subprocess.run(
                [str(w) for w in words],
                cwd=ROOT,
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                check=False,
            ).returncode
        if code:
            lines = self.log.read_text(errors='replace').splitlines()
            wrong = [line for line in lines if re.match(r'\s*(ERROR|error|fatal|.* error:)', line)]
            tail = '\n'.join(f'  {line[:200]}' for line in (wrong or lines)[-8:])
            raise SetupFailed(f'{self.name} failed (all of it: {self.log}):\n{tail}')

    @property
    def seconds(self) -> float:
        """How long it has taken."""
        return (self._ended_s or time.monotonic()) - self._began_s

    @property
    def running(self) -> bool:
        """Whether it is still at work."""
        return self._thread.is_alive()

    def words(self) -> str:
        """Return how long it has taken and what it prints at the moment."""
        if not self.running:
            return f'{self.name}: done in {self.seconds:.0f} s'
        return f'{self.name}, {self.seconds:.0f} s: {self._newest()}'[:WIDTH]

    def _newest(self) -> str:
        """Return the last line of the log."""
        lines = self.log.read_text(errors='replace').replace('\r', '\n').splitlines()
        return next((line.strip() for line in reversed(lines) if line.strip()), 'starting')


def wait(*steps: Step) -> None:
    """Wait for all steps, saying every few seconds how far they are; raises what one raised."""
    left = list(steps)
    told_s = time.monotonic()
    while left:
        time.sleep(0.1)
        for step in [s for s in left if not s.running]:
            left.remove(step)
            if step.error:
                raise step.error
            if step.seconds > step.quiet_s:  # else it had nothing to do
                say(step.words())
        if left and time.monotonic() - told_s > TELL_S:
            told_s = time.monotonic()
            say('\n'.join(step.words() for step in left))


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


def install_wheels(step: Step, extra: str) -> None:
    """Install all that this package needs, and the package itself, editable."""
    wheels = core_list() if extra == 'core' else LOCKS / ('test.txt' if extra else 'run.txt')
    step.command(*pip(PYTHON, 'install', *locked(wheels)))
    # Without PEP 517 isolation: the build needs nothing but the setuptools just installed.
    step.command(*pip(PYTHON, 'install', '--no-build-isolation', '--no-deps', '--editable', '.'))
    if extra == 'bench':  # the peers are not locked: whatever version there is shall be measured
        step.command(*pip(PYTHON, 'install', '--no-build-isolation', '--editable', '.[ros,bench]'))


def install_browser(step: Step, ready: Path) -> None:
    """Install what the tests put into a browser, by the hashes of its lock; npm keeps a copy.

    Only tests of the pages need it: without npm, or offline before the first time, those are
    skipped and say why.
    """
    folder = ready.parent.resolve()  # npm takes no prefix that is a link
    folder.mkdir(exist_ok=True)
    for name in ('package.json', 'package-lock.json'):
        shutil.copy(BROWSER / name, folder)
    quiet = ('--no-audit', '--no-fund', '--no-update-notifier')
    try:
        words = ('npm', 'ci', '--prefer-offline', '--ignore-scripts', *quiet, '--prefix', folder)
        step.command(*words)
    except SetupFailed as error:
        say(f'{error}\ngoing on without: accessibility of the pages is not tested')
    else:
        ready.touch()


def message_wheel_folder(messages: str) -> Path:
    """Return where the wheel of these message definitions is kept for this Python."""
    cache = os.environ.get('EOL_CACHE') or os.path.join(
        os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache'), 'eol_ros'
    )
    tag = f'{sys.implementation.cache_tag}-{platform.machine()}'
    return Path(cache) / 'wheels' / f'{messages}-{tag}'


def build_messages(step: Step, folder: Path) -> None:
    """Compile the messages into a wheel, kept by content beyond this checkout."""
    if not shutil.which('c++'):
        raise SetupFailed('no C++ compiler: sudo apt-get install g++ make')
    headers = Path(sysconfig.get_path('include'))
    if not (headers / 'Python.h').exists():
        raise SetupFailed(f'no Python headers in {headers}: sudo apt-get install python3-dev')
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as place:
        made, python = Path(place, 'wheels'), Path(place, 'tools', 'bin', 'python')
        step.command(sys.executable, '-m', 'venv', python.parents[1])
        step.command(*pip(python, 'install', *locked(LOCKS / 'messages.txt')))
        words = ('--verbose', '--no-deps', '--no-build-isolation', '--wheel-dir', made, MESSAGES)
        step.command(*pip(python, 'wheel', *words))
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

    steps = []
    if not ready.exists():
        say('installing the wheels (about a minute, once)')
        steps.append(Step('wheels', install_wheels, extra))
    if extra == 'core':  # its tests compile their own kernels
        wait(*steps)
        ready.touch()
        return
    browser_ready = VENV / 'browser' / f'.ready-{digest(*sorted(BROWSER.glob("*.json")))}'
    if extra and not browser_ready.exists() and shutil.which('npm'):
        steps.append(Step('browser', install_browser, browser_ready))
    wheels = message_wheel_folder(messages)
    if not messages_ready.exists() and not wheels.exists():
        say('compiling the messages (about a minute, once)')
        steps.append(Step('messages', build_messages, wheels))
    wait(*steps)
    if not messages_ready.exists():
        step = Step('messages-install', lambda step: step.command(
            *pip(PYTHON, 'install', '--force-reinstall', '--no-deps', *wheels.glob('*.whl'))
        ))  # fmt: skip
        wait(step)
        for old in VENV.glob('.messages-*'):
            old.unlink()
        messages_ready.touch()
    ready.touch()
    # Does nothing if the cache is complete for this version.
    parts = ['--parts', 'tracker,twin,sound,ice,simulate'] if extra else []
    wait(
        Step(
            'kernels',
            lambda step: step.command(PYTHON, '-m', 'eol_ros', 'compile', *parts),
            quiet_s=2.0,
        )
    )


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

# SPDX-License-Identifier: Apache-2.0
"""Runs all tests in their two parts, and says at the end what was not tested and why.

    tools/run_tests.py            everything: six at a time, then what keeps real time, one by one
    tools/run_tests.py --quick    the pure core without its slow tests, in two processes
    tools/run_tests.py --bare     what touches devices, pages and scenes, on a machine that has none
                                  of the optional system packages: they are hidden, not removed

A first part that fails does not keep the second from running. Further arguments go to pytest.
"""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# A shared machine can stall for longer than real time allows. So up to three failed tests are
# retried after all others, in a new process and alone. The last lines name each with its reason.
# More failures are no accident.
MOST_AGAIN = 3
SLOWEST = 10  # files that the last lines name with their seconds
# A test retried twice in ten runs is a defect: `make test` keeps the retries of these runs.
REMEMBERED = 10
RECORD = ROOT / '.pytest_cache' / 'second-tries.json'
NOTHING_SELECTED = 5  # pytest's exit code, where a part holds none of what was asked for
BESIDE = ('-n', '6', '--dist', 'loadfile', '--no-loadscope-reorder')  # many of them wait
MAY_COMPILE = '--timeout=300'  # the first test that calls a kernel may compile it
PARTS = {
    'side by side': (*BESIDE, MAY_COMPILE, '-m', 'not live and not soak and not firmware'),
    'one by one, in real time': ('-m', 'live and not soak and not firmware'),
}
# Halves of about the same length; xdist would have both processes import and compile everything.
FIRST_HALF = [
    f'test/core/{name}' for name in ('physics', 'light', 'montage', 'science', 'motion', 'measure')
]
QUICK = (FIRST_HALF, ['test/core', *(f'--ignore={folder}' for folder in FIRST_HALF)])
BARE = ('test/devices', 'test/web', 'test/scenes', 'test/nodes', 'test/verbs', 'test/bringup',
        'test/bench/test_bench_sound.py', 'test/test_cli.py')  # fmt: skip
# Thousands of processes would each compile all modules; numba keeps its code in the same folders.
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)
BARE_MOUNTS = 'EOL_TEST_BARE'  # set once the packages are hidden


def packages() -> dict[str, tuple[str, str]]:
    """Return stage and probe of each package in tools/system_packages.txt."""
    lines = (ROOT / 'tools' / 'system_packages.txt').read_text().splitlines()
    rows = [line.split(None, 3) for line in lines if line and not line.startswith('#')]
    return {package: (stage, probe) for package, stage, probe, _ in rows}


def places(probe: str) -> list[Path]:
    """Return the files or folders whose absence makes a probe fail."""
    kind, _, name = probe.partition(':')
    if kind == 'command':
        folders = os.get_exec_path()
        return [Path(f, name).resolve() for f in folders if os.access(Path(f, name), os.X_OK)]
    if kind == 'library':
        path = os.pathsep.join([*os.get_exec_path(), '/sbin', '/usr/sbin'])
        known = subprocess.run(
            ['ldconfig', '-p'], capture_output=True, text=True, check=False,
            env={**os.environ, 'PATH': path},
        ).stdout  # fmt: skip
        found = re.findall(rf'{re.escape(name)} .*=> (\S+)', known)
        return [Path(path).resolve() for path in found]
    return [Path(name)] if Path(name).exists() else []


def hide() -> None:
    """Cover what the optional packages have installed, in a mount namespace of this process."""
    empty = Path(tempfile.mkdtemp(prefix='eol-bare-'))
    file, folder = empty / 'file', empty / 'folder'
    file.touch(mode=0o644)
    folder.mkdir()
    for stage, probe in packages().values():
        if stage != 'build':
            for place in places(probe):
                cover = folder if place.is_dir() else file
                subprocess.run(['mount', '--bind', cover, place], check=True)


def run_bare(words: list[str]) -> int:
    """Start this script again where the packages can be hidden without anybody else noticing."""
    unshare = ['unshare', '--mount', '--propagation', 'private']
    if os.geteuid() != 0:
        unshare.append('--map-root-user')
    again = [*unshare, sys.executable, __file__, '--bare', *words]
    if not shutil.which('unshare') or subprocess.run([*unshare, 'true'], check=False).returncode:
        print('run_tests: packages cannot be hidden here (no mount namespaces): not run')
        return 1
    return subprocess.run(again, cwd=ROOT, env={**os.environ, BARE_MOUNTS: '1'}).returncode


def run_quick(words: list[str]) -> int:
    """Run both halves of the quick tests at once; print one after the other."""
    # Without plugins that seconds go into: coverage, processes, what colcon brings along.
    words = ['-q', '-p', 'pytest_timeout', '-p', 'no:cacheprovider', *words]
    words = [MAY_COMPILE, *words, '-m', 'not slow and not soak']
    halves = [
        subprocess.Popen(
            [sys.executable, '-m', 'pytest', *words, *half], cwd=ROOT, text=True,
            env={**os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )
        for half in QUICK
    ]  # fmt: skip
    for half in halves:
        print(half.communicate()[0], end='', flush=True)
    return max(half.returncode for half in halves)


def with_live_tests(paths: list[str]) -> list[str]:
    """Return the files that have live tests: what others import is left out of their part."""
    places = [ROOT / path for path in paths]
    files = [f for place in places for f in (place, *place.rglob('test_*.py')) if f.is_file()]
    return [str(file) for file in sorted(files) if 'mark.live' in file.read_text()]


def compile_tests() -> None:
    """Compile all test files of a new clone, in two processes; else each of six would do so."""
    if any((ROOT / 'test').rglob('__pycache__/*-pytest-*.pyc')):
        return
    files = sorted(str(path) for path in (ROOT / 'test').rglob('test_*.py'))
    words = [sys.executable, '-m', 'pytest', '--collect-only', '-q']
    halves = [
        subprocess.Popen([*words, *files[k::2]], cwd=ROOT, stdout=subprocess.DEVNULL)
        for k in range(2)
    ]
    for half in halves:
        half.wait()  # the parts report its faults again


def run_part(selection: tuple[str, ...], paths: list[str], words: list[str]) -> tuple[int, dict]:
    """Run pytest once; return its exit code and what test/conftest.py tells of the outcomes."""
    with tempfile.TemporaryDirectory(prefix='eol-tests-') as folder:
        told = Path(folder) / 'outcomes.json'
        code = subprocess.run(
            [sys.executable, '-m', 'pytest', '--durations=15', *selection, *words, *paths],
            cwd=ROOT, env={**os.environ, 'EOL_TEST_OUTCOMES': str(told)}, check=False,
        ).returncode  # fmt: skip
        found = json.loads(told.read_text()) if told.exists() else {}
    return code, found


def remember(again: Iterable[str]) -> list[str]:
    """Record the retries of this run; return the tests that earlier runs retried, too."""
    try:
        runs = json.loads(RECORD.read_text())
    except (OSError, ValueError):
        runs = []
    runs = [*runs, list(again)][-REMEMBERED:]
    RECORD.parent.mkdir(exist_ok=True)
    RECORD.write_text(json.dumps(runs))
    return [name for name in again if sum(name in run for run in runs) > 1]


def main() -> int:
    """Run the parts; return 0 where all that ran has passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--bare', action='store_true', help='hide the optional system packages')
    parser.add_argument('--quick', action='store_true', help='the quick tests of the core')
    args, words = parser.parse_known_args()
    # A shell has its background jobs ignore SIGINT, and tests send it to programs.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if args.quick:
        return run_quick(words)
    if args.bare and BARE_MOUNTS not in os.environ:
        return run_bare(words)
    if args.bare:
        hide()
    codes, counts, skipped, failed = [], Counter(), Counter(), {}
    seconds, took = Counter(), {}
    compile_tests()
    for name, selection in PARTS.items():
        print(f'\n=== tests, {name}{", bare" if args.bare else ""}', flush=True)
        paths = list(BARE) if args.bare else ['test']
        if '-n' not in selection:
            paths = with_live_tests(paths)
        started = time.monotonic()
        code, found = run_part(selection, paths, words)
        took[name] = time.monotonic() - started
        seconds.update(found.get('seconds', {}))
        codes.append(code)
        counts.update(found.get('counts', {}))
        skipped.update(found.get('skipped', {}))
        failed |= found.get('failed', {})
    again = {}
    if set(codes) <= {0, 1, NOTHING_SELECTED} and 0 < len(failed) <= MOST_AGAIN:
        print('\n=== tests that failed, once more with nothing beside them', flush=True)
        code, found = run_part((), list(failed), words)
        if found:
            codes = [code]
            counts['passed'] += found['counts']['passed']
            for name in ('failed', 'error'):
                counts[name] = found['counts'][name]
            again, failed = failed, found['failed']
    print('\n' + '; '.join(f'{name}: {part:.0f} s' for name, part in took.items()))
    print('the slowest files:')
    for name, part in seconds.most_common(SLOWEST):
        print(f'  {part:5.0f} s  {name}')
    print('\nnot tested here:' if skipped else '\neverything was tested')
    for reason, count in sorted(skipped.items()):
        print(f'  {count:3} test{"s" if count > 1 else " "}  {reason}')
    if len(failed) > MOST_AGAIN:
        print(f'{len(failed)} tests failed: only up to {MOST_AGAIN} are tried again')
    for name, why in failed.items():
        print(f'failed: {name}: {why}')
    for name, why in again.items():
        if name not in failed:
            print(f'passed only when tried again: {name}: {why}')
    if not (args.bare or words):
        for name in remember(again):
            print(f'a defect, tried again twice in {REMEMBERED} runs: {name}')
    if args.bare and not skipped:
        print('run_tests: nothing was skipped, so nothing was hidden')
        codes.append(1)
    print(
        f'{counts["passed"]} passed, {counts["failed"] + counts["error"]} failed, '
        f'{counts["skipped"]} skipped',
        flush=True,
    )
    return max(codes, key=bool)


if __name__ == '__main__':
    sys.exit(main())

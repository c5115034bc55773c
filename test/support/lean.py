# SPDX-License-Identifier: Apache-2.0
"""What a node or a verb must not load, and a probe of what it loads: a test, and `eol bench lean`.

A package is loaded where it is used: a museum without a twin has no solver, a report no ROS.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from eol_ros import parent_death
from eol_ros.errors import EolError

ROOT = Path(__file__).parents[2]
PROBE = Path(__file__).with_name('lean_probe')

ONLY = {  # which nodes may have loaded a package
    'numba': {'twin', 'tracker', 'sound'},
    'llvmlite': {'twin', 'tracker', 'sound'},
    'cv2': {'camera', 'tracker'},
    'aiohttp': {'panel'},
    'mcap': {'recorder', 'replay'},
    'zstandard': {'recorder', 'replay'},
    'sounddevice': {'sound'},
    'soundfile': {'sound'},
    'serial': {'leds'},
    'pythonosc': {'osc'},
    'rtmidi': {'midi'},
}
NOBODY = (
    'matplotlib',
    'rich',
    'pytest',
    'unittest',
    'numpy.testing',
    'numpy.f2py',
    'scipy.linalg',
    'scipy.special',
    'scipy.signal',
    'scipy.optimize',
    'scipy.sparse',
    'numba.np.linalg',
    'numba.np.arraymath',  # numba's compiler, where nothing is compiled
    'lark',
    'rosidl_parser.parser',  # the generator of message code
)
LIBRARIES = {  # part of a mapped file's name: which nodes may have it
    'avcodec': ONLY['cv2'],
    'libllvmlite': ONLY['numba'],
    '/scipy/linalg': set(),
    'board/_block': {'twin'},
}
# Besides what no node loads, for processes that are no nodes
HEAVY = (
    'rclpy', 'numpy', 'numba', 'scipy', 'cv2', 'aiohttp', 'mcap', 'zstandard', 'sounddevice',
    'soundfile', 'serial', 'matplotlib', 'rich', 'yaml', 'pytest', 'unittest',
)  # fmt: skip
VERBS: dict[str, set[str]] = {  # words after `eol`: what it may load of HEAVY
    '--help': set(),
    'check rehearsal': {'yaml', 'numpy'},
    'status': {'yaml'},
    'devices': {'serial', 'sounddevice'},
    'keys list': set(),
    'topics': {'yaml', 'numpy', 'rclpy'},
    'bag info bags/sample': {'yaml', 'mcap', 'zstandard', 'numpy'},
    'bag info bags/sample --index': {'yaml', 'mcap', 'zstandard'},
    'simulate S1': {'yaml', 'numpy', 'numba', 'scipy'},
    'lattice --help': set(),
    'corpus --help': set(),
    'call --help': {'yaml'},
}
BRINGUP = {'yaml'}
OF_A_BAG = {'mcap', 'zstandard', 'numpy'}  # of a bringup that looks what a bag has


def barred(nodes: Iterable[str]) -> list[str]:
    """Return the modules that a process of `nodes` must not have."""
    here = set(nodes)
    names = [name for name, allowed in ONLY.items() if not here & allowed] + list(NOBODY)
    if not here & ONLY['numba']:
        names.append('scipy')  # numba looks at the version of it
    return names


def node_faults(nodes: Iterable[str], modules: Iterable[str], files: Iterable[str]) -> list[str]:
    """Return what a process of `nodes` has loaded and must not have."""
    here = set(nodes)
    found = sorted(set(modules) & set(barred(here)))
    for part, allowed in LIBRARIES.items():
        if not here & allowed:
            found += [file for file in files if part in file]
    return found


def other_faults(allowed: set[str], modules: Iterable[str]) -> list[str]:
    """Return what bringup or a verb has loaded of HEAVY beyond `allowed`."""
    return sorted((set(HEAVY) - allowed) & set(modules))


def probed(folder: Path) -> dict[str, str]:
    """Return the environment in which Python processes tell into `folder` what they load."""
    paths = [str(PROBE), str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {'PYTHONPATH': os.pathsep.join(paths), 'EOL_LEAN': str(folder)}


def verb_row(words: str) -> dict[str, Any]:
    """Return what `eol` with `words` loads; it may end as it likes, for devices may be missing."""
    with tempfile.TemporaryDirectory(prefix='eol-lean-') as place:
        begin = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, '-m', 'eol_ros', *words.split()],
            cwd=ROOT,
            env={**os.environ, **probed(Path(place))},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=parent_death.following(),
        )
        _, said = process.communicate(timeout=600)
        took = time.monotonic() - begin
        file = Path(place) / f'{process.pid}.json'
        if not file.exists():
            raise EolError(f'eol {words} ended by {process.returncode}: {said.decode()[-500:]}')
        told = json.loads(file.read_text())
    return {
        'verb': words,
        'exit': process.returncode,
        'seconds': round(took, 2),
        'pss_mb': round(told['pss_mb'], 1),
        'modules': len(told['modules']),
        'threads': told['threads'],
        'faults': other_faults(VERBS[words], told['modules']),
    }

# SPDX-License-Identifier: Apache-2.0
"""The house stands as drawn: who may import what."""

import ast
import functools
import itertools
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / 'eol_ros'
ROS = {
    'rclpy', 'rcl_interfaces', 'std_srvs', 'rosbag2_interfaces', 'rosidl_runtime_py',
    'ament_index_python', '_rclpy',
}  # fmt: skip
# Which packages of others a part may use; those of ROS: ros and nodes.
ALLOWED = {
    'core': 'numba numpy scipy',
    'core/vision': 'cv2 numba numpy scipy',
    'core/compiled.py': 'llvmlite numba numpy',
    'streams': 'numpy',
    'devices': (
        'PIL _sounddevice cv2 lz4 mcap numba numpy pythonosc scipy serial sounddevice soundfile '
        'yaml zstandard'
    ),
    'ros': 'numpy yaml',
    'nodes': 'numpy',
    'web': 'aiohttp numpy',
    'devices/audio/midi.py': 'rtmidi',
    'devices/files/sealed_file.py': 'cryptography',
    'bringup': 'yaml',
    'scene.py': '',
    'yaml_text.py': 'yaml',
    'scene_secrets.py': 'yaml',
    'scene_text.py': 'yaml',
    'settings.py': '',
    'errors.py': '',
    'said.py': '',
    'folders.py': '',
    'interrupts.py': '',
    'parent_death.py': '',
    'thread_faults.py': 'errors',
    'compiled.py': '',
    'disk.py': '',
    'memory.py': '',
    'cli.py': 'rich',
}
# Which of our own parts a part may use: arrows point down.
BELOW = {
    'core': 'core errors said settings',
    'disk.py': 'errors',
    'core/compiled.py': 'compiled',
    'streams': 'core errors said settings streams',
    'scene.py': 'disk errors said scene_secrets settings streams yaml_text',
    'yaml_text.py': 'errors',
    'scene_secrets.py': 'settings',
    'scene_text.py': 'disk errors scene yaml_text',
    'devices': 'core devices disk errors folders parent_death said settings streams yaml_text',
    'ros': (
        'compiled core disk errors folders nodes ros said scene settings streams thread_faults '
        'yaml_text'
    ),
    'nodes': 'core devices errors nodes ros said scene settings streams web',
    'web': 'core devices disk errors said settings streams web',
    'bringup': (
        'bringup cli compiled devices disk errors folders interrupts parent_death ros said scene '
        'settings streams thread_faults yaml_text'
    ),
    'lab': 'core devices disk errors lab parent_death scene settings yaml_text',
    'analysis': (
        'analysis core devices disk errors lab parent_death scene settings streams yaml_text'
    ),
}
MODULES = sorted(ROOT.rglob('*.py'))


@functools.cache
def imports(path):
    """Return (line, dotted name) of every import, at the top and inside functions."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module == 'eol_ros':
            found += [(node.lineno, f'eol_ros.{alias.name}') for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.append((node.lineno, node.module))
    return found


def rule(table, path):
    """Return the names of the innermost folder (or the file) that has an entry, or None."""
    place = path.relative_to(ROOT).as_posix()
    while place and place != '.':
        if place in table:
            return set(table[place].split())
        place = Path(place).parent.as_posix()
    return None


def name(path):
    return path.relative_to(ROOT).as_posix()


def test_outside_imports():
    for path in MODULES:
        allowed = rule(ALLOWED, path)
        if allowed is None:
            allowed = None if name(path).startswith(('verbs', 'analysis', 'lab')) else set()
        for line, module in imports(path):
            top = module.split('.')[0]
            if top in sys.stdlib_module_names or top == 'eol_ros':
                continue
            message = top.endswith('_msgs') or top == 'builtin_interfaces' or top in ROS
            if message:
                ours = name(path).split('/')[0]
                assert ours in ('ros', 'nodes'), f'{name(path)}:{line} imports {module}'
            elif allowed is not None:
                assert top in allowed, f'{name(path)}:{line} imports {module}'


def test_inner_imports():
    for path in MODULES:
        below = rule(BELOW, path)
        for line, module in imports(path):
            if below is not None and module.startswith('eol_ros.'):
                part = module.split('.')[1]
                assert part in below, f'{name(path)}:{line} imports {module}'


def test_names_and_licence():
    for path in MODULES:
        parts = set(name(path)[:-3].split('/'))
        assert not {'utils', 'helpers', 'common', 'misc'} & parts, name(path)
        lines = path.read_text().splitlines()  # REUSE-IgnoreStart
        assert lines[0] == '# SPDX-License-Identifier: Apache-2.0', name(path)  # REUSE-IgnoreEnd


def test_modules_typed_less_strictly_have_kernels():
    """The exception that mypy makes for loops of numba is no place to hide other code."""
    tomllib = pytest.importorskip('tomllib')  # Python 3.11
    settings = tomllib.loads((ROOT.parent / 'pyproject.toml').read_text())['tool']['mypy']
    lax = [
        module
        for override in settings['overrides']
        if override.get('disallow_untyped_defs') is False
        for module in override['module']
        if module.startswith('eol_ros.core')
    ]
    assert settings['strict'] and lax
    compilers = {'numba', 'llvmlite', 'eol_ros.core.compiled', 'eol_ros.core.physics.series'}
    for module in lax:
        path = ROOT.parent / (module.replace('.', '/') + '.py')
        assert compilers & {found for _, found in imports(path)}, f'{module} has no kernels'


def test_each_exception_from_typing_names_its_rule():
    """And has its reason behind it or in the line above."""
    for path in MODULES:
        lines = path.read_text().splitlines()
        for before, line in itertools.pairwise(lines):
            if 'type: ignore' in line:
                named = line.partition('# type: ignore[')[2].partition(']')[2]
                assert '#' in named or before.strip().startswith('#'), f'{name(path)}: {line}'


def proves(function, functions, seen=()):
    """Tell whether a test can fail: by itself, or by a function of its file that it calls."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assert):
            return True
        if isinstance(node, ast.Call):
            words = ast.unparse(node.func)
            called = words.split('.')[-1]
            if words in ('pytest.raises', 'pytest.fail', 'pytest.warns') or called == 'wait_until':
                return True
            inner = functions.get(called)
            if 'assert_' in called or called == 'until_page':
                return True
            if called == 'until' and inner is None:  # support.spinning.Nodes, which fails
                return True
            if inner and called not in seen and proves(inner, functions, (*seen, called)):
                return True
    return False


def test_every_test_can_fail():
    for path in sorted((ROOT.parent / 'test').rglob('test_*.py')):
        nodes = ast.walk(ast.parse(path.read_text()))
        functions = {node.name: node for node in nodes if isinstance(node, ast.FunctionDef)}
        for title, function in functions.items():
            if title.startswith('test_'):
                assert proves(function, functions, (title,)), f'{path}: {title} asserts nothing'


def test_the_package_does_without_benchmarks_and_tests():
    for path in MODULES:
        for line, module in imports(path):
            assert module.split('.')[0] not in ('benchmarks', 'test'), f'{name(path)}:{line}'


def test_only_tests_of_benchmarks_import_benchmarks():
    """What tests and benchmarks share is in test/support."""
    tests = ROOT.parent / 'test'
    for path in tests.rglob('*.py'):
        if tests / 'bench' not in path.parents:
            for line, module in imports(path):
                assert module.split('.')[0] != 'benchmarks', f'{path}:{line}'


def test_the_firmware_of_the_blocks_is_loaded_by_the_twin_alone():
    firmware = 'eol_ros.devices.board.block'
    boards = {f'devices/board/{user}.py' for user in ('block', 'felt', 'firmware')}
    users = boards | {'nodes/twin.py'}
    for path in MODULES:
        if name(path) not in users:
            found = {module for _, module in imports(path)}
            barred = {firmware, 'eol_ros.devices.board.felt', 'eol_ros.devices.board'}
            assert not barred & found, name(path)
            assert 'board._block' not in path.read_text(), name(path)


def test_core_is_pure():
    """No files, clocks, threads, logging or global random numbers in core."""
    barred = {
        'os',
        'io',
        'time',
        'threading',
        'logging',
        'random',
        'pathlib',
        'subprocess',
        'socket',
        'asyncio',
        'tempfile',
    }
    for path in (ROOT / 'core').rglob('*.py'):
        text = path.read_text()
        for line, module in imports(path):
            assert module.split('.')[0] not in barred, f'{name(path)}:{line} imports {module}'
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in ('open', 'print'), f'{name(path)}:{node.lineno} {called}'
                tells_time = called.split('.')[-1] in ('now', 'today', 'utcnow')  # of datetime
                assert not tells_time, f'{name(path)}:{node.lineno} {called}'
                drawn = called.startswith('np.random.') and '(' not in called
                seeded = called.split('.')[-1] in (
                    'default_rng',
                    'Generator',
                    'PCG64',
                    'SeedSequence',
                    'Philox',
                )
                assert not drawn or (seeded and node.args), f'{name(path)}:{node.lineno} {called}'


# What is recomputed from a recording or has a digest: its bits follow from IEEE 754 alone.
SAME_BITS = (
    'core/motion', 'core/light', 'core/montage', 'core/sound', 'core/vision/background',
    'core/vision/appearance', 'core/vision/blink.py', 'core/vision/outline.py',
    'core/vision/symmetry.py', 'core/vision/tracker.py', 'core/vision/turn_by_taps.py',
    'core/vision/calibration/mapping.py', 'core/vision/calibration/model.py',
    'lab/automaton', 'core/algebra.py', 'core/elementary.py',
    'core/elementary_kernels.py',
)  # fmt: skip
FREE = {  # of these modules, with the reason
    'core/sound/meter.py': 'levels for people',
    'core/sound/presets.py': 'what a preset becomes is recorded as settings',
    'core/vision/appearance/squares.py': 'whole powers, which numba multiplies out',
    'core/vision/symmetry.py': 'erfc of the C library in a sum that a threshold decides',
}
PLATFORM = {
    'dot', 'matmul', 'einsum', 'inner', 'vdot', 'tensordot', 'convolve', 'correlate', 'cov',
    'corrcoef', 'polyfit', 'linalg', 'exp', 'expm1', 'exp2', 'log', 'log2', 'log10', 'log1p',
    'sin', 'cos', 'tan', 'arcsin', 'arccos', 'arctan', 'arctan2', 'sinh', 'cosh', 'tanh', 'hypot',
    'power', 'cbrt', 'angle', 'hanning', 'hamming', 'blackman', 'geomspace', 'logspace',
    'float_power', 'asin', 'acos', 'atan', 'atan2', 'pow', 'erf', 'erfc', 'gamma', 'lgamma',
}  # fmt: skip


def platform_bits(path):
    """Yield (line, what) of each operation whose last bits follow the processor or its C library.

    Squares are products, and powers of literals are worked out when Python compiles them.
    """
    tree = ast.parse(path.read_text())
    errors = {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and node.attr == 'LinAlgError'
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield node.lineno, '@'
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            base, exponent = ast.unparse(node.left), ast.unparse(node.right)
            if exponent != '2' and not re.fullmatch(r'[-\d.]+', base + exponent):
                yield node.lineno, f'** {exponent}'
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in ('np', 'math')
            and node.attr in PLATFORM
            and node not in errors
        ):
            yield node.lineno, f'{node.value.id}.{node.attr}'


def test_bits_of_what_is_recomputed_follow_no_processor():
    for path in MODULES:
        if name(path).startswith(SAME_BITS):
            found = sorted(set(platform_bits(path)))
            if name(path) in FREE:
                assert found, f'{name(path)} needs no exception any more'
            else:
                assert found == [], f'{name(path)}: take core/elementary.py or core/algebra.py'


def test_what_is_started_ends_with_its_parent():
    """Every Popen has a `preexec_fn`; a corpus is made by a process that calls `follow` itself."""
    bare = []
    shared = (ROOT.parent / 'test' / 'support').glob('*.py')
    for path in [*MODULES, *(ROOT.parent / 'benchmarks').glob('*.py'), *shared]:
        for call in ast.walk(ast.parse(path.read_text())):
            if (
                isinstance(call, ast.Call)
                and ast.unparse(call.func) == 'subprocess.Popen'
                and 'preexec_fn' not in {keyword.arg for keyword in call.keywords}
            ):
                bare.append(path.name)
    assert bare == ['corpus_build.py']

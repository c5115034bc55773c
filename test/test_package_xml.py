# SPDX-License-Identifier: Apache-2.0
"""package.xml and setup.py name what the code imports, and nothing else."""

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

from eol_ros.ros import installed

ROOT = Path(__file__).parents[1]
# Import to rosdep key, where they differ; rosdep/python.yaml of ros/rosdistro has them.
KEYS = {
    'PIL': 'python3-pil',
    'aiohttp': 'python3-aiohttp',
    'cryptography': 'python3-cryptography',
    'cv2': 'python3-opencv',
    'matplotlib': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'rich': 'python3-rich',
    'scipy': 'python3-scipy',
    'serial': 'python3-serial',
    'sounddevice': 'python3-sounddevice-pip',
    'soundfile': 'python3-soundfile',
    'yaml': 'python3-yaml',
}
PART_OF = {'_sounddevice': 'sounddevice', 'llvmlite': 'numba', 'mpl_toolkits': 'matplotlib'}
WHEELS = {
    'PIL': 'pillow',
    'cv2': 'opencv-python-headless',
    'pythonosc': 'python-osc',
    'rtmidi': 'python-rtmidi',
    'serial': 'pyserial',
    'yaml': 'pyyaml',
}


def imports(*folders):
    """Return the packages that modules in these parts of eol_ros import, wherever in the file."""
    found = set()
    for path in (ROOT / 'eol_ros').rglob('*.py'):
        part = path.relative_to(ROOT / 'eol_ros').parts[0]
        if folders and part not in folders:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split('.')[0])
    return {PART_OF.get(name, name) for name in found - sys.stdlib_module_names} - {'eol_ros'}


def table():
    """Return import and origin of what docs/guides/packages.md says that rosdep has no key for."""
    text = (ROOT / 'docs/guides/packages.md').read_text()
    section = text.partition('rosdep has no key for:')[2].partition('\n## ')[0]
    return dict(re.findall(r'^\| `(\w+)` \| (.*) \|$', section, re.M))


def test_package_xml_names_what_is_imported():
    root = ElementTree.parse(ROOT / 'package.xml').getroot()
    declared = {tag.text for tag in root.iter('exec_depend')}
    keyless = table()
    wanted = {KEYS.get(name, name) for name in imports() - set(keyless)}
    wanted.add('launch')  # by launch/eol.launch.py alone: no wheel has it
    covering = {key for key in declared if any(f'`{key}`' in row for row in keyless.values())}

    assert sorted(wanted - declared) == []
    assert sorted(declared - wanted - covering) == []
    assert set(keyless) <= imports()


def test_setup_py_names_what_is_imported():
    text = (ROOT / 'setup.py').read_text()
    runtime = set(re.findall(r"'([\w-]+)[><=]", text.partition('RUNTIME = [')[2].split(']')[0]))
    extras = set(re.findall(r"'([\w-]+)[><=]", text.partition('SCIENCE = [')[2].split('TEST')[0]))
    python = {WHEELS.get(name, name) for name in imports() - set(installed.PACKAGES)}

    assert sorted(python - runtime - extras) == []
    assert sorted(runtime - python) == []


def test_all_of_ros_that_is_imported_is_looked_for():
    ros = {name for name in imports('ros', 'nodes') if name == 'rclpy' or name.endswith(
        ('_msgs', '_interfaces'))}  # fmt: skip

    assert ros <= set(installed.PACKAGES)

# SPDX-License-Identifier: Apache-2.0
"""sdist and wheels: complete, equal, installable together; and the analysis without ROS."""

import hashlib
import json
import os
import re
import stat
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from support.checkout import ROOT, checkout, tracked

from eol_ros import folders
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.streams.graph import NODES

VERSION = re.search('<version>(.*)</version>', (ROOT / 'package.xml').read_text())[1]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # a busy machine and a slow network
# Links, which an sdist cannot hold, the hint that leads to them, and what only git reads.
LEFT_OUT = ('workspace/', 'colcon.pkg', '.git')
OFFLINE = ('NewConnectionError', 'ConnectTimeout', 'ReadTimeout', 'ProxyError', 'NameResolution',
           'Temporary failure in name resolution', 'Network is unreachable')  # fmt: skip


def run(*words, cwd=None, environment=None):
    result = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, f'{words}\n{result.stdout[-2000:]}{result.stderr[-3000:]}'
    return result.stdout


@pytest.fixture(scope='module')
def clone(tmp_path_factory):
    return checkout(tmp_path_factory.mktemp('clone') / 'eol_ros')


@pytest.fixture(scope='module')
def sdist(clone, tmp_path_factory):
    folder = tmp_path_factory.mktemp('sdist')
    run(sys.executable, 'setup.py', '-q', 'sdist', '-d', folder, cwd=clone)
    return next(folder.glob('*.tar.gz'))


def wheel_of(source, folder):
    run(sys.executable, '-m', 'pip', '-q', 'wheel', '--no-deps', '--no-build-isolation',
        '-w', folder, source)  # fmt: skip
    return next(folder.glob('*.whl'))


@pytest.fixture(scope='module')
def wheel(clone, tmp_path_factory):
    return wheel_of(clone, tmp_path_factory.mktemp('wheel'))


def contents(wheel):
    with zipfile.ZipFile(wheel) as file:
        return {i.filename: hashlib.sha256(file.read(i)).hexdigest() for i in file.infolist()}


def test_the_sdist_has_all_that_is_tracked(clone, sdist):
    with tarfile.open(sdist) as file:
        names = {m.name.partition('/')[2] for m in file.getmembers() if m.isfile()}
    wanted = {name for name in tracked(clone) if not name.startswith(LEFT_OUT)}
    made = {'PKG-INFO', 'setup.cfg'}
    names = {name for name in names if not name.startswith('eol_ros.egg-info/')}

    assert sorted(wanted - names) == []
    assert sorted(names - wanted - made) == []


def test_a_wheel_from_the_sdist_equals_that_from_the_clone(wheel, sdist, tmp_path):
    assert contents(wheel_of(sdist, tmp_path)) == contents(wheel)


def test_the_wheel_has_the_whole_package(clone, wheel):
    have = contents(wheel)
    package = {name for name in tracked(clone) if name.startswith('eol_ros/')}
    assert sorted(package - set(have)) == []
    data = f'eol_ros-{VERSION}.data/data/'
    shared = {f'{data}share/eol_ros/{path.relative_to(clone).as_posix()}'
              for path in (*clone.glob('config/*.yaml'), *clone.glob('launch/*.py'))}  # fmt: skip
    shared |= {f'{data}share/eol_ros/view/{path.name}' for path in clone.glob('config/view/*')}
    shared |= {f'{data}share/eol_ros/eol_msgs/{path.relative_to(clone / "msg_defs" / "eol_msgs")}'
               for path in (clone / 'msg_defs').rglob('*') if path.is_file()}  # fmt: skip
    assert sorted(shared - set(have)) == []


def test_the_wheel_has_the_firmware_of_the_blocks_compiled(wheel):
    suffix = sysconfig.get_config_var('EXT_SUFFIX')
    assert f'eol_ros/devices/board/_block{suffix}' in contents(wheel)
    assert wheel.name.split('-')[2] == f'cp{sys.version_info[0]}{sys.version_info[1]}'


def test_only_eol_goes_to_the_path(wheel):
    with zipfile.ZipFile(wheel) as file:
        entries = file.read(f'eol_ros-{VERSION}.dist-info/entry_points.txt').decode().split('\n')
        libexec = {Path(i.filename).name: i.external_attr >> 16 for i in file.infolist()
                   if '/data/lib/eol_ros/' in i.filename}  # fmt: skip
    assert [line for line in entries if '=' in line] == ['eol = eol_ros.__main__:main']
    assert set(libexec) == {*NODES, 'bringup'}  # `ros2 run eol_ros NAME`
    assert all(mode & stat.S_IXUSR for mode in libexec.values())


def test_ros_is_an_extra(wheel):
    with zipfile.ZipFile(wheel) as file:
        lines = file.read(f'eol_ros-{VERSION}.dist-info/METADATA').decode().split('\n')
    needs = [line for line in lines if line.startswith('Requires-Dist: ') and 'extra' not in line]
    assert needs and not any('ros' in line.lower() for line in needs)


# From here on, for `make soak`: a new environment, filled from PyPI as the documents say.


@pytest.fixture(scope='module')
def outside():
    """The environment of a shell that knows nothing of the Python under test."""
    gone = {'PYTHONPATH', 'LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'AMENT_PREFIX_PATH',
            'VIRTUAL_ENV'}  # fmt: skip
    return {name: value for name, value in os.environ.items() if name not in gone}


def pip(folder, environment, cwd, *words):
    """Run pip install for the environment `folder`; skip where PyPI cannot be reached."""
    result = subprocess.run(
        [sys.executable, '-m', 'pip', '--python', folder / 'bin' / 'python',
         'install', '--quiet', '--no-compile', *map(str, words)],
        cwd=cwd, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    if result.returncode and any(word in result.stderr for word in OFFLINE):
        pytest.skip(f'PyPI cannot be reached: {result.stderr.strip().splitlines()[-1]}')
    assert result.returncode == 0, result.stderr[-3000:]


@pytest.fixture(scope='module')
def science(clone, outside, tmp_path_factory):
    """A new environment, filled by the line of the README's section on analysis."""
    section = (clone / 'README.md').read_text().partition('## Read a bag without ROS')[2]
    what = re.search(r"pip install '(\.\[science\])'", section.partition('\n## ')[0]).group(1)
    folder = tmp_path_factory.mktemp('science')
    run(sys.executable, '-m', 'venv', '--without-pip', folder, environment=outside)
    pip(folder, outside, clone, what)
    return folder


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Ten slips and the blocks at their stamps, as the graph records them."""
    from eol_msgs.msg import Block, Blocks, Slip
    from rclpy.serialization import serialize_message

    from eol_ros.ros.definitions import describe
    from eol_ros.ros.stamps import to_msg

    folder = tmp_path_factory.mktemp('bags') / 'run'
    topics = [BagTopic(f'/eol/{name}', **describe(name)) for name in ('blocks', 'slips')]
    writer = BagWriter(folder, topics, {'scene_name': 'made'})
    for i in range(20):
        now = 1_700_000_000_000_000_000 + i * 100_000_000
        seen = Blocks(image=i, blocks=[Block(id=k) for k in range(25)])
        slip = Slip(
            kind=(Slip.KIND_START, Slip.KIND_STOP)[i % 2], slip=i // 2, distance=0.004 * (i % 2)
        )
        for topic, message in (('/eol/blocks', seen), ('/eol/slips', slip)):
            message.header.stamp = to_msg(now)
            writer.write(topic, bytes(serialize_message(message)), now + 8_000_000, now)
    writer.close()
    return folder


@pytest.mark.soak
def test_the_snippet_of_the_readme_runs_without_ros(science, outside, bag, tmp_path):
    section = (ROOT / 'README.md').read_text().partition('## Read a bag without ROS')[2]
    script = re.search(r'```python\n(.*?)```', section, re.S).group(1)
    script = re.sub(r"open_bag\('[^']*'\)", f'open_bag({str(bag)!r})', script)
    script += 'import importlib.util\nassert not importlib.util.find_spec("rclpy")\n'

    said = run(science / 'bin' / 'python', '-c', script, cwd=tmp_path, environment=outside)

    assert said == '10 slips; the longest moved 0.004 m\n'


@pytest.mark.soak
@pytest.mark.parametrize('words', [
    'report BAG --output report', 'bag info BAG', 'lattice --size 8 --events 10 --warmup 0',
])  # fmt: skip
def test_verbs_that_need_no_ros_work_there(science, outside, bag, tmp_path, words):
    words = [str(bag) if word == 'BAG' else word for word in words.split()]
    run(science / 'bin' / 'eol', *words, cwd=tmp_path, environment=outside)


@pytest.mark.soak
def test_the_others_name_the_command_that_helps(science, outside, tmp_path):
    result = subprocess.run(
        [science / 'bin' / 'eol', 'run', 'rehearsal'], cwd=tmp_path, env=outside,
        capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 69
    [line] = result.stderr.splitlines()
    source = science / 'share' / 'eol_ros' / 'eol_msgs'
    assert line.endswith(f'{science}/bin/python -m pip install {source}')
    assert (source / 'msg' / 'Slip.msg').is_file() and (source / 'pyproject.toml').is_file()


@pytest.fixture(scope='module')
def messages(tmp_path_factory):
    """A wheel of the messages: the one that set-up keeps, if it has these very definitions."""
    ours = {path.name: path.read_bytes() for path in (ROOT / 'msg_defs').rglob('*.msg')}
    tag = f'-cp{sys.version_info[0]}{sys.version_info[1]}-'
    for kept in folders.cache('wheels').glob('*/eol_msgs-*.whl'):
        with zipfile.ZipFile(kept) as file:
            names = [n for n in file.namelist() if re.search(r'share/eol_msgs/msg/\w+\.msg$', n)]
            if tag in kept.name and {Path(n).name: file.read(n) for n in names} == ours:
                return kept
    folder = tmp_path_factory.mktemp('messages')
    run(sys.executable, '-m', 'pip', '-q', 'wheel', '--no-deps', '-w', folder,
        ROOT / 'msg_defs' / 'eol_msgs')  # fmt: skip
    return next(folder.glob('*.whl'))


@pytest.fixture(scope='module')
def installed(science, outside, wheel, messages):
    """Both wheels in one command, in an environment that had no ROS."""
    pip(science, outside, '/', wheel, messages)
    return science


@pytest.mark.soak
def test_both_wheels_install_with_one_command(installed, outside, tmp_path):
    eol = installed / 'bin' / 'eol'
    checked = json.loads(run(eol, 'check', 'museum', '--json', cwd=tmp_path, environment=outside))
    assert checked['ok'] is True
    script = (
        'import eol_msgs.msg, rclpy; from rclpy.serialization import serialize_message as s,'
        ' deserialize_message as d; m = eol_msgs.msg.Slip(block=7);'
        ' assert d(s(m), eol_msgs.msg.Slip) == m; print(rclpy.__file__)'
    )
    where = run(installed / 'bin' / 'python', '-c', script, cwd=tmp_path, environment=outside)
    assert where.startswith(str(installed))


@pytest.mark.soak
def test_ros2_run_finds_the_nodes_of_the_environment(installed, outside, tmp_path):
    """What `ros2 run` does: the prefix from the ament index, then any executable in lib/eol_ros."""
    script = 'from ament_index_python import get_package_prefix as p; print(p("eol_ros"))'
    environment = {**outside, 'AMENT_PREFIX_PATH': str(installed)}
    prefix = run(installed / 'bin' / 'python', '-c', script, cwd=tmp_path, environment=environment)
    tracker = Path(prefix.strip()) / 'lib' / 'eol_ros' / 'tracker'

    assert os.access(tracker, os.X_OK)
    said = run(tracker, '--help', cwd=tmp_path, environment=environment)
    assert 'eol_ros.nodes tracker' in said
    ours = {name for name in (*NODES, 'bringup') if (installed / 'bin' / name).exists()}
    assert ours == set()


def test_the_version_is_one(wheel):
    package = (ROOT / 'package.xml').read_text()
    both = [re.search('<version>(.*)</version>', package).group(1), wheel.name.split('-')[1]]
    assert len(set(both)) == 1 and metadata.version('eol_msgs') == both[0]

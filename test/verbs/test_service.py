# SPDX-License-Identifier: Apache-2.0
"""The units that `eol service` writes, as systemd itself reads them."""

import os
import pwd
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support import needs

from eol_ros import cli
from eol_ros import scene as scenes
from eol_ros.verbs import service

ROOT = Path(__file__).parents[2]
USER = pwd.getpwuid(os.getuid()).pw_name


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Write the units of a scene for this user; return the folder."""
    monkeypatch.chdir(ROOT)

    def write(*words):
        code = cli.main(['service', 'install', *words, '--user', USER, '--output', str(tmp_path)])
        assert code == 0
        return tmp_path

    return write


def settings(path):
    """The lines of a unit as a dictionary of lists."""
    found: dict[str, list[str]] = {}
    for line in path.read_text().splitlines():
        if '=' in line and not line.startswith('#'):
            key, value = line.split('=', 1)
            found.setdefault(key, []).append(value)
    return found


@needs.marker('systemd')
@pytest.mark.parametrize('scene', ['museum', 'rehearsal', 'lights', 'playback'])
def test_systemd_takes_them_and_finds_little_exposed(written, scene):
    unit = written(scene) / service.WORK_PATH
    checked = subprocess.run(
        ['systemd-analyze', 'verify', '--man=no', str(unit)], capture_output=True, text=True
    )
    assert (checked.returncode, checked.stderr) == (0, '')
    judged = subprocess.run(
        ['systemd-analyze', 'security', '--offline=true', '--no-pager', str(unit)],
        capture_output=True, text=True,
    )  # fmt: skip
    exposure = float(re.search(r'exposure level for eol.service: ([\d.]+)', judged.stdout)[1])
    assert exposure <= 4.0


def test_the_unit_starts_this_scene_with_this_python(written):
    folder = written('museum', '--log-in')
    unit, walls = settings(folder / service.WORK_PATH), settings(folder / service.WALLS_PATH)

    scene = f'{ROOT}/config/museum.yaml'
    assert unit['ExecStart'] == [f'{sys.executable} -m eol_ros.bringup {scene}']
    assert unit['WorkingDirectory'] == [str(ROOT)] and unit['User'] == [USER]
    assert unit['Type'] == ['notify'] and float(unit['WatchdogSec'][0]) > 0
    assert f'-{ROOT}/bags' in unit['ReadWritePaths'][0].split()
    assert unit['IPAddressDeny'] == ['any']  # the panel serves this machine alone
    assert unit['IPAddressAllow'] == ['localhost 239.255.0.1']  # or DDS brings nobody together
    assert walls['ExecStart'] == [f'{sys.executable} -m eol_ros kiosk --url http://127.0.0.1:8080']
    log_in = [folder / place for place in (service.GETTY_PATH, service.LIGHTDM_PATH)]
    assert sum(USER in path.read_text() for path in log_in if path.exists()) == 1


MACHINES = """
network: lan
nodes: {twin:, tracker:, motion:, montage:, panel:, recorder: {folder: FOLDER/bags}}
machines:
  show: {address: 10.9.0.1, nodes: [twin, tracker, motion, recorder]}
  walls: {address: 10.9.0.2, nodes: [montage, panel]}
"""


def test_a_machine_of_several_starts_its_part_of_the_scene(written, tmp_path, capsys):
    scene = tmp_path / 'show.yaml'
    scene.write_text(MACHINES.replace('FOLDER', str(tmp_path)))
    for name, walls in (('show', False), ('walls', True)):
        unit = settings(written(str(scene), '--machine', name) / service.WORK_PATH)
        command = f'{sys.executable} -m eol_ros.bringup {scene} --machine {name}'
        assert unit['ExecStart'] == [command]
        assert (tmp_path / service.WALLS_PATH).exists() is walls
        assert 'IPAddressDeny' not in unit
    refused = cli.main(['service', 'install', str(scene), '--machine', 'cellar', '-o', 'x'])
    assert (refused, 'no such machine' in capsys.readouterr().err) == (2, True)


def test_folders_of_ones_own_may_be_written_and_all_that_is_made_is_the_users(
    written, tmp_path, monkeypatch
):
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'a' / 'b'))
    unit = settings(written('lights') / service.WORK_PATH)
    assert f'EOL_STATE={tmp_path}/a/b' in unit['Environment']
    assert f'-{tmp_path}/a/b' in unit['ReadWritePaths'][0].split()

    assert service.made(tmp_path / 'a' / 'b') == [tmp_path / 'a' / 'b', tmp_path / 'a']
    assert service.made(tmp_path / 'a') == []


def test_a_scene_without_walls_opens_none(written):
    assert not (written('lights') / service.WALLS_PATH).exists()


def test_what_is_open_to_the_network_is_not_shut_in(tmp_path):
    path = tmp_path / 'open.yaml'
    for head, node in (
        ('network: lan', 'tracker: {}'),
        ('notify: {webhook: "https://museum.at/hook"}', 'tracker: {}'),
        ('programs: {post: [curl, museum.at]}', 'tracker: {}'),
        ('', 'projectors: {addresses: [10.0.0.5]}'),
        ('', 'osc: {peers: [10.0.0.7]}'),
        ('', 'osc: {tuio: ["10.0.0.7:3333"]}'),
        ('', 'sacn: {}, leds: {}, motion: {}, tracker: {}'),
    ):
        path.write_text(f'{head}\nnodes: {{twin: {{}}, {node}}}\n')
        units = service.units(scenes.load(path), 'museum', Path('/home/museum'), tmp_path)
        assert 'IPAddressDeny' not in units[service.WORK_PATH], node
    path.write_text('nodes: {twin: {}, osc: {send_to: ["127.0.0.1:57120"]}}\n')
    units = service.units(scenes.load(path), 'museum', Path('/home/museum'), tmp_path)
    assert 'IPAddressDeny' in units[service.WORK_PATH]


def test_all_folders_that_a_scene_writes_to_can_be_written(tmp_path, monkeypatch):
    for name in service.FOLDERS:
        monkeypatch.delenv(name, raising=False)
    for name in ('ice.wav', 'dirt.png', 'camera.yaml'):
        (tmp_path / name).touch()
    path = tmp_path / 'scene.yaml'
    path.write_text(
        'nodes:\n  twin: {}\n  tracker: {background: dirt.png}\n'
        '  grains: {sound: ice.wav}\n  sound: {wav: /data/sound/out.wav}\n'
        '  recorder: {folder: /data/bags}\n'
    )
    found = {str(f) for f in service.writes(scenes.load(path), Path('/home/m'), Path('/work'))}
    assert found == {
        '/data/bags', '/data/sound', str(tmp_path), '/home/m/.cache', '/home/m/.local/state/eol_ros'
    }  # fmt: skip
    path.write_text('programs: {count: [python, count.py]}\nnodes: {twin: {}}\n')
    assert tmp_path in service.writes(scenes.load(path), Path('/home/m'), Path('/work'))


@pytest.mark.parametrize(
    ('words', 'code', 'what'),
    [
        (['install', 'museum', '--user', 'nobody-of-that-name'], 2, 'there is no such user'),
        (['install', 'museum', '--user', 'root'], 2, 'root may not run the scene'),
        (['install', 'musem', '--user', 'root'], 78, 'Did you mean museum?'),
    ],
)
def test_what_cannot_be_installed_is_refused_in_a_line(words, code, what, capsys):
    assert cli.main(['service', *words]) == code
    err = capsys.readouterr().err
    assert what in err and err.count('\n') == 1


def test_a_path_with_a_space_is_refused(tmp_path, capsys):
    folder = tmp_path / 'my museum'
    folder.mkdir()
    (folder / 'scene.yaml').write_text('nodes: {twin: {}, tracker: {}}')
    words = ['service', 'install', str(folder / 'scene.yaml'), '--user', USER]
    assert cli.main([*words, '--output', str(tmp_path / 'out')]) == 78
    assert 'without spaces' in capsys.readouterr().err

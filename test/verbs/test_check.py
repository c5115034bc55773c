# SPDX-License-Identifier: Apache-2.0
"""What nodes would refuse is told before anything starts, all at once and each at its place."""

import json
import shutil
import zoneinfo
from pathlib import Path

import pytest

from eol_ros import cli
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.files import calibration_file, time_zone
from eol_ros.errors import ConfigError


@pytest.fixture
def check(tmp_path, capsys, monkeypatch):
    """Run `eol check` on a scene of these nodes; return exit code, output and words."""
    monkeypatch.chdir(tmp_path)

    def run(nodes, *words, head=''):
        path = tmp_path / 'scene.yaml'
        path.write_text(f'{head}nodes:\n{nodes}')
        code = cli.main(['check', str(path), *words])
        told = capsys.readouterr()
        return code, told.out, told.err

    return run


def test_each_line_of_opening_hours_that_cannot_be_meant(check):
    code, _, words = check(
        """\
  twin: {}
  hours:
    time_zone: Europe/Viena
    open: ['Tue-Sun 18:00-10:00', Mon closed, 'Thu 10-21']
"""
    )
    lines = [line.partition(' error ')[2] for line in words.splitlines() if ' error ' in line]
    assert code == 78
    assert lines == [
        "hours.time_zone: 'Europe/Viena': no such time zone. Did you mean Europe/Vienna?",
        "hours.open: 'Thu 10-21': '10-21' is neither times nor closed, such as 'Tue-Sun"
        " 10:00-18:00', '2026-12-24 closed'",
        "hours.open: 'Tue-Sun 18:00-10:00': 18:00-10:00 ends before it begins; past midnight is"
        ' written 18:00-34:00',
    ]
    assert ':4:16 error hours.time_zone' in words and ':5:11 error hours.open' in words

    code, out, words = check(
        '  twin: {}\n  hours: {time_zone: Asia/Taipei, open: [Tue-Sun 10:00-18:00]}\n'
    )
    assert (code, words) == (0, 'no mistakes\n') and 'hours' in out


CUES = """\
  twin: {}
  tracker: {}
  grains: {}
  hours:
    time_zone: Europe/Vienna
    open: [Tue-Sun 10:00-18:00]
    cues:
      - day set grains radius=0.05
      - day set grains radis=0.05
      - day set grain radius=0.05
      - day set leds peak=0.5
      - day set grains seed=one
      - day set twin fps=30
      - day slep
      - day recall_preset preset=x
      - day cue name=day
      - day
      - day set grains "radius=1
    cue_times:
      - Fri 18:30 day
      - Fri 18:30 dya
"""


def test_each_cue_that_could_not_be_given(check):
    code, _, words = check(CUES)
    found = [line.partition(' error ') for line in words.splitlines() if ' error ' in line]
    assert code == 78
    place = {where.rsplit(':', 3)[-2] + ': ' + what for where, _, what in found}
    for number, line, why in (
        (1, 'day set grains radis=0.05', 'grains has no setting radis. Did you mean radius?'),
        (2, 'day set grain radius=0.05', 'set: grain does not heed it, but twin, tracker'),
        (3, 'day set leds peak=0.5', 'this scene has no leds: add it, or leave out this line'),
        (4, 'day set grains seed=one', "seed: 'one' is not a whole number (at least 0)"),
        (5, 'day set twin fps=30', 'fps'),
        (6, 'day slep', 'slep: no such request. Did you mean sleep?'),
        (7, 'day recall_preset preset=x', 'over_s'),
        (8, 'day cue name=day', 'a cue gives no other cue: write the requests of that one'),
        (9, 'day', 'give CUE REQUEST, such as evening set leds look=embers'),
        (10, 'day set grains "radius=1', 'No closing quotation'),
    ):
        told = f'{9 + number}: hours.cues[{number}]: {line!r}: '
        assert [p for p in place if p.startswith(told) and why in p], (told, words)
    assert "22: hours.cue_times[1]: 'Fri 18:30 dya': no such cue. Did you mean day?" in place
    assert len(found) == 11, words


@pytest.mark.parametrize(
    'hours',
    ["open: ['9999-12-31 closed']", "open: ['0001-01-01 10:00-12:00']", 'open: [9999-12-31]',
     'time_zone: 0001-01-01T00:00:00+23:00', "open: ['2026-01-01-9999-12-31 closed']"],
)  # fmt: skip
def test_dates_at_the_ends_of_the_calendar_are_mistakes_in_a_line(tmp_path, capsys, hours):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(f'nodes:\n  twin: {{}}\n  hours:\n    {hours}\n')
    assert cli.main(['check', str(scene)]) == 78
    told = capsys.readouterr().err
    assert f'{scene}:4:' in told and 'error' in told


def test_a_system_without_time_zones_says_what_to_install(monkeypatch):
    monkeypatch.setattr(zoneinfo, 'available_timezones', set)
    monkeypatch.setattr(zoneinfo, 'ZoneInfo', _no_zone)
    with pytest.raises(ConfigError, match='apt install tzdata, or .* -m pip install tzdata'):
        time_zone.load('Europe/Vienna')


def _no_zone(name):
    raise zoneinfo.ZoneInfoNotFoundError(name)


EVERYTHING = """\
  twin: {mu_kinetic: 1.2}
  tracker: {calibration: camera.yaml, background: dirt.png, blink_block: 3}
  motion: {}
  leds:
    port: twin
    flash_limit: false
    blink_block: 4
  grains: {sound: ice.wav}
  sound:
    device: wav
  osc: {send_to: [nowhere], peers: [10.0.0.300, x]}
  montage: {pairs: pictures}
  panel:
    host: 0.0.0.0
  recorder: {folder: /dev/null/bags}
"""


def test_all_that_nodes_would_refuse_is_told_at_once(check, tmp_path):
    calibration_file.save(tmp_path / 'camera.yaml', Calibration.ideal(640, 480))
    (tmp_path / 'dirt.png').write_text('no image')
    (tmp_path / 'ice.wav').write_text('no sound')
    (tmp_path / 'pictures').mkdir()
    (tmp_path / 'pictures' / 'pairs.csv').write_text('a.png,b.png\n')
    code, out, words = check(EVERYTHING)

    assert (code, out) == (78, '')
    lines = [line.removeprefix('eol check: ') for line in words.splitlines()]
    scene = tmp_path / 'scene.yaml'
    for place, what in {
        f'{tmp_path}/dirt.png:1:1 error tracker.background': 'not an image',
        f'{tmp_path}/ice.wav:1:1 error grains.sound': 'not a sound that libsndfile reads',
        f'{tmp_path}/pictures:1:1 error montage.pairs': 'a.png: missing',
        f'{scene}:2:22 error twin.mu_kinetic': 'is 1.2, mu_static is 0.9',
        f'{scene}:3:26 error tracker.calibration': 'images of 640x480, twin gives 1280x800',
        f'{scene}:7:18 error leds.flash_limit': 'needs a written reason',
        f'{scene}:8:18 error leds.blink_block': 'is 4, tracker.blink_block is 3',
        f'{scene}:12:18 error osc.send_to': 'give HOST:PORT',
        f'{scene}:12:36 error osc.peers': "'10.0.0.300': give an IPv4 address",
        f'{scene}:12:36 error osc.peers: ': "'x': give an IPv4 address",
        f'{scene}:15:11 error panel.host': 'set panel.pin too',
        f'{scene}:16:22 error recorder.folder': 'nothing can be written in /dev/null',
    }.items():
        assert [line for line in lines if line.startswith(place) and what in line], (place, words)
    assert lines[-1] == '12 errors. Nothing was started.'


def test_a_node_osc_without_another_program_is_refused(check):
    code, _, words = check('  twin: {}\n  osc: {}\n')
    assert code == 78 and 'error osc: has nothing to do: set send_to, port' in words


def test_a_wrong_value_hides_no_other_mistake(check):
    """What depends on the wrong value is not told: nobody knows what it was to be."""
    code, _, words = check(
        "  grains: {match: ['flatness 2 q', 'pitch 1 x y'], sound: ice.wav}\n"
        '  twin: {mu_static: high, mu_kinetic: 1.2}\n'
        '  panel: {host: 0.0.0.0}\n'
        '  recorder: {folder: /proc/bags}\n'
    )

    assert code == 78
    for what in (
        'publishes: add',
        "grains.match: 'flatness 2 q' is not DESCRIPTOR WEIGHT SOURCE; 'pitch 1 x y' is not",
        'grains.sound: ',
        'twin.mu_static: ',
        'panel.pin',
        '/proc',
    ):
        assert what in words
    assert words.splitlines()[-1] == '6 errors. Nothing was started.'


def test_a_typo_hides_nothing_that_a_node_would_refuse(check):
    """Nor does a misspelt node hide its own settings, or seem to be missing to the others."""
    code, _, words = check(
        '  twin: {}\n'
        '  trackr: {background: gone.png, treshold: 1}\n'
        '  motion: {}\n'
        '  panel: {hos: x, host: 0.0.0.0}\n',
        head='network: wan\n',
    )

    lines = [line.split(' error ')[1] for line in words.splitlines() if ' error ' in line]
    assert code == 78 and len(lines) == 6, words
    for what, line in zip(
        ('network: ', 'nodes.trackr: ', 'tracker.background: gone.png: no such', 'tracker.treshold',
         'panel.hos: no such key. Did you mean host', 'panel.host: 0.0.0.0 opens'),
        lines, strict=True,
    ):  # fmt: skip
        assert line.startswith(what)


def test_an_own_program_or_its_script_that_is_missing(check, tmp_path):
    (tmp_path / 'there.py').touch()
    (tmp_path / 'run.py').touch(0o755)
    (tmp_path / 'folder').mkdir()
    head = (
        'programs: {a: [./gone], b: [python, gone.py], c: [python, there.py], d: [python, -i],\n'
        '  e: [./there.py], f: [run.py], g: [folder]}\n'
    )
    code, _, words = check('  twin: {}\n', head=head)
    assert code == 78
    for name, missing in (
        ('a', './gone: no such program'), ('b', 'gone.py: no such file'),
        ('g', 'folder: no such program'),
    ):  # fmt: skip
        assert f'programs.{name}: {missing}; name it by its path' in words
    assert 'programs.f: run.py: not on PATH: write ./run.py' in words
    assert 'programs.e: ./there.py: not executable; `chmod +x` it' in words
    assert 'programs.c' not in words and 'programs.d' not in words

    code, out, _ = check('  twin: {}\n', head='programs: {c: [python, there.py]}\n')
    assert code == 0 and out.endswith('\n  c         python there.py\n')


def test_each_mistake_shows_its_line_and_a_caret(check):
    words = check("  panel: {pin: 'geheim7', hos: 'geheim7'}  # 地 \n  twin: {夢: 1, fpss: 3}\n")[2]
    lines = words.splitlines()
    assert 'geheim' not in words
    for found in ('hos: ***', '夢: 1', 'fpss: 3'):
        at = next(k for k, line in enumerate(lines) if line.startswith(' ') and found in line)
        below = [line.index('^') for line in lines[at + 1 :: 3] if line.strip() == '^']
        begin = lines[at].index(found) + lines[at][: lines[at].index(found)].count('夢')
        assert begin in below, (found, words)


@pytest.mark.parametrize('variable', ['EOL_STATE', 'EOL_CACHE'])
def test_a_folder_that_every_scene_writes_to_cannot_be_written(check, monkeypatch, variable):
    monkeypatch.setenv(variable, '/proc/nothing')
    code, _, words = check('  twin: {}\n')
    assert code == 78
    assert f'error {variable}: nothing can be written in /proc' in words
    assert f'set {variable} to another folder' in words


def test_programs_get_the_mistakes_as_json(check):
    code, out, _ = check('  panel: {host: 0.0.0.0}\n', '--json')

    assert code == 78
    (mistake,) = json.loads(out)['mistakes']
    assert (mistake['line'], mistake['column'], mistake['where']) == (2, 17, 'panel.host')


def test_programs_are_told_as_json_too_that_there_is_no_such_scene(tmp_path, capsys):
    for name, what in (('musem', 'no such scene. Did you mean museum?'), (tmp_path, 'is a folder')):
        code = cli.main(['check', str(name), '--json'])
        told = json.loads(capsys.readouterr().out)

        assert code == 78 and not told['ok']
        (mistake,) = told['mistakes']
        assert mistake['file'] == str(name) and mistake['what'].startswith(what)


def test_a_replay_of_what_is_no_bag_or_has_no_such_topic(check, tmp_path):
    (tmp_path / 'run.mcap').write_text('not a bag')
    code, _, words = check('  replay: {bag: run.mcap}\n  tracker: {}\n')

    assert code == 78
    assert f'{tmp_path}/run.mcap:1:1 error replay.bag: not a bag' in words


def test_what_is_allowed_and_should_be_known_is_a_warning(check, tmp_path):
    pictures = tmp_path / 'pictures'
    pictures.mkdir()
    for name in 'ab':
        (pictures / f'{name}.svg').write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    (pictures / 'pairs.csv').write_text('a.svg,b.svg\na.svg,gone.svg\n')
    code, _, words = check(
        '  twin: {}\n  tracker: {}\n  motion: {}\n'
        '  leds: {port: twin, flash_limit: false, flash_limit_off_because: a test}\n'
        '  montage: {pairs: pictures}\n  recorder: {min_free_gb: 1.0e+9}\n',
        head='network: lan\n',
    )

    assert code == 0
    for what in (
        'network: lan lets every machine',
        'gone.svg: missing: this pair is skipped',
        'leds.flash_limit is off: a test',
        'less than min_free_gb (1e+09 GB)',
        'no mistakes, 4 warnings',
    ):
        assert what in words


def test_the_certificate_of_the_panel(check, tmp_path):
    panel = "  panel: {host: 0.0.0.0, pin: '471147'%s}\n"
    assert 'the PIN can be read on the network' in check(panel % '')[2]
    (tmp_path / 'panel.pem').write_text('none')
    code, _, words = check(panel % ', certificate: panel.pem')
    assert code == 78 and words.count('panel.certificate: ') == 1
    shutil.copy(Path(__file__).parents[1] / 'support/localhost.pem', tmp_path / 'panel.pem')
    code, _, words = check(panel % ', certificate: panel.pem')
    assert code == 0 and 'warning' not in words


def test_loudspeakers_that_do_not_fit(check):
    nodes = """\
  camera: {}
  tracker: {}
  grains: {}
  sound:
    sub_output: true
    channels: %s
    speakers: [front 0, %s, right -120]
"""
    code, _, words = check(nodes % (3, 'left 0.5, back') + '    sub_low_hz: 70\n')
    assert code == 78 and "; 'back' is not a loudspeaker" in words
    assert 'sound.speakers' in words and 'front stands in that direction already' in words
    assert 'sound.sub_low_hz: is 70, sub_high_hz is 60' in words
    code, _, words = check(nodes % (3, 'left 120'))
    assert code == 78 and 'is 3; 3 speakers and one for the sub voice make 4' in words


def test_devices_that_are_not_there(check, monkeypatch):
    monkeypatch.setattr('eol_ros.devices.camera.ports.list_cameras', list)
    monkeypatch.setattr('eol_ros.devices.board.ports.list_ports', list)
    nodes = '  camera: {}\n  tracker: {}\n  motion: {}\n  leds: {port: COM}\n'
    assert check(nodes)[0] == 0
    code, _, words = check(nodes, '--devices')

    assert code == 69
    assert 'scene.yaml:2:11 error camera.device: no camera found' in words
    assert "scene.yaml:5:16 error leds.port: no serial port has 'COM' in its name" in words

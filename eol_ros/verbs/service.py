# SPDX-License-Identifier: Apache-2.0
"""eol service: start at boot, by systemd."""

import os
import pwd
import shutil
import subprocess
import sys
from pathlib import Path

from eol_ros import scene as scenes
from eol_ros.bringup import plan
from eol_ros.bringup.status import UNIT
from eol_ros.devices.files.names import is_text
from eol_ros.disk import DISK, check_file
from eol_ros.errors import ConfigError, DeviceMissing, EolError, UsageError

HELP = (
    'Start the work at boot under systemd, and its two walls when the user logs in. Run this as '
    'root, from the folder in which you start the scene by hand.'
)
EXAMPLES = [
    'sudo .venv/bin/eol service install museum --user museum --log-in',
    'eol service install museum --user museum --output units   # only write them, to look at',
    'sudo .venv/bin/eol service install show.yaml --machine audio   # its part of the scene',
    'sudo .venv/bin/eol service remove',
]
WORK, WALLS = 'eol.service', 'eol-walls.service'
DISCOVERY = '239.255.0.1'  # where participants of DDS find each other (RTPS 2.3, 9.6.1.4.1)
FOLDERS = 'EOL_CACHE', 'EOL_STATE'  # of who installs; the unit has them, too
# Where each unit and drop-in lies below the root of the file system.
WORK_PATH = str(UNIT.relative_to('/'))
WALLS_PATH = 'etc/systemd/user/eol-walls.service'
GETTY_PATH = 'etc/systemd/system/getty@tty1.service.d/eol.conf'
LIGHTDM_PATH = 'etc/lightdm/lightdm.conf.d/50-eol.conf'
PATHS = (WORK_PATH, WALLS_PATH, GETTY_PATH, LIGHTDM_PATH)

_WORK = """\
# Written by `eol service install`, which will write it again.
[Unit]
Description=Echoes of the Land, scene {scene}
Documentation=https://www.freedesktop.org/software/systemd/man/systemd.exec.html
After=sound.target network.target
StartLimitIntervalSec=0

[Service]
Type=notify
NotifyAccess=main
User={user}
WorkingDirectory={folder}
{environment}ExecStart={python} -m eol_ros.bringup {scene}{machine}
# A camera that is not plugged in, a full disk: tried again for ever. A wrong scene is not.
Restart=always
RestartSec=5
RestartPreventExitStatus=2 3 78
SuccessExitStatus=3
# The first start after an upgrade compiles the loops, two minutes on two cores.
TimeoutStartSec=15min
WatchdogSec=30
# Bringup ends its nodes in their order; what is left after 90 s is killed.
KillMode=mixed
KillSignal=SIGINT
TimeoutStopSec=90
LimitRTPRIO=2
OOMPolicy=continue

# What it may touch: its folders, its devices, {network}.
SupplementaryGroups=video audio dialout
UMask=0027
ProtectSystem=strict
ProtectHome=read-only
ReadWritePaths={writes}
PrivateTmp=yes
DevicePolicy=closed
DeviceAllow=char-video4linux rw
DeviceAllow=char-alsa rw
DeviceAllow=char-ttyACM rw
DeviceAllow=char-ttyUSB rw
{addresses}RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
CapabilityBoundingSet=
AmbientCapabilities=
NoNewPrivileges=yes
ProtectClock=yes
ProtectControlGroups=yes
ProtectHostname=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
ProtectProc=invisible
RestrictNamespaces=yes
RestrictSUIDSGID=yes
LockPersonality=yes
RemoveIPC=no
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged
SystemCallErrorNumber=EPERM

[Install]
WantedBy=multi-user.target
"""
_WALLS = """\
# Written by `eol service install`, which will write it again.
[Unit]
Description=Echoes of the Land, the two walls
PartOf=graphical-session.target
After=graphical-session.target

[Service]
ExecStart={python} -m eol_ros kiosk --url {url}
ExecCondition=/usr/bin/test %u = {user}
Restart=always
RestartSec=5
TimeoutStopSec=15

[Install]
WantedBy=graphical-session.target
"""
_GETTY = """\
# Written by `eol service install --log-in`: {user} is logged in on the first console.
[Service]
ExecStart=
ExecStart=-/sbin/agetty --autologin {user} --noclear %I $TERM
"""
_LIGHTDM = """\
# Written by `eol service install --log-in`: {user} is logged in when the screen comes up.
[Seat:*]
autologin-user={user}
autologin-user-timeout=0
"""


def add_arguments(parser):
    """Declare the command line."""
    commands = parser.add_subparsers(dest='what', metavar='COMMAND', required=True)
    install = commands.add_parser('install', help='write the units and enable them')
    install.add_argument(
        'scene', nargs='?', default='museum', help='scene file, or name of a shipped scene'
    )
    install.add_argument(
        '--user', default=os.environ.get('SUDO_USER', ''),
        help='user that runs it, not root (default: the user who called sudo)',
    )  # fmt: skip
    install.add_argument(
        '--log-in', action='store_true', help='log this user in at boot, for the walls'
    )
    install.add_argument(
        '-o',
        '--output',
        metavar='DIR',
        help='only write the files below this folder, and start nothing',
    )
    install.add_argument(
        '--machine',
        metavar='NAME',
        help='one of the `machines` of the scene (default: the machine with an address of this '
        'one)',
    )
    install.set_defaults(does=_install)
    remove = commands.add_parser('remove', help='stop the work and no longer start it at boot')
    remove.set_defaults(does=_remove)


def run(args):
    """Do what is asked."""
    return args.does(args)


def units(scene: scenes.Scene, user: str, home: Path, folder: Path, log_in: str = '') -> dict:
    """Return the files to write, by their place below the root.

    user: who runs it, with this home folder. folder: where it is started. log_in: 'getty',
    'lightdm' or empty.
    """
    panel, machine = scene.nodes.get('panel'), scene.nodes.get('machine')
    scheme = 'https' if panel and panel.certificate else 'http'
    alone = not _reaches_out(scene)
    kept = (*FOLDERS, 'ROS_DOMAIN_ID')
    environment = [
        f'Environment={_quoted(f"{k}={os.environ[k]}")}\n' for k in kept if os.environ.get(k)
    ]
    values = {
        'scene': scene.path or scene.name,
        'machine': f' --machine {machine.name}' if machine else '',
        'user': user,
        'folder': folder,
        'python': sys.executable,
        'environment': ''.join(environment),
        'network': 'this machine' if alone else 'the network',
        'addresses': f'IPAddressDeny=any\nIPAddressAllow=localhost {DISCOVERY}\n' if alone else '',
        'writes': ' '.join(_quoted(f'-{path}') for path in writes(scene, home, folder)),
        'url': f'{scheme}://127.0.0.1:{panel.port if panel else 8080}',
    }
    for key in ('scene', 'folder', 'python'):
        if any(c in str(values[key]) for c in ' \t"\'%\\'):
            raise ConfigError(
                f'{values[key]}: a systemd unit cannot name it; move it to a path without spaces'
            )
    found = {WORK_PATH: _WORK.format(**values)}
    if {'montage', 'panel'} <= set(scene.nodes):
        found[WALLS_PATH] = _WALLS.format(**values)
    if log_in:
        place, text = (LIGHTDM_PATH, _LIGHTDM) if log_in == 'lightdm' else (GETTY_PATH, _GETTY)
        found[place] = text.format(**values)
    return found


def _reaches_out(scene: scenes.Scene) -> bool:
    """Return whether a node of the scene exchanges packets with other machines."""
    from eol_ros.devices.address import target
    from eol_ros.web.guard import is_loopback

    if scene.network != 'local' or scene.notify or {'projectors', 'sacn'} & set(scene.nodes):
        return True
    if scene.programs:  # of which nobody knows what they do
        return True
    panel, osc = scene.nodes.get('panel'), scene.nodes.get('osc')
    hosts = [panel.host] if panel else []
    if osc:
        hosts += [target(one)[0] for one in (*osc.send_to, *osc.tuio, *osc.tuio2)]
    return bool(osc and osc.peers) or not all(map(is_loopback, hosts))


def _quoted(word: str) -> str:
    """Return a word as units have it (man 7 systemd.syntax); blanks end one that is not quoted."""
    if any(ord(c) < 32 for c in word) or not is_text(word):
        raise ConfigError(f'{word!a}: a systemd unit cannot name this path; rename it')
    word = word.replace('%', '%%')
    if not set(word) & set(' \t"\'\\;'):
        return word
    return '"' + word.replace('\\', '\\\\').replace('"', '\\"') + '"'


def writes(scene: scenes.Scene, home: Path, folder: Path) -> list[Path]:
    """Return the folders that the nodes of a scene write to."""
    found = [home / '.cache', home / '.local/state/eol_ros']
    found += [folder / os.environ[name] for name in FOLDERS if os.environ.get(name)]
    recorder, sound = scene.settings('recorder'), scene.nodes.get('sound')
    found.append(folder / recorder.folder)
    found += filter(None, map(scene.folder_of, scene.programs))
    if sound and sound.wav:
        found.append((folder / sound.wav).parent)
    if (tracker := scene.nodes.get('tracker')) is not None:
        found += [Path(f).parent for f in (tracker.background, tracker.calibration) if f]
    grains = scene.nodes.get('grains')
    if grains and grains.sound:  # what is moved by hand is kept beside the sound
        sounds = Path(grains.sound)
        found.append(sounds if sounds.is_dir() else sounds.parent)
    return sorted(set(found))


def made(path: Path) -> list[Path]:
    """Make a folder, and those above it that are not there; return all of these."""
    new = [there for there in (path, *path.parents) if not there.exists()]
    path.mkdir(parents=True, exist_ok=True)
    return new


def _install(args) -> int:
    check_file(args.scene)  # it is read at every boot
    scene = scenes.load(args.scene)
    if scene.machines or args.machine:
        scene = plan.own_part(plan.on_machine(scene, args.machine))
    try:
        person = pwd.getpwnam(args.user or pwd.getpwuid(os.getuid()).pw_name)
    except KeyError:
        raise UsageError(f'--user {args.user}: there is no such user here') from None
    if person.pw_uid == 0 and not args.output:
        raise UsageError('--user: root may not run the scene; name another user of this machine')
    home, folder = Path(person.pw_dir), Path.cwd()
    log_in = ('lightdm' if shutil.which('lightdm') else 'getty') if args.log_in else ''
    files = units(scene, person.pw_name, home, folder, log_in)
    if args.output:
        _write(files, args.output)
        return 0
    _need_root('install')
    if shutil.which('gdm3') and log_in == 'getty':
        raise ConfigError(
            '--log-in: gdm3 has one file for this, /etc/gdm3/daemon.conf; write under [daemon] '
            f'AutomaticLoginEnable=true and AutomaticLogin={person.pw_name}, and leave --log-in out'
        )
    for path in writes(scene, home, folder):
        for new in made(path):
            os.chown(new, person.pw_uid, person.pw_gid)
    _write(files, '/')
    _systemctl('daemon-reload')
    if WALLS_PATH in files:
        _systemctl('--global', 'enable', WALLS)
    _systemctl('enable', '--now', WORK)
    print(f'{scene.name} runs, and starts at boot: `systemctl status eol`', file=sys.stderr)
    return 0


def _write(files: dict[str, str], root: str) -> None:
    for place, text in files.items():
        path = Path(root, place)
        path.parent.mkdir(parents=True, exist_ok=True)
        DISK.write(path, text)
        print(path)


def _remove(args) -> int:
    _need_root('remove')
    there = [Path('/', place) for place in PATHS if Path('/', place).exists()]
    if not there:
        raise DeviceMissing(f'{WORK} is not installed')
    if Path('/', WORK_PATH) in there:
        _systemctl('disable', '--now', WORK)
    if Path('/', WALLS_PATH) in there:
        _systemctl('--global', 'disable', WALLS)
    for path in there:
        path.unlink()
        print(f'removed {path}')
    _systemctl('daemon-reload')
    return 0


def _need_root(what: str) -> None:
    if os.geteuid() != 0:
        raise UsageError(f'systemd takes units from root only: sudo {sys.argv[0]} service {what}')
    _found()


def _found() -> str:
    path = shutil.which('systemctl')
    if not path:
        raise DeviceMissing('there is no systemctl: this machine is not run by systemd')
    return path


def _systemctl(*words: str) -> None:
    done = subprocess.run([_found(), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise EolError(f'systemctl {" ".join(words)}: {done.stderr.strip() or done.returncode}')

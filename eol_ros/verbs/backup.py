# SPDX-License-Identifier: Apache-2.0
"""eol backup: what cannot be installed again, of one installation, in one file."""

import contextlib
import hashlib
import importlib.metadata
import io
import json
import os
import sys
import tarfile
import time
from collections.abc import Iterator
from pathlib import Path

from eol_ros import folders
from eol_ros import scene as scenes
from eol_ros.devices.bag.retention import KEPT
from eol_ros.devices.files import machine_id, sealed_file
from eol_ros.disk import DISK, check_file
from eol_ros.errors import ConfigError, DeviceMissing, writing
from eol_ros.scene import Scene

HELP = (
    'Write one file with all that cannot be installed again. It holds the scene with its includes, '
    'calibration, background, moved grains, and the names of the bags that are kept. It also holds '
    'learned covers, presets, corners of walls and counts of the day. It holds no sounds, images '
    'or bags, and secrets only with --secrets, which encrypts the file with a password. '
    'After a backup without secrets, `eol restore` names the files that need them.'
)
EXAMPLES = ['eol backup museum', 'eol backup my/scene.yaml --output /media/usb/eol.tar.gz']
MANIFEST = 'manifest.json'
MOVED = '*.moved.csv'
MOST = 100_000_000  # bytes of a backup, packed or not (chosen); one has some 100 kB


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'scene', nargs='?', default='museum', help='scene file, or name of a shipped scene'
    )
    parser.add_argument(
        '-o', '--output', metavar='FILE',
        help='the file to write (default: eol-backup-DATE.tar.gz here, .sealed with --secrets)',
    )  # fmt: skip
    parser.add_argument(
        '--secrets', action='store_true',
        help='include PIN, passwords, keys and certificate, and encrypt the file with a password',
    )  # fmt: skip
    add_password(parser)


def add_password(parser):
    """Declare where a password comes from."""
    parser.add_argument(
        '--password-file', metavar='FILE',
        help='file whose first line is the password; - for standard input (default: the terminal)',
    )  # fmt: skip


def run(args):
    """Write the file."""
    check_file(args.scene)  # it is read again
    scene = scenes.load(args.scene)
    kind = 'sealed' if args.secrets else 'tar.gz'
    output = args.output or time.strftime(f'eol-backup-%Y%m%d-%H%M%S.{kind}')
    folders.check_writable(output, '--output')
    password = sealed_file.ask(args.password_file, new=True) if args.secrets else ''
    contents = dict(_contents(scene, args.secrets))
    bags = Path(scene.settings('recorder').folder)
    about = {
        'version': importlib.metadata.version('eol_ros'),
        'written': time.strftime('%Y-%m-%d %H:%M:%S %z'),
        'scene': args.scene, 'folder': str(_home(scene)), 'secrets': args.secrets,
        'kept_bags': sorted(mark.parent.name for mark in bags.glob(f'*/{KEPT}')),
        'files': {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()},
    }  # fmt: skip
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode='w:gz') as tar:
        for name, content in {MANIFEST: json.dumps(about, indent=1).encode(), **contents}.items():
            member = tarfile.TarInfo(name)
            member.size, member.mtime, member.mode = len(content), int(time.time()), 0o600
            tar.addfile(member, io.BytesIO(content))
    data = packed.getvalue()
    if max(len(data), sum(map(len, contents.values()))) > MOST:
        raise ConfigError(
            f'more than {MOST / 1e6:.0f} MB, the limit of restore: look for large files'
        )
    data = sealed_file.seal(data, password) if args.secrets else data
    with writing(output, '--output'), private(args.secrets):
        DISK.write(Path(output), data)
    print(f'eol backup: {len(contents)} files', file=sys.stderr)
    print(output)
    return 0


@contextlib.contextmanager
def private(secrets: bool) -> Iterator[None]:
    """Let files that the body makes be readable by their owner only, if they hold secrets."""
    before = os.umask(0o077)
    if not secrets:
        os.umask(before)
    try:
        yield
    finally:
        os.umask(before)


def places(folder: Path) -> dict[str, Path]:
    """Return the folder of each part of a backup; `folder` is that of the scene."""
    found = {
        'state': folders.state_path(), 'cache': folders.cache_path(),
        'config': folders.config_path(), 'scene': folder, 'elsewhere': Path('/'),
    }  # fmt: skip
    return {name: path.resolve() for name, path in found.items()}


def _home(scene: Scene) -> Path:
    return (scene.path or Path()).resolve().parent


def _contents(scene: Scene, secrets: bool) -> Iterator[tuple[str, bytes]]:
    """Yield the name in the backup and the content of each file."""
    ours = {path.resolve() for path in scenes.shipped().values()}
    roots = places(_home(scene))
    texts = {Path(name).resolve(): text for name, text in scene.texts.items()}
    for path in sorted({*texts, *_named(scene, secrets), *_kept(roots, secrets)} - ours):
        root = next(root for root, folder in roots.items() if path.is_relative_to(folder))
        try:
            content = path.read_bytes()
        except OSError as error:
            raise DeviceMissing(f'{path}: cannot be read ({error.strerror})') from None
        if path in texts and not secrets:
            masked = texts[path].masked(scene.hidden)
            content = scenes.without_secrets(scene, masked).encode()
        yield f'{root}/{path.relative_to(roots[root]).as_posix()}', content


def _named(scene: Scene, secrets: bool) -> Iterator[Path]:
    """Yield the files that settings name, and the moved grains beside their sounds."""
    for node, names in {
        'twin': ['calibration'], 'camera': ['calibration'], 'panel': ['certificate'] * secrets,
        'tracker': ['calibration', 'background'],
    }.items():  # fmt: skip
        for name in names if node in scene.nodes else ():
            if (path := Path(getattr(scene.nodes[node], name))).is_file():
                yield path.resolve()
    grains = scene.settings('grains')
    for sound in map(Path, filter(None, (grains.sound, *grains.more_sounds))):
        where = sound if sound.is_dir() else sound.parent
        yield from (path.resolve() for path in where.glob(MOVED))


def _kept(roots: dict[str, Path], secrets: bool) -> Iterator[Path]:
    state = (p for p in roots['state'].rglob('*') if '.log' not in p.name)
    keys = roots['config'].rglob('*') if secrets else ()
    for path in (*state, *roots['cache'].rglob(MOVED), *keys):
        private = path.name.startswith('staff-')  # addresses that gave the PIN
        ours = path.name == machine_id.FILE  # a second machine must not have it too
        if path.is_file() and not ours and (secrets or not private):
            yield path.resolve()

# SPDX-License-Identifier: Apache-2.0
"""eol restore: put back what `eol backup` wrote."""

import gzip
import hashlib
import io
import json
import sys
import tarfile
from pathlib import Path, PurePosixPath

from eol_ros.devices.files import sealed_file
from eol_ros.disk import DAMAGED, DISK, content, readable
from eol_ros.errors import ConfigError, DeviceMissing, EolError, UsageError, writing
from eol_ros.settings import MASK
from eol_ros.verbs.backup import MANIFEST, MOST, add_password, places, private

HELP = (
    'Put back what `eol backup` wrote: state, presets and moved grains into the folders of this '
    'user, the scene into its folder. All digests are verified before the first file is written. '
    'Stop the work first. Restore only backups of your own: they name the files to write.'
)
EXAMPLES = [
    'eol restore eol-backup-20261128-120000.tar.gz',
    'eol restore /media/usb/eol.tar.gz ~/museum --force',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('backup', help='the file that `eol backup` wrote')
    parser.add_argument('folder', nargs='?', help='folder for the scene (default: where it was)')
    parser.add_argument('--force', action='store_true', help='replace existing files')
    add_password(parser)


def run(args):
    """Verify all, then write all."""
    about, contents = _read(Path(args.backup), args.password_file)
    roots = places(Path(args.folder or about['folder']).expanduser())
    files = {_target(roots, name): content for name, content in contents.items()}
    files = {p: content for p, content in files.items() if not _same(p, content)}
    there = [path for path in files if path.exists()]
    if there and not args.force:
        more = f' and {len(there) - 1} more' if len(there) > 1 else ''
        raise UsageError(
            f'{there[0]}{more}: there, with other content; nothing was written. '
            '`eol backup` first keeps what is there, --force replaces it'
        )
    for path, data in files.items():
        with writing(path), private(about['secrets']):
            path.parent.mkdir(parents=True, exist_ok=True)
            DISK.write(path, data)
        print(path)
        if path.suffix in ('.yaml', '.yml') and MASK.encode() in data:
            print(f'eol restore: {path}: enter the secrets in place of {MASK}', file=sys.stderr)
    if about['kept_bags']:
        bags = ', '.join(about['kept_bags'])
        print(f'eol restore: bags that were kept, and are not in it: {bags}', file=sys.stderr)
    return 0


def _read(path: Path, password_file: str | None) -> tuple[dict, dict[str, bytes]]:
    """Return the manifest and the verified contents."""
    if not readable(path):
        raise DeviceMissing(f'{path}: no such file')
    try:
        data = content(path, MOST)
        if data.startswith(sealed_file.MAGIC):
            data = _opened(path, data, password_file)
        whole = io.BytesIO(_unpacked(data))
        with tarfile.open(fileobj=whole, mode='r:') as tar:
            packed = {m.name: file.read() for m in tar if (file := tar.extractfile(m))}
        about = json.loads(packed.pop(MANIFEST))
        digests, about = dict(about['files']), about | {'kept_bags': list(about['kept_bags'])}
        about |= {'folder': str(about['folder']), 'secrets': bool(about['secrets'])}
    except EolError:  # about the password: it says itself what is wrong
        raise
    except (*DAMAGED, tarfile.TarError) as error:
        raise ConfigError(f'{path}: not a backup of eol, or damaged ({error})') from None
    found = {name: hashlib.sha256(content).hexdigest() for name, content in packed.items()}
    wrong = sorted(n for n in digests.keys() | found.keys() if digests.get(n) != found.get(n))
    if wrong:
        raise ConfigError(f'{path}: {wrong[0]} is not what was backed up; nothing was written')
    return about, packed


def _opened(path: Path, data: bytes, password_file: str | None) -> bytes:
    password = sealed_file.ask(password_file)
    try:
        return sealed_file.unseal(data, password)
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}; nothing was written') from None


def _unpacked(data: bytes) -> bytes:
    """Return what gzip data hold, at most `MOST` bytes: a small file may hold endless ones."""
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        found = file.read(MOST + 1)
    if len(found) > MOST:
        raise ValueError(f'more than {MOST / 1e6:g} MB in it')
    return found


def _target(roots: dict[str, Path], name: str) -> Path:
    parts = PurePosixPath(name).parts
    if len(parts) < 2 or parts[0] not in roots or '..' in parts:
        raise ConfigError(f'{name or "(no name)"}: no place of a backup; nothing was written')
    return roots[parts[0]].joinpath(*parts[1:])


def _same(path: Path, content: bytes) -> bool:
    return path.is_file() and path.read_bytes() == content

# SPDX-License-Identifier: Apache-2.0
"""eol check: would the nodes of this scene start?"""

import dataclasses
import functools
import json
import os
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from eol_ros import folders
from eol_ros import scene as scenes
from eol_ros.errors import ConfigError, DeviceMissing, EolError, printable
from eol_ros.ros import installed, network
from eol_ros.scene import Scene
from eol_ros.yaml_text import Mistake

HELP = (
    'Check a scene and report all mistakes with file, line and column: keys, values, missing '
    'files, and settings that nodes would reject at start. Also check that ROS and the messages '
    'that the scene needs are installed.'
)
EXAMPLES = [
    'eol check museum',
    'eol check museum --devices',
    'eol check config/museum.yaml --json',
]

# The setting that is meant, and what raises EolError, or a mistake that is known already.
Check = tuple[str, Callable[[], object] | str]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'scene', nargs='?', default='rehearsal', help='scene file, or name of a shipped scene'
    )
    parser.add_argument(
        '--devices', action='store_true',
        help='also check that its camera, board and sound card are connected',
    )  # fmt: skip
    parser.add_argument(
        '--json', action='store_true', help='print the checked scene, or the mistakes, as JSON'
    )


def run(args):
    """Print what would run, or raise with all mistakes."""
    try:
        scene = _checked(args.scene)
    except ConfigError as error:
        if not args.json:
            raise
        told = [dataclasses.asdict(m) for m in _mistakes(error, args.scene)]
        print(json.dumps({'ok': False, 'mistakes': told}))
        return error.exit_code
    warnings = [*scene.warnings, *_warnings(scene)]
    absent = _refused(scene, _devices(scene)) if args.devices else []
    scene = scenes.public(scene)
    missing = installed.missing()
    if args.json:
        answer = {'ok': not missing and not absent, **scenes.plain(scene), 'warnings': warnings}
        if missing:
            answer |= {'missing': missing, 'install': installed.command()}
        if absent:
            answer['devices'] = [dataclasses.asdict(m) for m in absent]
        print(json.dumps(answer, indent=2))
        return DeviceMissing.exit_code if missing or absent else 0
    for warning in warnings:
        print(f'eol check: {warning}', file=sys.stderr)
    name = printable(scene.name)
    print(f'{scene.path}: {name}, {len(scene.nodes)} nodes, network {scene.network}')
    for name, settings in scene.nodes.items():
        changed = [
            f'{f.name}={getattr(settings, f.name)!r}'
            for f in dataclasses.fields(settings)
            if getattr(settings, f.name) != f.default
        ]
        print(f'  {name:9} {", ".join(changed) or "as it ships"}')
    for name, words in scene.programs.items():
        print(f'  {name:9} {printable(shlex.join(words))}')
    installed.require()
    if absent:
        raise DeviceMissing('\n'.join(str(m) for m in absent))
    count = len(warnings)
    also = f', {count} warning{"s" if count > 1 else ""}' if count else ''
    print(f'no mistakes{also}', file=sys.stderr)
    return 0


def _checked(name: str) -> Scene:
    """Return the scene; raise SceneError with the mistakes of its files and of its settings."""
    wrong: list[Mistake] = []
    try:
        scene = scenes.load(name)
    except scenes.SceneError as error:
        if error.scene is None:
            raise
        scene, wrong = error.scene, error.mistakes
    # a default replaces each wrong value: what depends on one of these is not checked
    values = [m.where for m in wrong if m.where in scene.places]
    found = [*_refused(scene, _settings(scene)), *_unwritable()]
    wrong += [m for m in found if not any(_depends(m, value) for value in values)]
    if wrong:
        raise scenes.SceneError(wrong, scene)
    return scene


def _depends(mistake: Mistake, value: str) -> bool:
    """Return whether a mistake is about a setting, such as `leds.port`, or compares with it."""
    node, _, key = value.partition('.')
    own = mistake.where.partition('.')[0] == node
    named = re.escape(key if own and key else value)
    return mistake.where in (node, value) or bool(re.search(rf'\b{named}\b', mistake.what))


def _unwritable() -> list[Mistake]:
    """Return which of the folders that every scene writes to cannot be written."""
    wrong = []
    for variable, folder in (
        ('EOL_STATE', folders.state_path()),
        ('EOL_CACHE', folders.cache_path()),
    ):
        try:
            _writable(folder, f'set {variable} to')
        except EolError as error:
            wrong.append(Mistake(str(folder), 1, 1, variable, str(error)))
    return wrong


def _mistakes(error: ConfigError, name: str) -> list[Mistake]:
    """Return the mistakes of a scene; that there is none of this name is one as well."""
    if isinstance(error, scenes.SceneError):
        return error.mistakes
    return [Mistake(name, 1, 1, '', str(error).removeprefix(f'{name}: '))]


def _refused(scene: Scene, checks: Iterator[Check]) -> list[Mistake]:
    """Run all checks; return what they raise, each at the file or setting that it is about."""
    found = []
    for where, check in checks:
        try:
            if isinstance(check, str):
                raise ConfigError(check)
            check()
        except EolError as error:
            node, _, key = where.partition('.')
            named = str(getattr(scene.nodes.get(node), key, ''))
            if named and str(error).startswith(f'{named}: '):
                what = str(error).removeprefix(f'{named}: ')
                found.append(Mistake(named, 1, 1, where, what))
            else:
                found.append(scenes.mistake(scene, where, error))
    return found


def _settings(scene: Scene) -> Iterator[Check]:
    """Yield what the nodes check when they start, without any device or graph."""
    for name, settings in scene.nodes.items():
        if name in _NODES:
            yield from _NODES[name](settings, scene)
    if scene.notify:
        from eol_ros.bringup import notify

        for name, what in notify.mistakes(scene.notify):
            yield f'notify.{name}', what
    cameras = [(n, scene.nodes[n]) for n in ('twin', 'camera') if n in scene.nodes]
    tracker, leds = scene.nodes.get('tracker'), scene.nodes.get('leds')
    if tracker and cameras and tracker.calibration:
        yield 'tracker.calibration', lambda: _same_size(tracker.calibration, *cameras[0])
    for name, words in scene.programs.items():
        yield f'programs.{name}', functools.partial(_program, words, scene.folder_of(name))
    if tracker and leds:
        yield 'leds.blink_block', lambda: _same_blink(tracker, leds)


def _program(words: tuple[str, ...], folder: Path | None) -> None:
    from eol_ros.bringup.plan import found_program

    folder = folder or Path()
    if not found_program(words[0], folder):
        file = folder / words[0]
        if file.is_file() and os.access(file, os.X_OK):
            raise ConfigError(f'{words[0]}: not on PATH: write ./{words[0]}')
        if file.is_file():
            raise ConfigError(f'{words[0]}: not executable; `chmod +x` it, and name it with a /')
        raise ConfigError(f'{words[0]}: no such program; name it by its path from the scene file')
    script = words[1] if len(words) > 1 and words[0].startswith('python') else '-'
    if not script.startswith('-') and not (folder / script).is_file():
        raise ConfigError(f'{script}: no such file; name it by its path from the scene file')


def _calibration(settings: Any, name: str, scene: Scene) -> Iterator[Check]:
    if path := settings.calibration:
        from eol_ros.core.table import Table
        from eol_ros.devices.files import calibration_file

        mirror = getattr(settings, 'mirror', False)
        yield (
            f'{name}.calibration',
            lambda: calibration_file.load(path, mirror, Table.of(scene.table)),
        )


def _twin(settings: Any, scene: Scene) -> Iterator[Check]:
    static, kinetic = settings.mu_static, settings.mu_kinetic
    if kinetic > static:
        what = f'is {kinetic:g}, mu_static is {static:g}: kinetic friction cannot exceed static'
        yield 'twin.mu_kinetic', what
    if settings.calibration:
        from eol_ros.core.table import Table
        from eol_ros.devices.files.twin_camera import twin_camera

        yield 'twin.calibration', lambda: twin_camera(settings, Table.of(scene.table))


def _camera(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.camera.sources import VideoFile, is_file

    yield from _calibration(settings, 'camera', scene)
    if is_file(settings.device):
        yield 'camera.device', lambda: VideoFile(settings).open()


def _tracker(settings: Any, scene: Scene) -> Iterator[Check]:
    yield from _calibration(settings, 'tracker', scene)
    if settings.background:
        from eol_ros.devices.files import background_file

        yield 'tracker.background', lambda: background_file.load(settings.background)


def _leds(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.board.lights import check_settings

    yield 'leds.flash_limit', lambda: check_settings(settings)


def _grains(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.corpus import corpus_build
    from eol_ros.devices.corpus.loader import corpus_spec

    yield 'grains.sound', lambda: corpus_build.apart(*corpus_spec(settings))


def _sound(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.core.sound import ring

    for name, what in ring.mistakes(settings):
        yield f'sound.{name}', what
    if settings.wav:
        yield 'sound.wav', lambda: _writable(Path(settings.wav).parent)


def _montage(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.files.media_folder import MediaFolder

    yield 'montage.pairs', lambda: MediaFolder(settings.pairs)


def _hours(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.core import opening_hours
    from eol_ros.devices.files import time_zone
    from eol_ros.ros import cues

    yield 'hours.time_zone', lambda: time_zone.load(settings.time_zone)
    for what in opening_hours.mistakes(settings.open):
        yield 'hours.open', what
    there = {*scene.nodes, *scene.elsewhere}
    for name, what in cues.mistakes(settings.cues, settings.cue_times, there):
        yield f'hours.{name}', what


def _projectors(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.projector.pjlink import host_and_port

    if not settings.addresses:
        yield 'projectors.addresses', 'no projector is named'
    for address in settings.addresses:
        yield 'projectors.addresses', functools.partial(host_and_port, address)


def _midi(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.audio.midi import MidiOut

    yield 'midi.output', lambda: MidiOut(settings.output).close()


def _osc(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.devices.address import networks, own_address, target
    from eol_ros.streams.osc import IDLE

    if not (settings.send_to or settings.port or settings.tuio or settings.tuio2):
        yield 'osc', IDLE
    for line in settings.peers:
        yield 'osc.peers', functools.partial(networks, [line])
    yield 'osc.send_from', lambda: own_address(settings.send_from)
    for name in ('send_to', 'tuio', 'tuio2'):
        for line in getattr(settings, name):
            yield f'osc.{name}', functools.partial(target, line)


def _sacn(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.core.light.e131 import mistakes, target
    from eol_ros.devices import address

    cells = scene.table.rows * scene.table.columns
    for line in settings.send_to:
        yield 'sacn.send_to', functools.partial(address.target, target(line))
    yield 'sacn.send_from', lambda: address.own_address(settings.send_from)
    leds, replayed = scene.nodes.get('leds'), 'replay' in scene.nodes
    for name, what in mistakes(settings.first_channel, leds, cells, replayed):
        where = name if name == 'sacn' else f'sacn.{name}'
        yield where, what


def _panel(settings: Any, scene: Scene) -> Iterator[Check]:
    from eol_ros.web import guard

    yield 'panel.host', lambda: guard.check_settings(settings.host, settings.pin)
    if settings.certificate:
        from eol_ros.web import certificate

        yield 'panel.certificate', lambda: certificate.context(settings.certificate)


def _replay(settings: Any, scene: Scene) -> Iterator[Check]:
    if settings.bag:  # else the newest one, which is looked for when the run begins
        from eol_ros.devices.bag.player import choose
        from eol_ros.devices.bag.reader import BagReader

        yield 'replay.bag', lambda: BagReader(settings.bag)
        if settings.topics:
            yield 'replay.topics', lambda: choose(BagReader(settings.bag), settings.topics, [])


def _recorder(settings: Any, scene: Scene) -> Iterator[Check]:
    yield 'recorder.folder', lambda: _writable(Path(settings.folder))


_NODES: dict[str, Callable[[Any, Scene], Iterator[Check]]] = {
    'twin': _twin,
    'camera': _camera,
    'tracker': _tracker,
    'leds': _leds,
    'grains': _grains,
    'sound': _sound,
    'montage': _montage,
    'hours': _hours,
    'projectors': _projectors,
    'osc': _osc,
    'sacn': _sacn,
    'midi': _midi,
    'panel': _panel,
    'replay': _replay,
    'recorder': _recorder,
}


def _writable(folder: Path, remedy: str = 'name') -> None:
    """Raise EolError unless `folder` can be written, or made."""
    there = folders.nearest(folder)
    try:  # the rights alone do not tell: root has all of them, also where nothing can be made
        with tempfile.TemporaryDirectory(dir=there):
            pass
    except OSError as error:
        raise EolError(
            f'nothing can be written in {there} ({error.strerror}); {remedy} another folder'
        ) from None


def _same_size(path: str, name: str, settings: Any) -> None:
    from eol_ros.devices.files import calibration_file

    try:
        found = calibration_file.load(path)
    except EolError:
        return  # told already
    size, wanted = (found.image_width, found.image_height), (settings.width, settings.height)
    if size != wanted:
        raise EolError(
            f'is for images of {size[0]}x{size[1]}, {name} gives {wanted[0]}x{wanted[1]}: '
            'use the calibration of this camera, or set its size'
        )


def _same_blink(tracker: Any, leds: Any) -> None:
    for key in ('blink_block', 'blink_period_s', 'blink_off_s'):
        if getattr(tracker, key) != getattr(leds, key) and leds.blink_block >= 0:
            raise EolError(
                f'leds.{key}: is {getattr(leds, key)}, tracker.{key} is {getattr(tracker, key)}: '
                'both must say the same, or the tracker waits for another blink'
            )


def _warnings(scene: Scene) -> Iterator[str]:
    """Yield what a scene may say, and a person should know before the doors open."""
    yield from network.warnings(scene.network)
    if panel := scene.nodes.get('panel'):
        from eol_ros.web import guard

        if not panel.certificate and not guard.is_loopback(panel.host):
            yield (
                'panel: without panel.certificate the PIN can be read on the network, and other '
                'machines hear no sound: see `HTTPS` in docs/reference/web.md'
            )
    if montage := scene.nodes.get('montage'):
        from eol_ros.devices.files.media_folder import MediaFolder

        folder = MediaFolder(montage.pairs)
        yield from (f'{folder.path}: {skipped}: this pair is skipped' for skipped in folder.skipped)
    if (leds := scene.nodes.get('leds')) and leds.flash_limit == 'false':
        yield f'leds.flash_limit is off: {leds.flash_limit_off_because}'
    if recorder := scene.nodes.get('recorder'):
        there = folders.nearest(Path(recorder.folder))
        free_gb = shutil.disk_usage(there).free / 1e9
        if free_gb < recorder.min_free_gb:
            yield (
                f'recorder.folder: {there} has {free_gb:.1f} GB free, less than min_free_gb '
                f'({recorder.min_free_gb:g} GB): nothing would be recorded'
            )


def _devices(scene: Scene) -> Iterator[Check]:
    """Yield whether what must be plugged in is there."""
    if camera := scene.nodes.get('camera'):
        from eol_ros.devices.camera.ports import find_camera
        from eol_ros.devices.camera.sources import is_file

        if not is_file(camera.device):
            yield 'camera.device', lambda: find_camera(camera.device)
    leds = scene.nodes.get('leds')
    if leds and leds.port != 'twin':
        from eol_ros.devices.board.ports import find_port

        yield 'leds.port', lambda: find_port(leds.port)
    sound = scene.nodes.get('sound')
    if sound and sound.device != 'wav':
        from eol_ros.devices.audio import outputs

        yield 'sound.device', lambda: outputs.find(sound.device, sound.channels)

# SPDX-License-Identifier: Apache-2.0
"""Scene file to checked settings: every error at once, with file, line and column.

A scene names the nodes that run and what differs from their defaults:

    scene: lights
    network: local            # or secure (by keys), or lan (everybody)
    namespace: eol            # topics are /eol/blocks ...: another for each graph of a domain
    include: table.yaml       # values there stand unless this file says otherwise
    nodes:
      camera: {device: auto}
      tracker: {}
    together: [[camera, tracker]]
    table: {rows: 4, columns: 6}   # the table, if not the default
    elsewhere: [motion]        # somebody else starts it, on any machine of the network
    machines:                  # what each machine runs, by name; the same file on all of them
      show: {address: 10.0.0.1, nodes: [camera, tracker, recorder]}
    programs: {counter: [python, counter.py]}   # own programs, in the folder of this file
    notify: {webhook: URL}     # who is told what lasts

Every scene has a recorder, named or not. `off` leaves out a node: recorder, or one of `include`.
"""

import dataclasses
import difflib
import functools
import ipaddress
import itertools
import math
import os
import re
import sys
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eol_ros import yaml_text
from eol_ros.disk import check_file, content, readable
from eol_ros.errors import FEW_NAMES, ConfigError, EolError, each, nearest
from eol_ros.said import said
from eol_ros.scene_secrets import SceneText, without
from eol_ros.settings import (
    FORMS,
    MASK,
    NotifySettings,
    TableSettings,
    by_today,
    masked,
    renamed,
    secrets,
)
from eol_ros.streams.graph import IMAGE_SOURCES, MAX_DOMAIN, NAMESPACE, NODES, providers
from eol_ros.yaml_text import Mistake, Place

KEYS = {  # key: example, meaning (docs/reference/scene.md)
    'scene': ('scene: lights', 'name of the scene, shown in the panel and in bags'),
    'include': (
        'include: museum',
        'start from another scene: a file, relative to this one, or the name of a shipped scene',
    ),
    'nodes': (
        'nodes: {camera: {device: auto}, tracker: {}}',
        'nodes of the scene, each with its settings that differ from the defaults. `off` leaves '
        'out a node of the included scene, or the recorder, which runs otherwise',
    ),
    'network': (
        'network: secure',
        'other machines that see the graph: `local` none, `secure` those with a key, `lan` all',
    ),
    'domain': ('domain: 7', 'DDS domain, 0 to 232 (default: `ROS_DOMAIN_ID`, else 0)'),
    'namespace': ('namespace: north', 'first part of all topic names, such as `/north/blocks`'),
    'table': ('table: {rows: 4, columns: 6}', 'rows, columns, sizes and empty places of the table'),
    'together': ('together: [[motion, leds]]', 'groups of nodes that share a process'),
    'elsewhere': (
        'elsewhere: [camera]',
        'nodes that other programs start or replace, such as a camera driver, so that their topics '
        'count as published; write them `off` under `nodes` if the included scene has them. The '
        'program may be in `programs`',
    ),
    'machines': (
        'machines: {show: {address: 10.0.0.1, nodes: [camera]}}',
        'nodes of each machine, for one scene on several machines; needs `network: secure` or '
        '`lan`',
    ),
    'programs': (
        'programs: {count_slips: [python, count_slips.py]}',
        'own programs that start, restart and stop with the nodes: name and command, run in the '
        'folder of the file that names it; `off` leaves out one of the included scene',
    ),
    'real_time': ('real_time: true', 'real-time priority for the nodes from camera to sound'),
    'notify': ('notify: {webhook: URL}', 'receivers of notifications of faults'),
}
SECRET = frozenset(  # settings whose values are never shown
    f.name
    for kind in (NotifySettings, *(node.settings for node in NODES.values()))
    for f in dataclasses.fields(kind)
    if f.metadata.get('secret')
)
_WORDS = {float: 'a number', int: 'a whole number', bool: 'true or false', str: 'text'}


def machine_node(machine: str) -> str:
    """Return the name on the graph of the node `machine` of a machine: there is one on each."""
    return f'machine_{machine}'


@dataclass(frozen=True)
class Machine:
    """One of several machines of a scene: its address on their network, and the nodes it runs."""

    address: str
    nodes: tuple[str, ...]


@dataclass(frozen=True)
class Scene:
    """What runs: nodes with their settings, and how they are wired to the world."""

    name: str
    nodes: dict[str, Any]
    network: str = 'local'
    domain: int | None = None
    together: tuple[tuple[str, ...], ...] = ()
    elsewhere: tuple[str, ...] = ()  # nodes of the graph that somebody else starts
    machines: dict[str, Machine] = field(default_factory=dict)  # none: all on this one
    path: Path | None = None
    real_time: bool = False  # ask for real-time priority
    text: str = ''  # file and includes as recorded in a bag, without secrets
    warnings: tuple[str, ...] = ()  # what is understood, and should be said in another way
    namespace: str = NAMESPACE  # without the slash at its beginning
    notify: NotifySettings | None = None
    table: TableSettings = field(default_factory=TableSettings)
    programs: dict[str, tuple[str, ...]] = field(default_factory=dict)  # own ones, by command
    # Where nodes and their settings stand (`leds`, `leds.port`): file, line, column.
    places: dict[str, tuple[str, int, int]] = field(default_factory=dict, repr=False, compare=False)
    # Secret values, parsed and as spelt in the files.
    hidden: tuple[str, ...] = field(default=(), repr=False, compare=False)
    texts: dict[str, SceneText] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def alone(cls, *names: str) -> 'Scene':
        """Return the scene of nodes that somebody starts by hand, with default settings."""
        return cls('+'.join(names), {name: NODES[name].settings() for name in names})

    def settings(self, name: str) -> Any:
        """Return the settings of node `name`; a node the scene does not name has its defaults."""
        return self.nodes[name] if name in self.nodes else NODES[name].settings()

    def machine_of(self, node: str) -> str:
        """Return the machine that runs `node`; '' where the scene names no machines."""
        return next((name for name, one in self.machines.items() if node in one.nodes), '')

    def folder_of(self, program: str) -> Path | None:
        """Return the folder in which an own program runs: that of the file that names it."""
        if place := self.places.get(f'programs.{program}'):
            return Path(place[0]).resolve().parent
        return self.path.parent if self.path else None

    @property
    def main(self) -> str:
        """The machine whose clock stamps the images: that of their source, else the first."""
        found = filter(None, map(self.machine_of, IMAGE_SOURCES))
        return next(found, next(iter(self.machines), ''))

    @property
    def image_rate(self) -> float:
        """How many images a second its twin or camera is to give; 0 where that is not known."""
        sources = [self.nodes[name] for name in ('twin', 'camera') if name in self.nodes]
        return sources[0].fps if sources else 0.0


def mistake(scene: Scene, where: str, error: EolError) -> Mistake:
    """Return the mistake that `error` tells of, at the place of `where`, such as `leds.port`.

    A message that begins with a setting (`panel.host: ...`) names the place itself.
    """
    what = str(error)
    head, colon, rest = what.partition(': ')
    if colon and head.partition('.')[0] in (*scene.nodes, 'notify'):
        where, what = head, rest
    file = str(scene.path) if scene.path else ''
    places = [where, where.partition('.')[0]]
    place = next((scene.places[p] for p in places if p in scene.places), (file, 1, 1))
    return Mistake(*place, where, what)


class SceneError(yaml_text.Mistakes):
    """All mistakes of a scene; the scene without the wrong values, if its files could be read."""

    def __init__(self, mistakes: list[Mistake], scene: Scene | None = None):
        self.scene = scene
        quotes = {m: _quoted(scene, m) for m in mistakes} if scene else {}
        super().__init__(mistakes, 'Nothing was started.', quotes)


def _quoted(scene: Scene, mistake: Mistake) -> str:
    text = scene.texts.get(mistake.file)
    if text is None:
        return ''
    return yaml_text.quoted(*text.quoted(mistake.line, mistake.column, scene.hidden))


def inherited(fd: int) -> Path:
    """Return the path by which a process opens the scene that its parent has left it open."""
    return Path(f'/proc/self/fd/{fd}')


def _shown(path: Path) -> str:
    """Return what to call a scene file: an inherited one by the name that bringup gave it.

    What lies beside such a one is nothing: its paths have been resolved before. Those of a pipe
    count from the working folder.
    """
    if path.is_fifo() or str(path) == '-':
        return 'pipe'
    if path.parent != inherited(0).parent:
        return str(path)
    given = os.readlink(path).removeprefix('/memfd:').removesuffix(' (deleted)')
    return str(path.with_name(given.rpartition('/')[2]))


class Reader(yaml_text.Reader):
    """Reads one scene and gathers its mistakes."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: dict[str, SceneText] = {}
        self.warnings: list[str] = []
        self.places: dict[str, tuple[str, int, int]] = {}

    def read(self, path: Path, seen: tuple[Path, ...] = ()) -> Place:
        """Return the mapping in `path`, its includes merged below it."""
        name = _shown(path)
        start = Place({}, name)
        try:
            data = content(path)
        except OSError as error:
            self.wrong(start, '', f'{error.strerror}')
            return start
        top, tree, text = self.parse(data, name, '; `include` adds a scene')
        if tree is not None or not any(secret in text for secret in SECRET):  # else none is found
            self.texts[name] = SceneText(text, tree, SECRET)
        if not isinstance(top.value, dict):
            self.wrong(top, '', 'a scene is a mapping with the keys ' + ', '.join(KEYS))
            return start
        if 'include' in top.value:
            self._include(top, path, seen + (path.resolve(),))
        return top

    def _include(self, top: Place, path: Path, seen: tuple[Path, ...]) -> None:
        place = top.value['include']
        if not isinstance(place.value, str):
            self.wrong(place, 'include', f'{place.bare!r} is not a file name')
            return
        other = Path(top.file).parent / place.value
        try:
            there = other.is_file()
        except (OSError, ValueError):  # no name of a file at all
            there = False
        if not there and place.value in shipped():
            other, there = shipped()[place.value], True
        if there and other.resolve() in seen:
            self.wrong(place, 'include', f'{place.value} includes itself')
        elif not there:
            self.wrong(
                place,
                'include',
                f'{place.value}: no such file beside {path.name}, and no shipped scene.'
                f' {nearest(place.value, shipped())}',
            )
        else:
            _merge(top, self.read(other, seen))

    def unknown(self, place: Place, where: str, key: str, valid: typing.Iterable[str]) -> None:
        owners = [f'nodes.{name}' for name, spec in NODES.items() if key in _names(spec.settings)]
        if owners:
            hint = f'; {" and ".join(owners)} {"has" if len(owners) == 1 else "have"} it'
        else:
            hint = f'. {nearest(key, valid)}'
        kind = 'node' if where.startswith('nodes.') else 'key'
        self.wrong(place.keys[key], where, f'no such {kind}{hint}')

    def settings(self, name: str, kind: type, place: Place) -> Any:
        """Return the settings of `name`, a dataclass of this kind."""
        self.places[name] = place.file, place.line, place.column
        fields = {f.name: f for f in dataclasses.fields(kind)}
        if place.value is None:  # `camera:` with nothing behind it: all defaults
            return kind()
        if not isinstance(place.value, dict):
            such = {
                'recorder': '{images: all}, nor off',
                'notify': '{webhook: URL}',
                'table': '{rows: 4, columns: 6}',
            }
            such_as = such.get(name, '{device: auto}')
            self.wrong(place, name, f'not a mapping of settings, such as {such_as}')
            return kind()
        values = {}
        before = renamed(kind)
        for key, item in place.value.items():
            where = f'{name}.{key}'
            if key in before and before[key] not in place.value:
                self.warnings.append(
                    f'{item.file}:{item.line}: {where} is now called {name}.{before[key]}; the old'
                    ' name goes with the next version'
                )
                key = before[key]
            if key not in fields:
                self.unknown(place, where, key, fields)
                continue
            self.places[f'{name}.{key}'] = item.file, item.line, item.column
            for number, one in enumerate(item.value if isinstance(item.value, list) else ()):
                self.places[f'{name}.{key}[{number}]'] = one.file, one.line, one.column
            try:
                meant = by_today(kind, {key: _meant(item, fields[key].type)})
                value = check_value(fields[key], meant[key])
            except ConfigError as error:
                self.wrong(item, where, f'{error}{item.how_to_write}')
                continue
            first = value[0] if isinstance(value, tuple) and value else value
            if isinstance(first, (int, float)) and (how := item.how_to_write):
                self.wrong(item, where, f'{item.text or item.bare} would be {value}{how}')
                continue
            kind_of = fields[key].metadata.get('kind', '')
            if kind_of in ('path', 'optional path') and value:
                needed = kind_of == 'path'
                if isinstance(value, tuple):
                    value = tuple(self._path(item, where, one, needed) for one in value)
                else:
                    value = self._path(item, where, value, needed)
            values[key] = value
        return kind(**values)

    def _path(self, item: Place, where: str, value: str, needed: bool) -> str:
        full = (Path(item.file).parent / Path(value).expanduser()).resolve()
        if full.exists():
            if needed:
                try:
                    check_file(full)  # a node reads its files again after a restart
                except ConfigError as error:
                    self.wrong(item, where, str(error))
            return str(full)
        if needed:
            self.wrong(item, where, f'{value}: no such file or folder')
        return value


def _names(kind: type) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def _meant(place: Place, kind: Any) -> Any:
    """Return the plain value for a setting of type `kind`; text is taken as it is written.

    YAML 1.1 makes 34 of 0042, true of `on`, and a day of 2026-11-22.
    """
    if isinstance(place.value, list) and typing.get_origin(kind) is tuple:
        return [_meant(item, typing.get_args(kind)[0]) for item in place.value]
    if kind is str and place.text and place.value is not None:
        return place.text
    return place.bare


def _merge(top: Place, below: Place) -> None:
    """Take from `below` what `top` does not say; mappings are merged key by key."""
    for key, place in below.value.items():
        mine = top.value.get(key)
        if mine is None:
            top.value[key] = place
            top.keys[key] = below.keys[key]
        elif isinstance(mine.value, dict) and isinstance(place.value, dict):
            _merge(mine, place)
        elif mine.value is None and isinstance(place.value, dict):
            top.value[key] = place


def _range(meta: typing.Mapping[str, Any]) -> str:
    low, high, unit = meta.get('min'), meta.get('max'), meta.get('unit', '')
    words = ''
    if low is not None and high is not None:
        words = f'{low:g} to {high:g}'
    elif low is not None:
        words = f'at least {low:g}'
    elif high is not None:
        words = f'at most {high:g}'
    return ' '.join(w for w in (words, unit) if w)


def check_value(field_: dataclasses.Field[Any], value: Any) -> Any:
    """Return `value` as the type of the setting; raise ConfigError that says what is asked for."""
    kind, meta = field_.type, field_.metadata
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f'{value!r} is not a list')
        item_type = typing.get_args(kind)[0]
        item_field = dataclasses.field(metadata=meta)
        item_field.type = item_type
        return tuple(each(functools.partial(check_value, item_field), value))
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    asked = _range(meta)
    if type(value) is not kind:
        shown = 'nothing' if value is None else MASK if meta.get('secret') else repr(value)
        asked = f' ({asked})' if asked else ''
        if kind is str and value is not None:
            asked = ': put it into quotes'
        # `kind` is a type by now, which mypy cannot see
        words = _WORDS.get(kind, kind)  # type: ignore[arg-type]
        raise ConfigError(said('not_a_line', value=shown, shape=f'{words}{asked}'))
    if meta.get('choices') and value not in meta['choices']:
        choices, hint = ', '.join(meta['choices']), nearest(str(value), meta['choices'])
        if len(meta['choices']) > FEW_NAMES:
            choices = f'{len(meta["choices"])} choices. {hint}'
        elif hint.startswith('Did'):
            choices += f'. {hint}'
        raise ConfigError(said('not_one_of', value=repr(value), choices=choices))
    if (form := meta.get('kind')) in FORMS and not re.fullmatch(FORMS[form], str(value)):
        raise ConfigError(said('not_a_line', value=f'{value!r:.80}', shape=form))
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        low, high = meta.get('min'), meta.get('max')
        inside = (low is None or value >= low) and (high is None or value <= high)
        if not inside:  # also refuses NaN
            raise ConfigError(said('out_of_range', value=f'{value:g}', asked=asked))
        if math.isinf(value):
            raise ConfigError(f'{value:g} is not a finite number')
    return value


def without_secrets(scene: Scene, text: str) -> str:
    """Return `text` with a mask in place of each secret of the scene, however it is spelt."""
    kept = (secrets(s).values() for s in (*scene.nodes.values(), scene.notify) if s)
    return without(text, {*itertools.chain.from_iterable(kept), *scene.hidden})


def public(scene: Scene) -> Scene:
    """Return the scene as it may be shown and kept: without what is secret in it."""
    nodes = {name: masked(settings) for name, settings in scene.nodes.items()}
    notify = masked(scene.notify) if scene.notify else None
    text = without_secrets(scene, scene.text)
    return dataclasses.replace(scene, nodes=nodes, notify=notify, text=text, hidden=(), texts={})


def plain(scene: Scene) -> dict[str, Any]:
    """Return the scene as the plain data that `load` reads again, every setting written out."""
    data: dict[str, Any] = {'scene': scene.name, 'network': scene.network}
    if scene.domain is not None:
        data['domain'] = scene.domain
    if scene.namespace != NAMESPACE:
        data['namespace'] = scene.namespace
    if scene.real_time:
        data['real_time'] = True
    if scene.table != TableSettings():
        data['table'] = _plain(scene.table)
    data['nodes'] = {name: _plain(settings) for name, settings in scene.nodes.items()}
    if 'recorder' not in scene.nodes:
        data['nodes']['recorder'] = False  # as YAML 1.1 reads `off`
    data['together'] = [list(group) for group in scene.together]
    if scene.elsewhere:
        data['elsewhere'] = list(scene.elsewhere)
    if scene.machines:
        data['machines'] = {
            name: {'address': one.address, 'nodes': list(one.nodes)}
            for name, one in scene.machines.items()
        }
    if scene.programs:
        data['programs'] = {name: list(words) for name, words in scene.programs.items()}
    if scene.notify:
        data['notify'] = _plain(scene.notify)
    return data


def _plain(settings: Any) -> dict[str, Any]:
    values = dataclasses.asdict(settings).items()
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values}


def shipped() -> dict[str, Path]:
    """Return the scenes that ship, by name: from a checkout, an environment or a ROS workspace."""
    prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    folders = [Path(__file__).resolve().parents[1] / 'config']
    folders += [Path(p) / 'share' / 'eol_ros' / 'config' for p in prefixes if p]
    for folder in folders:
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob('*.yaml'))}
    return {}


def find(name: str) -> Path:
    """Return the file of scene `name`: a path, or the name of one that ships."""
    path = Path(name)
    ours = shipped()
    if readable(path):
        return path
    if name in ours:
        return ours[name]
    if path.is_dir():
        raise ConfigError(f'{name}: is a folder; name the YAML file of a scene in it')
    raise ConfigError(f'{name}: no such scene. {nearest(path.stem, ours)}')


def load(name: str | Path) -> Scene:
    """Read a scene, and check all of it.

    Parameters
    ----------
    name : str or Path
        A YAML file, or the name of a scene that ships.

    Returns
    -------
    Scene
        Nodes with their settings, and how they are wired to the world.

    Raises
    ------
    SceneError
        With all mistakes, each with file, line and column.

    Examples
    --------
    >>> scene = load('rehearsal')
    >>> scene.nodes['twin'].fps
    60.0
    """
    path = find(str(name))
    reader = Reader()
    top = reader.read(path)
    values = top.value
    for key in values:
        if key not in KEYS:
            reader.unknown(top, key, key, KEYS)
    elsewhere = _elsewhere(reader, top)
    nodes = _nodes(reader, top, elsewhere)
    network = _choice(reader, values, 'network', ('local', 'secure', 'lan'), 'local')
    real_time = _choice(reader, values, 'real_time', (True, False), False)
    domain = values.get('domain')
    if domain and not (type(domain.value) is int and 0 <= domain.value <= MAX_DOMAIN):
        said = f'{domain.value!r} is not a whole number from 0 to {MAX_DOMAIN}'
        reader.wrong(domain, 'domain', said)
    namespace = _namespace(reader, values.get('namespace'))
    title = values.get('scene')
    together = _together(reader, values.get('together'), nodes, values.get('nodes'))
    machines = _machines(reader, values.get('machines'), nodes, together, network)
    if 'machine' in nodes and not machines:
        place = top.value['nodes']
        reader.wrong(place.keys['machine'], 'nodes.machine', 'runs where the scene has `machines`')
    elif machines and 'machine' not in nodes:
        nodes['machine'] = NODES['machine'].settings()
        nodes = {name: nodes[name] for name in NODES if name in nodes}
    table = _table(reader, values.get('table'), nodes)
    place = values.get('notify')
    notify = reader.settings('notify', NotifySettings, place) if place else None
    hidden = tuple({s for text in reader.texts.values() for s in text.secrets() if s})
    scene = Scene(
        str(title.value) if title else path.stem,
        nodes,
        network,
        domain.value if domain else None,
        together,
        elsewhere,
        machines,
        path.resolve() if path.is_file() else Path.cwd() / top.file,
        real_time,
        '\n'.join(
            f'# {Path(name).name}\n{text.masked(hidden)}' for name, text in reader.texts.items()
        ),
        tuple(reader.warnings),
        namespace,
        notify,
        table,
        _programs(reader, values.get('programs')),
        reader.places,
        hidden,
        reader.texts,
    )
    if reader.mistakes:
        raise SceneError(reader.mistakes, scene)
    return scene


def check_namespace(text: str) -> str:
    """Return a namespace of ROS without the slash at its beginning; raise ConfigError."""
    parts = text.removeprefix('/').split('/')
    if not all(re.fullmatch('[A-Za-z_][A-Za-z0-9_]*', part) and '__' not in part for part in parts):
        raise ConfigError(
            f'{text!r} is not a namespace: words of letters, digits and _, parted by /, such as '
            'museum/north'
        )
    return '/'.join(parts)


def _namespace(reader: Reader, place: Place | None) -> str:
    if place is None:
        return NAMESPACE
    try:
        return check_namespace(str(place.value))
    except ConfigError as error:
        reader.wrong(place, 'namespace', str(error))
        return NAMESPACE


def _choice(
    reader: Reader, values: dict[str, Place], key: str, valid: tuple[Any, ...], default: Any
) -> Any:
    place = values.get(key)
    if place is None:
        return default
    if place.value not in valid:
        words = ', '.join(str(v).lower() for v in valid)
        reader.wrong(place, key, f'{place.value!r} is not one of {words}')
        return default
    return place.value


def _nodes(reader: Reader, top: Place, elsewhere: tuple[str, ...]) -> dict[str, Any]:
    place = top.value.get('nodes')
    if place is None or not isinstance(place.value, dict) or not place.value:
        if place is not None and isinstance(place.value, list) and place.value:
            reader.wrong(place, 'nodes', 'is a list; write each node as a key: `twin: {}`')
        elif not reader.mistakes:
            reader.wrong(place or top, 'nodes', 'names no node; a scene needs at least one')
        return {}
    for given in [name for name in place.value if name not in NODES]:
        reader.unknown(place, f'nodes.{given}', given, NODES)
        item = place.value.pop(given)
        near = difflib.get_close_matches(given, NODES, 1, 0.6)
        if near and near[0] not in place.value:  # its settings are checked, too
            place.value[near[0]], place.keys[near[0]] = item, place.keys[given]
    nodes = {}
    for name, item in place.value.items():
        if not _off(item):
            nodes[name] = reader.settings(name, NODES[name].settings, item)
    if nodes and 'recorder' not in place.value:
        nodes['recorder'] = NODES['recorder'].settings()
    _check_together(reader, place, nodes, elsewhere)
    return {name: nodes[name] for name in NODES if name in nodes}  # in data order


def _check_together(
    reader: Reader, place: Place, nodes: dict[str, Any], elsewhere: tuple[str, ...]
) -> None:
    """Note where nodes that are right by themselves do not make a graph."""
    sources = [name for name in IMAGE_SOURCES if name in nodes]
    for extra in sources[1:]:
        reader.wrong(place.keys[extra], f'nodes.{extra}', f'{sources[0]} gives the images already')
    twin, tracker = nodes.get('twin'), nodes.get('tracker')
    if twin and tracker and not tracker.calibration and twin.mirror != tracker.mirror:
        what = f'must be as twin.mirror, which is {str(twin.mirror).lower()}: one camera'
        reader.wrong(place.keys['tracker'], 'tracker.mirror', what)
    if twin and tracker and twin.calibration and not tracker.calibration:
        what = f'must be as twin.calibration, which is {twin.calibration}: one camera'
        reader.wrong(place.keys['tracker'], 'tracker.calibration', what)
    if sources and tracker and tracker.image_transport == 'compressed':
        what = f'must be raw: {sources[0]} publishes no JPEG images for it'
        reader.wrong(place.keys['tracker'], 'tracker.image_transport', what)
    there = {name for name, item in place.value.items() if not _off(item)} | set(elsewhere)
    for name in nodes:
        needed = providers(name)
        if needed and not there & set(needed):
            topic, others = NODES[name].requires, ' or '.join(needed)
            what = f'subscribes to {topic}, which no node here publishes: add {others}'
            reader.wrong(place.keys[name], f'nodes.{name}', what)


def _table(reader: Reader, place: Place | None, nodes: dict[str, Any]) -> TableSettings:
    table = TableSettings()
    if place is not None:
        table = reader.settings('table', TableSettings, place)
        for key, reason in table.contradictions():
            item = place.value.get(key, place) if isinstance(place.value, dict) else place
            reader.wrong(item, f'table.{key}', reason)
    for name in ('tracker', 'leds'):
        block = getattr(nodes.get(name), 'blink_block', -1)
        if block >= table.rows * table.columns or block in table.absent:
            where = f'{name}.blink_block'
            reader.wrong(Place(None, *reader.places[where]), where, f'no block {block} is there')
    gap = 'gap_y_m' if 0 < table.gap_y_m < table.gap_m else 'gap_m'
    twin, gap_m = nodes.get('twin'), getattr(table, gap)
    if twin and twin.spring_natural_m >= gap_m:
        what = f'must be below table.{gap}, the {gap_m:g} m length of a mounted spring'
        asked = 'twin.spring_natural_m', 'table', 'twin'
        at = next(reader.places[name] for name in asked if name in reader.places)
        reader.wrong(Place(None, *at), 'twin.spring_natural_m', what)
    return table


def _elsewhere(reader: Reader, top: Place) -> tuple[str, ...]:
    place = top.value.get('elsewhere')
    if place is None:
        return ()
    names = place.bare
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        reader.wrong(place, 'elsewhere', 'not a list of nodes, such as [camera, tracker]')
        return ()
    for name in names:
        if name not in NODES:
            reader.wrong(place, 'elsewhere', f'{name}: no such node. {nearest(name, NODES)}')
    return tuple(names)


def _machines(
    reader: Reader,
    place: Place | None,
    nodes: dict[str, Any],
    together: tuple[tuple[str, ...], ...],
    network: str,
) -> dict[str, Machine]:
    """Return the machines of a scene; note each node that does not stand on exactly one."""
    if place is None:
        return {}
    if not isinstance(place.value, dict) or not place.value:
        what = 'not a mapping of machines, such as show: {address: 10.0.0.1, nodes: [camera]}'
        reader.wrong(place, 'machines', what)
        return {}
    if network == 'local':
        what = 'several machines need `network: secure` or `lan`; it is local'
        reader.wrong(place, 'machines', what)
    if 'replay' in nodes:
        reader.wrong(place, 'machines', 'a replay runs on one machine: leave out `machines`')
    found: dict[str, Machine] = {}
    on: dict[str, str] = {}
    for name, item in place.value.items():
        where = f'machines.{name}'
        if not re.fullmatch('[a-z][a-z0-9_]*', name):
            reader.wrong(item, where, 'is not a name of small letters, digits and _')
        one = _machine(reader, item, where)
        if one.address in {other.address for other in found.values()}:
            reader.wrong(item, where, f'{one.address} is the address of another machine here')
        for node in one.nodes:
            if node not in nodes or node == 'machine':
                reader.wrong(item, where, f'{node}: not a node of this scene')
            elif node in on:
                reader.wrong(item, where, f'{node} runs on {on[node]} already')
            on.setdefault(node, name)
        found[name] = one
    for node in nodes:
        if node not in on and node != 'machine':
            reader.wrong(place, 'machines', f'{node} runs on no machine')
    for why, group in (*_NEAR, *(('together', group) for group in together)):
        if len({on[node] for node in group if node in on}) > 1:
            reader.wrong(place, 'machines', f'{" and ".join(group)} run on one machine: {why}')
    _check_images(reader, place, nodes, on)
    return found


# What does not cross a network.
_NEAR = (
    ('the panel serves the pictures of the montage', ('montage', 'panel')),
    ("the twin's blocks are on a serial line of its machine", ('twin', 'leds')),
)


def _machine(reader: Reader, item: Place, where: str) -> Machine:
    values = item.bare
    keys = {'address', 'nodes'}
    if not isinstance(values, dict) or set(values) != keys:
        reader.wrong(item, where, 'is not {address: 10.0.0.1, nodes: [camera, tracker]}')
        return Machine('', ())
    address, nodes = values['address'], values['nodes']
    try:
        ipaddress.IPv4Address(str(address))
    except ValueError:
        reader.wrong(item.value['address'], where, f'{address!r} is not an IPv4 address')
    if not isinstance(nodes, list) or not nodes or not all(isinstance(n, str) for n in nodes):
        reader.wrong(item.value['nodes'], where, 'nodes is not a list such as [camera, tracker]')
        nodes = []
    return Machine(str(address), tuple(nodes))


def _check_images(reader: Reader, place: Place, nodes: dict[str, Any], on: dict[str, str]) -> None:
    """Note who subscribes to raw images on another machine than their source."""
    sources = [name for name in IMAGE_SOURCES if name in on]
    wants = {'tracker'} & set(on)
    if 'recorder' in on and nodes['recorder'].images in ('all', 'around_slips'):
        wants.add('recorder')
    for name in wants if sources else ():
        if on[name] != on[sources[0]]:
            what = f'runs on {on[name]} and takes raw images of {on[sources[0]]}, 60 MB/s'
            reader.wrong(place, 'machines', f'{name} {what}: let both run on one machine')


def _off(place: Place) -> bool:
    """Whether the value is `off`, which YAML 1.1 reads as false."""
    return place.value is False or place.value == 'off'


def _programs(reader: Reader, place: Place | None) -> dict[str, tuple[str, ...]]:
    if place is None:
        return {}
    if not isinstance(place.value, dict):
        what = 'not a mapping of programs, such as count_slips: [python, count_slips.py]'
        reader.wrong(place, 'programs', what)
        return {}
    found: dict[str, tuple[str, ...]] = {}
    for name, item in place.value.items():
        where, words = f'programs.{name}', item.bare
        if not re.fullmatch('[a-z][a-z0-9_]*', name) or name in NODES:
            what = 'is not a name of small letters, digits and _ that no node has'
            reader.wrong(item, where, what)
        if _off(item):  # of an included scene
            continue
        listed = isinstance(words, list) and words
        if not listed or not all(isinstance(w, str) and '\0' not in w for w in words):
            reader.wrong(item, where, 'not a command as a list of texts, such as [python, my.py]')
            continue
        reader.places[where] = item.file, item.line, item.column
        found[name] = tuple(words)
    return found


def _together(
    reader: Reader, place: Place | None, nodes: dict[str, Any], listed: Place | None
) -> tuple[tuple[str, ...], ...]:
    """Return groups of nodes that share a process, without the nodes that `listed` turns off."""
    if place is None:
        return ()
    groups = place.bare
    if not isinstance(groups, list) or not all(
        isinstance(group, list) and group and all(isinstance(name, str) for name in group)
        for group in groups
    ):
        reader.wrong(place, 'together', 'not a list of lists of nodes, such as [[camera, tracker]]')
        return ()
    seen: set[str] = set()
    written = listed.value if listed and isinstance(listed.value, dict) else {}
    off = {name for name, value in written.items() if _off(value)}
    for name in [name for group in groups for name in group]:
        if name not in nodes and name not in off:
            reader.wrong(place, 'together', f'{name}: not a node of this scene')
        elif name in seen:
            reader.wrong(place, 'together', f'{name} stands twice')
        seen.add(name)
    left = (tuple(name for name in group if name in nodes) for group in groups)
    return tuple(group for group in left if group)

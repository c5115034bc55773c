# SPDX-License-Identifier: Apache-2.0
import dataclasses
import math
import os
import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from eol_ros import scene as scenes
from eol_ros.errors import ConfigError
from eol_ros.ros import presets
from eol_ros.ros.parameters import checked
from eol_ros.streams.graph import NODES

FUZZ = Path(tempfile.mkdtemp(prefix='eol-fuzz-'))


def write(folder, text, name='s.yaml'):
    path = folder / name
    path.write_text(text)
    return path


def mistakes(path):
    with pytest.raises(scenes.SceneError) as caught:
        scenes.load(path)
    return [(m.line, m.column, m.where, m.what) for m in caught.value.mistakes]


@pytest.mark.parametrize('name', scenes.shipped())
def test_shipped_scenes_are_right(name):
    scene = scenes.load(name)

    assert scene.name == name
    assert list(scene.nodes) == [n for n in NODES if n in scene.nodes]  # in data order
    assert scene.nodes['recorder'].images == ('preview' if name == 'museum' else 'none')


FILES = [
    (name, field)
    for name, spec in NODES.items()
    for field in dataclasses.fields(spec.settings)
    if field.metadata.get('kind') == 'path'
]


@pytest.mark.parametrize(('node', 'field'), FILES, ids=lambda x: getattr(x, 'name', x))
def test_a_setting_that_names_a_pipe_is_refused(tmp_path, node, field):
    """Its node would read it for ever, and could not read it again."""
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    several = isinstance(field.default, tuple)
    value = '[pipe]' if several else 'pipe'
    found = mistakes(write(tmp_path, f'nodes: {{{node}: {{{field.name}: {value}}}}}\n'))
    refused = f'{pipe}: a pipe or device; write it to a file, and name that'
    assert refused in [what for *_, where, what in found if where == f'{node}.{field.name}']
    with pytest.raises(ConfigError, match='a pipe or device'):
        checked(NODES[node].settings, {field.name: [str(pipe)] if several else str(pipe)})


def test_every_mistake_at_its_place(tmp_path):
    path = write(
        tmp_path,
        """scene: x
nodes:
  camera: {exposure_us: fast, widht: 3}
  trakcer: {}
  motion:
  montage: {period_s: 0.1, pairs: nope}
  twin: [1]
network: wan
domain: 400
together: [[camera, sound]]
bags: 1
include: other.yaml
""",
    )

    found = mistakes(path)

    assert [(line, column, where) for line, column, where, _ in found] == [
        (3, 3, 'nodes.camera'),
        (3, 25, 'camera.exposure_us'),
        (3, 31, 'camera.widht'),
        (4, 3, 'nodes.trakcer'),
        (6, 23, 'montage.period_s'),
        (6, 35, 'montage.pairs'),
        (7, 9, 'twin'),
        (8, 10, 'network'),
        (9, 9, 'domain'),
        (10, 11, 'together'),
        (11, 1, 'bags'),
        (12, 10, 'include'),
    ]
    words = ' '.join(what for *_, what in found)
    for hint in ('Did you mean width?', 'Did you mean tracker?', '0.34 to 60 s', 'no such file'):
        assert hint in words


def test_mistakes_come_with_file_and_count(tmp_path):
    path = write(tmp_path, 'nodes: {twin: {fps: high}}\n')

    with pytest.raises(scenes.SceneError) as caught:
        scenes.load(path)

    assert caught.value.exit_code == 78
    assert str(caught.value) == (
        f"{path}:1:21 error twin.fps: 'high' is not a number (1 to 240 Hz)\n"
        '    nodes: {twin: {fps: high}}\n'
        '                        ^\n'
        '1 error. Nothing was started.'
    )


def test_whole_number_is_a_number(tmp_path):
    scene = scenes.load(write(tmp_path, 'nodes: {twin: {fps: 120}}'))

    assert scene.nodes['twin'].fps == 120.0
    assert isinstance(scene.nodes['twin'].fps, float)


@pytest.mark.parametrize(
    'text, where',
    [
        ('', (1, 1)),
        ('[1, 2]', (1, 1)),
        ('nodes: {twin: {', (1, 16)),
        ('nodes:\n\t- x', (2, 1)),
        ('nodes: {}', (1, 8)),
        ('nodes: {twin: {}, twin: {}}', (1, 19)),
        ('nodes: {sound: {}, twin: {}}', (1, 9)),
        ('nodes: {twin: {}, camera: {}}', (1, 19)),
    ],
)
def test_broken_files(tmp_path, text, where):
    assert mistakes(write(tmp_path, text))[0][:2] == where


def test_twin_and_tracker_agree_on_the_mirror(tmp_path):
    text = 'nodes: {twin: {mirror: %s}, tracker: {mirror: %s}}'
    for words in (text % ('false', 'false'), text % ('true', 'true')):
        scenes.load(write(tmp_path, words))
    for words in (text % ('true', 'false'), text % ('false', 'true')):
        assert [w for *_, w, _ in mistakes(write(tmp_path, words))] == ['tracker.mirror']


def test_a_twin_with_a_calibration_is_tracked_with_one(tmp_path):
    write(tmp_path, '', 'c.yaml')
    text = 'nodes: {twin: {calibration: c.yaml}, tracker: {calibration: %s}}'
    scenes.load(write(tmp_path, text % 'c.yaml'))
    ((*_, where, why),) = mistakes(write(tmp_path, text % '""'))

    assert where == 'tracker.calibration' and 'must be as twin.calibration' in why


@pytest.mark.parametrize('pin', ['0042', '1234', '"0042"', 'on', '1e3', '2026-11-22', '0x1F'])
def test_text_is_taken_as_it_is_written(tmp_path, pin):
    scene = scenes.load(write(tmp_path, f'nodes: {{panel: {{pin: {pin}, names: [10, museum]}}}}'))
    again = scenes.load(write(tmp_path, yaml.safe_dump(scenes.plain(scene))))

    assert scene.nodes['panel'].pin == pin.strip('"')
    assert scene.nodes['panel'].names == ('10', 'museum')
    assert again.nodes == scene.nodes


def test_a_number_for_text_by_ros_parameter_is_told_to_be_quoted():
    pin = next(f for f in dataclasses.fields(NODES['panel'].settings) if f.name == 'pin')
    with pytest.raises(ConfigError, match=r'\*\*\* is not text: put it into quotes'):
        scenes.check_value(pin, 34)


@pytest.mark.parametrize('value', ['motion', '[1]', '[moton]'])
def test_elsewhere_is_a_list_of_nodes(tmp_path, value):
    text = f'nodes: {{montage: {{}}}}\nelsewhere: {value}'
    with pytest.raises(scenes.SceneError, match='elsewhere'):
        scenes.load(write(tmp_path, text))
    right = write(tmp_path, 'nodes: {montage: {}}\nelsewhere: [motion]')
    assert scenes.load(right).elsewhere == ('motion',)


SEVERAL = """
network: lan
nodes: {camera: {}, tracker: {}, motion: {}, sound: {}, grains: {}, montage: {}, panel: {}}
machines:
  show: {address: 10.0.0.1, nodes: [camera, tracker, motion, grains, recorder]}
  audio: {address: 10.0.0.2, nodes: [sound]}
  walls: {address: 10.0.0.3, nodes: [montage, panel]}
"""


def test_machines_say_what_runs_where(tmp_path):
    scene = scenes.load(write(tmp_path, SEVERAL))
    again = scenes.load(write(tmp_path, yaml.safe_dump(scenes.plain(scene), sort_keys=False)))
    assert again.machines == scene.machines and list(again.nodes) == list(scene.nodes)
    assert scene.machine_of('sound') == 'audio' and scene.main == 'show'
    assert 'machine' in scene.nodes
    assert 'machine' not in scenes.load('museum').nodes  # nothing more where all run on one


@pytest.mark.parametrize(
    ('programs', 'what'),
    [
        ('[python, my.py]', 'not a mapping of programs, such as'),
        ('{tracker: [python, my.py]}', 'is not a name of small letters, digits and _ that no node'),
        ('{My: [python, my.py]}', 'is not a name of small letters, digits and _ that no node'),
        ('{my: python my.py}', 'not a command as a list of texts'),
        ('{my: ["a\\0b"]}', 'not a command as a list of texts'),
        ('{my: [python, 3]}', 'not a command as a list of texts'),
        ('{my: []}', 'not a command as a list of texts'),
    ],
)
def test_programs_are_commands_by_name(tmp_path, programs, what):
    text = 'nodes: {montage: {}}\nelsewhere: [motion]\nprograms: '
    found = mistakes(write(tmp_path, text + programs))
    assert [said.startswith(what) for *_, said in found] == [True]
    right = scenes.load(write(tmp_path, text + '{my: [python, my.py]}'))
    assert right.programs == {'my': ('python', 'my.py')}
    assert scenes.plain(right)['programs'] == {'my': ['python', 'my.py']}


@pytest.mark.parametrize(
    ('right', 'wrong', 'what'),
    [
        ('network: lan', 'network: local', 'several machines need `network: secure` or `lan`; it'),
        ('[sound]', '[sound, grains]', 'grains runs on show already'),
        ('grains, recorder]', 'grains]', 'recorder runs on no machine'),
        ('[sound]', '[sound, hours]', 'hours: not a node of this scene'),
        ('10.0.0.3', '10.0.0.2', '10.0.0.2 is the address of another machine here'),
        ('10.0.0.3', 'walls.local', "'walls.local' is not an IPv4 address"),
        ('[montage, panel]', 'panel', 'nodes is not a list such as [camera, tracker]'),
        ('{address: 10.0.0.2, nodes: [sound]}', '[sound]', 'is not {address: 10.0.0.1, '),
        ('audio:', '2nd:', 'is not a name of small letters, digits and _'),
        ('camera: {}, tr', 'replay: {}, tr', 'a replay runs on one machine'),
        ('tracker, motion, grains, recorder]}', 'motion, grains, recorder]}\n  see: '
         '{address: 10.0.0.4, nodes: [tracker]}', 'runs on see and takes raw images of show'),
        ('[sound]', '[sound, panel]', 'montage and panel run on one machine'),
        ('network: lan', 'network: lan\ntogether: [[grains, sound]]', 'sound run on one machine'),
    ],
)  # fmt: skip
def test_machines_that_make_no_graph(tmp_path, right, wrong, what):
    text = SEVERAL.replace(right, wrong)
    if what.startswith('montage'):
        text = text.replace('[montage, panel]', '[montage]')
    assert what in '\n'.join(said for *_, said in mistakes(write(tmp_path, text)))


def test_a_node_that_is_off_leaves_the_groups_of_the_included_scene(tmp_path):
    assert scenes.load('instrument').together == (('motion', 'leds'),)
    off = scenes.load(write(tmp_path, 'include: instrument\nnodes: {leds: off}'))
    assert 'leds' not in off.nodes and off.together == (('motion',),)


def test_the_node_machine_needs_machines(tmp_path):
    path = write(tmp_path, 'nodes: {twin: {}, machine: {}}')
    assert mistakes(path)[0][3] == 'runs where the scene has `machines`'


@pytest.mark.parametrize(
    ('table', 'where', 'told'),
    [
        ('{rows: 1}', 'table.rows', '2 to 15'),
        ('{columns: 16}', 'table.columns', '2 to 15'),
        ('{rows: 3.5}', 'table.rows', 'whole number'),
        ('{block_side_m: 84}', 'table.block_side_m', '0.02 to 0.5'),
        ('{platform_m: [0.9, 1.4]}', 'table.platform_m', '0.988 m wide outside'),
        ('{platform_m: [1.4]}', 'table.platform_m', 'width and depth'),
        ('{absent: [25]}', 'table.absent', 'ids 0 to 24'),
        ('{rows: 2, columns: 2, absent: [0]}', 'table.absent', 'at least 4'),
        ('{gap_m: 0.05}', 'twin.spring_natural_m', 'below table.gap_m, the 0.05 m'),
        ('{gap_y_m: 0.05}', 'twin.spring_natural_m', 'below table.gap_y_m, the 0.05 m'),
        ('[5, 5]', 'table', 'mapping'),
        ('{row: 5}', 'table.row', 'rows'),
    ],
)
def test_a_table_that_cannot_stand_is_told_where_it_is_written(tmp_path, table, where, told):
    text = f'nodes: {{twin: {{}}, tracker: {{}}}}\ntable: {table}\n'
    ((line, _, at, what),) = mistakes(write(tmp_path, text))
    assert (line, at) == (2, where) and told in what


def test_a_table_is_merged_with_that_of_an_included_scene(tmp_path):
    write(tmp_path, 'nodes: {twin: {}}\ntable: {rows: 3, absent: [0]}\n', 'base.yaml')
    scene = scenes.load(write(tmp_path, 'include: base.yaml\ntable: {columns: 4}\n'))
    assert (scene.table.rows, scene.table.columns, scene.table.absent) == (3, 4, (0,))
    again = scenes.load(write(tmp_path, yaml.safe_dump(scenes.plain(scene)), 'again.yaml'))
    assert again.table == scene.table


@pytest.mark.parametrize('text', ['north', '/north', 'museum/_left2'])
def test_a_namespace_is_taken_with_or_without_its_slash(tmp_path, text):
    scene = scenes.load(write(tmp_path, f'namespace: {text}\nnodes: {{twin: {{}}}}'))
    again = scenes.load(write(tmp_path, yaml.safe_dump(scenes.plain(scene))))
    assert scene.namespace == again.namespace == text.removeprefix('/')


@pytest.mark.parametrize(
    'text', ["''", '/', 'north/', '2nd', 'a__b', 'a b', 'ä', '7', '//a', 'a-b']
)
def test_what_is_no_namespace_is_told(tmp_path, text):
    path = write(tmp_path, f'namespace: {text}\nnodes: {{twin: {{}}}}')
    [(line, column, where, what)] = mistakes(path)
    assert (line, column, where) == (1, 12, 'namespace')
    assert 'is not a namespace' in what and 'museum/north' in what


def test_include_is_merged_below(tmp_path):
    write(tmp_path, 'network: lan\nnodes: {twin: {fps: 30, seed: 7}, tracker: {}}', 'base.yaml')
    path = write(tmp_path, 'include: base.yaml\nnodes: {twin: {fps: 90}}')

    scene = scenes.load(path)

    assert (scene.network, scene.nodes['twin'].fps, scene.nodes['twin'].seed) == ('lan', 90.0, 7)
    assert 'tracker' in scene.nodes
    assert 'base.yaml' in scene.text and 'seed: 7' in scene.text  # a bag gets the whole of it


def test_a_shipped_scene_is_included_by_its_name(tmp_path):
    scene = scenes.load(write(tmp_path, 'include: rehearsal\nnodes: {twin: {fps: 90}}'))

    assert scene.nodes['twin'].fps == 90
    assert scene.nodes.keys() == scenes.load('rehearsal').nodes.keys()
    assert 'rehearsal' in mistakes(write(tmp_path, 'include: reharsal'))[0][3]
    told = mistakes(write(tmp_path, 'include: [a.yaml, b.yaml]'))[0][3]
    assert told == "['a.yaml', 'b.yaml'] is not a file name"


def test_mistake_in_an_include_is_named_there(tmp_path):
    base = write(tmp_path, 'nodes:\n  twin: {fps: -3}', 'base.yaml')
    path = write(tmp_path, 'include: base.yaml')

    with pytest.raises(scenes.SceneError) as caught:
        scenes.load(path)

    assert f'{base}:2:15 error twin.fps' in str(caught.value)


def test_include_of_itself(tmp_path):
    assert 'includes itself' in mistakes(write(tmp_path, 'include: s.yaml'))[0][3]


def test_paths_are_relative_to_the_scene(tmp_path):
    (tmp_path / 'ice.wav').write_bytes(b'')
    scene = scenes.load(
        write(
            tmp_path,
            'nodes: {replay: {}, grains: {sound: ice.wav}}'.replace(
                'replay: {}', f'replay: {{bag: {tmp_path}}}'
            ),
        )
    )

    assert scene.nodes['grains'].sound == str(tmp_path / 'ice.wav')


def values_of(field):
    """Return a strategy of what a scene may say of a number, a choice or a switch; else None."""
    meta = field.metadata
    low, high = meta.get('min'), meta.get('max')
    if field.name == 'blink_block':
        high = 24  # of the blocks that there are
    if meta.get('choices'):
        one = st.sampled_from(meta['choices'])
        return st.lists(one, unique=True).map(tuple) if isinstance(field.default, tuple) else one
    if field.type is bool:
        return st.booleans()
    if low is None or high is None:
        return None
    if field.type is int:
        return st.integers(int(low), int(high))
    return st.floats(low, high) if field.type is float else None


@st.composite
def changes(draw):
    """Draw some settings of some nodes of the rehearsal."""
    found = {}
    for name in draw(st.sets(st.sampled_from(sorted(scenes.load('rehearsal').nodes)))):
        kinds = {f.name: values_of(f) for f in dataclasses.fields(NODES[name].settings)}
        # Twin and tracker must agree on the mirror and on images, a limit goes off with a reason
        # alone, and springs are shorter than the table's gaps.
        apart = 'mirror', 'image_transport', 'flash_limit', 'spring_natural_m'
        kinds = {k: v for k, v in kinds.items() if v is not None and k not in apart}
        for key in draw(st.sets(st.sampled_from(sorted(kinds)), max_size=4)) if kinds else ():
            found.setdefault(name, {})[key] = draw(kinds[key])
    return found


@pytest.mark.parametrize(
    ('written', 'meant'),
    [('true', 'field'), ('field', 'field'), ('field_of_view', 'field_of_view')],
)
def test_a_limit_of_flashes_that_was_true_is_that_of_the_whole_field(tmp_path, written, meant):
    path = tmp_path / 'scene.yaml'
    path.write_text(
        f'include: rehearsal\nnodes: {{leds: {{port: twin, flash_limit: {written}}}}}\n'
    )
    assert scenes.load(path).nodes['leds'].flash_limit == meant


@given(changes())
@settings(max_examples=25)
def test_a_scene_has_what_it_says_and_else_what_it_includes(changed):
    """And written out in full it is read back the same."""
    base = scenes.load('rehearsal')
    text = {'include': str(scenes.find('rehearsal')), 'nodes': changed}
    scene = scenes.load(write(FUZZ, yaml.safe_dump(text)))
    for name, mine in base.nodes.items():
        assert scene.nodes[name] == dataclasses.replace(mine, **changed.get(name, {}))
    again = scenes.load(write(FUZZ, yaml.safe_dump(scenes.plain(scene)), 'again.yaml'))
    assert again.nodes == scene.nodes


@pytest.mark.parametrize(
    'base, mine, images',
    [
        ('', '', 'none'),  # nobody has to ask for it
        ('', 'recorder:', 'none'),
        ('', 'recorder: {images: all}', 'all'),
        ('', 'recorder: off', None),
        ('', 'recorder: "off"', None),
        ('recorder: off', '', None),
        ('recorder: {images: all}', 'recorder: off', None),
        ('recorder: off', 'recorder: {images: all}', 'all'),
    ],
)
def test_every_scene_has_a_recorder_unless_it_says_off(tmp_path, base, mine, images):
    write(tmp_path, f'nodes:\n  twin: {{}}\n  {base}\n', 'base.yaml')
    path = write(tmp_path, f'include: base.yaml\nnodes:\n  tracker: {{}}\n  {mine}\n')
    recorder = scenes.load(path).nodes.get('recorder')

    assert (recorder and recorder.images) == images
    assert list(scenes.Scene.alone('tracker').nodes) == ['tracker']  # started by hand: as asked


def test_a_node_of_an_included_scene_is_left_out(tmp_path):
    (tmp_path / 'base.yaml').write_text('nodes: {camera: {}, tracker: {}, recorder: off}')
    mine = tmp_path / 'mine.yaml'
    mine.write_text('include: base.yaml\nnodes: {camera: off}\nelsewhere: [camera]')
    assert list(scenes.load(mine).nodes) == ['tracker']
    mine.write_text('include: base.yaml\nnodes: {camera: off}')
    with pytest.raises(ConfigError, match='camera/image_raw, which no node here publishes'):
        scenes.load(mine)


@pytest.mark.parametrize('value', ['on', '0', '[]', 'none'])
def test_a_recorder_is_settings_or_off(tmp_path, value):
    path = write(tmp_path, f'nodes: {{twin: {{}}, recorder: {value}}}')

    assert mistakes(path) == [
        (1, 29, 'recorder', 'not a mapping of settings, such as {images: all}, nor off')
    ]


def test_every_path_of_a_list_is_resolved_and_every_line_has_its_form(tmp_path):
    write(tmp_path, '', 'a.wav')
    path = write(
        tmp_path,
        'scene: s\nnodes:\n  twin: {}\n  tracker: {}\n'
        '  grains: {more_sounds: [a.wav], weights: [a 0.5]}\n',
    )
    alone = scenes.load(path).settings('grains')
    assert alone.more_sounds == (str(tmp_path / 'a.wav'),) and alone.weights == ('a 0.5',)
    bad = write(
        tmp_path,
        'scene: s\nnodes:\n  grains:\n    more_sounds: [b.wav]\n    weights: [a 5]\n'
        '    match: [flatness 1 moon]\n',
        'bad.yaml',
    )
    found = [what for *_, what in mistakes(bad)]
    assert 'b.wav: no such file or folder' in found
    assert "'a 5' is not NAME WEIGHT" in found
    assert "'flatness 1 moon' is not DESCRIPTOR WEIGHT SOURCE" in found


WRONG = {  # of each setting, what it cannot be, where its definition says so
    'a list': lambda kind, _: [{'a': 1}],
    'a mapping': lambda kind, _: {'a': 1},
    'nothing': lambda kind, _: None,
    'a switch': lambda kind, _: True if kind in (int, float) else {},
    'text': lambda kind, _: '60' if kind in (int, float, bool) else {},
    'not a number': lambda kind, _: math.nan if kind is float else {},
    'endless': lambda kind, _: math.inf if kind is float else {},
    'too small': lambda kind, meta: {} if meta.get('min') is None else meta['min'] - 1,
    'too large': lambda kind, meta: {} if meta.get('max') is None else meta['max'] + 1,
    'no choice': lambda kind, meta: 'nonsense' if meta.get('choices') else {},
}


@pytest.mark.parametrize('what', WRONG)
@pytest.mark.parametrize('node', NODES)
def test_every_setting_of_every_node_refuses_what_it_cannot_be(node, what, tmp_path):
    fields = dataclasses.fields(NODES[node].settings)
    values = {f.name: WRONG[what](f.type, f.metadata) for f in fields}
    path = write(tmp_path, yaml.safe_dump({'nodes': {node: values}}))
    told = [where for *_, where, _ in mistakes(path) if where.partition('.')[2] in values]

    assert sorted(told) == sorted(f'{node}.{name}' for name in values)


def test_settings_renamed_since_the_last_release_are_read_everywhere(tmp_path):
    """In a scene with a warning; in presets and recordings without."""
    old = {'grains': {'bed_rate': 3.0, 'bed_speed': 0.5}, 'sound': {'felt_latency_s': 0.1}}
    path = write(tmp_path, f'include: rehearsal\nnodes: {old}')
    scene = scenes.load(path)

    assert (scene.nodes['grains'].ambience_rate, scene.nodes['sound'].tap_latency_s) == (3.0, 0.1)
    assert len(scene.warnings) == 3
    assert 's.yaml:2: grains.bed_rate is now called grains.ambience_rate' in scene.warnings[0]
    old['grains']['ambience_rate'] = 3.0
    with pytest.raises(scenes.SceneError, match='bed_rate: no such key'):
        scenes.load(write(tmp_path, f'include: rehearsal\nnodes: {old}'))
    del old['grains']['ambience_rate']
    path.write_text(f'nodes: {old}')
    assert presets.load(path)['grains'] == {'ambience_rate': 3.0, 'ambience_playback_rate': 0.5}


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('twin: {seed: 010}', ':2:16 error .*octal in YAML: leave the 0 out'),
        ('panel: {port: 08080}', 'octal in YAML'),
        ('twin: {seed: 1e6}', 'write the number in full'),
        ('sound: {gain_db: -1,5}', 'write a decimal point'),
        ('sound: {device: hw:1,0}', 'text with commas in quotes'),
        ('twin:\u00a0{seed: 1}', ':2:8 error a no-break space'),
    ],
)
def test_yaml_that_means_something_else_is_told(tmp_path, text, told):
    path = tmp_path / 's.yaml'
    path.write_text(f'nodes:\n  {text}\n')
    with pytest.raises(scenes.SceneError, match=told):
        scenes.load(path)


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'utf-16', 'utf-16-le', 'utf-16-be'])
def test_scenes_of_editors_of_windows(tmp_path, encoding):
    text = '' if encoding in ('utf-8-sig', 'utf-16') else '\ufeff'
    (tmp_path / 's.yaml').write_bytes(f'{text}nodes:\r\n  twin: {{seed: 7}}\r\n'.encode(encoding))
    assert scenes.load(tmp_path / 's.yaml').settings('twin').seed == 7

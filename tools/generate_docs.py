# SPDX-License-Identifier: Apache-2.0
"""Writes the generated pages of docs/reference, from code, and a table of its page on OSC.

python tools/generate_docs.py            write them
python tools/generate_docs.py --check    exit 1 when they are not up to date
"""

import argparse
import ast
import dataclasses
import importlib
import sys
from pathlib import Path

import public_api

from eol_ros import cli, errors, scene
from eol_ros.settings import NotifySettings, TableSettings
from eol_ros.streams import osc
from eol_ros.streams.graph import NODES, QOS, TOPICS
from eol_ros.streams.requests import KINDS, SET, Number

ROOT = Path(__file__).parents[1]
OSC_TABLE = '<!-- made by tools/generate_docs.py -->'
# What to do about each kind of error, beside what its line says.
REMEDIES = {
    errors.EolError: '`eol bundle` gathers what a maintainer needs, if the line names no remedy',
    errors.UsageError: '`eol VERB --help` lists the options, with examples',
    errors.DeviceMissing: 'connect or install it; `eol devices` lists what is there',
    errors.SupervisorSilent: 'end the process that the line names, then start the scene again',
    errors.ConfigError: '`eol check SCENE` lists all mistakes with their lines; then correct them',
}
# Commands whose exit code is a result.
RESULTS = {
    'eol status': '0: all nodes are OK; 1: a warning, or no answer; 2: an error; 69: no graph runs',
    'eol call`, `eol param set': '1: a node refuses; 69: no graph or node runs that could answer, '
    'or one does not answer in time; 2: no such request or argument',
    'eol check': '78: mistakes in the scene; 69: a missing package, or device with `--devices`',
    'eol bag info`, `verify`, `recover': '1: something of the bag is damaged or lost',
    'eol report --retrack': '1: a recomputed result differs, or a part cannot be proved',
    'eol board': '1: a block failed a test, or is missing',
}
MESSAGES = ROOT / 'msg_defs' / 'eol_msgs' / 'msg'
PLAY_GRAIN = """\
The easiest way is `eol call play_grain grain=12`. A node can publish a `GrainTrigger`, in a shell \
with [`eol_msgs`](../guides/connect.md#rviz-and-your-own-ros-2-nodes):

```python
import rclpy
from eol_msgs.msg import GrainTrigger

rclpy.init()
node = rclpy.create_node('player', namespace='eol')
publisher = node.create_publisher(GrainTrigger, 'grain_triggers', 10)
while not publisher.get_subscription_count():
    rclpy.spin_once(node, timeout_sec=0.1)
trigger = GrainTrigger(grain=12, block=255, gain=1.0, rate=1.0)
trigger.header.stamp = node.get_clock().now().to_msg()
publisher.publish(trigger)
rclpy.spin_once(node, timeout_sec=1.0)  # time to send it
```

Fields left out are 0. `gain: 0` is silent. `rate: 0` is out of range: the grain is dropped and \
counted (`dropped`). A stamp over 60 s from now is rejected. Attack and release are at least 2 ms. \
`block: 255` means no block; the id of a block makes the grain part of its cascade. The \
same with `ros2` (not tried):

    ros2 topic pub --once /eol/grain_triggers eol_msgs/msg/GrainTrigger \\
        '{header: auto, grain: 12, block: 255, gain: 1.0, rate: 1.0}'"""


REQUESTS = """\
`eol call KIND NAME=VALUE ...`. By OSC the values stand in this order, without names: \
`/eol/call/play_grain 12`. OSC changes settings by `/eol/set/NODE/NAME VALUE`."""


def node_table() -> str:
    rows = ['| node | what it does | subscribes | publishes |', '| --- | --- | --- | --- |']
    for name in NODES:
        tree = ast.parse((ROOT / 'eol_ros' / 'nodes' / f'{name}.py').read_text())
        says = (ast.get_docstring(tree) or '').splitlines()[0].rstrip('.')
        node = NODES[name]
        subscribes = ', '.join(
            [f'`{t}`' for t in TOPICS if t in node.subscribes]
            + [f'(`{t}`)' for t in TOPICS if t in node.optional]
        )
        publishes = ', '.join(
            [f'`{t}`' for t in TOPICS if t in node.publishes]
            + [f'(`{t}`)' for t in TOPICS if t in node.on_request]
        )
        if name == 'recorder':
            subscribes = '[what bags keep](../guides/bags.md#what-is-in-a-bag)'
        rows.append(f'| `{name}` | {says} | {subscribes or "-"} | {publishes or "-"} |')
    return '\n'.join(rows)


def topic_table() -> str:
    rows = ['| topic | type | QoS | carries |', '| --- | --- | --- | --- |']
    for row in TOPICS.values():
        name = row.name if row.name.startswith('/') else f'/eol/{row.name}'
        rows.append(f'| `{name}` | `{row.type_name}` | {qos(row.qos)} | {row.doc} |')
    return '\n'.join(rows)


def kind_s(name: str) -> str:
    return f'{KINDS[name].within_s:g}'


def service_table() -> str:
    rows = ['| service | type | effect | nodes |', '| --- | --- | --- | --- |']
    for kind in KINDS.values():
        if kind.off or kind.triggered:
            type_ = 'SetBool' if kind.off else 'Trigger'
            says = kind.doc + (f'; `data: false`: {KINDS[kind.off].doc}' if kind.off else '')
            nodes = ', '.join(f'`{node}`' for node in kind.whom(''))
            nodes += f'; answer of `{kind.answered_by}`' if kind.answered_by else ''
            rows.append(f'| `/eol/{kind.name}` | `std_srvs/srv/{type_}` | {says} | {nodes} |')
    return '\n'.join(rows)


def qos(name: str) -> str:
    profile = QOS[name]
    words = ['reliable' if profile.reliable else 'best effort']
    words += ['transient local'] * profile.latched
    return ', '.join([*words, f'keep last {profile.depth}'])


def topics_page() -> str:
    parts = [
        '# Nodes, topics and messages',
        'Generated by `make docs` from `eol_ros/streams/graph.py` and `msg_defs/eol_msgs/msg`. In '
        'a scene with `namespace: north`, topics begin with `/north` in place of `/eol`, and the '
        'frames `table` and `camera_optical` with `north/`. `/tf_static`, `/diagnostics` and the '
        'frame `world` keep their names. `eol topics` lists the topics of a running graph.',
        'Every node also publishes `node_states` and `/diagnostics`, once a second and at each '
        'change of level, and subscribes to `ready`, which the image source publishes.',
        'A topic in brackets below is not always there. The node publishes it only after a person, '
        'a program or another node sent a request, and subscribes to it only if a setting of the '
        'node needs it.',
        '## Frames',
        'Coordinate system of `table`: the origin is the centre of the platform, x points right, '
        'y away from the front edge, z up. `world` is the same frame: the transform from `world` '
        'to `table` is the identity. Units are metres and radians; yaw is anticlockwise. '
        '`camera_optical` is the camera, placed by the calibration; `/tf_static` lacks it if the '
        'camera sees the table in a mirror.',
        '## Nodes',
        node_table(),
        '## Topics',
        'Every topic without *transient local* is volatile, such as `blocks` and `slips`: a late '
        'subscriber gets the next message and nothing older. On a transient local (latched) topic '
        'a late subscriber that asks for transient local gets the newest message at once.',
        topic_table(),
        '## Services',
        'The node `panel` serves them; in a scene without it, another node that subscribes to '
        '`requests`. It serves those whose nodes are in the scene. A call is also published on '
        '`requests`, so a bag has it.\n\n'
        'The response comes when all nodes of the last column that are in the scene have answered, '
        'or one has refused. `success: true`: all accepted; `message` is what they report, or '
        'empty. `success: false`: `message` names the nodes that refused and why, or those that '
        f'do not run or did not answer in time. They have {kind_s("sleep")} s (`test` '
        f'{kind_s("test")} s, `calibrate` {kind_s("calibrate")} s, `learn_background` '
        f'{kind_s("learn_background")} s, `restart` and `stop` {kind_s("stop")} s). Nodes that '
        'had accepted keep what they did.\n\n'
        "    ros2 service call /eol/mute std_srvs/srv/SetBool '{data: true}'",
        service_table(),
        "The node `replay` has the services of rosbag2's player, of `rosbag2_interfaces/srv`: "
        '`/eol/replay/pause`, `resume`, `toggle_paused`, `is_paused`, `get_rate`, `set_rate` and '
        '`seek`.',
        '## Play a grain from your own program',
        PLAY_GRAIN,
        '## Messages',
        'All fields, with their units: of slips, cascades, blocks, grain triggers and so on. '
        '[Contribute](../contributing.md) lists what has changed since 0.2.0.',
    ]
    for path in sorted(MESSAGES.glob('*.msg')):
        parts += [f'### {path.stem}', f'```\n{path.read_text().rstrip()}\n```']
    return '\n\n'.join(parts) + '\n'


def settings_page() -> str:
    parts = [
        '# Settings',
        'Generated by `make docs` from `eol_ros/settings.py`. These are the settings of each node '
        'in a scene; the same names are ROS parameters. *Live* settings can change while the node '
        'runs, by `eol param set NODE NAME VALUE`, the panel or `ros2 param set /eol/NODE NAME '
        'VALUE`. The node refuses to change others: write them into the scene and start it again. '
        '`ros2 param describe /eol/NODE NAME` and rqt show the range and meaning of a parameter. '
        'The column *range* has least and greatest value with the unit, or all allowed values.',
        'A live change, by whichever way, survives a crash of the node, of bringup and a power '
        'cut. Ctrl-C discards it, except in a run by `eol service`, which keeps it over every '
        'boot until the scene of that node changes ([after a power cut]'
        '(../guides/install.md#after-a-power-cut)). A scene with the node `replay` keeps none for '
        'its next start. To keep a change for good, write it into the scene.',
    ]
    kinds: dict[str, type] = {'table, beside nodes': TableSettings}
    kinds |= {node.name: node.settings for node in NODES.values()}
    kinds['notify, beside nodes'] = NotifySettings
    for node, kind in kinds.items():
        rows = [
            f'## {node}',
            '',
            '| setting | default | range | live | meaning |',
            '| --- | --- | --- | --- | --- |',
        ]
        for field in dataclasses.fields(kind):
            meta = field.metadata
            span = ', '.join(meta.get('choices') or ())
            if not span:
                low, high = meta.get('min'), meta.get('max')
                span = ' to '.join(f'{v:g}' for v in (low, high) if v is not None)
                span = f'at least {span}' if low is not None and high is None else span
                span = ' '.join(w for w in (span, meta.get('unit', '')) if w)
            rows.append(
                f'| `{field.name}` | `{field.default!r}` | {span} | '
                f'{"live" if meta.get("live") else ""} | {meta.get("doc", "")} |'
            )
        parts.append('\n'.join(rows))
    return '\n\n'.join(parts) + '\n'


def scene_page() -> str:
    parts = [
        '# Scene keys',
        'Generated by `make docs` from `eol_ros/scene.py`. A scene is a YAML file with these keys. '
        '[Settings](settings.md) lists the settings of each node, of `table` and of `notify`. '
        '`eol check SCENE` finds every mistake, with its line.',
        '\n'.join([
            '| key | example | meaning |',
            '| --- | --- | --- |',
            *(f'| `{key}` | `{example}` | {doc} |' for key, (example, doc) in scene.KEYS.items()),
        ]),
        '## Leave out a node',
        'This scene is `rehearsal` without sound. `recorder: off` starts it without a recording.',
        '    include: rehearsal\n    nodes: {sound: off, recorder: off}',
        '## Shipped scenes',
        'Use them by name, as in `eol run lights` or `include: lights`.',
        '\n'.join([
            '| scene | nodes |',
            '| --- | --- |',
            *(
                f'| `{name}` | {", ".join(f"`{n}`" for n in scene.load(path).nodes)} |'
                for name, path in sorted(scene.shipped().items())
            ),
        ]),
    ]  # fmt: skip
    return '\n\n'.join(parts) + '\n'


def arguments(parser: argparse.ArgumentParser) -> list[str]:
    """Return a row for each argument of a command that is no command itself."""
    rows = []
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction | argparse._SubParsersAction):
            continue
        names = ', '.join(action.option_strings)
        choices = '|'.join(map(str, action.choices or ()))
        takes = action.metavar or choices or ('' if action.nargs == 0 else action.dest)
        if isinstance(takes, tuple):
            takes = ' '.join(takes)
        elif names and not action.metavar and not choices:
            takes = takes.upper()
        about = (action.help or '') % {'default': action.default}
        if choices and choices not in takes and action.choices[0] not in about:
            about += f' ({choices})'
        cells = f'`{names} {takes}`'.replace('` ', '`').replace(' `', '`'), about
        rows.append(f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in cells)} |')
    return ['| argument | meaning |', '| --- | --- |', *rows] if rows else []


def command(prog: str, about: str, parser: argparse.ArgumentParser) -> str:
    """Return usage text, arguments and sub-commands of a command."""
    parts = [about, '\n'.join(arguments(parser))]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            told = {one.dest: one.help for one in action._choices_actions}
            for name, sub in dict.fromkeys(
                (next(n for n, s in action.choices.items() if s is sub), sub)
                for sub in action.choices.values()
            ):
                parts += [f'**`{prog} {name}`**: {told[name]}', '\n'.join(arguments(sub))]
    return '\n\n'.join(filter(None, parts))


def request_table() -> str:
    rows = ['| kind | arguments | effect | answered by |', '| --- | --- | --- | --- |']
    for kind in KINDS.values():
        if kind.internal:
            continue
        takes = ', '.join(
            f'`{t.name}`'
            + (f' {t.low:g} to {t.high:g}' if isinstance(t, Number) and not t.whole else '')
            for t in kind.takes
        )
        takes = takes or ('NODE, NAME=VALUE ...' if kind.name == SET else '-')
        answering = [kind.answered_by] if kind.answered_by else kind.whom('')
        nodes = ', '.join(f'`{node}`' for node in answering)
        rows.append(f'| `{kind.name}` | {takes} | {kind.doc} | {nodes} |')
    return '\n'.join(rows)


def commands_page() -> str:
    parts = [
        '# Commands',
        'Generated by `make docs` from the parsers of `eol_ros/verbs`. `eol VERB --help` prints '
        'the same. Data goes to stdout, messages to stderr. [Exit codes](exit_codes.md) are the '
        'same for all commands.',
    ]
    for group, verbs in cli.GROUPS.items():
        parts.append(f'## {group.capitalize()}')
        for verb in verbs:
            module = importlib.import_module(f'eol_ros.verbs.{verb}')
            parser = cli.Parser(prog=f'eol {verb}')
            module.add_arguments(parser)
            parts += [
                f'### eol {verb}',
                command(f'eol {verb}', module.HELP, parser),
                '```\n' + '\n'.join(module.EXAMPLES) + '\n```',
            ]
            if verb == 'call':
                parts += ['#### Kinds of requests', REQUESTS, request_table()]
    return '\n\n'.join(parts) + '\n'


def exit_codes_page() -> str:
    found = [
        kind
        for kind in vars(errors).values()
        if isinstance(kind, type) and issubclass(kind, errors.EolError)
    ]
    kinds = sorted(found, key=lambda kind: kind.exit_code)
    rows = ['| code | error | meaning | remedy |', '| --- | --- | --- | --- |']
    rows.append('| 0 | - | The command did its work, or stopped on request. | - |')
    for kind in kinds:
        doc = 'Any other fault.' if kind is errors.EolError else (kind.__doc__ or '')
        rows.append(f'| {kind.exit_code} | `{kind.__name__}` | {doc} | {REMEDIES[kind]} |')
    results = [f'| `{verb}` | {code} |' for verb, code in RESULTS.items()]
    parts = [
        '# Exit codes',
        'Generated by `make docs` from `eol_ros/errors.py`. An error is one line on stderr: what '
        'was found, where, and what to do. With `--json` stdout then stays empty.',
        '\n'.join(rows),
        '`eol run` and each node use the same codes. systemd does not restart a run that ended '
        'with 2, 3 (by the service `stop`) or 78.',
        '## Codes that are results',
        '\n'.join(['| command | code |', '| --- | --- |', *results]),
    ]
    return '\n\n'.join(parts) + '\n'


def osc_page() -> str:
    """Return docs/reference/osc.md as it is, with the table of messages of today."""
    rows = ['| message | address and values | meaning |', '| --- | --- | --- |']
    rows += [f'| `{r.name}` | `/eol/{r.name}` {r.takes} | {r.doc} |' for r in osc.ROWS.values()]
    head, _, rest = (ROOT / 'docs/reference/osc.md').read_text().partition(OSC_TABLE)
    return (
        f'{head}{OSC_TABLE}\n'
        + '\n'.join(rows)
        + '\n<!-- end -->'
        + rest.partition('<!-- end -->')[2]
    )


def main() -> int:
    pages = {
        'docs/reference/osc.md': osc_page(),
        'docs/reference/topics.md': topics_page(),
        'docs/reference/settings.md': settings_page(),
        'docs/reference/scene.md': scene_page(),
        'docs/reference/commands.md': commands_page(),
        'docs/reference/exit_codes.md': exit_codes_page(),
        'docs/reference/api.md': public_api.page(),
    }
    stale = [
        name
        for name, text in pages.items()
        if not (ROOT / name).exists() or (ROOT / name).read_text() != text
    ]
    if '--check' in sys.argv:
        for name in stale:
            print(f'{name} is out of date: make docs', file=sys.stderr)
        return bool(stale)
    for name in stale:
        (ROOT / name).write_text(pages[name])
        print(name)
    return 0


if __name__ == '__main__':
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""`eol measure` on recordings and on a running graph of twins that nobody has told."""

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np
import pytest
from eol_msgs.msg import Blocks
from eol_msgs.msg import Table as TableMessage
from support.measured_twins import FPS, Hung, Pulled
from support.waiting import GENEROUS_S

from eol_ros import cli, scene
from eol_ros.core.table import Table
from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import ConfigError
from eol_ros.ros import network
from eol_ros.ros.definitions import definition, describe
from eol_ros.ros.session import session
from eol_ros.ros.topics import PUBLISHER_QOS
from eol_ros.streams import blocks, tables
from eol_ros.verbs import measure

pytestmark = pytest.mark.slow
T0 = 1_700_000_000_000_000_000
SCENE = """\
# the table in the hall
scene: mine
nodes:
  twin: {hands: nobody}  # quiet
  tracker: {}
"""


def messages(images):
    """Yield stamp (ns) and CDR bytes of the messages of the tracker."""
    codec = blocks.Codec(definition(blocks.TYPE))
    rows = np.zeros(25, blocks.BLOCK)
    rows['id'], rows['sigma'] = np.arange(25), 9e-6
    for k, (stamp_s, places, seen) in enumerate(images):
        rows['x'], rows['y'], rows['yaw'] = places.T
        rows['seen'] = seen
        stamp_ns = T0 + round(1e9 * stamp_s)
        yield stamp_ns, codec.pack(stamp_ns, TRACKING, False, k, rows)


def recorded(path, images):
    writer = BagWriter(path, [BagTopic('/eol/blocks', **describe('blocks'))], {'seeds': '{}'})
    for stamp_ns, data in messages(images):
        writer.write('/eol/blocks', data, stamp_ns, stamp_ns)
    writer.close()
    return str(path)


@pytest.fixture(scope='module')
def hung(tmp_path_factory):
    """A twin with weights, its images, and a bag of them."""
    twin = Hung(1003, shares=(0.35, 0.7, 1.0, 0.6, 0.2))
    images = list(twin.images())
    return twin, images, recorded(tmp_path_factory.mktemp('hung') / 'bag', images)


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(SCENE)
    return str(path)


@pytest.fixture(scope='module')
def pulled(tmp_path_factory):
    twin = Pulled(7, seconds=15.0)
    return twin, recorded(tmp_path_factory.mktemp('pulled') / 'bag', twin.images())


def grams(twin):
    return ','.join(f'{1e3 * weight:g}' for weight in twin.weights_kg)


def test_weights_on_a_recorded_table_go_into_the_scene(hung, mine, capsys):
    twin, _, bag = hung
    words = [
        'measure',
        'springs',
        mine,
        '--weights',
        grams(twin),
        '--bag',
        bag,
        '--natural',
        '59.5',
    ]

    assert cli.main(words) == 0

    out, err = capsys.readouterr()
    found = scene.load(mine).nodes['twin']
    assert out.startswith(f'stiffness {found.stiffness:g} +- {found.stiffness_error:g} N/m; 95 %')
    assert abs(found.stiffness - twin.stiffness) < 5 * found.stiffness_error
    assert 0 < found.stiffness_error < 0.08 * twin.stiffness
    assert re.match('(good|usable|poor): .*error of stiffness', out.splitlines()[-1])
    assert found.spring_natural_m == 0.0595
    assert 'written into' in err and err.count('at rest') == 1 + len(twin.weights_kg)
    text = Path(mine).read_text()
    assert text.startswith('# the table in the hall\n') and '# quiet\n' in text


def test_figures_for_a_program_write_nothing(hung, capsys):
    twin, _, bag = hung
    words = ['measure', 'springs', '--weights', grams(twin), '--bag', bag, '--json']
    assert cli.main(words) == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found['stiffness_95']
    assert low < found['stiffness_68'][0] < found['stiffness'] < found['stiffness_68'][1] < high
    assert len(found['rests']) == len(twin.weights_kg)


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        (['--weights', '300,600'], 1, 'block 14 came to rest 6 times for 2 weights and none'),
        ([], 2, 'say --weights'),
        (['--weights', '300,many'], 2, 'not weights in grams'),
        (['--weights', '300,-5'], 2, '-5 g is not'),
        (['--weights', '300', '--block', '7'], 1, 'block 7 stands inside'),
        (['--weights', '300', '--block', '25'], 2, '--block: 25 is outside 0 to 24'),
        (['--weights', '300', '--natural', '6'], 2, '--natural: 6 is outside 10 to 88'),
        (['rehearsal.yaml', '--weights', '300'], 78, 'no such file'),
    ],
)
def test_refusals_are_one_line(hung, capsys, words, code, said):
    assert cli.main(['measure', 'springs', *words, '--bag', hung[2]]) == code
    err = capsys.readouterr().err.splitlines()
    assert said in err[-1] and err[-1].startswith('eol measure: ')


def test_a_pull_of_the_rim_gives_friction(pulled, mine, capsys):
    twin, bag = pulled
    mass = f'{1e3 * twin.mass.value:.1f}'
    words = ['measure', 'friction', mine, '--bag', bag, '--mass', mass]
    assert cli.main(words) == 2
    assert 'measure it before, `eol measure springs SCENE`' in capsys.readouterr().err
    value, error, _ = twin.stiffness
    known = f'{{stiffness: {value:.2f}, stiffness_error: {error:.2f}, hands'
    Path(mine).write_text(SCENE.replace('{hands', known))

    assert cli.main(words) == 0

    out = capsys.readouterr().out.splitlines()
    found = scene.load(mine).nodes['twin']
    assert out[0].startswith(f'mu_static {found.mu_static:g} +- {found.mu_static_error:g}; 95 %')
    for name in ('mu_static', 'mu_kinetic'):
        value, error = getattr(found, name), getattr(found, f'{name}_error')
        assert abs(value - getattr(twin.coupling, name)) < 3.5 * error
        assert 0 < error < 0.07 * value
    assert found.block_kg == pytest.approx(twin.mass.value, abs=1e-4)
    assert Path(mine).read_text().count('#') == SCENE.count('#')


def test_who_pulls_is_told_how_far_it_is(pulled, monkeypatch, capsys):
    twin, bag = pulled
    monkeypatch.setattr(measure, '_live', lambda args: measure._recorded(bag))
    monkeypatch.setattr(measure, '_told', lambda args: Table())
    words = ['measure', 'friction', '--stiffness', f'{twin.stiffness.value:.2f}', '--json']

    assert cli.main([*words, '--seconds', '14']) == 0

    told = capsys.readouterr()
    lines = [line for line in told.err.splitlines() if ' of 14 s: ' in line]
    assert [line.partition(' ')[0] for line in lines] == ['5', '10']  # it ends where that is enough
    assert 'slips in the middle, fewest of block' in lines[-1]
    found = json.loads(told.out)
    wanted = twin.coupling.break_m  # the scale said 250 g
    assert found['break_m'] == pytest.approx(wanted, rel=0.15)
    assert found['mu_static'] > found['mu_kinetic'] and set(found['blocks']) == {
        str(block) for block in (6, 7, 8, 11, 12, 13, 16, 17, 18)
    }


def test_weights_are_no_pull_of_the_rim(hung, mine, capsys):
    words = ['measure', 'friction', mine, '--stiffness', '70', '--bag', hung[2]]
    assert cli.main(words) == 1
    assert 'no block inside moved' in capsys.readouterr().err.splitlines()[-1]
    assert Path(mine).read_text() == SCENE


def test_a_person_is_guided_while_the_table_is_measured(hung, mine):
    """Live, faster than a camera: a weight hangs once the program has asked for it.

    A busy machine loses images of a stream, so the table stands there until that is said.
    """
    twin, images, _ = hung
    asked = [f'Weight {n} of 5: let' for n in range(1, 6)] + ['That was the last']
    weighed = np.array_split(np.arange(len(images)), len(asked))
    child = subprocess.Popen(
        [sys.executable, '-m', 'eol_ros', 'measure', 'springs', mine, '--weights', grams(twin)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ,
    )  # fmt: skip
    said = []
    listening = threading.Thread(target=lambda: said.extend(child.stderr), daemon=True)
    listening.start()

    def shown():
        """Yield images, those of each rest for as long as it takes."""
        count = 0
        for words, parts in zip(asked, weighed, strict=True):
            end = time.monotonic() + GENEROUS_S
            left = deque(parts)
            while not any(words in line for line in said):
                assert time.monotonic() < end and child.poll() is None, said
                _, places, seen = images[left.popleft() if left else parts[-1]]
                count += 1
                yield count / FPS, places, seen

    with child:
        try:
            with session() as visit:
                publisher = visit.node.create_publisher(
                    Blocks, '/eol/blocks', PUBLISHER_QOS['stream']
                )
                assert visit.run(lambda: publisher.get_subscription_count() == 1, 60)
                for _, data in messages(shown()):
                    publisher.publish(data)
                    time.sleep(0.002)
            out = child.stdout.read()
            listening.join()
        finally:
            child.kill()
    assert child.returncode == 0, said
    assert out.startswith('stiffness ')
    assert scene.load(mine).nodes['twin'].stiffness_error > 0


def test_the_table_is_that_of_bag_and_scene(hung, mine, capsys):
    words = ['measure', 'springs', mine, '--weights', '300', '--bag', hung[2]]
    for table, said in (
        ('{rows: 4}', 'scene: rows 5, not 4: name the scene'),
        ('{gap_y_m: 0.08}', 'scene: gap_y_m 0.0, not 0.08: name'),
    ):
        Path(mine).write_text(f'{SCENE}table: {table}\n')
        assert cli.main(words) == 78
        assert said in capsys.readouterr().err.splitlines()[-1]


def test_a_graph_tells_its_table():
    """It is on a topic that is latched; blocks of another number are refused in one line."""
    table = Table(rows=3, columns=4, gap_y_m=0.08, absent=(3,), platform_m=(1.5, 1.2))
    assert tables.table(tables.RECORD.fill(TableMessage(), tables.of(0, table))) == table
    one = next(iter(messages([(0.0, np.zeros((25, 3)), np.ones(25, bool))])))[1]
    codec = blocks.Codec(definition(blocks.TYPE), cells=12)
    with pytest.raises(ConfigError, match='not a .* message of 12 blocks.*Name the scene'):
        measure._read(codec, one, '/eol/blocks', table)


def test_without_a_graph_it_says_so(monkeypatch, capfd):
    monkeypatch.setattr(measure, 'SILENT_S', 0.2)
    monkeypatch.setattr(network, 'participants', lambda _domain: True)  # of others
    assert cli.main(['measure', 'springs', '--weights', '300,600']) == 69
    assert 'no message for 0.2 s: start the graph' in capfd.readouterr().err.splitlines()[-1]

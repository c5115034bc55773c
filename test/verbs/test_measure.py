# SPDX-License-Identifier: Apache-2.0
"""`eol measure` on recordings and on a running graph of twins that nobody has told."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from eol_msgs.msg import Blocks

from benchmarks.measure_twins import Hung
from eol_ros import cli, scene
from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.ros.definitions import definition, describe
from eol_ros.ros.session import session
from eol_ros.ros.topics import PUBLISHER_QOS
from eol_ros.streams import blocks
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


def grams(twin):
    return ','.join(f'{1e3 * weight:g}' for weight in twin.weights_kg)


def test_weights_on_a_recorded_table_go_into_the_scene(hung, mine, tmp_path, capsys):
    twin, _, bag = hung
    picture = tmp_path / 'fit.svg'
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

    assert cli.main([*words, '--picture', str(picture)]) == 0

    out, err = capsys.readouterr()
    found = scene.load(mine).nodes['twin']
    assert out.startswith(f'stiffness {found.stiffness:g} +- {found.stiffness_error:g} N/m; 95 %')
    assert abs(found.stiffness - twin.stiffness) < 5 * found.stiffness_error
    assert 0 < found.stiffness_error < 0.08 * twin.stiffness
    assert found.spring_natural_m == 0.0595
    assert 'written into' in err and err.count('at rest') == 1 + len(twin.weights_kg)
    text = Path(mine).read_text()
    assert text.startswith('# the table in the hall\n') and '# quiet\n' in text
    assert '<svg' in picture.read_text()


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
        (['--weights', '300,many'], 2, 'not grams'),
        (['--weights', '300,-5'], 2, '-5 g is not'),
        (['--weights', '300', '--block', '7'], 1, 'block 7 stands inside'),
        (['--weights', '300', '--block', '25'], 2, 'blocks are 0 to 24'),
        (['--weights', '300', '--natural', '6'], 2, 'a length in mm'),
        (['rehearsal.yaml', '--weights', '300'], 78, 'no such file'),
    ],
)
def test_refusals_are_one_line(hung, capsys, words, code, said):
    assert cli.main(['measure', 'springs', *words, '--bag', hung[2]]) == code
    err = capsys.readouterr().err.splitlines()
    assert said in err[-1] and err[-1].startswith('eol measure: ')


def test_a_person_is_guided_while_the_table_is_measured(hung, mine):
    """Live: the same images on the graph, as fast as they are heard."""
    twin, images, _ = hung
    child = subprocess.Popen(
        [sys.executable, '-m', 'eol_ros', 'measure', 'springs', mine, '--weights', grams(twin)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ,
    )  # fmt: skip
    try:
        with session() as visit:
            publisher = visit.node.create_publisher(Blocks, '/eol/blocks', PUBLISHER_QOS['stream'])
            assert visit.run(lambda: publisher.get_subscription_count() == 1, 60)
            for _, data in messages(images):
                publisher.publish(data)
                time.sleep(0.001)
            out, err = child.communicate(timeout=60)
    finally:
        child.kill()
    assert child.returncode == 0, err
    assert 'Weight 1 of 5: let' in err and 'That was the last' in err
    assert out.startswith('stiffness ')
    assert scene.load(mine).nodes['twin'].stiffness_error > 0


def test_without_a_graph_it_says_so(monkeypatch, capfd):
    monkeypatch.setattr(measure, 'SILENT_S', 0.2)
    assert cli.main(['measure', 'springs', '--weights', '300,600']) == 69
    assert 'no message for 0.2 s: start the graph' in capfd.readouterr().err.splitlines()[-1]

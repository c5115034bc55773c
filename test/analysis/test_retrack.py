# SPDX-License-Identifier: Apache-2.0
"""Images through the real nodes into a bag; the bag's images give the bag's results again."""

import argparse
import dataclasses
import json

import numpy as np
import pytest
from support.any_stamp import use_any_stamp
from support.bag_samples import T0, bag_of
from support.paper import rest_lattice

from eol_ros.analysis import retrack as retracking
from eol_ros.analysis.bag import open_bag
from eol_ros.analysis.retrack import DIFFERENT, Comparison, retrack
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from eol_ros.streams import calibrations

STEP_NS = 16_666_667
DARK = range(112, 132)  # images without infrared light, of which the tracker is told
LIVE = 86  # here settings of motion and grains are changed, while blocks slip
CALIBRATE = 12  # here it is asked to calibrate again, while all blocks rest


def scene_of_blocks(count=150):
    """Yield (25, 2) positions in m and (25,) yaws: at rest, then three blocks slip, then rest."""
    at = rest_lattice().astype(float)
    yaw = np.zeros(25)
    for i in range(count):
        if 80 <= i < 88:
            at[12] += [0.0015, 0.0006]
        if 84 <= i < 96:
            at[13] += [0.0012, 0.0]
            yaw[13] += 0.004
        if 90 <= i < 95:
            at[7] -= [0.0, 0.002]
        yield at.copy(), yaw.copy()


@pytest.fixture(scope='module')
def any_stamp():
    with pytest.MonkeyPatch.context() as patch:
        use_any_stamp(patch)
        yield


@pytest.fixture(scope='module')
def run(tmp_path_factory, any_stamp):
    """A bag of 150 images and all that tracker, motion and grains made of them."""
    import rclpy
    from rclpy.parameter import Parameter
    from support.spinning import Nodes

    from eol_ros.core.vision.render.renderer import Renderer
    from eol_ros.nodes.grains import GrainsNode
    from eol_ros.nodes.motion import MotionNode
    from eol_ros.nodes.recorder import RecorderNode
    from eol_ros.nodes.tracker import TrackerNode
    from eol_ros.ros.images import ImagePublisher
    from eol_ros.ros.node import EolNode
    from eol_ros.scene import Scene
    from eol_ros.settings import MontageSettings, RecorderSettings
    from eol_ros.streams.graph import NODES
    from eol_ros.streams.requests import Asked

    class Camera(EolNode):
        NAME = 'montage'

    root = tmp_path_factory.mktemp('bags')
    rclpy.init()
    names = ('tracker', 'motion', 'grains', 'recorder')
    scene = Scene('test', {n: NODES[n].settings() for n in names})
    recorder = RecorderNode(
        RecorderSettings(folder=str(root), images='all', min_free_gb=0.0), scene=scene
    )
    grains, motion, tracker = (
        kind(scene.settings(kind.NAME), scene=scene)
        for kind in (GrainsNode, MotionNode, TrackerNode)
    )
    camera = Camera(MontageSettings())
    publisher = ImagePublisher(camera, 'camera/image_raw')
    nodes = Nodes(recorder, grains, motion, tracker, camera)

    def heard(requests):
        nodes.until(lambda: recorder.recording.received['/eol/requests'] == requests)

    with nodes:
        nodes.meet()
        nodes.until(lambda: grains.corpus is not None)
        renderer = Renderer(calibration=Calibration.ideal(), seed=5)
        for i, (at, yaw) in enumerate(scene_of_blocks()):
            lit = np.full(25, 0.0 if i in DARK else 1.0)
            if i == CALIBRATE:
                camera.requests.ask(Asked('calibrate', 'tracker'))
                heard(requests=1)
            picture = renderer.render(at[:, 0], at[:, 1], yaw, i, ir=lit)
            if i == 98:  # what is asked for while running must not spoil the proof
                tracker.set_parameters([Parameter('preview_hz', value=6.0)])
                heard(requests=4)
            if i == LIVE:  # and changes how slips are found and grains are chosen
                grains.set_parameters([Parameter('radius', value=0.2)])
                slips = {'stop_mps': 0.05}
                camera.requests.ask(Asked('set', 'motion', slips))
                heard(requests=3)
            if i == DARK[0] - 3:
                until_ns = T0 + (DARK[-1] + 1) * STEP_NS
                from_ns = T0 + DARK[0] * STEP_NS
                values = {'until_ns': until_ns}
                camera.requests.ask(Asked('darkness', 'tracker', values, from_ns=from_ns))
                heard(requests=5)
            publisher.publish(T0 + i * STEP_NS, picture)
            nodes.until(lambda i=i: recorder.recording.received['/eol/blocks'] == i + 1)
        nodes.run(0.3)
    rclpy.try_shutdown()
    return open_bag(root)


@pytest.fixture(scope='module')
def result(run):
    return retrack(run)


@pytest.mark.slow
def test_pictures_give_the_recorded_results_to_the_last_bit(result):
    assert result.notes == []
    topics = {'blocks', 'slips', 'cascades', 'grain_triggers', 'felt_slips', 'felt_triggers'}
    assert set(result.topics) == topics
    for check in result.topics.values():
        assert check.equal, check
    assert result.topics['blocks'].recorded == 150
    assert result.topics['slips'].recorded >= 6
    assert result.topics['cascades'].recorded >= 1
    assert result.topics['grain_triggers'].recorded >= 1
    assert result.equal


@pytest.mark.slow
def test_a_bag_of_another_namespace_is_proved_and_reported_as_well(run, result, tmp_path):
    from eol_ros.analysis.report import numbers
    from eol_ros.devices.bag.writer import BagWriter

    moved = {t.name: t.name.replace('/eol/', '/museum/north/') for t in run.topics.values()}
    topics = [dataclasses.replace(t, name=moved[t.name]) for t in run.topics.values()]
    writer = BagWriter(tmp_path / 'run', topics, dict(run.about))
    for m in run.messages():
        writer.write(moved[m.topic], m.data, m.log_ns, m.publish_ns, m.sequence)
    writer.close()
    bag = open_bag(tmp_path / 'run')
    assert bag.namespace == 'museum/north' and run.namespace == 'eol'
    assert bag.table('slips').topic == '/museum/north/slips'

    theirs = retrack(bag)
    assert theirs.equal and theirs.notes == []
    assert {t: c.recomputed for t, c in theirs.topics.items()} == {
        t: c.recomputed for t, c in result.topics.items()
    }
    found, same = numbers(bag), numbers(run)
    named = {moved[name]: count for name, count in same['messages'].items()}
    assert found == same | {'bag': str(bag.path), 'messages': named, 'gaps': {}}


@pytest.mark.slow
def test_the_calibration_is_that_in_the_bag(run, monkeypatch):
    from eol_ros.devices.files import tracker_files

    rows = run.table('calibration')
    found = [calibrations.to_core(row, Table()) for row in calibrations.RECORD.each(rows)]
    ideal = Calibration.ideal()
    assert len(found) == 2  # it was asked to calibrate
    assert found[0].digest == ideal.digest != found[1].digest
    assert rows['digest'].tolist() == [c.digest for c in found]

    wider = ideal.homography @ np.diag([1.01, 1.01, 1.0])  # a hundredth more px for each metre
    other = dataclasses.replace(ideal, homography=wider)
    monkeypatch.setattr(tracker_files, 'calibration_of', lambda settings, table: other)
    assert retrack(run).equal  # the file has changed since
    monkeypatch.setattr(run, 'count', lambda topic: 0 if topic == 'calibration' else 150)
    assert not retrack(run).topics['blocks'].equal  # of a bag of before it is the file's


@pytest.mark.slow
def test_the_proof_needs_what_was_asked_for(run, result, monkeypatch):
    rows = run.table('request_results')
    assert rows['accepted'].all()
    assert sorted(rows['kind']) == ['calibrate', 'darkness', 'set', 'set', 'set']
    assert set(rows['node'][rows['kind'] == 'set']) == {'tracker', 'motion', 'grains'}
    states = run.table('blocks')['state']
    assert (states[DARK[0] : DARK[-1] + 1] == 2).all()  # LOST
    assert (states == 3).any()  # CALIBRATING: metres are new
    assert set(states) == {1, 2, 3}
    heeded = retracking.heeded(run)
    spoilt = {
        ('tracker', 'calibrate'): 'blocks',
        ('tracker', 'darkness'): 'blocks',
        ('motion', 'set'): 'slips',
        ('grains', 'set'): 'grain_triggers',
    }
    for left_out, topic in spoilt.items():
        some = [h for h in heeded if (h.asked.node, h.asked.kind) != left_out]
        monkeypatch.setattr(retracking, 'heeded', lambda bag, some=some: some)
        if topic != 'blocks':
            keep_blocks(result, monkeypatch)
        assert not retrack(run).topics[topic].equal, left_out


def keep_blocks(result, monkeypatch):
    """Reuse the comparison of blocks of `result`, which the test does not change."""
    blocks = result.topics['blocks']
    monkeypatch.setattr(
        retracking, '_compare_blocks', lambda *given: given[3].topics.update(blocks=blocks)
    )


def lose(run, monkeypatch, topic, rows, counted):
    """Let `run` lack messages of a topic, and its recorder have counted so many."""
    table, counts = run.table, json.dumps({run.name(topic): counted})
    monkeypatch.setattr(
        run, 'table',
        lambda name, *span: np.delete(table(name, *span), rows if name == topic else [], 0),
    )  # fmt: skip
    monkeypatch.setattr(type(run), 'gaps', {'lost_before_recorder': counts})
    return retrack(run)


@pytest.mark.slow
@pytest.mark.parametrize('topic', ['slips', 'cascades', 'grain_triggers'])
def test_results_that_were_lost_are_named_and_the_others_compared(run, result, monkeypatch, topic):
    keep_blocks(result, monkeypatch)
    there = result.topics[topic].proved
    lost = 0 if topic != 'grain_triggers' else (run.table(topic)['block'] < 25).argmax()
    result = lose(run, monkeypatch, topic, [lost], 1)
    check = result.topics[topic]
    assert (check.recomputed, check.proved, check.different) == (there - 1, there - 1, 0)
    assert result.holes == [f'not in the bag: 1 of {topic}, by the count of the recorder']
    assert result.verdict == 'part'


@pytest.mark.slow
def test_a_request_that_the_recorder_missed_is_named(run, result, monkeypatch):
    keep_blocks(result, monkeypatch)
    result = lose(run, monkeypatch, 'requests', [], 1)
    assert 'not in the bag: 1 of requests, whose answers it has' in result.notes
    assert result.holes == []


@pytest.mark.slow
def test_more_that_lack_than_were_lost_differ(run, result, monkeypatch):
    keep_blocks(result, monkeypatch)
    assert lose(run, monkeypatch, 'slips', [0, 2], 1).verdict == 'different'


@pytest.mark.slow
def test_a_difference_behind_lost_taps_is_no_proof(run, result, monkeypatch):
    keep_blocks(result, monkeypatch)
    found = lose(run, monkeypatch, 'block_taps', [], 3)
    assert found.topics['slips'].equal and found.verdict == 'part'
    monkeypatch.undo()
    keep_blocks(result, monkeypatch)
    table = run.table

    def later(name, *span):
        rows = table(name, *span)
        if name == 'slips':
            rows['onset'][0] += 1
        return rows

    monkeypatch.setattr(run, 'table', later)
    assert retrack(run).verdict == 'different'
    counts = json.dumps({run.name('block_taps'): 3})
    monkeypatch.setattr(type(run), 'gaps', {'dropped_in_recorder': counts})
    check = retrack(run).topics['slips']
    assert check.verdict == 'part'
    assert check.words() == 'not determined by the bag, which lacks 3 of block_taps'


@pytest.mark.slow
@pytest.mark.parametrize(
    'changes',
    [
        {'slips': ('stamp', 2, 'number 2: stamp ')},
        {
            'slips': ('x', 3, 'number 3: x '),
            'cascades': ('blocks', 0, 'number 0: blocks '),
            'grain_triggers': ('release', 0, 'number 0: release '),
            'blocks': ('yaw', 1, 'image 1: yaw'),
        },
    ],
)
def test_a_result_that_was_tampered_with_is_found(run, monkeypatch, changes):
    table = run.table

    def tampered(name, *span):
        rows = table(name, *span)
        if name in changes:
            column, number, _ = changes[name]
            cell = (rows if column in rows.dtype.names else rows['blocks'])[column][
                number : number + 1
            ]
            if cell.dtype.kind == 'f':
                cell[:] = np.nextafter(cell, np.float32(9.0))
            elif cell.dtype == object:
                cell[0] = cell[0] + 1
            else:
                cell += np.timedelta64(1, 'ns') if cell.dtype.kind == 'M' else 1
        return rows

    monkeypatch.setattr(run, 'table', tampered)
    result = retrack(run)
    assert {t for t, check in result.topics.items() if not check.equal} == changes.keys()
    for topic, (_, _, first) in changes.items():
        assert result.topics[topic].different == 1
        assert result.topics[topic].first.startswith(first)


def without(run, monkeypatch, images=(), blocks=(), slips=()):
    """Let `run` lack these images, blocks and slips, by their numbers."""
    messages, table = run.messages, run.table

    def lossy(topics=None, *span):
        lost = images if topics == ['/eol/camera/image_raw'] else ()
        for number, message in enumerate(messages(topics, *span)):
            if number not in lost:
                yield message

    def shorter(name, *span, **more):
        rows, lost = table(name, *span, **more), {'blocks': blocks, 'slips': slips}.get(name, ())
        return rows[[i not in lost for i in range(len(rows))]]

    monkeypatch.setattr(run, 'messages', lossy)
    monkeypatch.setattr(run, 'table', shorter)
    return retrack(run)


@pytest.mark.slow
def test_the_proof_ends_where_an_image_is_missing_and_each_hole_is_named(run, monkeypatch):
    result = without(run, monkeypatch, images=(60, 90, 91, 92, 149))
    check = result.topics['blocks']
    assert (check.recorded, check.proved, check.recomputed, check.different) == (150, 60, 60, 0)
    assert (check.verdict, check.words()) == ('part', '60 of 150 proved, no difference in these')
    assert (result.verdict, result.equal) == ('part', False)
    assert result.notes == [
        'blocks compared up to number 60 of 150: what the tracker saw next is not in the bag, or'
        ' not known'
    ]
    lacks = 'the tracker saw it, the bag lacks it: '
    assert result.holes == [
        f'{lacks}image 60, from {60 * STEP_NS * 1e-9:.3f} s on',
        f'{lacks}images 90 to 92 (3), from {90 * STEP_NS * 1e-9:.3f} s on',
        f'{lacks}image 149, from {149 * STEP_NS * 1e-9:.3f} s on',
    ]
    assert result.images == {'seen': 150, 'lacking': 5, 'not_seen': 0}
    assert all(result.topics[t].equal for t in ('slips', 'cascades', 'grain_triggers'))


@pytest.mark.slow
def test_answers_that_are_lost_end_the_proof_of_what_came_of_them_alone(run, monkeypatch):
    """Their images are there: the tracker is proved to its end; motion knew more than is here."""
    slips = run.table('slips')
    result = without(run, monkeypatch, blocks=(86, 87))
    blocks, found = result.topics['blocks'], result.topics['slips']
    assert (blocks.recorded, blocks.recomputed, blocks.different) == (148, 148, 0)
    begun = int((slips['stamp'].astype('i8') < T0 + 86 * STEP_NS).sum())
    assert 0 < begun < len(slips)
    assert (found.recorded, found.proved, found.recomputed) == (len(slips), begun, begun)
    assert (found.verdict, result.verdict) == ('part', 'part')
    assert result.holes == [
        f'not in the bag: blocks of images 86 to 87 (2), before {88 * STEP_NS * 1e-9:.3f} s'
    ]
    assert result.images == {'seen': 150, 'lacking': 0, 'not_seen': 0}


@pytest.mark.slow
def test_neither_image_nor_answer(run, monkeypatch):
    result = without(run, monkeypatch, images=(40,), blocks=(39, 40))
    assert result.images == {'seen': 150, 'lacking': 1, 'not_seen': 0}
    assert result.topics['blocks'].proved == 39 and result.verdict == 'part'
    assert result.holes[0] == (
        'the tracker saw it, the bag lacks it: 1 between images 38 and 41, before '
        f'{41 * STEP_NS * 1e-9:.3f} s'
    )


@pytest.mark.slow
def test_counts_that_differ_are_never_equal(run, monkeypatch):
    last = len(run.table('slips')) - 1
    result = without(run, monkeypatch, slips=(last,))
    check = result.topics['slips']
    assert check.different == 0 and check.recomputed == check.recorded + 1
    assert check.words() == f'counts differ: {last + 1} came of what gave {last}'
    assert (check.verdict, result.verdict, result.words()) == (
        'different',
        'different',
        'NOT equal',
    )


@pytest.mark.parametrize(
    ('column', 'by', 'rounding'),
    [
        ('x', 1 + 1e-13, True),
        ('near', 1 + 1e-3, True),
        ('x', 1 + 1e-3, False),
        ('x', np.nan, False),
        ('count', 2, False),
    ],
)
def test_last_digits_are_told_from_other_differences(column, by, rounding):
    """Another processor changes last digits; another code counts, or values."""
    columns = [('x', 'f8'), ('near', 'f8'), ('count', 'i4')]  # near: 1e-10 beside a value of 1
    theirs = np.array([(0.0, 1.0, 1), (-0.3, 1e-10, 2)], columns)
    mine = theirs.copy()
    mine[column][1] *= by
    check = Comparison('slips', 2, 2, proved=2)
    check.compare(mine, theirs, str)
    assert (check.different, check.verdict, check.rounding) == (1, DIFFERENT, rounding)
    assert ('by at most 1e-13 of the largest value' in check.words()) is rounding
    assert not dataclasses.replace(check, proved=3).rounding


@pytest.mark.slow
def test_a_tracker_that_was_started_again_ends_the_proof(run, monkeypatch):
    table = run.table

    def twice(name, *span):
        rows = table(name, *span)
        if name == 'blocks':
            rows['image'][100:] -= 100
        return rows

    monkeypatch.setattr(run, 'table', twice)
    result = retrack(run)
    assert result.topics['blocks'].proved == 100 and result.verdict == 'part'
    at_s = 100 * STEP_NS * 1e-9
    assert result.holes == [f'the tracker was started again at {at_s:.3f} s, after image 99']
    assert result.images['lacking'] == 0


@pytest.mark.slow
def test_the_report_says_what_was_proved(run, monkeypatch, tmp_path, capsys):
    from eol_ros.verbs import report

    parser = argparse.ArgumentParser()
    report.add_arguments(parser)
    args = parser.parse_args([str(run.path), '--output', str(tmp_path), '--retrack'])
    monkeypatch.setattr('eol_ros.analysis.bag.open_bag', lambda path: run)
    assert report.run(args) == 0
    assert 'recomputed from the recorded input: equal to the last bit' in capsys.readouterr().out
    monkeypatch.setattr('eol_ros.analysis.retrack.retrack', lambda bag, track: result)
    result = without(run, monkeypatch, images=(60,))
    assert report.run(args) == 1
    words = capsys.readouterr().out
    assert 'blocks: 150 recorded, 60 recomputed, 60 of 150 proved, no difference' in words
    assert 'the tracker saw 150 images, of which the bag lacks 1' in words
    assert words.endswith(': no difference in the part that can be proved\n')
    page = (tmp_path / 'report.html').read_text()
    assert 'recorded input: no difference in the part that can be proved</h2>' in page
    assert 'the bag lacks it: image 60' in page and 'equal to the last bit</h2>' not in page
    assert 'recorded with' not in words

    result = without(run, monkeypatch, slips=(3,))  # counts differ
    monkeypatch.setitem(run.about, 'versions', 'eol_ros: 0.1.0')
    assert report.run(args) == 1
    words = capsys.readouterr().out
    assert 'recorded with eol_ros 0.1.0, commit ?' in words and ': NOT equal\n' in words


def test_a_bag_without_blocks_is_said(tmp_path):
    from eol_ros.devices.bag.mcap_file import BagTopic
    from eol_ros.devices.bag.writer import BagWriter

    BagWriter(tmp_path / 'run', [BagTopic('/eol/blocks', 'x/msg/X', 'uint8 a\n')], {}).close()
    with pytest.raises(ConfigError, match='no blocks in it'):
        retrack(open_bag(tmp_path))


def test_taps_that_a_busy_recorder_got_late_count_from_their_stamps(tmp_path):
    from eol_msgs.msg import Block, Blocks, BlockTap, Cascade, FeltSlip, Slip

    from eol_ros.core.motion.felt import Knock
    from eol_ros.core.motion.motion import Motion
    from eol_ros.ros.stamps import to_msg
    from eol_ros.settings import MotionSettings
    from eol_ros.streams import cascades, felt, slips

    random, motion = np.random.default_rng(0), Motion(MotionSettings())
    knock_ns, told, tapped = T0 + 2 * 10**9 + 400_000, [], 0
    sigma_s = float(np.float32(2e-4))
    end_ns = T0 + 239 * STEP_NS
    knocks = [  # the second moves nothing; of the two after the last image one reached the bag
        Knock(knock_ns, 7, sigma_s, 3.0),
        Knock(knock_ns + 10**9, 3, sigma_s, 3.0),
        Knock(end_ns + 1000, 8, sigma_s, 1.0),
        Knock(end_ns + 2000, 9, sigma_s, 1.0),
    ]
    for knock in knocks:
        tap = BlockTap(block=knock.block, sigma=sigma_s, strength=knock.strength_mps2)
        tap.header.stamp = to_msg(knock.stamp_ns)
        # It had come in time, but not to the bag.
        told.append((knock.stamp_ns + 10**9, 'block_taps', tap))

    def tell_felt(found, image_ns=0):
        for one in found:
            row = felt.RECORD.fill(FeltSlip(), felt.of(one, image_ns))
            log_ns = T0 + int(random.integers(0, 4 * 10**9))  # as they may have arrived
            told.append((log_ns, 'felt_slips', row))

    tell_felt([one for knock in knocks[:2] for one in motion.tap(knock)])
    for k in range(240):
        stamp_ns, t = T0 + k * STEP_NS, k * STEP_NS * 1e-9
        at = rest_lattice() + random.normal(0, 1e-5, (25, 2))
        at[7, 0] += 1.25 * min(max(t - 2.0, 0), 0.1) ** 2
        message = Blocks(state=Blocks.STATE_TRACKING, image=k)
        message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'table'
        message.blocks = [
            Block(id=b, x=float(at[b, 0]), y=float(at[b, 1]), sigma=1e-5, seen=True)
            for b in range(25)
        ]
        told.append((stamp_ns + 5_000_000, 'blocks', message))
        sigma = np.full(25, np.float32(1e-5))
        found, closed = motion.update(stamp_ns * 1e-9, at[:, 0], at[:, 1], np.ones(25, bool), sigma)
        tell_felt(motion.felt_slips(), stamp_ns)
        for slip in found:
            tapped += slip.tapped
            row = slips.RECORD.fill(Slip(), slips.of(stamp_ns, slip))
            told.append((stamp_ns + 7_000_000, 'slips', row))
        for cascade in closed:
            row = cascades.RECORD.fill(Cascade(), cascades.of(stamp_ns, cascade))
            told.append((stamp_ns + 8_000_000, 'cascades', row))
    tell_felt(motion.tap(knocks[2]))
    messages = [(topic, message, (log_ns - T0) * 1e-9) for log_ns, topic, message in told]
    bag = bag_of(tmp_path / 'run', messages, settings='nodes: {motion: {}}\n')

    assert tapped == 1
    proofs = retrack(bag).topics
    slipped, cascaded = proofs['slips'], proofs['cascades']
    assert (slipped.recorded, slipped.recomputed, slipped.first) == (2, 2, '')
    assert (cascaded.recorded, cascaded.recomputed, cascaded.first) == (1, 1, '')
    felt_slips = proofs['felt_slips']
    assert (felt_slips.recorded, felt_slips.proved, felt_slips.recomputed) == (5, 5, 5)
    assert felt_slips.equal, felt_slips.words()

    table = felt.RECORD.rows([felt.of(one) for one in motion.tap(knocks[3])])
    other = retracking.Retracked()
    retracking._compare(bag, 'felt_slips', table, other, 2**63 - 1)
    assert other.topics['felt_slips'].verdict == retracking.DIFFERENT

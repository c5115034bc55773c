# SPDX-License-Identifier: Apache-2.0
"""The recorder over real DDS: what was published is what is in the bag, byte for byte."""

import importlib.metadata
import json
import time

import numpy as np
import pytest
import yaml
from eol_msgs.msg import Blocks, Corpus, GrainTrigger, Slip
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from support.spinning import Nodes

from eol_ros.devices.bag.reader import BagReader
from eol_ros.nodes.recorder import RecorderNode
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.ros.topics import CLOCK, CLOCK_QOS
from eol_ros.scene import Scene
from eol_ros.settings import MotionSettings, RecorderSettings, ReplaySettings
from eol_ros.streams.cdr import stamp_ns
from eol_ros.streams.requests import Asked


class Source(EolNode):
    """Publishes what the test wants recorded."""

    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.blocks, self.slips = self.publisher('blocks'), self.publisher('slips')
        self.triggers = self.publisher('grain_triggers')
        self.images = ImagePublisher(self, 'camera/image_raw', 'camera/camera_info')
        self.sent = {'/eol/blocks': [], '/eol/slips': [], '/eol/grain_triggers': []}

    def send(self, publisher, message):
        message.header.stamp, message.header.frame_id = to_msg(now_ns()), 'table'
        raw = bytes(serialize_message(message))  # sent as it is: padding differs from call to call
        self.sent[publisher.topic_name].append(raw)
        publisher.publish(raw)


def record(tmp_path, **settings):
    return RecorderNode(RecorderSettings(folder=str(tmp_path), min_free_gb=0.0, **settings))


@pytest.mark.slow
def test_the_bag_holds_the_bytes_that_were_published(ros, tmp_path):
    recorder, source = record(tmp_path, images='all'), Source()
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.meet()

    def taken():
        counts = recorder.recording.received
        return counts['/eol/camera/image_raw'] + sum(counts[topic] for topic in source.sent)

    images = np.random.default_rng(1).integers(0, 30, (40, 800, 1280), dtype=np.uint8)
    for i in range(40):
        source.images.publish(now_ns(), images[i])
        source.send(source.blocks, Blocks(image=i))
        source.send(source.slips, Slip(slip=i, kind=1 + i % 2))
        source.send(source.triggers, GrainTrigger(sequence=i))
        rig.until(lambda i=i: taken() >= 4 * (i + 1))  # no burst beyond the depth of the QoS
    source.requests.declare('mute', {}, 0)
    source.requests.answer(Asked('mute', id='of one who does not know the recorder'), True, '')
    rig.until(lambda: recorder.recording.received['/eol/request_results'] == 2)
    rig.until(lambda: recorder.recording.received['/eol/requests'] == 1)
    rig.close()
    bag = BagReader(tmp_path)
    for topic, sent in source.sent.items():
        assert [m.data for m in bag.messages([topic])] == sent, topic
    pictures = [m.data[-1024000:] for m in bag.messages(['/eol/camera/image_raw'])]
    assert pictures == [image.tobytes() for image in images]
    assert json.loads(bag.gaps['lost_before_recorder']) == {'/eol/requests': 1}
    assert bag.topics['/eol/blocks'].type == 'eol_msgs/msg/Blocks'


@pytest.mark.slow
def test_a_late_recorder_says_when_messages_were_sent_and_received(ros, tmp_path):
    recorder, source = record(tmp_path), Source()
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.meet()
    around = []
    for k in range(5):
        before_ns = now_ns()
        source.send(source.blocks, Blocks(image=k))
        around.append((before_ns, now_ns()))
    time.sleep(0.5)  # nothing is taken
    looked_ns = now_ns()
    rig.until(lambda: recorder.recording.received['/eol/blocks'] == 5)
    rig.close()
    found = list(BagReader(tmp_path).messages(['/eol/blocks']))
    for (before_ns, after_ns), m in zip(around, found, strict=True):
        assert before_ns <= m.publish_ns <= min(after_ns, m.log_ns) and m.log_ns < looked_ns


@pytest.mark.slow
@pytest.mark.parametrize('jump_s', [-3600, 3600])
def test_a_set_clock_ends_the_bag_with_a_mark_and_begins_another(
    ros, tmp_path, monkeypatch, jump_s
):
    recorder, source = record(tmp_path), Source()
    corpora = source.publisher('corpus')
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.meet()
    corpora.publish(Corpus(name='told once'))
    rig.until(lambda: recorder.latched)
    folders, recordings = [], []

    def taken():
        return sum(recording.received['/eol/blocks'] for recording in recordings)

    for part in range(2):
        folders.append(recorder.recording.folder)
        recordings.append(recorder.recording)
        rig.until(lambda n=6 * part: taken() == n)
        for k in range(5):
            source.send(source.blocks, Blocks(image=5 * part + k))
            rig.until(lambda n=6 * part + k + 1: taken() == n)
        if part == 0:
            monkeypatch.setattr(recorder, 'now_ns', lambda: now_ns() + jump_s * 10**9)
            source.send(source.blocks, Blocks(image=99))
            rig.until(lambda: recorder.recording.folder != folders[0])
    rig.close()
    before, after = (BagReader(folder) for folder in folders)
    assert json.loads(before.gaps['time_jump_s'])['system clock'] == pytest.approx(jump_s, abs=1)
    assert after.about['continues'] == folders[0].name and 'time_jump_s' not in after.gaps
    assert before.counts['/eol/blocks'] + after.counts['/eol/blocks'] == 11
    assert after.counts['/eol/corpus'] == 1  # what was told once is in both
    for bag in (before, after):
        logged = [m.log_ns for m in bag.messages(['/eol/blocks', '/eol/node_states'])]
        assert logged == sorted(logged) and logged[-1] - logged[0] < 60 * 10**9


def test_a_clock_that_is_set_before_the_first_message_begins_another_bag(
    ros, tmp_path, monkeypatch
):
    recorder, source, years_ns = record(tmp_path), Source(), 56 * 365 * 86400 * 10**9
    [first] = tmp_path.glob('*_*')
    monkeypatch.setattr(recorder, 'now_ns', lambda: now_ns() + years_ns)
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.until(lambda: recorder.recording.folder != first)
    rig.close()
    before, after = BagReader(first), BagReader(recorder.recording.folder)
    jump_s = json.loads(before.gaps['time_jump_s'])['system clock']
    assert jump_s == pytest.approx(years_ns * 1e-9, abs=10)
    assert not sum(before.counts.values()) and after.about['continues'] == first.name


@pytest.mark.slow
def test_behind_a_replay_bags_are_in_its_time_and_one_a_round(ros, tmp_path):
    sim = [Parameter('use_sim_time', value=True)]
    recorder = RecorderNode(
        RecorderSettings(folder=str(tmp_path), min_free_gb=0.0), parameter_overrides=sim
    )
    source, day_ns = Source(), 1_700_000_000_000_000_000
    clock = source.create_publisher(Clock, CLOCK, CLOCK_QOS)
    corpora = source.publisher('corpus')
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.meet()
    rig.until(lambda: clock.get_subscription_count() == 2)

    def tell(recorded_ns):
        clock.publish(Clock(clock=to_msg(recorded_ns)))
        rig.until(lambda: abs(recorder.now_ns() - recorded_ns) <= 20_000_000)

    corpora.publish(Corpus(name='early'))  # before there is a time
    rig.until(lambda: recorder.latched)
    folders = []
    for _ in range(2):
        folders.append(recorder.recording.folder)
        for k in range(5):
            tell(day_ns + k * 20_000_000)
            count = recorder.recording.received['/eol/blocks']
            source.send(source.blocks, Blocks(image=k))
            rig.until(lambda n=count: recorder.recording.received['/eol/blocks'] > n)
        tell(day_ns)
        rig.until(lambda: recorder.recording.folder != folders[-1])
    rig.close()
    for folder in folders:
        bag = BagReader(folder)
        blocks = [m.log_ns - day_ns for m in bag.messages(['/eol/blocks'])]
        assert len(blocks) == 5 and blocks == sorted(set(blocks))
        assert min(blocks) >= 0 and max(blocks) < 200_000_000
        assert bag.counts['/eol/corpus'] == 1


@pytest.mark.slow
def test_without_pictures_the_recorder_does_not_even_take_them(ros, tmp_path):
    recorder, source = record(tmp_path, images='none'), Source()
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.meet()
    assert source.images.subscribers() == 0
    rig.close()
    bag = BagReader(tmp_path)
    assert '/eol/camera/image_raw' not in bag.topics
    assert '/eol/sound_samples' not in bag.topics


@pytest.mark.slow
def test_pictures_are_kept_around_a_slip(ros, tmp_path):
    recorder = record(tmp_path, images='around_slips', before_s=0.2, after_s=0.2)
    source = Source()
    rig = Nodes(recorder, source, executor=EventsExecutor)
    rig.meet()
    image, stamps, slip_ns = np.zeros((80, 100), np.uint8), [], 0
    for i in range(60):
        stamps.append(now_ns())
        source.images.publish(stamps[-1], image)
        if i == 30:
            slip_ns = stamps[-1]
            source.send(source.slips, Slip(slip=1, kind=Slip.KIND_START))
            source.send(source.slips, Slip(slip=1, kind=Slip.KIND_STOP))
        rig.run(0.025)
    rig.close()
    bag = BagReader(tmp_path)
    times = [m.log_ns for m in bag.messages(['/eol/camera/image_raw'])]
    lenses = [stamp_ns(m.data) for m in bag.messages(['/eol/camera/camera_info'])]
    kept = [stamp_ns(m.data) for m in bag.messages(['/eol/camera/image_raw'])]
    assert len(set(lenses) ^ set(kept)) <= 2  # received one after the other: at the edges
    assert 8 <= len(times) <= 40
    assert min(times) >= slip_ns - 0.21e9
    assert max(times) <= slip_ns + 0.6e9


def test_the_recording_of_a_replay_says_of_which_bag(ros, tmp_path):
    settings = RecorderSettings(folder=str(tmp_path), min_free_gb=0.0)
    scene = Scene('playback', {'replay': ReplaySettings(bag='/bags/run'), 'recorder': settings})
    recorder = RecorderNode(settings, scene=scene)
    recorder.close()
    folder = recorder.recording.folder
    recorder.destroy_node()
    about = BagReader(folder).about
    assert about['replay_of'] == '/bags/run'
    versions = yaml.safe_load(about['versions'])
    assert versions['mcap'] and versions['ros-fastrtps']
    assert versions['rclpy'] == importlib.metadata.version('ros-rclpy')

# SPDX-License-Identifier: Apache-2.0
"""Records the topics that bags keep, as raw bytes, into an MCAP bag; a thread of its own writes."""

import math
import time
from collections import deque
from pathlib import Path

from eol_ros.devices.bag.mcap_file import BagMessage, BagTopic
from eol_ros.devices.bag.recording import Recording, Roles
from eol_ros.devices.bag.selection import LogTimes, Slipping
from eol_ros.devices.bag.writer import CONTINUES, REPLAY_OF
from eol_ros.ros.definitions import describe
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import REQUESTS, RESULTS
from eol_ros.ros.run_record import about
from eol_ros.ros.startup_barrier import READY
from eol_ros.ros.topics import CLOCK
from eol_ros.said import said
from eol_ros.streams.graph import TOPICS, counted
from eol_ros.streams.slips import START

IMAGES, INFO, SAMPLES = 'camera/image_raw', 'camera/camera_info', 'sound_samples'
PREVIEW, MARKERS, POSES = 'camera/image_raw/compressed', 'markers', 'block_poses'
FRAMES = '/tf_static'
RHYTHM = (IMAGES, 'blocks', 'truth')  # topics with a message for every image
DISK_HUNG_S = 60.0  # a thread may wait up to this for a slow disk
EARLY = 1000  # messages kept until a replay tells its time
DROPS_TOLD_S = 20.0  # after the last; the count stays in the values and in the bag


class RecorderNode(EolNode):
    NAME = 'recorder'
    MAPS_TIME = True

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        topics = [t for t in TOPICS if self._wanted(t)]
        self.described = {t: BagTopic(self.resolve_topic_name(t), **describe(t)) for t in topics}
        self.stamped(self.now_ns())  # the clock may be set before a first message comes
        self.recording = self.begin()
        self.latched: dict[str, BagMessage] = {}  # persists over the rounds of a replay
        self._times = LogTimes()
        self._early: deque[BagMessage] = deque(maxlen=EARLY)  # before a log time was known
        self._slips = self.intake('slips')
        self._ids = {t: self.intake(t) for t in (REQUESTS, RESULTS)}
        for topic, bag_topic in self.described.items():
            callback = self._callback(topic, bag_topic)
            self.subscribe(topic, callback, raw=True, with_info=True)
        self.health.watches('bag-writer', lambda: self.recording.rounds(), hung_s=DISK_HUNG_S)
        self.health.watches(
            'bag-housekeeper', lambda: self.recording.housekeeping(), DISK_HUNG_S, math.inf
        )
        self._last = self._dropped = 0
        self._dropped_s = 0.0
        self.create_timer(1.0, self.tell)
        self.tell()

    def begin(self, continues: str = '') -> Recording:
        """Return the recording of a run, of one round of a replay, or of what `continues` a bag."""
        described, replay = self.described, self.scene.nodes.get('replay')
        origin = {REPLAY_OF: replay.bag} if replay else {}
        if continues:
            origin[CONTINUES] = continues
        return Recording(
            Path(self.settings.folder).expanduser(),
            self.scene.name,
            list(described.values()),
            about(self.scene) | origin,
            self.settings,
            Roles(
                images=self.resolve_topic_name(IMAGES),
                infos=self.resolve_topic_name(INFO),
                requests=self.resolve_topic_name(REQUESTS),
                rhythm=[described[t].name for t in RHYTHM if t in described],
                thinned=[described[t].name for t in (PREVIEW, 'sound_meter') if t in described],
                rate_hz=self.scene.image_rate,
            ),
        )

    def restart(self) -> None:
        """What is replayed has begun again: so does the bag, for a bag is one run."""
        self._begin_again()

    def time_jumped(self, jump_ns: int) -> None:
        """In one bag time only goes on: end it with a mark, and begin another that names it."""
        ended = self.recording
        ended.time_jump_s = round(jump_ns * 1e-9, 3)
        self._begin_again(ended.folder.name if ended.folder else '', jumped=True)

    def _begin_again(self, continues: str = '', jumped: bool = False) -> None:
        before = self.recording
        before.close()
        self.recording, self._last, self._dropped = self.begin(continues), 0, 0
        self.recording.go_on(before)
        self._times = LogTimes(self.now_ns() if jumped else 0)
        now_ns = time.time_ns()
        for item in self.latched.values():
            self._keep(item, now_ns, now_ns)

    def _wanted(self, topic: str) -> bool:
        """Return whether to record a topic; those made on demand only where a setting requests it.

        Frames derive from `calibration`, and `/diagnostics` from `node_states`. Both topics also
        carry messages of other graphs.
        """
        if topic in (SAMPLES, MARKERS, POSES, FRAMES, READY, CLOCK, '/diagnostics'):
            return False
        images = self.settings.images
        if topic in (IMAGES, INFO):
            return images in ('all', 'around_slips')
        return topic != PREVIEW or images == 'preview'

    def _callback(self, topic, bag_topic):
        name, latched, numbers = bag_topic.name, TOPICS[topic].qos == 'latched', counted(topic)

        def keep(raw: bytes, received_ns: int, sent_ns: int, sequence: int) -> None:
            item = BagMessage(name, raw, 0, 0, sequence if numbers else 0)
            if latched:
                self.latched[name] = item
            log_ns = self._keep(item, received_ns, sent_ns)
            if topic == 'slips' and (slip := self._slips(raw)):
                self.recording.slip(Slipping(slip.slip, slip.kind == START, log_ns))
            elif topic in self._ids and (message := self._ids[topic](raw)):
                self.recording.request(message.id, topic == REQUESTS)

        return keep

    def _keep(self, item: BagMessage, received_ns: int, sent_ns: int) -> int:
        """Hand `item` over; return when it was received. Bags of a replay are in its time.

        `received_ns` and `sent_ns` are DDS's, for this node may be late without anybody's harm.
        """
        now_ns = self.now_ns()
        if not now_ns:
            self._early.append(item)
            return 0
        self.stamped(now_ns)
        log_ns, publish_ns = self._times.take(
            item.topic, self.recorded_ns(received_ns), self.recorded_ns(sent_ns), now_ns
        )
        while self._early:
            self.recording.take(self._early.popleft()._replace(log_ns=log_ns, publish_ns=log_ns))
        self.recording.take(item._replace(log_ns=log_ns, publish_ns=publish_ns))
        return log_ns

    def tell(self) -> None:
        recording, health = self.recording, self.health
        while recording.repaired:
            self.get_logger().info(recording.repaired.pop(0))
        count = recording.message_count
        health.tick(count - self._last)
        self._last = count
        health.values.update(
            messages=count, lost=recording.lost, bag=str(recording.folder or ''),
            dropped=sum(recording.dropped.values()), queue_mb=recording.queued_mb,
            images_gb=round(recording.budget.bytes / 1e9, 3),
        )  # fmt: skip
        dropped = sum(recording.dropped.values())
        if dropped != self._dropped:
            self._dropped, self._dropped_s = dropped, time.monotonic()
        if recording.trouble:
            health.error(said('not_recording', why=recording.trouble))
        elif dropped and time.monotonic() - self._dropped_s < DROPS_TOLD_S:
            health.warn(said('dropped', cause=recording.drop_cause, count=dropped))
        elif recording.budget.spent:
            limit = f'{self.settings.images_max_gb:g}'
            health.ok(said('no_images', limit=limit))
        else:
            health.ok(said('recording', folder=recording.folder))

    def close(self) -> None:
        self.recording.close()

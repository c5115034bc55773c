# SPDX-License-Identifier: Apache-2.0
"""Shows the graph to browsers and to RViz, and takes requests from browsers."""

import functools
import time
from collections.abc import Callable

from eol_msgs.msg import NodeState, RimCommand

from eol_ros.core import terrain
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.files.day_file import DayFile
from eol_ros.devices.files.media_folder import Pictures
from eol_ros.errors import EolError
from eol_ros.nodes.panel_frames import Frames
from eol_ros.nodes.panel_markers import Markers
from eol_ros.nodes.panel_streams import Streams
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import Answers, RequestClient, expected_of, parameter_messages
from eol_ros.ros.stamps import to_msg
from eol_ros.said import Said, clauses, code_and_args, said
from eol_ros.scene import machine_node
from eol_ros.streams import calibrations, corpus, work_state
from eol_ros.streams.graph import NODES
from eol_ros.streams.requests import Asked
from eol_ros.web import notices, screens, wire
from eol_ros.web.server import WebServer

OUTLINE = 96  # parts of a grain's outline: two pixels each where it is drawn
TEST_S = 20.0  # for which walls show the test card


@functools.cache
def landscape(seed: int, rows: int, columns: int) -> bytes:
    """Return the heights of the virtual table's covers, made when a page first asks for them."""
    return (terrain.landscape(seed, rows, columns) * 65535).astype('<u2').tobytes()


class PanelNode(EolNode):
    """All topics -> web pages; streams are subscribed to only while somebody looks."""

    NAME = 'panel'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        montage = self.scene.settings('montage')
        say, pictures = self.get_logger().warning, Pictures(montage.pairs)
        self.server = WebServer(self.settings, self, say, picture=pictures.file, table=self.table)
        self.client = RequestClient(self, self.requests.publisher)
        self.rims = self.publisher('rim_command')
        self.documents = self.server.routes.documents
        name = f'{self.frame_prefix}{self.scene.name}'
        day, known, staff = (DayFile(name, what) for what in ('cascades', 'screens', 'staff'))
        routes, self.day = self.server.routes, notices.Day(day.load(), self.table)
        if self.day.other:
            self.get_logger().warning(f'{day.path}: cascades of another table, left out')
        routes.screens = screens.kept(known.load())
        routes.pin.remember(staff.load())
        self.files = {
            day: self.day.kept,
            known: lambda: routes.screens,
            staff: lambda: routes.pin.known,
        }
        self.known = {*NODES, *map(machine_node, self.scene.machines)}
        self.roster = notices.Roster(self.scene.nodes, time.monotonic())
        self.grains = None
        self.work, self.work_states = said('starting'), self.publisher('work_state')
        self.test_until_s = 0.0
        self.streams, self.markers = Streams(self, self.server.hub), Markers(self)
        self.frames = Frames(self)
        self.subscribe(
            'wall', lambda m: self.tell('wall', notices.wall(m, montage.fade_s, pictures.look))
        )
        self.subscribe('corpus', self.on_corpus)
        self.subscribe('cascades', self.on_cascade)
        self.requests.serve(test=self.on_test)
        self.requests.on_results(self.client.heard)
        self.subscribe(
            'calibration',
            self.on_calibration,
            read=lambda message: calibrations.to_core(message, self.table),
        )
        self.subscribe('node_states', self.on_state)
        size = self.table.rows, self.table.columns
        self.documents['terrain'] = lambda: landscape(self.settings.terrain_seed, *size)
        self.documents['status'] = lambda: wire.text(self.roster.states(time.monotonic())).encode()
        self.server.routes.grain = self.grain
        self.server.start()
        self.health.watches('web', self.server.rounds)
        self.tell('limits', notices.limits(self.scene.network))
        self.tell('cascades', self.day.notice())
        self.create_timer(1.0, self.report)
        self.publish_work(self.work)
        self.report()

    def tell(self, name: str, notice: dict) -> None:
        self.health.tick()
        self.server.hub.put('notices', notice, sticky=name)

    def ask(self, asked: Asked, done: Callable[[Answers], None]) -> Answers:
        """Send a request of the web server, in its thread, like `give_up` and `rim`."""
        expected = expected_of(asked.kind, asked.node, self.runs)
        return self.client.ask(asked, expected, done)

    def give_up(self, answers: Answers) -> None:
        self.client.give_up(answers)

    def rim(self, source: str, velocity: tuple[float, float, float], hold_s: float) -> None:
        vx, vy, yaw_rate = velocity
        message = RimCommand(source=source, vx=vx, vy=vy, yaw_rate=yaw_rate, hold=hold_s)
        message.header.stamp = to_msg(self.now_ns())
        self.rims.publish(message)

    def runs(self, node: str) -> bool:
        return node == self.NAME or self.roster.runs(node, time.monotonic())

    def on_state(self, state: NodeState) -> None:
        if state.node in self.known:
            notice = self.roster.take(state, time.monotonic(), time.time())
            self.tell(f'health {state.node}', notice)
            self.tell_work()

    def on_corpus(self, message) -> None:
        self.documents['corpus'] = wire.text(corpus.to_json(message)).encode()
        self.grains = message
        self.tell('corpus', {'t': 'corpus', 'digest': message.digest})

    def grain(self, number: int) -> dict | None:
        """Return the outline of a grain's sound; None if there is none. Reads a file."""
        grains = self.grains
        if grains is None or number >= len(grains.file):
            return None
        from eol_ros.devices.audio import audio_file

        path = grains.files[grains.file[number]]
        stretch = float(grains.start[number]), float(grains.duration[number])
        try:
            found = audio_file.outline(path, *stretch, OUTLINE)
        except EolError:  # gone, or on another machine
            return {'peaks': []}
        return {'peaks': found.round(3).tolist()}

    def on_calibration(self, found: Calibration) -> None:
        size = {'width': found.image_width, 'height': found.image_height}
        self.tell('camera', {'t': 'camera', **size})
        self.frames.publish(found)

    def on_cascade(self, message) -> None:
        self.day.add(message, time.time())
        self.tell('cascades', self.day.notice())

    def on_test(self, _asked: Asked) -> None:
        self.test_until_s = time.monotonic() + TEST_S
        self.health.values['testing'] = True
        self.health.report()

    def tell_work(self) -> None:
        if (state := self.roster.work(time.monotonic())) != self.work:
            self.publish_work(state)

    def publish_work(self, state: Said) -> None:
        self.work = state
        self.tell('work', notices.work(state))
        code, args = code_and_args(state)
        message = NodeState(text=state, code=code, args=parameter_messages(args))
        message.header.stamp = to_msg(self.now_ns())
        message.level = work_state.LEVELS.get(code, work_state.OK)
        self.work_states.publish(message)

    def report(self) -> None:
        self.streams.follow()
        self.markers.follow()
        viewers = len(self.server.hub.viewers)
        skew_ms = round(self.server.routes.skew_ms, 1)
        self.health.values.update(
            viewers=viewers, wall_skew_ms=skew_ms, testing=time.monotonic() < self.test_until_s
        )
        self.tell_work()
        turned = self.day.turn(time.time())
        fitted = bool(viewers) and self.day.fit()  # some milliseconds: not for each cascade
        if fitted or turned:
            self.tell('cascades', self.day.notice())
        self.save(time.monotonic())
        trouble = next((file.trouble for file in self.files if file.trouble), '')
        here = said('panel', address=self.server.address, viewers=viewers)
        self.health.ok(clauses([here, trouble]))  # the panel works; a restart loses some

    def close(self) -> None:
        self.publish_work(said('stopped'))
        self.server.stop()
        self.save(float('inf'))

    def save(self, now_s: float) -> None:
        for file, kept in self.files.items():
            file.save(kept(), now_s)

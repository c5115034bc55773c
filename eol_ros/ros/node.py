# SPDX-License-Identifier: Apache-2.0
"""What every node of the graph is: settings as parameters, topics from the table, health."""

import dataclasses
import json
import os
import time
from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from eol_ros.core.played_clock import PlayedClock
from eol_ros.core.stamp_watch import StampWatch
from eol_ros.core.table import Table
from eol_ros.errors import ConfigError
from eol_ros.ros.health import Health
from eol_ros.ros.health_pipe import KEPT
from eol_ros.ros.intake import Intake, InTurn
from eol_ros.ros.main_clock import MainClock
from eol_ros.ros.parameters import checked, checked_live, no_setting
from eol_ros.ros.qos import OVERRIDES, NodeQoS
from eol_ros.ros.requests import REQUESTS, RequestServer, parameters
from eol_ros.ros.stamps import NS, to_ns
from eol_ros.ros.startup_barrier import LOOK_S, READY, PeerDiscovery
from eol_ros.ros.topics import (
    CLOCK,
    CLOCK_QOS,
    QOS,
    informed,
    type_name,
)
from eol_ros.said import clauses, said
from eol_ros.scene import Scene, check_namespace
from eol_ros.settings import by_today, live_fields, masked, renamed
from eol_ros.streams.checks import ANY_TIME, PLAYED_SPAN_NS, SPAN_NS
from eol_ros.streams.graph import IMAGE_SOURCES, NODES, TOPICS, frame_prefix
from eol_ros.streams.requests import SET, Asked, server_of

SIM_TIME = 'use_sim_time'
AHEAD_NS = 100_000_000  # a stamp so far ahead of /clock was played before time jumped back


class EolNode(Node):
    """A node with `settings` (frozen dataclass), `scene`, `health` and the topic table.

    `namespace` is that of its scene, or of the remapping rule `__ns`; names of its frames begin
    with `frame_prefix`.

    A subclass sets NAME, wires topics in `__init__`, and may override `on_settings`, `restart`,
    `time_jumped` and `close`. With the parameter `use_sim_time`, ROS time is what a replay tells on
    /clock; a node that must know when its moments are played says MAPS_TIME. Timers run on the
    steady clock in either case: a replay that stands still must not silence a node.
    """

    NAME = ''
    MAPS_TIME = False
    REST_S = 0.0  # within a burst of messages: others gather, and the process wakes up less often
    READS_ONLY = False  # of its messages: they may come as named tuples, which are read faster
    HOLDS = True  # a request that counts from a later stamp waits until `stamped` has told of it

    def __init__(self, settings: Any, scene: Scene | None = None, **kwargs: Any):
        self.scene = scene if scene is not None else Scene.alone(self.NAME)
        self.table = Table.of(self.scene.table)
        try:
            super().__init__(self.NAME, namespace=self.scene.namespace, **kwargs)
        except InvalidParameterTypeException as error:  # use_sim_time is declared there
            raise ConfigError(str(error)) from None
        self.namespace = check_namespace(self.get_namespace())
        self.frame_prefix = frame_prefix(self.namespace)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.resumed = _kept(self.NAME)  # of the process before, if it was restarted
        overrides = {name: p.value for name, p in self._parameter_overrides.items()}
        self.qos = NodeQoS(self, overrides)
        self.settings = self._declare(settings, overrides)
        self.sim_time = bool(self.get_parameter(SIM_TIME).value)
        if self.sim_time and self.NAME in IMAGE_SOURCES:
            raise ConfigError(
                f'{SIM_TIME}: {self.NAME} stamps its images itself; set it for the others'
            )
        self.played: PlayedClock | None = None
        self.main_clock: MainClock | None = None  # of a node that schedules by stamps
        self._round: tuple[int, int] | None = None  # what a replay has played, from when to when
        if self.sim_time:
            self._follow_clock()
        self.health = Health(self)
        self.health.kept = dict(self.resumed)
        if self.NAME in IMAGE_SOURCES:
            self.publisher(READY)  # `ros2 doctor` warns of subscribers without a publisher
        self._stamps, self.time_jumps = StampWatch(), 0
        self._requests: RequestServer | None = None
        self.live_from_ns = 0  # the stamp from which the settings that change now count
        self._checked: dict[str, Any] | None = None  # settings being changed, already validated
        self._recorded: dict[str, Any] = {}  # what a replay changed, as it was before
        self._turns: list[InTurn] = []
        self._state_listeners: list[Callable[[Any], None]] = []
        if self.NAME in NODES and REQUESTS in NODES[self.NAME].subscribes:
            self._requests = RequestServer(self, self.HOLDS)
            if live_fields(type(self.settings)):
                self._requests.serve(**{SET: self._on_set})
                if self.resumed.get('settings'):  # for the bag: from now on
                    self._requests.declare(SET, self.resumed['settings'], time.time_ns())
        there = {*self.scene.nodes, *self.scene.elsewhere}
        if self._requests is not None and server_of(there) == self.NAME:
            from eol_ros.ros.services import RequestServices  # std_srvs, for this node alone

            self._requests.services = RequestServices(self, self._requests)
        self._discovery = PeerDiscovery(self)
        self._looks = self.create_timer(LOOK_S, self._look)

    def _look(self) -> None:
        """Tell the others, by reading `ready`, once those whom this node needs have been met."""
        if self._discovery.complete():
            self._looks.cancel()
            self.subscribe(READY, lambda message: None)
            for name in self.qos.unused():
                self.get_logger().warning(f'parameter {name}: {self.NAME} has no such topic now')

    def pull_in_timers(self) -> None:
        """Reset each timer whose next call is more than a period away; `run` calls this regularly.

        rclpy's EventsExecutor checks all timers whenever one is added or reset, and after each
        call. On a busy machine several checks are queued. Each queues a call of every due timer,
        and each of these calls delays the timer's next call by a period. After six heartbeats
        together the next would come six seconds later, when bringup has given the node up. This
        happened to nodes with six timers whose start was delayed.
        """
        for timer in self.timers:
            if not timer.is_canceled() and timer.time_until_next_call() > timer.timer_period_ns:
                timer.reset()

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any],
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Create a timer, of the steady clock where none is named."""
        clock = clock or self._steady
        return super().create_timer(timer_period_sec, callback, callback_group, clock, autostart)

    @staticmethod
    def resume(timer: Timer, wait_s: float | None = None) -> None:
        """Restart a cancelled timer, with `wait_s` as its period if given.

        A running timer is left alone: each reset calls every due timer once more (see
        `pull_in_timers`).
        """
        if timer.is_canceled():
            if wait_s is not None:
                timer.timer_period_ns = round(wait_s * NS)
            timer.reset()

    def now_ns(self) -> int:
        """Return ROS time in nanoseconds: system time, or what a replay tells on /clock."""
        if self.played is not None:
            return self.recorded_ns(time.time_ns())
        return self.get_clock().now().nanoseconds

    def wall_ns(self, stamp_ns: int) -> int:
        """Return the system time of a moment of ROS time, in nanoseconds.

        Behind a replay that is when the moment was played; now, where that cannot be known. On
        another machine than that of the stamps its offset is in it. Only for nodes that say
        MAPS_TIME.
        """
        if self.played is None:
            return stamp_ns + (self.main_clock.ahead_ns if self.main_clock else 0)
        now_ns, found = time.time_ns(), self.played.wall_ns(stamp_ns)
        return now_ns if found is None or found > now_ns + AHEAD_NS else found

    def stretch(self) -> float:
        """Return how many times longer than in the run all takes, behind a slower replay."""
        return 1.0 if self.played is None else self.played.stretch

    def recorded_ns(self, wall_ns: int) -> int:
        """Return the ROS time at a system time of now, in ns; 0 before a replay has told any."""
        return wall_ns if self.played is None else self.played.recorded_ns(wall_ns) or 0

    def stamps_span(self) -> tuple[int, int]:
        """Return when stamps may lie, ns: around now, or around all that a replay has played."""
        if not self.sim_time:
            now_ns = time.time_ns()
            return now_ns - SPAN_NS, now_ns + SPAN_NS
        now_ns = self.now_ns()
        if not now_ns:
            return ANY_TIME
        first_ns, last_ns = self._round or (now_ns, now_ns)
        self._round = min(first_ns, now_ns), max(last_ns, now_ns)
        return self._round[0] - PLAYED_SPAN_NS, self._round[1] + PLAYED_SPAN_NS

    def _follow_clock(self) -> None:
        back = JumpThreshold(
            min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False
        )
        self._jumps = self.get_clock().create_jump_callback(back, post_callback=self._went_back)
        if self.MAPS_TIME:
            self.played = PlayedClock()
            self.create_subscription(ClockMessage, CLOCK, self._on_clock, CLOCK_QOS)

    def _on_clock(self, message: ClockMessage) -> None:
        assert self.played is not None
        self.played.take(to_ns(message.clock), time.time_ns())

    def _went_back(self, _jump: TimeJump) -> None:
        if self.executor is not None:
            self.executor.create_task(self._begin_again)
        else:
            self._begin_again()

    def _begin_again(self) -> None:
        self.catch_up()
        if self._requests is not None:
            self._requests.forget()
        if self._recorded:  # the new round asks for it again when its time comes
            self.change_settings(self._recorded)
            self._recorded = {}
        self.restart()

    def stamped(self, stamp_ns: int) -> None:
        """Take note of a stamp of the stream that this node lives by, before it is used.

        Requests that count from it are done. Where the system clock was set the node starts again;
        behind a replay /clock tells.
        """
        jump_ns = 0 if self.sim_time else self._stamps.take(stamp_ns, time.monotonic_ns())
        if self._requests is not None:
            if jump_ns:
                self._requests.forget()
            self._requests.reached(stamp_ns)
        if jump_ns:
            self.time_jumps += 1
            self.health.values['time_jumps'] = self.time_jumps
            way = 'ahead' if jump_ns > 0 else 'back'
            self.get_logger().warning(
                f'time jumped {way} by {abs(jump_ns) * 1e-9:.1f} s: starting again'
            )
            self.time_jumped(jump_ns)

    def publisher(self, topic: str, depth: int | None = None) -> Publisher:
        """Return a publisher of `topic` with type and QoS of the table.

        `depth` keeps more messages to send again, or fewer, than the table says.
        """
        return self.qos.publisher(topic, depth)

    def subscribe(
        self,
        topic: str,
        callback: Callable[..., None],
        raw: bool = False,
        with_info: bool = False,
        read: Callable[[Any], Any] | None = None,
        slow: bool = False,
    ) -> Subscription:
        """Subscribe to `topic` with type and QoS of the table.

        `callback` gets what `intake` returns, or with `raw` the CDR bytes, which may be anything.
        `with_info`, for `raw`, hands over after them when DDS received and when the publisher
        sent them, in ns of the system clock, and the publisher's number of them. `slow`: messages
        can come faster than the callback handles them; see `InTurn`.
        """
        if not raw:
            callback = _checked(self.intake(topic, read), callback)
        if slow:
            turn = InTurn(self, QOS[TOPICS[topic].qos].depth, callback)
            self._turns.append(turn)
            callback = turn.take
        return self.qos.subscription(topic, informed(callback) if with_info else callback)

    def on_states(self, callback: Callable[[Any], None]) -> None:
        """Call `callback` for each message of `node_states`; there is one subscription."""
        if not self._state_listeners:
            self.subscribe('node_states', self._hear_state)
        self._state_listeners.append(callback)

    def _hear_state(self, state: Any) -> None:
        for listener in self._state_listeners:
            listener(state)

    def catch_up(self) -> None:
        """Handle all messages that wait for their turn; see `InTurn`."""
        for turn in self._turns:
            turn.finish()

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription, or what was made in its place."""
        made = self.qos.now(subscription)
        handlers: Any = made.event_handlers  # a list, though rclpy annotates one
        for events in handlers:
            events.take_data = lambda: None  # else the executor reads a destroyed event
        return super().destroy_subscription(made)

    def intake(self, topic: str, read: Callable[[Any], Any] | None = None) -> Intake:
        """Return what decodes messages of a topic of the table, checks them and calls `read`."""
        return Intake(self, topic, TOPICS[topic].type_name, read)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *args: Any, raw: bool = False, **kwargs: Any
    ) -> Subscription:
        """Subscribe as rclpy does. No message comes to a callback unchecked but as its bytes."""
        if not raw:
            callback = _checked(Intake(self, topic, type_name(msg_type)), callback)
        return super().create_subscription(msg_type, topic, callback, *args, raw=True, **kwargs)

    def _on_set(self, asked: Asked) -> Any:
        """Change live settings as asked; raises ConfigError that names what cannot be."""
        before, self.live_from_ns = self.settings, asked.from_ns
        values = self.change_settings(asked.values)
        if self.sim_time and asked.source == 'replay':
            for name in values:
                self._recorded.setdefault(name, getattr(before, name))
        return clauses(said('is_now', setting=k, value=v) for k, v in values.items())

    def change_settings(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Change live settings and return them; raises ConfigError that names invalid ones."""
        values = self._checked = checked_live(type(self.settings), self.NAME, values)
        try:
            done = self.set_parameters_atomically(parameters(values))
        finally:
            self._checked = None
        if not done.successful:
            raise ConfigError(done.reason)
        return values

    @property
    def answers_as(self) -> str:
        """The name of this node in results of requests."""
        return self.NAME

    @property
    def requests(self) -> RequestServer:
        """What people and other nodes ask of this node, and what it asks; see `streams.graph`."""
        assert self._requests is not None, f'{self.NAME} takes no requests'
        return self._requests

    def on_settings(self, new: Any) -> None:
        """Take note that live settings have changed; `self.settings` is already the new one."""

    def restart(self) -> None:
        """Forget what has been seen: time has jumped back, as when a replay begins again.

        Called by the executor, before anything of the new round comes.
        """

    def time_jumped(self, jump_ns: int) -> None:
        """Forget what rests on earlier stamps: the clock of a running graph was set by `jump_ns`.

        The run goes on: what people asked for and the count of events may stay.
        """
        self.restart()

    def close(self) -> None:
        """Release devices; called once on the way out."""

    def _declare(self, settings: Any, overrides: dict[str, Any]) -> Any:
        """Declare a ROS parameter per setting; command-line overrides are checked like a scene.

        Other overrides are warned of: those for `/**` in a parameter file reach every node.
        """
        fields = {f.name: f for f in dataclasses.fields(settings)}
        for old, new in renamed(type(settings)).items():
            if old in overrides and new not in overrides:
                self.get_logger().warning(
                    f'parameter {old} is now called {new}; the old name goes with the next version'
                )
                overrides[new] = overrides.pop(old)
        known = set(fields) | {SIM_TIME, 'start_type_description_service'}
        for name in overrides:
            if name not in known and not name.startswith(OVERRIDES):
                self.get_logger().warning(f'parameter {no_setting(self.NAME, name, fields)}')
        given = by_today(type(settings), {n: v for n, v in overrides.items() if n in fields})
        settings = dataclasses.replace(settings, **checked(type(settings), given))
        self._at_start = settings
        settings = dataclasses.replace(settings, **self._resumed_settings(type(settings)))
        descriptors = {}
        for name, field in fields.items():
            text = field.metadata.get('doc', '')
            unit = field.metadata.get('unit', '')
            descriptors[name] = ParameterDescriptor(
                description=f'{text} [{unit}]' if unit else text,
                read_only=not field.metadata.get('live'),
                dynamic_typing=True,
                **_ranges(field),
            )
        # `declare_parameters` guesses the type of a value: an empty list becomes an array of bytes
        self._declare_parameter_common(
            parameters(dataclasses.asdict(masked(settings))), descriptors
        )
        self.add_on_set_parameters_callback(self._on_parameters)
        return settings

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        fields = {f.name for f in dataclasses.fields(self.settings)}
        if any(p.name == SIM_TIME for p in parameters):
            return SetParametersResult(
                successful=False, reason=f'{SIM_TIME} is read when the node starts: start it again'
            )
        given = self._checked
        try:
            changes = given or checked(
                type(self.settings), {p.name: p.value for p in parameters if p.name in fields}
            )
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        changes = {k: v for k, v in changes.items() if v != getattr(self.settings, k)}
        if changes:
            if self._requests is not None and given is None:  # to be recorded
                self.live_from_ns = self.requests.from_ns()
                self.requests.declare(SET, changes, self.live_from_ns)
            self.settings = dataclasses.replace(self.settings, **changes)
            self._keep_settings()
            self.on_settings(self.settings)
        return SetParametersResult(successful=True)

    def _keep_settings(self) -> None:
        now, then = dataclasses.asdict(self.settings), dataclasses.asdict(self._at_start)
        changed = {name: value for name, value in now.items() if value != then[name]}
        self.keep(settings=changed)

    def _resumed_settings(self, kind: type) -> dict[str, Any]:
        """Return the live settings that this node had when the process before ended unasked."""
        found = checked(kind, self.resumed.get('settings', {}))
        if found:
            words = ', '.join(f'{name} {value}' for name, value in found.items())
            self.get_logger().info(f'as before the restart: {words}')
        return found

    def keep(self, **state: Any) -> None:
        """Let this be taken up from `resumed` when the supervisor has to start the node again."""
        self.health.kept = self.health.kept | state


def _kept(name: str) -> dict[str, Any]:
    """Return what node `name` kept in the process that bringup saw end."""
    kept: dict[str, dict[str, Any]] = json.loads(os.environ.get(KEPT, '{}'))
    return kept.get(name, {})


def _checked(intake: Intake, callback: Callable[[Any], None]) -> Callable[[bytes], None]:
    def take(raw: bytes) -> None:
        message = intake(raw)
        if message is not None:
            callback(message)

    return take


def _ranges(field: dataclasses.Field[Any]) -> dict[str, Any]:
    """Return the range of a number as a descriptor has it, for sliders in rqt."""
    low, high = field.metadata.get('min'), field.metadata.get('max')
    if low is None or high is None:
        return {}
    if field.type is float:
        limits = FloatingPointRange(from_value=float(low), to_value=float(high))  # int: garbage
        return {'floating_point_range': [limits]}
    if field.type is int:
        return {'integer_range': [IntegerRange(from_value=int(low), to_value=int(high))]}
    return {}

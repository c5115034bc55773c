# SPDX-License-Identifier: Apache-2.0
"""What every node of the graph is: settings as parameters, topics from the table, health."""

import copy
import dataclasses
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.event_handler import (
    PublisherEventCallbacks,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from eol_ros.errors import ConfigError
from eol_ros.ros.audience import LOOK_S, READY, Meeting
from eol_ros.ros.health import Health
from eol_ros.ros.topics import GIVER_QOS, QOS, TOPICS
from eol_ros.scene import Scene, check_value

NAMESPACE = 'eol'


class EolNode(Node):
    """A node with `settings` (frozen dataclass), `scene`, `health` and the topic table.

    A subclass sets NAME, wires topics in `__init__`, and may override `on_settings` and `close`.
    """

    NAME = ''

    def __init__(self, settings: Any, scene: Scene | None = None, **kwargs: Any):
        super().__init__(self.NAME, namespace=NAMESPACE, **kwargs)
        self.scene = scene if scene is not None else Scene.alone(self.NAME)
        self.settings = self._declare(settings)
        self.health = Health(self)
        self._meeting = Meeting(self)
        self._looks = self.create_timer(LOOK_S, self._look)

    def _look(self) -> None:
        """Tell the others, by reading `ready`, once those whom this node needs have been met."""
        if self._meeting.over():
            self._looks.cancel()
            self.subscribe(READY, lambda message: None)

    def publisher(self, topic: str) -> Publisher:
        """Return a publisher of `topic` with type and QoS of the table."""
        row = TOPICS[topic]
        return self.create_publisher(
            row.message_class(), topic, GIVER_QOS[row.qos],
            event_callbacks=_loud(self, topic, True),
        )

    def subscribe(
        self,
        topic: str,
        callback: Callable[[Any], None],
        raw: bool = False,
        depth: int | None = None,
    ) -> Subscription:
        """Subscribe to `topic` with type and QoS of the table; `raw` hands over the CDR bytes.

        `depth` keeps more messages, or fewer, than the table says; no writer needs to know.
        """
        row = TOPICS[topic]
        qos = copy.copy(QOS[row.qos])
        qos.depth = depth or qos.depth
        return self.create_subscription(
            row.message_class(),
            topic,
            callback,
            qos,
            raw=raw,
            event_callbacks=_loud(self, topic, False),
        )

    def on_settings(self, new: Any) -> None:
        """Take note that live settings have changed; `self.settings` is already the new one."""

    def close(self) -> None:
        """Release devices; called once on the way out."""

    def _declare(self, settings: Any) -> Any:
        """Declare a ROS parameter per setting; command-line overrides are checked like a scene."""
        fields = {f.name: f for f in dataclasses.fields(settings)}
        overrides = {k: p.value for k, p in self._parameter_overrides.items()}
        known = set(fields) | {'use_sim_time', 'start_type_description_service'}
        unknown = [n for n in overrides if n not in known and not n.startswith('qos_overrides')]
        if unknown:
            raise ConfigError(f'parameter {unknown[0]}: {self.NAME} has no such setting')
        checked = {n: check_value(fields[n], v) for n, v in overrides.items() if n in fields}
        settings = dataclasses.replace(settings, **checked)
        for name, field in fields.items():
            text = field.metadata.get('doc', '')
            unit = field.metadata.get('unit', '')
            self.declare_parameter(
                name,
                _plain(getattr(settings, name)),
                ParameterDescriptor(
                    description=f'{text} [{unit}]' if unit else text,
                    read_only=not field.metadata.get('live'),
                    dynamic_typing=True,
                ),
                ignore_override=True,
            )
        self.add_on_set_parameters_callback(self._on_parameters)
        return settings

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        fields = {f.name: f for f in dataclasses.fields(self.settings)}
        try:
            changes = {p.name: check_value(fields[p.name], p.value) for p in parameters
                       if p.name in fields}
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        if changes:
            self.settings = dataclasses.replace(self.settings, **changes)
            self.on_settings(self.settings)
        return SetParametersResult(successful=True)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _loud(node: EolNode, topic: str, publishes: bool) -> Any:
    """A QoS mismatch is silent in ROS; here it is an error that names the topic."""

    def mismatch(_event: Any) -> None:
        other = 'a reader asks for' if publishes else 'a writer offers'
        node.get_logger().error(f'{topic}: {other} another QoS than ours; no data will flow')

    try:
        if publishes:
            return PublisherEventCallbacks(incompatible_qos=mismatch, use_default_callbacks=False)
        return SubscriptionEventCallbacks(incompatible_qos=mismatch, use_default_callbacks=False)
    except UnsupportedEventTypeError:
        return None

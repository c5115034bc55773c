# SPDX-License-Identifier: Apache-2.0
"""What is on the graph, copied into a DDS domain of its own, for those who may look and not touch.

Nothing goes the other way: there is no subscription in that domain. Who has a read-only key reaches
the ports of that domain alone (`ros/wireguard.py`), so neither messages nor discovery of theirs
come to a node of the work.
"""

from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from eol_ros.errors import ConfigError
from eol_ros.ros.session import NO_LOG_FILES
from eol_ros.ros.topics import PUBLISHER_QOS, QOS, message_class
from eol_ros.ros.wireguard import READ_ONLY_DOMAIN
from eol_ros.streams.graph import TOPICS

LOOK_S = 0.5  # between two looks who reads what


class Mirror:
    """Copies each topic while somebody reads the copy, as it comes, undecoded.

    `node` is in the domain of the work. Raises ConfigError where that is the other one.
    """

    def __init__(self, node: Node):
        if node.context.get_domain_id() == READ_ONLY_DOMAIN:
            raise ConfigError(
                f'ROS_DOMAIN_ID is {READ_ONLY_DOMAIN}, which is for the copies: set another'
            )
        self._node = node
        self._context = Context()
        rclpy.init(
            args=list(NO_LOG_FILES), context=self._context, domain_id=READ_ONLY_DOMAIN,
            signal_handler_options=SignalHandlerOptions.NO,
        )  # fmt: skip
        self._copies = Node(
            'mirror', context=self._context, namespace=node.get_namespace(),
            start_parameter_services=False, enable_rosout=False,
        )  # fmt: skip
        self._publishers = {
            name: self._copies.create_publisher(
                message_class(row.type_name), name, PUBLISHER_QOS[row.qos]
            )
            for name, row in TOPICS.items()
        }
        self._subscriptions: dict[str, Any] = {}
        node.create_timer(LOOK_S, self.look)

    def look(self) -> None:
        """Subscribe to what is read, and no longer to what is not."""
        for name, publisher in self._publishers.items():
            wanted = publisher.get_subscription_count() > 0
            if wanted and name not in self._subscriptions:
                row = TOPICS[name]
                self._subscriptions[name] = self._node.create_subscription(
                    message_class(row.type_name), name, publisher.publish, QOS[row.qos],
                    raw=True,
                )  # fmt: skip
            elif not wanted and name in self._subscriptions:
                self._node.destroy_subscription(self._subscriptions.pop(name))

    @property
    def read(self) -> list[str]:
        """The topics that somebody reads."""
        return sorted(self._subscriptions)

    def close(self) -> None:
        """Leave that domain."""
        self._copies.destroy_node()
        rclpy.try_shutdown(context=self._context)

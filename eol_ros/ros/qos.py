# SPDX-License-Identifier: Apache-2.0
"""Quality of service of one node: `qos_overrides` parameters, and peers that do not match.

ROS drops every message between two ends whose policies do not match, and only logs it. Here that is
part of the node's state, which names both policies. So is a publisher that has another definition
of the type, whose messages would be read wrongly.
"""

import copy
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.publisher import Publisher
from rclpy.qos import (
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from eol_ros.errors import ConfigError, nearest
from eol_ros.ros.definitions import type_hash
from eol_ros.ros.topics import PUBLISHER_QOS, QOS, message_class, with_depth
from eol_ros.said import Said, clauses, said
from eol_ros.streams import graph

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

OVERRIDES = 'qos_overrides.'
NO_HASH = 'INVALID'  # of a peer that tells none
LOOKS = 3  # seconds without a peer that does not match, until a mismatch is over
_OVERRIDE = re.compile(r'qos_overrides\.(/.+)\.(publisher|subscription)\.(\w+)')
_POLICIES = {k.lower(): v for k, v in QoSPolicyKind.__members__.items() if k != 'INVALID'}
_RELIABILITY = QoSPolicyKind.RELIABILITY


class _End:
    """A publisher or a subscription of the node, by the topic's name in the table."""

    def __init__(self, topic: str, profile: QoSProfile, publishes: bool = False):
        self.topic, self.publishes = topic, publishes
        self.profile = copy.copy(profile)  # rclpy writes overrides into it
        self.text: Said | str = ''
        self.looks = 0  # since a peer did not match


class NodeQoS:
    """Makes the publishers and subscriptions of `node`; `text` says which peers do not match."""

    def __init__(self, node: 'EolNode', overrides: dict[str, Any]):
        self._node = node
        self._unmatched: list[_End] = []  # or perhaps so: see `look`
        self._replaced: dict[Subscription, Subscription] = {}
        self._overrides = [name for name in overrides if name.startswith(OVERRIDES)]
        self._overridden: dict[tuple[str, str], list[QoSPolicyKind]] = {}
        for name in self._overrides:
            if found := _OVERRIDE.fullmatch(name):
                topic, end, policy = found.groups()
                if policy not in _POLICIES:
                    hint = nearest(policy, _POLICIES)
                    raise ConfigError(f'parameter {name}: no such policy. {hint}')
                self._overridden.setdefault((topic, end), []).append(_POLICIES[policy])

    def publisher(self, topic: str, depth: int | None) -> Publisher:
        """Return a publisher of a topic of the table."""
        row = graph.TOPICS[topic]
        end = _End(topic, with_depth(PUBLISHER_QOS[row.qos], depth), publishes=True)
        callbacks = PublisherEventCallbacks(
            incompatible_qos=lambda _event: self._differs(end), use_default_callbacks=False
        )
        kind = message_class(row.type_name)
        create = self._node.create_publisher
        made: Publisher = self._make(end, callbacks, create, kind, topic)
        return made

    def subscription(self, topic: str, callback: Callable[..., None]) -> Subscription:
        """Return a subscription to the CDR bytes of a topic of the table.

        A topic whose row says `sensor` is subscribed to again, best effort, where a
        publisher offers no more: as camera drivers do (SensorDataQoS, REP 2003).
        """
        row = graph.TOPICS[topic]
        end = _End(topic, QOS[row.qos])
        kind = message_class(row.type_name)
        overridden = self._overridden.get(self._key(end), ())
        adapts = row.sensor and _RELIABILITY not in overridden

        def differs(event: Any) -> None:
            reliable = end.profile.reliability == ReliabilityPolicy.RELIABLE
            if adapts and reliable and event.last_policy_kind == _RELIABILITY:
                end.profile.reliability = ReliabilityPolicy.BEST_EFFORT
                # later: the executor still holds the subscription that is replaced
                executor = self._node.executor
                assert executor is not None  # it calls this
                executor.create_task(replace)
            else:
                self._differs(end)

        def make() -> Subscription:
            callbacks = SubscriptionEventCallbacks(
                incompatible_qos=differs,
                matched=lambda _event: self._differs(end),  # by its definition, maybe
                use_default_callbacks=False,
            )
            create = self._node.create_subscription
            new: Subscription = self._make(end, callbacks, create, kind, topic, callback, raw=True)
            return new

        def replace() -> None:
            self._node.destroy_subscription(made)
            self._replaced[made] = make()
            self._node.get_logger().info(
                f'{topic}: subscribed with best effort, as its publisher offers'
            )

        made = make()
        return made

    def now(self, subscription: Subscription) -> Subscription:
        """Return what stands in place of a subscription that was made before."""
        return self._replaced.pop(subscription, subscription)

    def look(self) -> None:
        """Look at the peers of what did not match; to be called once a second."""
        for end in list(self._unmatched):
            end.looks += 1
            if text := self._difference(end):
                end.text, end.looks = text, 0
            elif end.looks >= LOOKS:  # DDS lists a peer a little later than it tells of it
                self._unmatched.remove(end)

    @property
    def text(self) -> Said:
        """The peers that do not match, '' where all do."""
        return clauses(end.text for end in self._unmatched)

    @property
    def starved(self) -> bool:
        """Whether a subscription of the node gets nothing from a publisher that does not match."""
        return any(end.text and not end.publishes for end in self._unmatched)

    def unused(self) -> list[str]:
        """Return the overrides that belong to no publisher or subscription made so far."""
        return [name for name in self._overrides if not self._node.has_parameter(name)]

    def _differs(self, end: _End) -> None:
        end.looks = 0
        if end not in self._unmatched:
            end.text = ''
            self._unmatched.append(end)

    def _key(self, end: _End) -> tuple[str, str]:
        full = self._node.resolve_topic_name(end.topic)
        return full, 'publisher' if end.publishes else 'subscription'

    def _make(
        self, end: _End, callbacks: Any, create: Callable[..., Any], *args: Any, **more: Any
    ) -> Any:
        policies = self._overridden.get(self._key(end))
        if not policies:
            return create(*args, qos_profile=end.profile, event_callbacks=callbacks, **more)
        try:
            return create(
                *args,
                qos_profile=end.profile,
                event_callbacks=callbacks,
                qos_overriding_options=QoSOverridingOptions(policies),
                **more,
            )
        except (RuntimeError, TypeError, AssertionError, InvalidParameterTypeException) as error:
            raise ConfigError(f'{OVERRIDES}{".".join(self._key(end))}: {error}') from None

    def _difference(self, end: _End) -> Said | str:
        """Return how a peer differs, '' where all match."""
        full = self._key(end)[0]
        if end.publishes:
            peers = self._node.get_subscriptions_info_by_topic(full)
        else:
            peers = self._node.get_publishers_info_by_topic(full)
        for peer in peers:
            ours, theirs = end.profile, peer.qos_profile
            offered, asked = (ours, theirs) if end.publishes else (theirs, ours)
            if qos_check_compatible(offered, asked)[0] == QoSCompatibility.ERROR:
                return said(
                    'qos_of_reader' if end.publishes else 'qos_of_writer',
                    topic=full,
                    peer=peer.node_name,
                    theirs=_policies(theirs),
                    ours=_policies(ours),
                )
            told = str(peer.topic_type_hash)
            if not end.publishes and told not in (NO_HASH, type_hash(peer.topic_type)):
                return said('other_type', topic=full, peer=peer.node_name, type=peer.topic_type)
        return ''


def _policies(qos: QoSProfile) -> str:
    return f'{qos.reliability.name.lower()} {qos.durability.name.lower()}'

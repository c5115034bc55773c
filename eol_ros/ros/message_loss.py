# SPDX-License-Identifier: Apache-2.0
"""What DDS says was lost of a topic, asked for so that it cannot hang.

rmw_fastrtps 8.4 takes a `message_lost` event with the lock of the event held, and where nothing has
changed since it was taken last it asks the reader, which has a lock of its own. The reader tells of
a loss with that lock held, and then wants the event's: the two wait for each other for good
(ros2/rmw_fastrtps#890, mended in 2026). An executor takes once per event, and of two that come
together the second finds nothing changed: so a recorder hung where messages were lost fast enough.
Here an event only says that there is something to take, and `take` takes it once.
"""

import time
from collections.abc import Callable

from rclpy.event_handler import (
    EventHandler,
    QoSMessageLostInfo,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.node import Node
from rclpy.subscription import Subscription

STALE_S = 0.005  # an event that comes so soon after a take was queued before it, mostly


class MessageLoss:
    """The losses of one subscription; nothing where the middleware cannot tell."""

    def __init__(
        self,
        node: Node,
        subscription: Subscription,
        topic: str,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._clock, self._taken_s = clock, -STALE_S
        self._some = self._late = False
        self._handler: EventHandler | None = None
        # rclpy calls it with what the executor took, and that is nothing: see `_note`.
        events = SubscriptionEventCallbacks(
            message_lost=lambda event: None, use_default_callbacks=False
        )
        try:
            [handler] = events.create_event_handlers(
                subscription.callback_group, subscription.handle, topic
            )
        except UnsupportedEventTypeError:
            return
        self._handler, self._take_data = handler, handler.take_data
        # What the executor calls for each event.
        handler.take_data = self._note  # type: ignore[method-assign]
        # Annotated as one handler, and a list.
        subscription.event_handlers.append(handler)  # type: ignore[attr-defined]
        node.add_waitable(handler)

    def _note(self) -> None:
        if self._clock() - self._taken_s >= STALE_S:
            self._some = True
        else:
            self._late = True

    def take(self, last: bool = False) -> int:
        """Return how many messages were lost since it was asked last; ask about once a second.

        last: nothing comes after this, so that a doubtful event counts too.
        """
        if self._handler is None or not (self._some or (last and self._late)):
            return 0
        self._some = self._late = False
        self._handler._ready_to_take_data = True
        found: QoSMessageLostInfo | None = self._take_data()
        self._taken_s = self._clock()
        return found.total_count_change if found else 0

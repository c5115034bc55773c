# SPDX-License-Identifier: Apache-2.0
"""Losses are taken once for many events: a second take finds nothing new, and could hang."""

import types

import pytest
from rclpy.event_handler import SubscriptionEventCallbacks

from eol_ros.ros.message_loss import STALE_S, MessageLoss


class Handler:
    """Stands for rclpy's: `lost` messages since the last take; a take of none is what may hang."""

    def __init__(self):
        self.lost = self.takes = 0
        self._ready_to_take_data = False

    def take_data(self):
        assert self._ready_to_take_data
        assert self.lost, 'nothing has changed: rmw would ask the reader now'
        self._ready_to_take_data = False
        self.takes += 1
        lost, self.lost = self.lost, 0
        return types.SimpleNamespace(total_count_change=lost)


@pytest.fixture
def made(monkeypatch):
    handler, now = Handler(), [100.0]
    monkeypatch.setattr(SubscriptionEventCallbacks, 'create_event_handlers', lambda *_: [handler])
    waitables = []
    node = types.SimpleNamespace(add_waitable=waitables.append)
    subscription = types.SimpleNamespace(callback_group=None, handle=None, event_handlers=[])
    loss = MessageLoss(node, subscription, '/eol/slips', lambda: now[0])
    assert waitables == subscription.event_handlers == [handler]
    return loss, handler, now


def lose(handler, count, events):
    handler.lost += count
    for _ in range(events):  # as the executor does
        assert handler.take_data() is None


def test_many_events_are_one_take(made):
    loss, handler, now = made
    assert loss.take() == 0
    lose(handler, 7, 3)
    assert loss.take() == 7 and handler.takes == 1
    assert loss.take() == 0 and handler.takes == 1
    now[0] += 1.0
    lose(handler, 2, 1)
    assert loss.take() == 2


def test_an_event_that_was_queued_while_its_loss_was_taken_takes_nothing(made):
    loss, handler, now = made
    lose(handler, 1, 1)
    assert loss.take() == 1
    now[0] += STALE_S / 2
    lose(handler, 0, 1)  # of the loss that was taken
    now[0] += 1.0
    assert loss.take() == 0 and handler.takes == 1
    lose(handler, 4, 1)
    assert loss.take() == 4


def test_what_came_with_a_late_event_is_counted_with_the_next(made):
    loss, handler, now = made
    lose(handler, 1, 1)
    loss.take()
    now[0] += STALE_S / 2
    lose(handler, 5, 1)
    now[0] += 1.0
    assert loss.take() == 0
    lose(handler, 1, 1)
    assert loss.take() == 6
    now[0] += STALE_S / 2
    lose(handler, 3, 1)
    assert loss.take() == 0 and loss.take(last=True) == 3

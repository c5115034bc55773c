# SPDX-License-Identifier: Apache-2.0
"""When there is no room, images go first; nothing goes uncounted or out of order."""

import random
from collections import Counter

import pytest

from eol_ros.devices.bag.backlog import Backlog
from eol_ros.devices.bag.mcap_file import BagMessage
from eol_ros.devices.bag.selection import Dropped, Slipping

IMAGE, SLIPS = '/eol/camera/image_raw', '/eol/slips'


def item(topic, number, size):
    return BagMessage(topic, bytes(size), number, number, number)


def test_without_images_to_drop_other_messages_are_kept_up_to_a_bound_of_their_own():
    backlog = Backlog(1000, IMAGE, 3000)
    backlog.put(0.0, item(IMAGE, 0, 900))
    for k in range(101):
        backlog.put(0.0, item(SLIPS, k, 30))
    backlog.put(0.0, item(IMAGE, 1, 10))
    assert backlog.dropped == {IMAGE: 2, SLIPS: 1} and backlog.bytes == 3000


@pytest.mark.parametrize('seed', range(20))
def test_random_loads(seed):
    rng, limit = random.Random(seed), 1000
    backlog = Backlog(limit, IMAGE, 10**9)
    put: list[tuple] = []
    out: list[tuple] = []
    for number in range(400):
        if rng.random() < 0.6:
            picture = rng.random() < 0.5
            new = item(IMAGE if picture else SLIPS, number, rng.randint(50, 200))
            backlog.put(float(number), new)
            put.append((new.topic, number))
        elif rng.random() < 0.1:
            backlog.put(float(number), Slipping(number, True, number))
        elif entry := backlog.pop():
            backlog.done(entry)
            if not isinstance(entry.item, Slipping):
                out.append((entry.item.topic, entry.item.sequence))
        assert backlog.bytes >= 0 and not backlog.dropped[SLIPS]
        if backlog.bytes > limit:
            assert not any(isinstance(e.item, BagMessage) for e in backlog._pictures)
    lost = Counter()
    while entry := backlog.pop():
        backlog.done(entry)
        if not isinstance(entry.item, Slipping):
            out.append((entry.item.topic, entry.item.sequence))
        lost[IMAGE] += isinstance(entry.item, Dropped)
    assert out == put and backlog.bytes == 0
    assert sum(backlog.dropped.values()) >= lost[IMAGE]

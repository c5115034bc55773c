# SPDX-License-Identifier: Apache-2.0
"""Newest wins, nobody waits, nothing grows."""

import asyncio

from eol_ros.web.hub import QUEUE, Hub


def run(story):
    async def told():
        hub = Hub()
        hub.attach(asyncio.get_running_loop())
        await story(hub)

    asyncio.run(told())


def test_a_viewer_gets_what_it_wants_and_no_more():
    async def story(hub):
        looker, wall = hub.join(), hub.join()
        hub.want(looker, ['blocks', 'nonsense', 'slips'])
        assert hub.demand == {'blocks', 'slips'}
        hub.put('blocks', b'b')
        hub.put('image', b'i')
        hub.put('notices', 'n')
        await asyncio.sleep(0)
        assert await looker.take() == ['n', b'b']
        assert await wall.take() == ['n']
        hub.leave(looker)
        assert hub.demand == frozenset() and hub.viewers == {wall}

    run(story)


def test_a_slow_viewer_gets_the_newest_state_and_the_last_events():
    async def story(hub):
        viewer = hub.join()
        hub.want(viewer, ['blocks', 'slips'])
        for i in range(1000):
            hub.put('blocks', b'%d' % i)
            hub.put('slips', f's{i}')
        await asyncio.sleep(0)
        got = await viewer.take()
        assert got[-1] == b'999'
        assert got[:-1] == [f's{i}' for i in range(1000 - QUEUE, 1000)]
        assert viewer.dropped == 999 + 1000 - QUEUE

    run(story)


def test_latecomers_are_told_the_newest_of_each_name():
    async def story(hub):
        hub.put('notices', 'wall 1', sticky='wall')
        hub.put('notices', 'gone')
        hub.put('notices', 'wall 2', sticky='wall')
        hub.put('notices', 'health', sticky='health')
        await asyncio.sleep(0)
        assert await hub.join().take() == ['wall 2', 'health']

    run(story)


def test_put_before_and_after_the_loop_does_nothing():
    hub = Hub()
    hub.put('blocks', b'x')
    loop = asyncio.new_event_loop()
    hub.attach(loop)
    loop.close()
    hub.put('blocks', b'x')

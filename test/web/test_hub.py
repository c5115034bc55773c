# SPDX-License-Identifier: Apache-2.0
"""Newest wins, nobody waits, nothing grows."""

import asyncio

from eol_ros.web.hub import FULL, QUEUE, RETRY_S, Hub


class Line:
    """A wire that can be stopped up; reads its frames back by RFC 6455, 5.2."""

    def __init__(self):
        self.writes, self.waiting, self.closing = [], 0, False

    def write(self, data):
        self.writes.append(data)

    def get_write_buffer_size(self):
        return self.waiting

    def is_closing(self):
        return self.closing

    def taken(self):
        """Return the payloads since the last look: str for text, bytes for binary."""
        data, payloads = b''.join(self.writes), []
        self.writes.clear()
        while data:
            first, length, at = data[0], data[1], 2
            assert first in (0x81, 0x82) and not length & 0x80  # whole, and not masked
            if length >= 126:
                at = 4 if length == 126 else 10
                length = int.from_bytes(data[2:at], 'big')
            body, data = data[at : at + length], data[at + length :]
            assert len(body) == length
            payloads.append(body.decode() if first == 0x81 else body)
        return payloads


def run(story):
    async def told():
        hub = Hub()
        hub.attach(asyncio.get_running_loop())
        await story(hub)

    asyncio.run(told())


def test_a_viewer_gets_what_it_wants_and_no_more():
    async def story(hub):
        lines = Line(), Line()
        viewer, wall = (hub.join(line) for line in lines)
        hub.want(viewer, ['blocks', 'nonsense', 'slips'])
        assert hub.demand == {'blocks', 'slips'}
        hub.put('blocks', b'b')
        hub.put('image', b'i')
        hub.put('notices', 'n')
        await asyncio.sleep(0)
        assert lines[0].taken() == [b'b', 'n']
        assert lines[1].taken() == ['n']
        hub.leave(viewer)
        assert hub.demand == frozenset() and hub.viewers == {wall}
        hub.put('notices', 'late')
        await asyncio.sleep(0)
        assert lines[0].taken() == []

    run(story)


def test_a_slow_viewer_gets_the_newest_state_and_the_last_events():
    async def story(hub):
        line, other = Line(), Line()
        viewer = hub.join(line)
        hub.want(viewer, ['blocks', 'slips'])
        hub.want(hub.join(other), ['slips'])
        line.waiting = FULL + 1
        for i in range(1000):
            hub.put('blocks', b'%d' % i)
            hub.put('slips', f's{i}')
        await asyncio.sleep(2 * RETRY_S)
        assert line.taken() == []
        assert other.taken() == [f's{i}' for i in range(1000)]  # another one does not notice
        line.waiting = 0
        while not line.writes:
            await asyncio.sleep(RETRY_S)
        assert line.taken() == [*(f's{i}' for i in range(1000 - QUEUE, 1000)), b'999']
        assert viewer.dropped == 999 + 1000 - QUEUE

    run(story)


def test_paced_states_wait_and_events_take_them_along():
    async def story(hub):
        line = Line()
        viewer = hub.join(line)
        viewer.pace_s = 30.0
        hub.want(viewer, ['blocks', 'leds', 'slips'])
        hub.put('blocks', b'1')
        await asyncio.sleep(0)
        assert line.taken() == [b'1']  # the first goes at once
        for payload in (b'2', b'3'):
            hub.put('blocks', payload)
        hub.put('leds', b'l')
        await asyncio.sleep(0.01)
        assert line.taken() == []
        hub.put('slips', 's')
        await asyncio.sleep(0)
        assert line.taken() == ['s', b'3', b'l']
        viewer.pace_s = viewer._due_s = 0.0
        hub.put('blocks', b'4')
        await asyncio.sleep(0)
        assert line.taken() == [b'4']

    run(story)


def test_frames_of_every_length():
    async def story(hub):
        line = Line()
        hub.join(line)
        for length in (0, 125, 126, 65535, 65536):
            hub.put('notices', 'x' * length)
        await asyncio.sleep(0)
        assert [len(text) for text in line.taken()] == [0, 125, 126, 65535, 65536]

    run(story)


def test_latecomers_are_greeted_and_told_the_newest_of_each_name():
    async def story(hub):
        hub.put('notices', 'wall 1', sticky='wall')
        hub.put('notices', 'gone')
        hub.put('notices', 'wall 2', sticky='wall')
        hub.put('notices', 'health', sticky='health')
        await asyncio.sleep(0)
        line = Line()
        hub.join(line, lambda viewer: f'hello {viewer.number}')
        assert line.taken() == ['hello 1', 'wall 2', 'health']

    run(story)


def test_a_line_that_closes_is_written_no_more():
    async def story(hub):
        line = Line()
        hub.join(line)
        line.closing = True
        hub.put('notices', 'n')
        await asyncio.sleep(0)
        assert line.taken() == []

    run(story)


def test_put_before_and_after_the_loop_does_nothing():
    hub, line = Hub(), Line()
    hub.put('blocks', b'x')
    loop = asyncio.new_event_loop()
    hub.attach(loop)
    hub.join(line)
    loop.close()
    hub.put('notices', 'n')
    assert line.taken() == []


def test_while_nobody_looks_nothing_is_woken_and_demands_are_told_once(monkeypatch):
    async def story(hub):
        woken, demands, line = [], [], Line()
        loop = asyncio.get_running_loop()
        monkeypatch.setattr(loop, 'call_soon_threadsafe', lambda *call: woken.append(call))
        hub.on_demand = lambda: demands.append(set(hub.demand))
        hub.put('notices', {'t': 'tick'}, sticky='tick')
        hub.put('blocks', b'b')
        assert woken == []
        viewer = hub.join(line)
        assert line.taken() == ['{"t":"tick"}']
        for channels in (['blocks'], ['blocks'], []):
            hub.want(viewer, channels)
        hub.put('blocks', b'b')
        assert demands == [{'blocks'}, set()] and len(woken) == 1
        hub.leave(viewer)
        assert len(demands) == 2

    run(story)

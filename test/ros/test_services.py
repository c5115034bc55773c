# SPDX-License-Identifier: Apache-2.0
"""Services for what people ask, called as `ros2 service call` does: by a client of stock rclpy."""

import dataclasses
import threading
import warnings

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.service import Service
from std_srvs.srv import SetBool, Trigger
from support.spinning import matched
from support.waiting import wait_until

from eol_ros.errors import EolError
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import LATER, request_from_msg
from eol_ros.scene import Scene
from eol_ros.streams.graph import NODES
from eol_ros.streams.requests import KINDS, Asked, server_of

SCENE = Scene.alone('tracker', 'leds', 'sound', 'montage', 'panel')


class Handling(EolNode):
    """A node of a scene that handles requests, and does nothing else."""

    def __init__(self, name, scene=SCENE, **handlers):
        self.NAME = name
        super().__init__(NODES[name].settings(), scene=scene)
        self.handled, self.asked = [], []
        if name == 'panel':
            self.subscribe('requests', lambda message: self.asked.append(request_from_msg(message)))
        kinds = [k.name for k in KINDS.values() if name in k.whom('')]
        self.requests.serve(**{kind: self.note for kind in kinds} | handlers)

    def note(self, asked):
        self.handled.append(asked.kind)
        return f'{self.NAME} did {asked.kind}'


class Graph:
    """Nodes in one executor and a client in another, as two processes have them."""

    def __init__(self, executor, *nodes):
        self.executor, self.nodes = executor(), nodes
        for node in nodes:
            self.executor.add_node(node)
        self.client, self.stopping = Node('asking', namespace='eol'), threading.Event()
        self.other = SingleThreadedExecutor()
        self.other.add_node(self.client)
        self.thread = threading.Thread(target=self.spin)
        self.thread.start()

    def spin(self):
        while not self.stopping.is_set():
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, type_, name, **fields):
        client = self.client.create_client(type_, name)
        assert client.wait_for_service(30.0)
        future = client.call_async(type_.Request(**fields))
        wait_until(future.done, 60.0, turn=lambda: self.other.spin_once(timeout_sec=0.05))
        self.client.destroy_client(client)
        return future.result()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stopping.set()
        self.thread.join()
        for node in self.nodes:
            self.executor.remove_node(node)
            node.close()
            node.destroy_node()
        self.client.destroy_node()


@pytest.mark.parametrize('executor', [EventsExecutor, SingleThreadedExecutor])
def test_a_call_is_a_request_and_returns_what_the_nodes_answered(ros, monkeypatch, executor):
    soon = dataclasses.replace(KINDS['learn_background'], within_s=1.0)
    monkeypatch.setitem(KINDS, 'learn_background', soon)
    names = 'tracker', 'leds', 'sound', 'montage', 'panel'
    nodes = {name: Handling(name) for name in names}
    with Graph(executor, *nodes.values()) as graph:
        done = graph.call(SetBool, 'mute', data=True)
        assert (done.success, done.message) == (True, 'sound did mute')
        assert graph.call(SetBool, 'mute', data=False).message == 'sound did unmute'
        assert nodes['sound'].handled == ['mute', 'unmute']
        asleep = graph.call(SetBool, 'sleep', data=True)
        said = [f'{name} did sleep' for name in ('leds', 'sound', 'montage')]
        assert asleep.success and sorted(asleep.message.split('; ')) == sorted(said)
        assert graph.call(Trigger, 'learn_background').success is False  # the tracker is silent
        wait_until(lambda: [a.kind for a in nodes['panel'].asked][-1] == 'learn_background', 30.0)
        assert {a.source for a in nodes['panel'].asked} == {'service'}


def test_a_refusal_is_no_success_and_a_slow_answer_is_waited_for(ros):
    waiting = []

    def refuse(asked):
        raise EolError('no wall is connected')

    def later(asked):
        waiting.append(asked)
        return LATER

    scene = Scene.alone('tracker', 'montage')
    tracker = Handling('tracker', scene, calibrate=later)
    montage = Handling('montage', scene, sleep=refuse)
    tracker.create_timer(
        0.2,
        lambda: waiting and tracker.requests.answer(waiting.pop(), True, 'calibrated to 0.1 px'),
    )
    with Graph(EventsExecutor, tracker, montage) as graph:
        refused = graph.call(SetBool, 'sleep', data=True)
        assert (refused.success, refused.message) == (False, 'montage: no wall is connected')
        done = graph.call(Trigger, 'calibrate')
        assert (done.success, done.message) == (True, 'calibrated to 0.1 px')


def test_a_response_that_no_client_can_read_yet_is_sent_again(ros, monkeypatch):
    """As rmw does where it has not discovered the reader of the response."""
    send, tries = Service.send_response, []

    def fail_twice(service, response, header):
        tries.append(service.service_name)
        if len(tries) > 2:
            return send(service, response, header)
        warnings.warn('client will not receive response', RuntimeWarning, stacklevel=1)

    monkeypatch.setattr(Service, 'send_response', fail_twice)
    with Graph(EventsExecutor, Handling('sound'), Handling('panel')) as graph:
        assert graph.call(SetBool, 'mute', data=False).message == 'sound did unmute'
    assert tries == ['/eol/mute'] * 3


def test_who_does_not_answer_is_named(ros, monkeypatch):
    monkeypatch.setitem(KINDS, 'mute', dataclasses.replace(KINDS['mute'], within_s=0.3))
    with Graph(EventsExecutor, Handling('panel')) as graph:
        silent = graph.call(SetBool, 'mute', data=True)
        assert (silent.success, silent.message) == (False, 'sound does not answer')


@pytest.mark.parametrize(
    ('kind', 'node', 'words'),
    [
        ('mut', '', 'mut: no such request. Did you mean mute?'),
        ('qqq', '', 'qqq: no such request. Of '),
        ('mute', 'sund', 'mute: sund does not heed it, but sound'),
        ('move_grain', '', 'grains does not run'),
        ('sleep', 'montge', 'sleep: montge does not heed it, but leds, sound, montage'),
    ],
)
def test_a_request_that_no_node_answers_is_answered(ros, kind, node, words):
    panel, sound = Handling('panel'), Handling('sound')
    results = []
    sound.subscribe('request_results', results.append)
    with Graph(EventsExecutor, panel, sound):
        wait_until(lambda: panel.count_publishers('/eol/requests') == 2, 30.0)
        wait_until(lambda: sound.requests.publisher.get_subscription_count() >= 3, 30.0)
        wait_until(lambda: matched(panel, sound))  # otherwise it misses the answer
        sound.requests.ask(Asked(kind, node))
        wait_until(lambda: results)
        assert (results[0].accepted, results[0].node) == (False, 'panel')
        assert results[0].reason.startswith(words)


def services(node):
    mine = [s.service_name for s in node.services]
    return sorted(name for name in mine if 'param' not in name and 'type_desc' not in name)


def test_one_node_of_a_scene_serves_what_its_nodes_handle(ros):
    panel, sound = Handling('panel'), Handling('sound')
    names = 'calibrate', 'learn_background', 'mute', 'sleep', 'test'
    assert services(panel) == [f'/eol/{name}' for name in names]
    assert services(sound) == []
    alone = Handling('sound', Scene.alone('sound'))
    assert services(alone) == ['/eol/mute', '/eol/sleep', '/eol/test']
    motion = Handling('motion', Scene.alone('motion'))
    assert services(motion) == []
    for node in (panel, sound, alone, motion):
        node.destroy_node()
    assert server_of(['camera', 'recorder']) == ''
    assert server_of(['tracker', 'motion', 'sound']) == 'sound'
    assert server_of(['tracker', 'hours', 'sound']) == 'hours'
    assert rclpy.ok()

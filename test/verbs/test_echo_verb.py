# SPDX-License-Identifier: Apache-2.0
"""`eol echo`, `eol topics` and `eol replay` as programs, on one graph."""

import contextlib
import itertools
import json
import os
import pty
import signal
import subprocess
import sys
import time

import pytest
import yaml
from eol_msgs.msg import Cascade, Slip
from rclpy.serialization import serialize_message
from support.domains import next_domain
from support.waiting import GENEROUS_S

from eol_ros import cli
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.ros.definitions import describe
from eol_ros.verbs import topics

T0 = 1_700_000_000_000_000_000


def eol(*words):
    return subprocess.Popen(
        [sys.executable, '-m', 'eol_ros', *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ,
    )  # fmt: skip


def end(child, seconds=GENEROUS_S):
    out, err = child.communicate(timeout=seconds)
    return child.returncode, out, err


@pytest.fixture
def start():
    """Starts `eol` with words; what a test leaves running, having failed, is stopped."""
    children = []

    def begin(*words):
        children.append(eol(*words))
        return children[-1]

    yield begin
    for child in children:
        if child.poll() is None:
            child.kill()
            child.communicate()


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Three seconds: 100 slips a second, one cascade a second."""
    path = tmp_path_factory.mktemp('bags') / 'run'
    topics = [BagTopic(f'/eol/{t}', **describe(t)) for t in ('slips', 'cascades')]
    writer = BagWriter(path, topics, {'seeds': '{}'})
    for i in range(300):
        now = T0 + i * 10_000_000
        writer.write('/eol/slips', bytes(serialize_message(Slip(slip=i, block=i % 25))), now, now)
        if i % 100 == 50:
            raw = bytes(serialize_message(Cascade(cascade=i // 100, blocks=[1, 2])))
            writer.write('/eol/cascades', raw, now, now)
    writer.close()
    return path


@pytest.fixture(scope='module')
def graph(bag):
    """The bag, playing for ever; yields the first message that `eol echo` has of it."""
    child = eol('replay', str(bag), '--only', 'all', '--loop', '--wait', '0')
    code, out, err = end(eol('echo', 'slips', '--once'))
    assert code == 0, err
    yield out
    child.send_signal(signal.SIGTERM)
    code, _, err = end(child)
    assert code == 0, err
    assert 'messages played' in err


@pytest.mark.slow
def test_echo_once_prints_one_message_as_yaml(graph):
    first, rest = graph.split('---\n')
    message = yaml.safe_load(first)
    assert rest == ''
    assert list(message)[:3] == ['header', 'kind', 'slip']
    assert message['block'] == message['slip'] % 25


@pytest.mark.slow
def test_echo_json(graph, start):
    lines = start('echo', '/eol/slips', '--json')
    got = [json.loads(lines.stdout.readline())['slip'] for _ in range(50)]
    assert all(b == (a + 1) % 300 for a, b in itertools.pairwise(got))
    lines.send_signal(signal.SIGINT)
    assert end(lines)[0] == 0


@pytest.mark.slow
def test_echo_into_a_pipe_that_closes_ends_without_a_word(graph):
    shell = f'"{sys.executable}" -m eol_ros echo slips --json; echo "code $?" >&2'
    child = subprocess.Popen(
        ['sh', '-c', f'({shell}) | head -n 2'], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    code, out, err = end(child)
    assert code == 0 and len(out.splitlines()) == 2
    assert err == 'code 0\n'


@pytest.mark.slow
def test_topics_with_rates(graph):
    for _ in range(5):  # few cascades: a busy machine may hear none in one look
        code, out, err = end(eol('topics', '--hz', '--json'))
        assert code == 0, err
        rates = {row['topic']: row['rate_hz'] for row in json.loads(out)}
        if rates['/eol/cascades'] > 0:
            break
    assert rates['/eol/slips'] > 10 * rates['/eol/cascades'] > 0  # a hundred to one in the bag


def readers_of_played(rows):
    return sum(row['readers'] for row in rows if row['topic'] in ('/eol/slips', '/eol/cascades'))


@pytest.mark.slow
def test_topics_are_the_same_each_time(graph):
    until = time.monotonic() + 60
    while readers_of_played(json.loads(first := end(eol('topics', '--json'))[1])):
        assert time.monotonic() < until, 'readers of the tests before do not go away'
    code, second, _ = end(eol('topics', '--json'))
    assert (code, second) == (0, first)
    rows = {row['topic']: row for row in json.loads(first)}
    assert rows['/eol/slips']['type'] == 'eol_msgs/msg/Slip'
    assert rows['/eol/slips']['publishers'] == 1
    assert rows['/eol/cascades']['doc']


def test_no_graph_has_no_topics(start, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(next_domain()))
    looks = [start('topics', '--seconds', '1', *words) for words in ([], ['--json'])]
    for look, printed in zip(looks, ('', '[]\n'), strict=True):
        code, out, err = end(look)
        assert (code, out) == (69, printed)
        assert 'no graph runs on domain' in err


def test_ctrl_c_before_any_topic_was_found_does_not_say_that_none_is_there(monkeypatch, capsys):
    class Visit:
        node, stopped = None, True

        def run(self, until, seconds):
            return False

    monkeypatch.setattr('eol_ros.ros.session.session', lambda **_: contextlib.nullcontext(Visit()))
    monkeypatch.setattr('eol_ros.ros.echo.on_the_graph', lambda _node: [])
    monkeypatch.setattr(topics, '_Discovery', lambda _node: None)

    assert cli.main(['topics', '--json']) == 0
    assert capsys.readouterr() == ('', 'eol topics: stopped\n')


@pytest.mark.slow
def test_what_nobody_publishes_is_said(graph):
    code, out, err = end(eol('echo', '/no/such', '--once'))
    assert (code, out) == (69, '')
    assert err.count('\n') == 1
    assert '/no/such: nothing publishes it. ' in err and ' /' in err and '/rosout' not in err
    code, out, err = end(eol('echo', 'wall', '--once', '--timeout', '1'))
    assert (code, out) == (69, '')
    assert 'no message for 1 s' in err


@pytest.mark.slow
def test_listening_without_a_graph_says_so_once_and_goes_on(start, monkeypatch):
    domain = str(next_domain())
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    child = start('echo', 'slips')
    line = child.stderr.readline()
    assert line.startswith(f'nothing publishes /eol/slips in domain {domain} now; waiting')
    assert child.poll() is None
    child.send_signal(signal.SIGINT)
    assert end(child) == (0, '', '')
    code, out, err = end(eol('echo', '/no/such'))
    assert (code, out) == (69, '')
    assert err.startswith(f'eol echo: no graph runs on domain {domain}: ')


@pytest.mark.slow
def test_a_replay_without_topics_or_behind_its_end_is_refused(bag):
    for words, code, said in (
        (['--start', '9'], 2, 'the bag has 3.0 s'),
        ([], 78, 'say which topics to play'),
    ):
        got, out, err = end(eol('replay', str(bag), *words))
        assert (got, out) == (code, ''), err
        assert said in err
        assert err.count('\n') == 1


@pytest.mark.slow
def test_space_pauses_and_goes_on(bag):
    ours, theirs = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, '-m', 'eol_ros', 'replay', str(bag), '--only', 'all', '--wait', '0',
         '--rate', '3'],
        stdin=theirs, stderr=subprocess.PIPE, text=True, env=os.environ,
    )  # fmt: skip
    assert '/eol/slips' in child.stderr.readline()
    os.write(ours, b' ')
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(timeout=2.5)  # it would take one second
    os.write(ours, b' ')
    _, err = child.communicate(timeout=30)
    assert child.returncode == 0
    assert '303 messages played' in err
    os.close(ours)
    os.close(theirs)

# SPDX-License-Identifier: Apache-2.0
"""The node sacn over real DDS and UDP: levels of the blocks arrive, and no more than may be."""

import socket
import time

import pytest
from eol_msgs.msg import LedCommand
from support.spinning import Nodes

from eol_ros.errors import ConfigError
from eol_ros.nodes.sacn import SacnNode
from eol_ros.ros.node import EolNode
from eol_ros.scene import Scene
from eol_ros.settings import LedsSettings, SacnSettings, TableSettings


class Leds(EolNode):
    NAME = 'leds'

    def __init__(self):
        super().__init__(LedsSettings())
        self.commands = self.publisher('led_commands')

    def light(self, *levels):
        self.commands.publish(LedCommand(white=levels))


FIELD = LedsSettings(flash_limit='field', decay_s=0.2)
LIT = Scene('lit', {'leds': FIELD})


@pytest.fixture
def fixture():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(('127.0.0.1', 0))
        made.setblocking(False)
        yield made


def packets(fixture):
    found = []
    while True:
        try:
            found.append(fixture.recv(2000))
        except BlockingIOError:
            return found


def test_levels_arrive_and_the_stream_ends_dark(ros, fixture):
    port = fixture.getsockname()[1]
    settings = SacnSettings((f'127.0.0.1:{port}',), universe=7, first_channel=11)
    with Nodes() as nodes:
        leds, node = nodes.add(Leds()), nodes.add(SacnNode(settings, scene=LIT))
        nodes.meet()
        levels = [(k, *range(24)) for k in range(1, 101)]
        began_s = time.monotonic()
        got = []
        for one in levels:
            leds.light(*one)
            nodes.turn()
            got += packets(fixture)
        nodes.until(lambda: got.extend(packets(fixture)) or (got and got[-1][136] == 100))
        took_s = time.monotonic() - began_s
        lit = [packet for packet in got if packet[136]]
        assert all(len(packet) == 126 + 10 + 25 for packet in got)
        assert {int.from_bytes(packet[113:115], 'big') for packet in got} == {7}
        assert 2 < len(lit) <= 44 * took_s + 4  # and three times the last
        assert lit[-1][126:] == bytes(10) + bytes([100, *range(24)])
        nodes.until(lambda: node.health.text == f'sends to 127.0.0.1:{port}')
        nodes.until(lambda: node.health.values['sent'] >= len(got))
    ended = packets(fixture)[-3:]
    assert [packet[112] for packet in ended] == [0x40] * 3
    assert not any(any(packet[126:]) for packet in ended)


def test_without_receivers_it_goes_to_all(ros):
    node = SacnNode(SacnSettings(universe=258), scene=LIT)
    assert [out.target for out in node.outs] == ['239.255.1.2:5568']
    node.close()
    node.destroy_node()


def test_its_id_stays_and_is_that_of_the_machine_graph_and_universe(ros, tmp_path, monkeypatch):
    def cid(state, universe=1):
        monkeypatch.setenv('EOL_STATE', str(tmp_path / state))
        node = SacnNode(SacnSettings(('127.0.0.1:9',), universe=universe), scene=LIT)
        with Nodes(node):
            return node.stream.end()[0][22:38]

    first = cid('here')
    assert cid('here') == first
    assert len({first, cid('here', 2), cid('there')}) == 3


def test_a_state_folder_may_refuse_the_id(ros, tmp_path, monkeypatch, capfd):
    (tmp_path / 'file').touch()
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'file' / 'state'))
    ids = set()
    for _ in range(2):
        node = SacnNode(SacnSettings(('127.0.0.1:9',)), scene=LIT)
        with Nodes(node):
            ids.add(node.stream.end()[0][22:38])
    assert len(ids) == 2
    warnings = [line for line in capfd.readouterr().err.splitlines() if 'another source' in line]
    assert len(warnings) == 2 and 'Not a directory; set EOL_STATE' in warnings[0]


@pytest.mark.parametrize(
    ('leds', 'table', 'settings', 'why'),
    [
        (
            LedsSettings(flash_limit='false', flash_limit_off_because='a film'),
            TableSettings(),
            SacnSettings(),
            'needs leds in this scene with leds.flash_limit: field',
        ),
        (None, TableSettings(), SacnSettings(), 'needs leds in this scene'),
        (
            FIELD,
            TableSettings(rows=15, columns=15, platform_m=(4.0, 4.0)),
            SacnSettings(first_channel=300),
            'first_channel: 300 leaves 213 channels for 225 places: at most 288',
        ),
        (LedsSettings(), TableSettings(), SacnSettings(), 'with leds.flash_limit: field'),
        (FIELD, TableSettings(), SacnSettings(('a:b',)), "'a:b': give HOST:PORT"),
        (FIELD, TableSettings(), SacnSettings(send_from='eth1'), "'eth1': give the IPv4 address"),
    ],
)
def test_what_cannot_be(ros, leds, table, settings, why):
    nodes = {'sacn': settings} | ({'leds': leds} if leds else {})
    scene = Scene('test', nodes, table=table)
    with pytest.raises(ConfigError, match=why):
        SacnNode(settings, scene=scene)

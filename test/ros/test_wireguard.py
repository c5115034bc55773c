# SPDX-License-Identifier: Apache-2.0
"""Keys: what is written is what WireGuard itself reads, and who is let in."""

import base64
import re
import stat
import subprocess
from pathlib import Path

import pytest
from support import needs

from eol_ros import cli
from eol_ros.errors import ConfigError
from eol_ros.ros import network, wireguard

KEY = base64.b64encode(bytes(range(31)) + b'\x00').decode()
pytestmark = needs.marker('wireguard-tools')


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Return the folder of the keys, empty."""
    monkeypatch.setenv('EOL_CONFIG', str(tmp_path / 'work'))
    return tmp_path / 'work'


def stripped(path):
    """Return what `wg-quick` hands to WireGuard; it fails on what it does not understand."""
    return subprocess.run(
        ['wg-quick', 'strip', str(path)], check=True, capture_output=True, text=True
    ).stdout


def test_both_ends_fit_together(folder, tmp_path, monkeypatch):
    wireguard.make()
    work = folder / 'eol0.conf'
    keys, theirs = wireguard.add('laptop', 'museum.local')
    assert stat.S_IMODE(work.stat().st_mode) == 0o600
    monkeypatch.setenv('EOL_CONFIG', str(tmp_path / 'laptop'))
    joined = wireguard.join(theirs)
    ends = [dict(re.findall(r'^(\w+) = (.*)$', stripped(k.path), re.M)) for k in (keys, joined)]
    for one, other in (ends, ends[::-1]):
        public = subprocess.run(
            ['wg', 'pubkey'], input=one['PrivateKey'], capture_output=True, text=True, check=True
        ).stdout.strip()
        assert other['PublicKey'] == public
    assert ends[0]['PresharedKey'] == ends[1]['PresharedKey']
    assert ends[1]['Endpoint'] == 'museum.local:51820'
    assert (keys.address, joined.address) == ('10.77.0.1', '10.77.0.2')
    assert [peer.address for peer in joined.peers] == ['10.77.0.1']
    assert ends[0]['AllowedIPs'] == '10.77.0.2/32' and ends[1]['AllowedIPs'] == '10.77.0.1/32'


def test_addresses_are_given_once_and_again_when_they_are_free():
    wireguard.make('192.168.250.0/29', 4000)
    for i in range(5):
        keys, theirs = wireguard.add(f'guest{i}', 'museum:1234')
        assert 'Endpoint = museum:1234' in theirs
    assert [peer.address for peer in keys.peers] == [f'192.168.250.{i}' for i in range(2, 7)]
    with pytest.raises(ConfigError, match='no address is free'):
        wireguard.add('one.more', 'museum')
    left = wireguard.revoke('guest2')
    assert [peer.name for peer in left.peers] == ['guest0', 'guest1', 'guest3', 'guest4']
    keys, theirs = wireguard.add('one.more', 'museum', public=KEY)
    assert keys.peers[-1] == wireguard.Peer('one.more', '192.168.250.4', KEY)
    assert 'PrivateKey = YOUR-PRIVATE-KEY' in theirs  # theirs never was here
    assert stripped(keys.path).count('[Peer]') == 5


def test_names_are_compared_whole():
    wireguard.make()
    wireguard.add('lap', 'museum')
    wireguard.add('lap.top', 'museum')
    assert [peer.name for peer in wireguard.revoke('lap').peers] == ['lap.top']


@pytest.mark.parametrize(
    ('words', 'code', 'says'),
    [
        (['list'], 78, 'run `eol keys make`'),
        (['env'], 78, 'run `eol keys make`'),
        (['add', 'laptop'], 78, 'run `eol keys make`'),
        (['make', '--subnet', '10.77.0.0/33'], 78, '--subnet 10.77.0.0/33: '),
        (['make', '--subnet', '10.77.0.0/31'], 78, 'has no room for two machines'),
        (['make', '--port', '0'], 2, '--port: 0 is outside 1 to 65535'),
        (['join', '/none.conf'], 78, '/none.conf: No such file'),
        (['join', '/etc/hostname'], 78, 'not what `eol keys add` writes'),
    ],
)
def test_mistakes_before_there_are_keys(capsys, words, code, says):
    assert cli.main(['keys', *words]) == code
    said = capsys.readouterr().err
    assert says in said and said.count('\n') == 1


@pytest.mark.parametrize(
    ('words', 'code', 'says'),
    [
        (['make'], 78, 'exists already'),
        (['add', 'laptop'], 78, 'has a key already'),
        (['add', 'two words'], 78, "'two words': a name has letters"),
        (['add', 'x\n[Peer]'], 78, 'a name has letters'),
        (['add', 'tablet', '--public', 'abc'], 78, 'not a WireGuard key'),
        (['revoke', 'tablet'], 78, 'tablet: has no key; names with keys: laptop'),
    ],
)
def test_mistakes_where_there_are_keys(folder, capsys, words, code, says):
    wireguard.make()
    wireguard.add('laptop', 'museum')
    before = (folder / 'eol0.conf').read_bytes()
    assert cli.main(['keys', *words]) == code
    assert says in capsys.readouterr().err
    assert (folder / 'eol0.conf').read_bytes() == before


def test_a_damaged_file_is_one_line(folder, capsys):
    wireguard.make()
    (folder / 'eol0.conf').write_text('[Interface]\nAddress = here\n')
    assert cli.main(['keys', 'list']) == 78
    assert 'not a WireGuard configuration as' in capsys.readouterr().err


def test_what_is_not_up_is_said(capsys, tmp_path):
    keys = wireguard.make('203.0.113.0/24')  # for documentation: nobody's
    assert not keys.up
    assert network.warnings('secure') == [
        f'network: secure: 203.0.113.1 is not up, so nobody else is let in; {keys.how_up}'
    ]
    assert cli.main(['topics', '--secure']) == 69
    assert 'is not up: sudo wg-quick up' in capsys.readouterr().err
    scene = tmp_path / 'scene.yaml'
    scene.write_text('network: secure\nnodes: {twin: {}, tracker: {}}\n')
    assert cli.main(['check', str(scene)]) == 0
    assert 'is not up, so nobody else' in capsys.readouterr().err


def test_what_changes_is_said_once(monkeypatch):
    wireguard.make()
    states = iter([False, False, True, True, True, False])
    monkeypatch.setattr(wireguard.Keys, 'up', property(lambda keys: next(states)))
    look = network.changes('secure')
    assert [look(False) for _ in range(5)] == [
        '', 'network: secure: 10.77.0.1 is up now', '', '',
        'network: secure: 10.77.0.1 is down now',
    ]  # fmt: skip


def test_what_dds_may_use(monkeypatch, tmp_path):
    monkeypatch.setenv('EOL_CACHE', str(tmp_path))
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE', raising=False)
    wireguard.make()
    given = network.environment('secure')
    profile = Path(given['FASTRTPS_DEFAULT_PROFILES_FILE']).read_text()
    assert re.findall('<address>(.*)</address>', profile) == ['127.0.0.1', '10.77.0.1']
    assert 'ROS_STATIC_PEERS' not in given
    local = Path(network.environment('local')['FASTRTPS_DEFAULT_PROFILES_FILE']).read_text()
    assert re.findall('<address>(.*)</address>', local) == ['127.0.0.1']
    lan = Path(network.environment('lan')['FASTRTPS_DEFAULT_PROFILES_FILE']).read_text()
    assert '<address>' not in lan

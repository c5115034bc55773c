# SPDX-License-Identifier: Apache-2.0
"""The report: numbers against a bag whose law is known, one page that needs nothing else."""

import csv
import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from eol_msgs.msg import Cascade, Slip
from rclpy.serialization import serialize_message

from eol_ros import cli
from eol_ros.analysis import report
from eol_ros.analysis.bag import open_bag
from eol_ros.devices.bag_file import BagTopic
from eol_ros.devices.bag_writer import BagWriter
from eol_ros.ros.definitions import describe
from eol_ros.ros.stamps import to_msg

T0 = 1_700_000_000_000_000_000
TAU = 1.6


def made(folder, cascades):
    """A bag of one slip, 20 ms long and 4 mm far, per cascade; areas drawn from A^-TAU."""
    support = np.arange(1, 26)
    weight = support**-TAU
    areas = np.random.default_rng(2).choice(support, cascades, p=weight / weight.sum())
    topics = [BagTopic(f'/eol/{t}', **describe(t)) for t in ('slips', 'cascades')]
    bag = BagWriter(folder, topics, {'scene_name': 'a <b>', 'settings': 'x: 1\n'})
    for i, area in enumerate(areas):
        now = T0 + i * 200_000_000
        for kind, at in ((Slip.START, now), (Slip.STOP, now + 20_000_000)):
            slip = Slip(kind=kind, slip=i, block=i % 5, distance=0.004 * (kind == Slip.STOP))
            slip.header.stamp = to_msg(at)
            bag.write('/eol/slips', bytes(serialize_message(slip)), at + 8_000_000, at)
        cascade = Cascade(cascade=i, area=int(area), size=int(area), blocks=list(range(area)))
        cascade.header.stamp = cascade.onset = to_msg(now)
        raw = bytes(serialize_message(cascade))
        bag.write('/eol/cascades', raw, now + 30_000_000, now)
    bag.gaps = {'lost_before_recorder': '{"/eol/slips": 2}'}
    bag.close()
    return open_bag(folder), areas


@pytest.fixture(scope='module')
def big(tmp_path_factory):
    """2000 cascades."""
    return made(tmp_path_factory.mktemp('big') / 'run', 2000)


def test_numbers(big):
    bag, areas = big
    found = report.numbers(bag)
    assert found['slips']['count'] == 2000
    assert found['slips']['median_distance_mm'] == 4.0
    assert found['slips']['per_block'] == [400] * 5 + [0] * 20
    assert found['latency_ms']['slips']['p50'] == pytest.approx(8.0, abs=0.01)
    assert found['gaps'] == {'lost_before_recorder': {'/eol/slips': 2}}
    law = found['cascades']
    assert law['largest'] == areas.max()
    assert law['b_value'] == pytest.approx(TAU - 1, abs=4 * law['b_error'])
    assert law['b_error'] < 0.3


def test_too_few_cascades_are_not_fitted(tmp_path):
    bag, _ = made(tmp_path / 'run', 18)
    found = report.numbers(bag)
    assert 'too few events' in found['cascades']['why']
    assert 'b_value' not in found['cascades']
    assert 'too few events' in report.summary(found)


@pytest.fixture(scope='module')
def page(big, tmp_path_factory):
    """The report of the 2000 cascades."""
    out = tmp_path_factory.mktemp('page')
    return out, report.write(big[0], out)


@pytest.mark.slow
def test_the_page_stands_alone(big, page):
    (out, found), areas = page, big[1]
    page = (out / 'report.html').read_text()
    assert 'a &lt;b&gt;' in page
    outside = re.findall(r'(?:src|href)="(?!#)([^"]*)"', page.split('</style>')[1])
    assert outside == []
    assert page.count('<svg') == 5
    assert json.loads((out / 'report.json').read_text()) == found
    names = {'areas', 'waiting', 'distances', 'blocks', 'activity'}
    for name in names:
        ElementTree.parse(out / f'{name}.svg')
        assert (out / f'{name}.pdf').read_bytes()[:5] == b'%PDF-'
    with open(out / 'areas.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(r['cascades_at_least']) for r in rows] == [
        int((areas >= a).sum()) for a in range(1, 26)
    ]


@pytest.mark.slow
def test_the_same_bag_gives_the_same_page_by_the_command(big, page, tmp_path, capsys):
    assert cli.main(['report', str(big[0].path), '--out', str(tmp_path), '--json']) == 0
    assert json.loads(capsys.readouterr().out) == page[1]
    for file in page[0].iterdir():
        assert file.read_bytes() == (tmp_path / file.name).read_bytes(), file.name


def test_csv_and_mistakes(big, tmp_path, capsys):
    path = str(big[0].path)
    assert cli.main(['report', path, '--csv', 'slips', '--out', str(tmp_path / 'c')]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / 'c' / 'slips.csv')
    with open(tmp_path / 'c' / 'slips.csv', newline='') as file:
        assert len(list(csv.DictReader(file))) == 4000
    (tmp_path / 'not.txt').write_text('not a bag')
    for words, code in (
        ((str(tmp_path / 'absent'),), 69),
        ((str(tmp_path / 'not.txt'),), 78),
        ((path, '--csv', 'walls'), 78),
        ((path, '--retrack'), 78),
        ((path, '--csv', 'slips', '--out', str(tmp_path / 'not.txt' / 'x')), 69),
    ):
        got = cli.main(['report', *words])
        said = capsys.readouterr()
        assert (got, said.out, said.err.count('\n')) == (code, '', 1), (words, said)

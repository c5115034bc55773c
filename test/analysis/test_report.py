# SPDX-License-Identifier: Apache-2.0
"""The report: numbers against a bag whose law is known, one page that needs nothing else."""

import csv
import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from eol_msgs.msg import BlockTap, Cascade, GrainTrigger, LedCommand, Slip
from rclpy.serialization import serialize_message
from support.bag_samples import T0, bag_of

from eol_ros import cli
from eol_ros.analysis import catalogue_file, figures, report, series
from eol_ros.analysis.bag import open_bag
from eol_ros.core.science import powerlaw
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.ros.definitions import describe
from eol_ros.ros.stamps import to_msg
from eol_ros.settings import TwinSettings

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
        for kind, at in ((Slip.KIND_START, now), (Slip.KIND_STOP, now + 20_000_000)):
            slip = Slip(kind=kind, slip=i, block=i % 5, distance=0.004 * (kind == Slip.KIND_STOP))
            slip.header.stamp, slip.onset = to_msg(at), to_msg(now)
            slip.duration = 0.02 * (kind == Slip.KIND_STOP)
            bag.write('/eol/slips', bytes(serialize_message(slip)), at + 8_000_000, at)
        cascade = Cascade(cascade=i, area=int(area), size=int(area), blocks=list(range(area)))
        cascade.distance = 0.004 * area
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


@pytest.fixture(scope='module')
def found(big):
    return report.numbers(big[0])


def test_numbers(big, found):
    _, areas = big
    assert found['slips']['count'] == 2000
    assert found['slips']['median_distance_mm'] == 4.0
    assert found['slips']['per_block'] == [400] * 5 + [0] * 20
    assert found['latency_ms']['slips']['p50'] == pytest.approx(8.0, abs=0.01)
    assert found['gaps'] == {'lost_before_recorder': {'/eol/slips': 2}}
    law = found['cascades']
    assert law['largest'] == areas.max()
    assert law['b_value'] == pytest.approx(TAU - 1, abs=4 * law['b_error'])
    assert law['b_error'] < 0.3
    assert not law['rejected'] and 'a power law is not ruled out' in law['sentence']
    assert law['alternatives']['exponential']['verdict'] == 'worse'
    assert 'worse: exponential' in law['sentence'] and law['sentence'] in report.summary(found)


@pytest.mark.parametrize(
    ('far_mm', 'said'), [(16.1891, '3 slips, median distance 16.2 mm'), (None, '3 slips')]
)
def test_slips_are_told_in_digits_that_mean_something(far_mm, said):
    found = {'bag': 'a', 'duration_s': 1.0, 'latency_ms': {}, 'onset_latency_ms': {}}
    found |= {'slips': {'count': 3, 'median_distance_mm': far_mm}}
    assert report.summary(found).splitlines() == ['a: 1.0 s', said]


def test_values_that_cannot_be_are_told_or_left_out(tmp_path):
    slips = [Slip(kind=Slip.KIND_STOP, distance=float(x)) for x in (0.004, np.nan, np.inf)]
    bag = bag_of(tmp_path / 'slips', [('slips', slip, k) for k, slip in enumerate(slips)])
    assert report.numbers(bag)['slips']['median_distance_mm'] == 4.0
    cascades = [Cascade(nucleus=nucleus, area=1, size=1) for nucleus in (7, 255)]
    bag = bag_of(tmp_path / 'cascades', [('cascades', one, k) for k, one in enumerate(cascades)])
    found = report.write(bag, tmp_path / 'report')
    assert found['cascades']['count'] == 2
    assert [line for line in found['lacking'] if line.startswith('catalogue')] == [
        'catalogue: 1 of 2 cascades left out: they begin at no block of the table, so the '
        'recording is damaged or does not say its table'
    ]
    assert len((tmp_path / 'report/catalogue.csv').read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ('late_ms', 'said', 'kept'),
    [
        ([0.0, 0.0], ['not measured, messages have the time of the image'], {}),
        ([1e12, -1e9], ['2 of 2 left out, beyond 600 s: times are 0 or of another clock'], {}),
        ([0.0, 1e12], ['1 of 2 left out, beyond 600 s: times are 0 or of another clock',
                       'not measured, messages have the time of the image'], {}),
        ([1.0, 3.0, 1e12], ['1 of 3 left out, beyond 600 s: times are 0 or of another clock'],
         {'blocks': {'p50': 2.0, 'p99': 2.98, 'max': 3.0, 'count': 2}}),
    ],
)  # fmt: skip
def test_invalid_delays_are_reported_by_cause(late_ms, said, kept):
    found = {'latency_ms': {'blocks': report._summary(np.array(late_ms))}, 'onset_latency_ms': {}}
    assert report._of_another_clock(found) == [f'delay of blocks: {line}' for line in said]
    assert found['latency_ms'] == kept


def test_too_few_cascades_are_not_fitted(tmp_path):
    bag, _ = made(tmp_path / 'run', 18)
    found = report.numbers(bag)
    why = '18 cascades are too few for a power law of areas: 200 are needed'
    assert found['cascades']['why'] == why
    assert 'b_value' not in found['cascades']
    words = report.summary(found)
    assert f'{why}; the largest had' in words
    lacks = [line for line in words.splitlines() if line.startswith('not fitted')]
    assert lacks == [
        f'not fitted, too few: {found["cascades"]["from_rest_to_rest"]["count"]} cascades '
        'from rest to rest of the whole table, 200 needed'
    ]
    assert words.count('are needed') == 1


@pytest.mark.parametrize(
    ('topic', 'messages', 'said'),
    [
        ('/eol/slips', 0, 'the bag is empty: no messages, so nothing can be said of a table'),
        ('/chatter', 9, 'a bag of something else: none of its 1 topics (/chatter) is of eol_ros'),
        ('/eol/slips', 2, None),
    ],
)
def test_an_empty_or_foreign_bag_says_what_it_cannot_say(tmp_path, capsys, topic, messages, said):
    bag = BagWriter(tmp_path / 'run', [BagTopic(topic, **describe('slips'))], {})
    slip = bytes(serialize_message(Slip(kind=Slip.KIND_START)))
    for i in range(messages):
        bag.write(topic, slip, T0 + i * 10**9, T0 + i * 10**9)
    bag.close()

    assert cli.main(['report', str(tmp_path / 'run'), '--output', str(tmp_path / 'out')]) == 0
    lines = [
        'cascades: no law and no energies, since the bag has no cascades',
        'light: not measured, since the bag has no led_commands',
    ]
    page = (tmp_path / 'out/report.html').read_text()
    words = capsys.readouterr().out
    for line in [said, *lines] if said else lines:
        assert line in page and line in words.splitlines()
    assert said or ('is of eol_ros' not in words and 'is empty' not in words)
    unknown = [line for line in words.splitlines() if '1/f is undecided' in line]
    names = [name for line in unknown for name in line.split(':')[0].split(', ')]
    assert sorted(names) == sorted(series.NAMES)
    whys = [line.split(': ', 1)[1] for line in unknown]
    assert len(whys) == len(set(whys)) < 5  # each said once


def test_moment_and_energy_need_what_was_measured(big, found):
    bag, _ = big
    told = bag.table('cascades')
    table = TwinSettings(stiffness=50.0, stiffness_error=2.0, mu_kinetic=0.5, block_kg=0.3)
    known = report.numbers(bag, measured=table)['catalogue']['energy']['sentence']
    rows = catalogue_file.of(bag, told, table)

    assert 'not known' in found['catalogue']['energy']['sentence']
    assert np.isnan(catalogue_file.of(bag, told)['energy_j']).all()
    np.testing.assert_allclose(rows['energy_j'], 0.5 * 0.3 * 9.81 * told['distance'])
    np.testing.assert_allclose(rows['moment_nm'], 50.0 * 0.174 * told['distance'])
    assert 'spring 50 N/m +- 2, mu_k 0.5 (not measured), 0.3 kg' in known
    assert f'friction took {rows["energy_j"].sum():.3g} J' in known


def test_the_same_slips_from_rest_to_rest(found):
    """In this bag every slip is over before the next: each is a cascade of one block."""
    other = found['cascades']['from_rest_to_rest']
    assert other['count'] == 2000 and other['largest'] == 1
    assert other['at_least'] == [2000] + [0] * 24
    assert other['sentence'].startswith('the same slips from rest to rest of the whole table')


def test_latency_of_light_and_sound(tmp_path):
    """Each slip: onset, image 10 ms later, first packet 6 ms after that, then 0.3 s of decay.

    And another one that its block felt, which lit itself 2 ms after the knock.
    """
    ms, messages = 1_000_000, []

    def write(topic, message, at):
        messages.append((topic, message, (at - T0) * 1e-9))

    for i in range(50):
        onset = T0 + i * 1000 * ms
        image = onset + 10 * ms
        slip = Slip(kind=Slip.KIND_START, slip=i, block=i % 25, onset=to_msg(onset))
        slip.header.stamp = to_msg(image)
        write('slips', slip, image + 4 * ms)
        for k in range(31):
            sent = image + 6 * ms + k * 10 * ms
            light = LedCommand(white=bytes(25), sequence=31 * i + k, sent=to_msg(sent))
            if k == 0:
                light.header.stamp = to_msg(image)
            write('led_commands', light, sent + 3 * ms)
        tap, sent = BlockTap(block=i % 25), onset + 502 * ms
        own = LedCommand(white=bytes(25), sequence=31 * i + 30, sent=to_msg(sent))
        tap.header.stamp = own.header.stamp = to_msg(onset + 500 * ms)
        write('block_taps', tap, sent + 3 * ms)
        write('led_commands', own, sent + 80 * ms)
        for later, block in ((0, (i + 1) % 25), (20, i % 25), (40, i % 25)):
            grain = GrainTrigger(sequence=3 * i + later // 20, block=block)
            grain.header.stamp = to_msg(image + later * ms)
            late = 5 if i < 40 else 60  # of the last ten the trigger comes after it was due
            write('grain_triggers', grain, image + (later + late) * ms)
    scene = 'nodes: {sound: {latency_s: 0.025}}\n'
    found = report.numbers(bag_of(tmp_path / 'run', messages, settings=scene))
    light, onset = found['latency_ms']['led_commands'], found['onset_latency_ms']
    assert light == {'p50': 6.0, 'p99': 6.0, 'max': 6.0, 'count': 50}
    assert onset['slips']['p50'] == pytest.approx(14.0, abs=0.01)
    assert onset['led_commands'] == {'p50': 16.0, 'p99': 16.0, 'max': 16.0, 'count': 50}
    assert onset['own_light'] == {'p50': 2.0, 'p99': 2.0, 'max': 2.0, 'count': 50}
    # the block's own grain for an image 20 ms later, due after 25 ms more
    assert onset['first_sample']['p50'] == pytest.approx(55.0, abs=0.01)
    assert onset['first_sample']['max'] == pytest.approx(90.0, abs=0.01)
    words = report.summary(found)
    assert 'median delay of led_commands: 6.0 ms after the image (99 % within 6.0 ms)' in words
    assert 'led_commands: 16.0 ms after the onset of the slip' in words


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


@pytest.mark.parametrize('rejected', [False, True])
def test_a_law_that_is_rejected_has_no_line(rejected):
    """The band holds the points it is of; the fit is drawn only where it is not ruled out."""
    from matplotlib import pyplot

    rng = np.random.default_rng(1)
    areas = powerlaw.sample(1.7, 1, 25, 1000, rng)
    if rejected:
        areas[::4] = 25
    found = report.law(areas, 25)
    assert found['rejected'] is rejected
    figure = figures._areas(areas, found, 25, 'note')
    c = figure.columns
    assert np.isnan(c['fit']).all() == rejected
    reached = c['cascades_at_least']
    assert (c['low'] <= reached).all() and (reached <= c['high']).all()
    picture, axes = pyplot.subplots()
    figure.paint(axes, c)
    drawn = {line.get_label(): len(line.get_xdata()) for line in axes.lines}
    pyplot.close(picture)
    law = [length for label, length in drawn.items() if label.startswith(('b = ', 'not a power'))]
    assert law == [0 if rejected else 25]
    assert any(label.startswith('not a power law: KS') for label in drawn) is rejected


@pytest.mark.slow
def test_the_same_bag_gives_the_same_page_by_the_command(big, page, tmp_path, capsys):
    assert cli.main(['report', str(big[0].path), '--output', str(tmp_path), '--json']) == 0
    assert json.loads(capsys.readouterr().out) == page[1]
    for file in page[0].iterdir():
        assert file.read_bytes() == (tmp_path / file.name).read_bytes(), file.name


def test_csv_and_mistakes(big, tmp_path, capsys):
    path = str(big[0].path)
    assert cli.main(['report', path, '--csv', 'slips', '--output', str(tmp_path / 'c')]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / 'c' / 'slips.csv')
    with open(tmp_path / 'c' / 'slips.csv', newline='') as file:
        assert len(list(csv.DictReader(file))) == 4000
    (tmp_path / 'not.txt').write_text('not a bag')
    for words, code in (
        ((str(tmp_path / 'absent'),), 69),
        ((str(tmp_path / 'not.txt'),), 78),
        ((path, '--csv', 'walls'), 78),
        ((path, '--csv', ''), 2),
        ((path, '--retrack'), 78),
        ((path, '--csv', 'slips', '--output', str(tmp_path / 'not.txt' / 'x')), 78),
    ):
        got = cli.main(['report', *words])
        said = capsys.readouterr()
        assert (got, said.out, said.err.count('\n')) == (code, '', 1), (words, said)

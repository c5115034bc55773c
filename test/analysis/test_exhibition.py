# SPDX-License-Identifier: Apache-2.0
"""A week of bags made here, with a known drift, a block that dies and an hour of visitors."""

import dataclasses
import datetime
import json
import os

import numpy as np
import pytest
from eol_msgs.msg import BlockTap, Cascade, Slip
from support.bag_samples import T0, bag_of
from support.paper import rest_lattice

from eol_ros import cli
from eol_ros.analysis import catalogue_file, exhibition, report
from eol_ros.core.science import powerlaw
from eol_ros.core.table import Table
from eol_ros.devices.bag.writer import REPLAY_OF
from eol_ros.errors import ConfigError
from eol_ros.lab.sweeps import crews, work
from eol_ros.ros.stamps import to_msg
from eol_ros.web import notices

S = 1_000_000_000
ZONE = datetime.timezone(datetime.timedelta(hours=2))
MONDAY = int(datetime.datetime(2026, 6, 1, 9, 30, tzinfo=ZONE).timestamp()) * S
DAY_S, DAYS, SLIPS = 24 * 3600, 6, 240
DRIFT = 0.05  # of the distance, a day
DEAD, DIES = 7, 3  # block, and the day from which on it does not slip
HOURS = 3.0  # each day from 9:30
VISITS = (0.25, 1.0, 2.6)  # hours after 9:30 when a minute of visit begins


def write(folder, day, about=None):
    """One day: slips in three visits, one after the other, each a cascade of its own."""
    rng = np.random.default_rng(day)
    begin = MONDAY + day * DAY_S * S
    told = []

    def tell(topic, message, at):
        told.append((topic, message, (at - T0) / S))

    def knock(at):
        tap = BlockTap(block=3)
        tap.header.stamp = to_msg(at)
        tell('block_taps', tap, at)

    knock(begin)
    for k in range(SLIPS):
        at = begin + round((VISITS[k % 3] * 3600 + 60 * (k // 3) / (SLIPS // 3)) * S)
        block = int(rng.integers(25))
        if block == DEAD and day >= DIES:
            block = 8
        area = 1 if k % 5 else 4
        distance = 0.01 * (1 + DRIFT * day) * rng.uniform(0.9, 1.1)
        for kind, when in ((Slip.KIND_START, at), (Slip.KIND_STOP, at + S // 10)):
            slip = Slip(
                kind=kind, slip=k, block=block, distance=distance * (kind == Slip.KIND_STOP)
            )
            slip.header.stamp = to_msg(when)
            tell('slips', slip, when)
        cascade = Cascade(
            cascade=k, area=area, size=area, blocks=list(range(area)), nucleus=block,
            distance=area * distance, duration=0.1,
        )  # fmt: skip
        cascade.onset = to_msg(at)
        tell('cascades', cascade, at + S // 5)
    knock(begin + round(HOURS * 3600) * S)
    bag_of(folder / f'day{day}', told, versions='eol_ros 0.2.0', **(about or {}))


@pytest.fixture(scope='module')
def week(tmp_path_factory):
    folder = tmp_path_factory.mktemp('week')
    for day in range(DAYS):
        write(folder, day)
    return folder


@pytest.fixture(scope='module')
def digests(week):
    return [exhibition.digest(path, ZONE) for path in exhibition.bags_in([week])[0]]


@pytest.fixture(scope='module')
def found(digests):
    return exhibition.numbers(list(reversed(digests)), [])


def test_days_and_hours_are_counted_in_local_time(found):
    assert [d['day'] for d in found['days']] == [f'2026-06-0{k + 1}' for k in range(DAYS)]
    for day in found['days']:
        assert day['starts'] == 1 and day['up_s'] == pytest.approx(HOURS * 3600)
        assert day['up_share'] == pytest.approx(1) and day['visits'] == len(VISITS)
        assert day['slips'] == day['cascades'] == SLIPS
    monday = {h['hour'][11:]: h for h in found['hours'] if h['hour'].startswith('2026-06-01')}

    assert {h: row['up_s'] for h, row in monday.items()} == {
        '09': 1800, '10': 3600, '11': 3600, '12': 1800
    }  # fmt: skip
    assert {h: row['visits'] for h, row in monday.items()} == {'09': 1, '10': 1, '11': 0, '12': 1}
    assert sum(row['slips'] for row in monday.values()) == SLIPS
    assert found['up_s'] == pytest.approx(DAYS * HOURS * 3600)


def test_friction_drifts_as_much_as_was_made(found):
    friction = found['friction']
    # medians are relative to that of all days, which lies in their middle
    assert friction['per'] == 'day'
    assert friction['slope'] == pytest.approx(DRIFT / (1 + DRIFT * (DAYS - 1) / 2), rel=0.15)
    assert friction['p_value'] < 0.01
    assert 'single slips become longer' in friction['sentence']


def test_without_drift_there_is_no_trend(digests):
    still = [d for d in digests if d.path.endswith('day2')]
    copies = []
    for day in range(6):
        rows = still[0].rows.copy()
        rows['onset_ns'] += (day - 2) * DAY_S * S
        copies.append(exhibition.Digest(**{**vars(still[0]), 'rows': rows}))

    assert 'no trend' in exhibition._friction(copies)['sentence']


def test_a_dead_block_is_named_with_its_last_slip(found):
    dead = [d for d in found['dead_blocks'] if d['what'] == 'slips']

    assert [d['block'] for d in dead] == [DEAD]
    assert dead[0]['since'].startswith('2026-06-03') and dead[0]['expected'] >= exhibition.DEAD
    assert exhibition.NOT_TOLD in exhibition.sentences(found)
    said = [line for line in exhibition.sentences(found) if 'no longer' in line]
    assert len(said) == 1
    assert f'slip no longer: block {DEAD} since {dead[0]["since"]} (' in said[0]
    assert not [d for d in found['dead_blocks'] if d['what'] == 'taps']  # twelve in all


def test_blocks_that_are_silent_alike_are_told_of_once(digests):
    """Four never slipped, of which one tells of knocks; two more stop."""
    rng = np.random.default_rng(1)
    blocks = rng.choice([b for b in range(25) if b not in (1, 2, 3, 4)], 4000)
    times = digests[0].start_ns + np.arange(4000) * S
    gone = ((blocks == 5) & (np.arange(4000) > 1000)) | ((blocks == 6) & (np.arange(4000) > 2000))
    slips = np.stack([times, blocks], axis=1)[~gone]
    taps = slips.copy()
    taps[::30, 1] = 4
    one = exhibition.Digest(**{**vars(digests[0]), 'slips': slips, 'taps': taps})
    dead = exhibition._dead([one], 'slips') + exhibition._dead([one], 'taps')
    said = exhibition._said_of_dead(dead)

    assert [line.split(' (')[0] for line in said[:2]] == [
        'blocks 1, 2, 3 never slipped nor told of a knock', 'block 4 never slipped',
    ]  # fmt: skip
    assert [line.split(':')[0] for line in said[2:]] == [
        'slip no longer', 'tell of knocks no longer',
    ]  # fmt: skip
    assert said[2].count('since 2026-06-01') == 2 and 'block 5 since' in said[2]
    assert exhibition._said_of_dead([]) == ['no block has fallen silent']


def test_bags_of_several_tables_are_no_exhibition(digests):
    other = dataclasses.replace(digests[1], table=Table(rows=4, columns=6))

    with pytest.raises(ConfigError, match=r'day1: its table .*day0: rows 4, not 5, columns 6'):
        exhibition.numbers([digests[0], other], [])


def test_only_blocks_that_are_there_can_fall_silent(digests):
    """Half an equal share is due to each of five blocks, and to a hole none."""
    times = digests[0].start_ns + np.arange(60) * S
    slips = np.stack([times, np.zeros(60, np.int64)], axis=1)
    one = dataclasses.replace(digests[0], slips=slips, table=Table(rows=2, columns=3, absent=(4,)))

    assert [b['block'] for b in exhibition._dead([one], 'slips')] == []
    one = dataclasses.replace(one, slips=np.repeat(slips, 4, axis=0))
    assert [b['block'] for b in exhibition._dead([one], 'slips')] == [1, 2, 3, 5]


def test_a_day_says_only_what_the_whole_does_not(digests):
    """Three days of one law, three of another: the verdict stands once, days show their own."""
    days = []
    for k, one in enumerate(digests):
        law = np.random.default_rng(k)
        rows = np.repeat(one.rows, 4)
        rows['area'] = powerlaw.sample(1.7, 1, 25, len(rows), law) if k < 3 else (
            np.minimum(law.geometric(0.2, len(rows)), 25)
        )  # fmt: skip
        days.append(exhibition.Digest(**{**vars(one), 'rows': rows}))
    found = exhibition.numbers(days, [])
    said = exhibition.sentences(found)

    assert said[2].endswith(found['cascades']['sentence'])
    assert 'day by day: a power law is rejected on 3 of 6 days' in said[3]
    assert '; on the others b is 0.' in said[3]
    for k, day in enumerate(found['days']):
        assert day['law'].startswith('b = 0.' if k < 3 else 'rejected, p 0.')
        assert len(day['law']) < 30 and day['law'] not in ' '.join(said)


def test_the_catalogue_has_units_and_origin(week, tmp_path, capsys):
    assert cli.main(['report', str(week), '--all', '--output', str(tmp_path), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    about = json.loads((tmp_path / 'catalogue.json').read_text())
    table = np.genfromtxt(tmp_path / 'catalogue.csv', delimiter=',', names=True, dtype=None)
    place = rest_lattice()[table['nucleus']]

    assert found['bags'] == DAYS and len(table) == DAYS * SLIPS
    assert list(table.dtype.names) == list(catalogue_file.COLUMNS) == list(about['columns'])
    assert about['columns']['potency_m']['unit'] == 'm'
    provenance = about['provenance']
    assert len(provenance['bags']) == DAYS and provenance['recorded_with'] == ['eol_ros 0.2.0']
    assert (np.diff(table['onset_ns']) >= 0).all()
    np.testing.assert_allclose(table['x_m'], place[:, 0])
    page = (tmp_path / 'report.html').read_text()
    assert 'slip no longer: block 7 since 2026-06-03' in page and '2026-06-06' in page
    assert (tmp_path / 'friction.svg').exists() and (tmp_path / 'hours.svg').exists()


def test_what_is_no_bag_is_named_and_left_out(week, tmp_path, capsys):
    write(tmp_path, 0, {REPLAY_OF: 'day0'})
    (tmp_path / 'broken').mkdir()
    (tmp_path / 'broken' / 'x_0.mcap').write_bytes(b'nonsense')
    empty = tmp_path / 'empty'
    empty.mkdir()
    words = [str(week / 'day1'), str(tmp_path), '--output', str(tmp_path / 'out')]

    assert cli.main(['report', *words]) == 0
    said = capsys.readouterr().out
    assert '1 bags' in said and 'day0: a replay, left out' in said and 'broken' in said
    with pytest.raises(ConfigError, match='no bags in this folder'):
        exhibition.bags_in([empty])
    assert cli.main(['report', str(empty), '--all']) == os.EX_CONFIG
    assert cli.main(['report', *words, '--csv', 'slips']) == 2
    assert (
        cli.main(['report', str(tmp_path), '--all', '--output', str(tmp_path / 'o')])
        == os.EX_CONFIG
    )
    assert 'no bag that can be reported' in capsys.readouterr().err


def test_files_beside_the_bags_of_a_folder_are_named_and_left_out(tmp_path, capsys):
    """What was cut out of a bag, or is no bag at all, neither counts nor stands in the way."""
    write(tmp_path, 1)
    whole = next(iter((tmp_path / 'day1').glob('*.mcap')))
    (tmp_path / 'cut.mcap').write_bytes(whole.read_bytes())
    (tmp_path / 'broken.mcap').write_bytes(b'nonsense')

    assert cli.main(['report', str(tmp_path), '--all', '--output', str(tmp_path / 'out')]) == 0
    said = capsys.readouterr().out
    assert '1 bags' in said and f'{SLIPS} slips' in said
    assert f'{tmp_path}/broken.mcap: a file beside the bags, left out' in said
    named = [tmp_path, tmp_path / 'cut.mcap']
    paths, left_out = exhibition.bags_in(named)
    assert [path.name for path in paths] == ['day1', 'cut.mcap'] and len(left_out) == 1


def test_panel_report_and_exhibition_give_one_answer(tmp_path):
    """Cascades that were told in another order than they began: blocks of the bootstrap differ."""
    rng = np.random.default_rng(5)
    areas = powerlaw.sample(1.5, 1, 25, 1500, rng)
    messages, day = [], notices.Day()
    for i, area in enumerate(areas.tolist()):
        told = MONDAY + i * S
        cascade = Cascade(cascade=i, area=area, size=area, blocks=list(range(area)), distance=0.01)
        cascade.onset = cascade.header.stamp = to_msg(told - int(rng.integers(0, 300)) * S)
        messages.append(('cascades', cascade, (told - T0) / S))
        day.add(cascade, MONDAY / S)
    bag = bag_of(tmp_path / 'run', messages)
    day.fit()
    shown = day.notice()['law']
    alone = report.numbers(bag)['cascades']
    whole = exhibition.numbers([exhibition.digest(tmp_path / 'run', ZONE)], [])

    assert shown['fitted'] == alone['count'] == whole['cascades']['count'] == 1500
    assert whole['cascades'] == {k: v for k, v in alone.items() if k != 'median_size'}
    assert (shown['b'], shown['error'], shown['from'], shown['count']) == tuple(
        alone[name] for name in ('b_value', 'b_error', 'area_min', 'fitted')
    )
    onsets = exhibition.digest(tmp_path / 'run', ZONE).rows
    order = np.argsort(onsets['onset_ns'], kind='stable')
    assert report.law(onsets['area'][order], 25) != whole['cascades']  # so the order matters


@pytest.mark.slow
def test_two_processes_read_the_same_as_one(week, digests, monkeypatch):
    monkeypatch.setenv(work.THREADS, '1')
    with crews.local(2) as crew:
        paths = [*exhibition.bags_in([week])[0], week / 'none']
        read = [one for one, _ in crew.work_through(exhibition.digest, paths, 2)]
    left_out = [one for one in read if isinstance(one, str)]
    there = exhibition.numbers([one for one in read if not isinstance(one, str)], left_out)
    here = exhibition.numbers(
        [exhibition.digest(path) for path in exhibition.bags_in([week])[0]], []
    )

    assert len(left_out) == 1 and 'no such bag' in left_out[0]
    assert there | {'left_out': []} == here

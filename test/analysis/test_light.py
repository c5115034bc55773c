# SPDX-License-Identifier: Apache-2.0
"""A cascade's light against levels made here; its figures against signals."""

from pathlib import Path

import numpy as np
import pytest
from eol_msgs.msg import Cascade, LedCommand, Slip
from support.bag_samples import T0, bag_of

from eol_ros.analysis import figures, light, report
from eol_ros.analysis.bag import open_bag
from eol_ros.core.table import Table
from eol_ros.errors import ConfigError
from eol_ros.ros.stamps import to_msg

S = 1_000_000_000
SAMPLE = Path(__file__).parents[2] / 'bags' / 'sample'


def at_ns(at_s):
    return T0 + round(at_s * S)


def packet(at_s, cells=25, **levels):
    white = np.zeros(cells, np.uint8)
    for block, level in levels.items():
        white[int(block[1:])] = level
    return 'led_commands', LedCommand(white=white, sent=to_msg(at_ns(at_s))), at_s


@pytest.fixture
def bag(tmp_path):
    """Blocks 7 and 8 flash at 0.05 s, 8 again before it is dark at 0.5 s, 9 at 1.3 s."""
    cascade = Cascade(cascade=1, area=3, size=4, blocks=[7, 8, 9], duration=1.3)
    cascade.onset = to_msg(at_ns(0.05))
    small = Cascade(cascade=2, area=1, size=1, blocks=[3], duration=0.1)
    small.onset = to_msg(at_ns(0.0))
    packets = [
        packet(0.0), packet(0.05, b7=255, b8=200), packet(0.3, b7=180, b8=120),
        packet(0.5, b7=120, b8=255), packet(0.9, b8=100), packet(1.3, b8=60, b9=90),
        packet(2.0, b8=80), packet(3.0),
    ]  # fmt: skip
    cascades = [('cascades', cascade, 1.4), ('cascades', small, 0.2)]
    return bag_of(tmp_path / 'run', [*packets, *cascades])


def test_the_greatest_cascade_is_shown_as_its_light_was(bag):
    found = light.frames(bag, bag.table('cascades'))
    level = found['level'].reshape(light.FRAMES, 25)
    times_s = found['time_s'].reshape(light.FRAMES, 25)[:, 0]

    assert times_s.tolist() == pytest.approx([0.05, 0.55, 1.05])
    assert np.flatnonzero(level[0]).tolist() == [7, 8]
    # onset at 0.05 s, so the frames are at 0.1, 0.6 and 1.1 s
    np.testing.assert_allclose(level[:, 7] * 255, [255, 120, 0])
    np.testing.assert_allclose(level[:, 8] * 255, [200, 255, 100])


def test_light_that_comes_in_parts_is_the_same(bag, monkeypatch):
    ((begin_s, whole),) = light.levels(bag)
    monkeypatch.setattr(light, 'CHUNK_S', 0.75)
    parts = list(light.levels(bag))
    assert begin_s == 0.0 and whole.max() == 1.0 and len(parts) == 4
    np.testing.assert_array_equal(np.concatenate([levels for _, levels in parts]), whole)


def test_turnover_counts_blocks_that_only_one_of_two_frames_has():
    lit = np.array([[1, 1, 0, 0], [1, 0, 1, 0], [0, 0, 0, 1]], bool)

    assert light.turnover(lit) == pytest.approx((2 + 3) / (3 + 3))
    assert light.turnover(lit & False) is None


def test_the_report_says_and_shows_it(bag, tmp_path):
    said = light.ask(bag)
    found = report.write(bag, tmp_path / 'out')
    page = (tmp_path / 'out' / 'report.html').read_text()

    assert said['sentences'][0].startswith('3 flashes: ')
    assert found['light'] == said and said['sentences'][0] in page
    assert said['sentences'][0] in report.summary(found)
    assert said['flash']['frames_lit'] == [2, 2, 1]
    assert said['flash']['frames_turnover'] == pytest.approx(1 / 4)
    assert (tmp_path / 'out' / 'light.svg').read_text().count(' ms</text>') == light.FRAMES
    assert (tmp_path / 'out' / 'light.csv').read_text().count('\n') == 1 + 25 * light.FRAMES
    lit = np.loadtxt(tmp_path / 'out' / 'light_share.csv', delimiter=',', skiprows=1)
    assert lit[:, 0].tolist() == [0, 1, 2] and lit[1, 1] > lit[2, 1] > 0


def test_a_flash_is_measured_by_its_levels():
    time_s = np.arange(int(35 * light.RATE_HZ)) / light.RATE_HZ
    levels = np.zeros((len(time_s), 25))
    for begin_s, blocks in ((1.0, slice(0, 1)), (2.5, slice(0, 1)), (4.0, slice(0, 20))):
        since_s = time_s - begin_s
        flash = np.where(since_s >= 0, np.exp(-since_s / 0.1), 0.0)
        levels[:, blocks] = np.maximum(levels[:, blocks], flash[:, None])
    whole, halves = light.Measure(Table()), light.Measure(Table())
    whole.add(levels)
    halves.add(levels[: len(levels) // 2])
    halves.add(levels[len(levels) // 2 :])
    found = whole.figures()

    assert found['flashes'] == 22
    assert found['flash_median_s'] == pytest.approx(0.1 * np.log(10), abs=0.02)
    assert found['many_lit'] == pytest.approx(1 / 3, abs=0.02)
    # one of 25 that shines deviates by sqrt(24) of the mean
    assert found['contrast_space'] == pytest.approx(24**0.5, abs=1e-6)
    assert found['contrast_time'] > 0.3
    assert found['most_falls_of_a_block'] == 1
    assert found['most_falls_of_a_square'] == 4
    assert found['at_limit'] == 0
    assert halves.figures()['flashes'] == 22
    share = whole.share()
    assert share['time_s'] == list(range(35))
    assert share['share'][4] == pytest.approx(20 / 25 * 0.1 * np.log(10), abs=0.01)
    assert sum(share['share'][5:]) == 0


def test_the_time_at_the_limit_is_measured():
    """Three falls in a second, at 0.1, 0.35 and 0.6 s: as many as are allowed, until 1.1 s."""
    time_s = np.arange(int(2 * light.RATE_HZ)) / light.RATE_HZ
    levels = np.zeros((len(time_s), 25))
    levels[:, 24] = 0.5  # there is light all the time
    levels[:, 0] = (time_s < 0.6) & (time_s % 0.25 < 0.1 - 1e-9)
    measure = light.Measure(Table())
    measure.add(levels)

    assert measure.figures()['at_limit'] == pytest.approx(0.5 / 2, abs=0.01)


def test_the_spectrum_has_the_power_of_the_light():
    time_s = np.arange(int(60 * light.RATE_HZ)) / light.RATE_HZ
    levels = np.zeros((len(time_s), 25))
    levels[:, 3] = 0.5 + 0.4 * np.sin(2 * np.pi * 4 * time_s)
    measure = light.Measure(Table())
    measure.add(levels)
    found = measure.spectrum()
    power = np.array(found['power_per_hz'])
    at = int(np.argmax(power))

    # bins 102 to 127 of a window of 30 s are one band
    assert found['frequency_hz'][at] == pytest.approx(np.mean(np.arange(102, 128)) / 30)
    assert power[at] * 26 / 30 == pytest.approx(0.4**2 / 2 / 25)
    assert np.delete(power, at).max() < 1e-20


def test_light_of_a_table_with_a_hole(tmp_path):
    """Eight of eleven blocks are many no more; the contrast and the picture leave the hole out."""
    settings = 'table: {rows: 3, columns: 4, absent: [5]}'
    lit = {f'b{block}': 255 for block in (0, 1, 2, 3, 4, 6, 7, 8)}
    cascade = Cascade(cascade=1, area=9, size=9, blocks=[*range(5), *range(6, 10)], duration=1.0)
    cascade.onset = to_msg(at_ns(0.95))
    slip = Slip(kind=Slip.KIND_START, block=11)
    slip.header.stamp = slip.onset = cascade.onset
    messages = [packet(1.0, 12, **lit, b9=255), packet(1.5, 12, **lit), packet(2.0, 12)]
    more = [('cascades', cascade, 2.5), ('slips', slip, 1.0)]
    bag = bag_of(tmp_path / 'run', [packet(0.0, 12), *messages, *more], settings=settings)
    found = report.write(bag, tmp_path / 'out')

    assert found['light']['flash']['many_lit'] == pytest.approx(0.5)
    nine, eight = (((11 - n) / n) ** 0.5 for n in (9, 8))
    assert found['light']['flash']['contrast_space'] == pytest.approx((nine + eight) / 2)
    assert found['light']['flash']['most_falls_of_a_square'] == 4
    assert found['light']['flash']['frames_lit'] == [9, 8, 0]
    said = found['light']['sentences']
    assert any(line.startswith('9 or more of 11 blocks lit for 50.0%') for line in said)
    counts = (tmp_path / 'out' / 'blocks.csv').read_text().split()
    assert len(counts) == 1 + 11 and counts[-1] == '11,2,3,1'
    areas = (tmp_path / 'out' / 'areas.csv').read_text().split()
    assert len(areas) == 1 + 11 and areas[-1].startswith('11,0,')


def test_light_of_another_table_than_the_bag_says_is_named(tmp_path):
    settings = 'table: {rows: 3, columns: 4}'
    bag = bag_of(tmp_path / 'run', [packet(0.0), packet(1.0)], settings=settings)

    with pytest.raises(ConfigError, match='a message has 25 levels of light.* 12 places: '):
        light.measured(bag)


def test_light_that_never_shone_has_no_figures(tmp_path):
    bag = bag_of(tmp_path / 'run', [packet(0.0), packet(1.0)])
    assert light.measured(bag)['sentences'] == ['flashes: no block was lit']


@pytest.mark.parametrize(('late_s', 'tau'), [((0.0, 0.0, 0.0, 0.0, 0.0), 1.0),
                                             ((0.16, 0.13, 0.0, 0.0, 0.0), 0.2)])  # fmt: skip
def test_the_order_of_lighting_is_held_against_that_of_onsets(tmp_path, late_s, tau):
    cascade = Cascade(cascade=1, area=5, size=5, blocks=[0, 1, 2, 3, 4], duration=0.5)
    cascade.onset = to_msg(at_ns(1.0))
    messages, lit = [('cascades', cascade, 1.6), packet(0.5)], {}
    shone_s = [1.0 + 0.05 * b + late for b, late in enumerate(late_s)]
    for block in np.argsort(shone_s).tolist():
        lit[f'b{block}'] = 191
        messages.append(packet(shone_s[block], **lit))
    for block in range(5):
        slip = Slip(kind=Slip.KIND_START, block=block, onset=to_msg(at_ns(1.0 + 0.05 * block)))
        messages.append(('slips', slip, 1.0 + 0.05 * block))
    found, share = light.recorded_order(bag_of(tmp_path / 'run', [*messages, packet(3.0)]))

    assert found == pytest.approx(tau) and share == 1


def test_a_bag_without_light_has_none(tmp_path):
    bag = bag_of(tmp_path / 'run', [('cascades', Cascade(area=1), 0.0)])

    assert light.ask(bag) is None and light.frames(bag, bag.table('cascades')) is None
    drawn = figures.of(None, None, {'bag': 'x', 'duration_s': 1.0}, Table())
    assert 'light' not in [f.name for f in drawn]


@pytest.mark.slow
def test_the_blocks_of_the_sample_flash_in_their_cascades():
    said = light.ask(open_bag(SAMPLE))

    assert said['flash']['cascade_lit'] > 0.85
    assert said['flash']['flash_median_s'] > 3  # it was recorded under flash_limit: field

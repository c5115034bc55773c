# SPDX-License-Identifier: Apache-2.0
"""What the blocks really show, read from the board at the other end of the line."""

import math
import time

import numpy as np
import pytest
from support.fake_board import FakeBoard
from support.flashes import changes
from support.set_clock import SetClock
from support.waiting import wait_until

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.table import Table
from eol_ros.devices.board.board import State
from eol_ros.devices.board.lights import Lights, Played, faults
from eol_ros.devices.board.twin import LINK_NS, Felt, Lamps, Radio, TwinBoard
from eol_ros.settings import LedsSettings

DAY_NS = 1_700_000_000_000_000_000  # when the replayed run was


@pytest.fixture
def fake():
    with FakeBoard() as one:
        yield one


@pytest.fixture
def make_lights():
    made = []

    def make(on_tap=lambda tap: None, table=Table(), **settings):
        lights = Lights(LedsSettings(**{'port': 'twin'} | settings), on_tap, table=table)
        made.append(lights)
        lights.start()
        count = table.count if lights.twin else 25
        wait_until(
            lambda: lights.board.ready and len(lights.board.blocks) > min(count, lights.board.count)
        )
        return lights

    yield make
    for lights in made:
        lights.close()


def seen(lights, block, stamp_ns):
    """A slip that began 15 ms before the image that shows it."""
    lights.slip(block, stamp_ns, stamp_ns - 15_000_000)


def replayed_storm(lights, fake, rate, seconds=2.0):
    """A slip of one block every 400 recorded ms, played at `rate`."""
    times, shown, at, told, began = [], [], 0.0, 0.0, time.monotonic()
    while (now := time.monotonic() - began) < seconds:
        if now * rate >= at:
            seen(lights, 12, DAY_NS + round(at * 1e9))
            at += 0.4
        for sent in lights.frame():
            told = sent.white[12] / 255
        times.append(now)
        shown.append(fake.levels()[12] / 255 if fake else told)
        time.sleep(0.002)
    return np.array(times), np.array(shown)


def flashes(found):
    """The most pairs of changes in any second."""
    return max(((found >= t) & (found <= t + 1)).sum() // 2 for t in found)


@pytest.mark.slow
def test_a_real_board_keeps_its_limit_in_wall_time_at_any_rate():
    """And the levels that are told with the twin's do not: they are those of the run again."""
    began_ns = time.time_ns()
    played = Played(
        lambda stamp: began_ns + (stamp - DAY_NS) // 4,
        lambda wall: DAY_NS + 4 * (wall - began_ns),
        lambda: 1.0,
    )
    most = {}
    with FakeBoard() as fake:
        boards = {'twin': None, fake.port: fake}
        for port, board in boards.items():
            lights = Lights(LedsSettings(port=port, decay_s=0.02), played=played)
            lights.start()
            wait_until(lambda board=lights.board: board.ready)
            began_ns = time.time_ns()
            most[port] = flashes(changes(*replayed_storm(lights, board, 4.0)))
            lights.close()
    assert most['twin'] > 3
    assert most[fake.port] <= 3


def told_by(lights, seconds=0.3):
    told = []

    def all_shown():
        told.extend(lights.frame())
        return time.monotonic() > end

    end = time.monotonic() + seconds
    wait_until(all_shown)
    return told


def test_a_block_that_felt_its_slip_is_not_lit_again(fake, make_lights):
    taps = []
    lights = make_lights(port=fake.port, on_tap=taps.append)
    wait_until(lambda: lights.board.sync.ready)
    fake.knock(3, 2.0, ago_s=0.004, lit_s=0.001)
    wait_until(lambda: taps)
    knock_ns = taps[0].stamp_ns
    lights.tap(3, knock_ns, taps[0].board_us)
    same_s = lights.slip(3, knock_ns + 20_000_000, knock_ns + 2_000_000)  # the same
    assert same_s == pytest.approx(-0.001)  # by its own light, 1 ms after the knock
    seen_s = lights.slip(4, knock_ns + 20_000_000, knock_ns + 2_000_000)  # only the camera saw it
    assert seen_s == pytest.approx((time.time_ns() - knock_ns) * 1e-9 - 0.002, abs=0.05)
    wait_until(lambda: fake.levels()[4] > 0)
    told = told_by(lights)
    assert [a.kind for a in fake.log if a.kind == 'Light'] == ['Light']
    by_knock, by_camera = (one for one in told if one.stamp_ns)
    assert by_knock.stamp_ns == knock_ns and by_camera.stamp_ns == knock_ns + 20_000_000
    assert by_knock.sent_ns - knock_ns == pytest.approx(1e6, abs=1)  # when it shone
    assert by_knock.white[3] == 191 and by_knock.white[4] == 0
    assert by_camera.white[4] == 191 and 0 < by_camera.white[3] < 191
    sent = [one.sent_ns for one in told if one is not by_camera]
    assert sent == sorted(sent)


@pytest.mark.parametrize(
    ('trigger', 'lit'), [('blocks', [3]), ('slips', [4]), ('both', [3, 4])]
)  # fmt: skip
def test_what_lights_is_chosen(fake, make_lights, trigger, lit):
    """Block 3 knocks, block 4 is seen."""
    taps = []
    lights = make_lights(port=fake.port, trigger=trigger, on_tap=taps.append)
    assert fake.bridge.by_itself == (trigger != 'slips')
    fake.knock(3, 2.0)
    wait_until(lambda: taps)
    lights.tap(3, taps[0].stamp_ns, taps[0].board_us)
    seen(lights, 4, time.time_ns())
    wait_until(lambda: all(fake.levels()[b] for b in lit))
    assert [b for b, level in enumerate(fake.levels()) if level] == lit
    lights.asleep = True
    lights.close()
    wait_until(lambda: not fake.bridge.by_itself)


def test_without_a_camera_light_goes_on_and_without_a_bridge_too(fake, make_lights):
    lights = make_lights(port=fake.port)
    fake.knock(1, 2.0)  # and no slip comes
    assert fake.levels()[1] > 0
    fake.fault('unplug')
    wait_until(lambda: not lights.board.ready)
    fake.knock(2, 2.0)
    assert fake.levels()[2] > 0
    seen(lights, 5, time.time_ns())
    assert fake.levels()[5] == 0


def test_what_is_wrong_with_a_block_is_a_line(fake, make_lights):
    lights = make_lights(port=fake.port)
    assert lights.faults() == []
    fake.report(4, millivolts=3000)
    fake.report(7, flags=protocol.LINKED | protocol.SENSOR_DEAD)
    fake.report(9, flags=0)
    fake.firmware = (2, 5)
    fake.report(10)
    wait_until(lambda: len(lights.faults()) == 4)
    battery, sensor, link, firmware = lights.faults()
    assert firmware.startswith('the firmware of block 10 is 2.5, and 2.6 is needed')
    assert battery == 'the battery of block 4 is at 3.0 V: charge it'
    assert sensor.startswith('the accelerometer of block 7 repeats one value')
    assert link.startswith('block 9 does not answer')
    assert lights.values()['lowest_battery_v'] == 3.0


def test_two_blocks_of_one_number_and_a_board_of_fewer_blocks_are_a_line_each(fake, make_lights):
    fake.count = 24
    lights = make_lights(port=fake.port)
    (count,) = lights.faults()
    assert count.startswith('the board drives 24 blocks, and the table has 25')
    fake.report(6, flags=protocol.LINKED | protocol.TWICE)
    wait_until(lambda: len(lights.faults()) == 2)
    assert lights.faults()[1].startswith('several blocks have the number 6: give all but')
    assert lights.board.ready  # the rest goes on


def test_the_board_of_the_twin_drives_any_table(make_lights):
    table = Table(rows=15, columns=15, block_side_m=0.03, gap_m=0.02, absent=(1,))
    radio = Radio()
    lamps = Lamps(radio, table)
    lights = make_lights(table=table, decay_s=0.5)
    fake = lights.twin.fake
    wait_until(lambda: lamps.advance(0.0, 0.0, [])[1] and radio.linked)
    seen(lights, 224, time.time_ns())
    wait_until(lambda: fake.levels()[224])
    light, _ = lamps.advance(1.0, 1.0, [])
    radio.close()

    assert np.flatnonzero(light).tolist() == [224]
    assert not lights.faults() and lights.values()['flash_limit'] == 'field_of_view'
    lights.infrared(1 << 224 | 1)
    wait_until(lambda: fake.infrared_mask == 1 << 224 | 1)
    fake.knock(1, 5.0)
    wait_until(lambda: lights.board.rejected == 1)  # there is no block


@pytest.mark.parametrize(
    ('version', 'limit'), [((2, 4), 'field'), (protocol.FIRMWARE, 'field_of_view')]
)
def test_the_bridge_is_told_of_another_table(fake, make_lights, version, limit):
    fake.firmware = version
    lights = make_lights(port=fake.port, table=Table(rows=3, columns=4))
    told = protocol.Lattice(4, 3, 12)
    wait_until(lambda: (fake.bridge.limit, fake.lattice) == ('field', told))
    lights.follow_firmware()
    wait_until(lambda: fake.bridge.limit == limit)
    assert lights.values()['flash_limit'] == limit


def test_a_table_within_the_numbers_of_the_board_has_no_other_blocks(fake, make_lights):
    lights = make_lights(port=fake.port, table=Table(rows=3, columns=4))
    fake.report(20, flags=0)
    fake.report(11, flags=0)
    wait_until(lambda: lights.faults())

    assert len(lights.faults()) == 1 and 'block 11' in lights.faults()[0]


def test_a_bridge_without_its_radio_is_one_line():
    def status(block, flags=0):
        return protocol.BlockStatus(block, 0, 0, *protocol.FIRMWARE, flags)

    blocks = {n: status(n) for n in range(25)}
    alone = status(protocol.BRIDGE, protocol.LINKED | protocol.RADIO_DEAD)
    (line,) = faults(blocks | {protocol.BRIDGE: alone})
    assert line.startswith('the radio of the bridge does not work')
    well = status(protocol.BRIDGE, protocol.LINKED)
    assert len(faults(blocks | {protocol.BRIDGE: well})) == 25


def test_a_slip_that_was_in_time_is_in_time_when_played_slowly(monkeypatch):
    """30 ms from the stamp to the light are 120 ms at a quarter of the speed."""
    wall_ns = DAY_NS
    monkeypatch.setattr('eol_ros.devices.board.lights.PLAYED_NS', 40_000_000)
    monkeypatch.setattr('eol_ros.devices.board.lights.time.time_ns', lambda: wall_ns)
    played = Played(
        lambda stamp: DAY_NS + 4 * (stamp - DAY_NS),
        lambda wall: DAY_NS + (wall - DAY_NS) // 4,
        lambda: 4.0,
    )
    lights = Lights(LedsSettings(port='twin'), played=played)
    lights.start()
    wait_until(lambda: lights.board.ready)
    for wall_ms in range(0, 2000, 4):
        wall_ns = DAY_NS + wall_ms * 1_000_000
        if wall_ms % 400 == 120:
            seen(lights, wall_ms // 400, wall_ns // 4 + 3 * DAY_NS // 4 - 30_000_000)
        lights.frame()
    lights.close()
    assert lights.glows and lights.frames.late == 0


def test_a_slip_is_shown_and_told(fake, make_lights):
    lights = make_lights(port=fake.port)
    stamp_ns = time.time_ns()
    seen(lights, 4, stamp_ns)
    wait_until(lambda: fake.levels()[4] > 0)
    sent = told_by(lights)[0]
    assert (sent.stamp_ns, sent.white[4], sent.infrared) == (stamp_ns, 191, True)
    assert lights.values()['sent'] >= 2
    lights.asleep = True
    orders = sum(a.kind == 'Light' for a in fake.log)
    seen(lights, 5, time.time_ns())
    told_by(lights, 0.1)
    assert sum(a.kind == 'Light' for a in fake.log) == orders


def test_light_runs_on_over_dark_blocks_at_the_delay_of_its_look(fake, make_lights):
    lights = make_lights(port=fake.port, spread_blocks=2, spread_delay_s=0.05)
    stamp_ns = time.time_ns()
    seen(lights, 6, stamp_ns - 20_000_000)
    seen(lights, 0, stamp_ns)
    lit = {}
    for sent in told_by(lights, 0.4):
        for block in range(25):
            if sent.white[block] >= 180:
                lit.setdefault(block, sent)
    orders = [a for a in fake.log if a.kind == 'Light']
    assert sorted(lit) == [0, 1, 2, 5, 6, 7, 8, 10, 11, 12, 16]  # each once: 1 is near both
    assert len(orders) == len(lit)
    lights.set(LedsSettings(port=fake.port, look='embers'))
    seen(lights, 24, time.time_ns())
    assert len(lights._running) == 0


def test_running_light_gets_dimmer(fake, make_lights):
    lights = make_lights(port=fake.port, spread_blocks=1, spread_share=0.5, spread_delay_s=0.05)
    seen(lights, 0, time.time_ns())
    brightest = np.max([np.frombuffer(one.white, np.uint8) for one in told_by(lights)], axis=0)

    assert brightest[[0, 1, 5]].tolist() == [191, 96, 96]
    kinds = [a.kind for a in fake.log if 'Light' in a.kind and a.kind != 'Lighting']
    assert kinds == ['Light', 'DimLight', 'DimLight']


def test_dim_light_runs_from_the_middle_while_all_is_still(fake, make_lights):
    lights = make_lights(port=fake.port, idle_period_s=1.0, spread_delay_s=0.05, decay_s=0.02)
    seen(lights, 24, time.time_ns())
    told_by(lights, 0.5)
    seen(lights, 24, time.time_ns())  # from here on
    slipped_ns, told = time.time_ns(), []

    def dimmed():
        return [a.time_ns for a in fake.log if a.kind == 'DimLight']

    def all_ran():
        told.extend(lights.frame())
        return len(dimmed()) >= 25

    wait_until(all_ran)
    told += told_by(lights)
    white = np.array([list(one.white) for one in told])

    assert dimmed()[0] - slipped_ns > 0.9e9
    assert white[:, :24].max(axis=0).tolist() == [48] * 24
    first = np.argmax(white > 0, axis=0)
    assert first[12] < first[7] < first[2] < first[1] < first[0]
    lights.set(LedsSettings(port=fake.port))
    count = len(dimmed())
    told_by(lights, 1.2)
    assert len(dimmed()) == count and not lights.glows


class Untouched:
    """Lights that nobody touches, on a clock of their own; `began`: when idle light began, s."""

    def __init__(self, monkeypatch, **settings):
        self.clock, self.began = SetClock(DAY_NS * 1e-9), []
        monkeypatch.setattr('eol_ros.devices.board.lights.time', self.clock)
        self.lights = Lights(LedsSettings(port='twin', **settings))
        self.lights.board.light = self.lit
        self.t0_ns = self.clock.steady_ns

    @property
    def now_s(self):
        return (self.clock.steady_ns - self.t0_ns) * 1e-9

    def lit(self, mask, stamp_us, share):
        if mask == 1 << 12 and share == 0.25:
            self.began.append(round(self.now_s, 2))
        return 0

    def wait(self, until_s, tick_ns=10_000_000):
        """Ask for frames as the node does: while light glows, or when idle light is due."""
        asked = 0
        while self.now_s < until_s:
            wait_s = self.lights.idle_in_s
            if self.lights.glows or (wait_s is not None and wait_s < 1e-9):
                self.lights.frame()
                asked += 1
            self.clock.steady_ns += tick_ns
        return asked


@pytest.fixture
def untouched(monkeypatch):
    made = []

    def make(**settings):
        made.append(Untouched(monkeypatch, **settings))
        return made[-1]

    yield make
    for one in made:
        one.lights.close()


def test_idle_light_begins_without_a_slip_and_nothing_runs_until_it_is_due(untouched):
    still = untouched(idle_period_s=6.0)
    assert still.wait(5.99) == 0
    frames = still.wait(18.5)

    assert still.began == [6.0, 12.0, 18.0]
    assert 50 < frames < 300  # of 1250


@pytest.mark.parametrize(
    ('changes', 'began'),
    [
        ([(10.0, 2.0)], [10.0, 12.0, 14.0]),  # shorter: it is due already
        ([(1.0, 4.0)], [4.0, 8.0, 12.0]),
        ([(1.0, 3.0), (2.0, 9.0)], [9.0]),  # longer again
        ([(1.0, 2.0), (5.0, 0.0)], [2.0, 4.0]),
        ([(0.0, 0.5)], [float(k) for k in range(1, 15)]),  # at least 1 s
    ],
)
def test_a_changed_idle_period_counts_at_once(untouched, changes, began):
    still = untouched(idle_period_s=60.0)
    for at_s, period_s in changes:
        still.wait(at_s)
        still.lights.set(LedsSettings(port='twin', idle_period_s=period_s))
    still.wait(14.99)

    assert still.began == began


def test_no_idle_light_while_asleep_nor_within_a_period_of_a_slip_or_of_waking(untouched):
    still = untouched(look='embers')
    still.wait(1.0)
    still.lights.asleep = True
    still.wait(20.0)
    assert still.lights.idle_in_s is None and not still.began
    still.lights.asleep = False
    still.wait(23.0)
    seen(still.lights, 3, still.clock.time_ns())
    still.wait(30.0)

    assert still.began == [29.0]


def test_idle_light_shows_the_stress_of_each_block(untouched):
    strains, shown = np.full(25, np.nan), {}
    strains[[3, 12, 24]] = 0.5, 0.0, 1.7
    still = untouched(idle_period_s=2.0, idle_by_stress=True)
    still.lights._stress = lambda: strains
    still.lights.board.light = lambda mask, stamp_us, share: shown.update({mask: share}) or 0
    still.wait(3.9)

    assert shown == {1 << 3: 0.125, 1 << 24: 0.25}
    still.lights.set(LedsSettings(port='twin', idle_period_s=2.0))
    still.wait(5.9)
    assert shown == {1 << block: 0.25 for block in range(25)}


def test_flashes_get_dimmer_over_the_fade_into_sleep_and_brighter_out_of_it(untouched):
    still, told = untouched(sleep_fade_s=3.0, peak=0.8), []
    lights = still.lights
    lights.board.state = State('ready', '')

    def configure(lighting, _detector):
        by_itself = bool(lighting.flags & protocol.BY_ITSELF)
        told.append((round(still.now_s, 2), lighting.peak / 255, by_itself))

    lights.board.configure = configure
    lights.asleep = True
    still.wait(1.5)
    seen(lights, 3, still.clock.time_ns())
    lights.frames.due(still.clock.time_ns())
    assert lights.frames.field.levels(0)[3] == pytest.approx(0.75 * 0.4, abs=0.02)
    still.wait(4.0)
    assert lights.dark and not lights.glows
    *fading, asleep = told
    assert asleep == (pytest.approx(3.0, abs=0.011), fading[-1][1], False)
    assert 25 < len(fading) < 33 and all(by_itself for *_, by_itself in fading)
    for at_s, peak, _ in fading:
        assert peak == pytest.approx(0.8 * (1 - at_s / 3), abs=0.01)
    assert lights.slip(4, still.clock.time_ns(), still.clock.time_ns()) is None
    lights.test(still.clock.time_ns())
    assert told[-1][1:] == (0.8, False)
    lights.frames.due(still.clock.time_ns())
    assert lights.frames.field.levels(0)[3] == pytest.approx(0.75 * 0.8, abs=0.01)

    told.clear()
    lights.asleep = False
    still.wait(5.0)
    lights.asleep = True  # half-way: from there
    still.wait(6.5)
    assert lights.dark and max(peak for _, peak, _ in told[:-1]) == pytest.approx(0.25, abs=0.03)
    lights.restart()
    assert told[-1][1:] == (0.8, True) and not lights.glows


def test_an_afterglow_runs_through_the_last_slips_in_their_order(fake, make_lights):
    lights = make_lights(port=fake.port, afterglow_s=1.2, decay_s=0.05)
    began_ns = time.time_ns()
    slips = [(9, 0.0), (3, 0.1), (20, 0.2), (9, 0.35)]
    levels, at_s = [], []
    while (now_s := (time.time_ns() - began_ns) * 1e-9) < 1.9:
        while slips and slips[0][1] <= now_s:
            block, after_s = slips.pop(0)
            seen(lights, block, began_ns + round(after_s * 1e9))
        for sent in lights.frame():
            levels.append(np.frombuffer(sent.white, np.uint8))
            at_s.append((sent.sent_ns - began_ns) * 1e-9)
        time.sleep(0.005)
    rises = np.diff(np.array(levels, int), axis=0, prepend=0) > 100
    again = [(int(b), at_s[k]) for k, b in np.argwhere(rises) if at_s[k] > 0.7]

    assert [block for block, _ in again] == [3, 20, 9]
    frames_s = np.array(at_s)
    for (_, t), due_s in zip(again, (1.3, 1.4, 1.55), strict=True):
        before_s = frames_s[frames_s < t].max()  # a frame of a busy machine may be late
        assert due_s - 0.06 < t and before_s < due_s + 0.06


def test_a_knock_is_reported_when_its_block_has_measured_it():
    """The twin's table is ahead; what is told later of an earlier knock comes later."""
    board, radio, taps = TwinBoard(), Radio(), []
    board.fake.knock = lambda *tap: taps.append((tap, time.time_ns()))
    now = time.time_ns()
    slow = Felt(now + 20_000_000, 3, 2.5, 0.5, told_s=0.06)
    quick = Felt(now + 40_000_000, 24, 0.25, 1.0, True)
    past = Felt(now + 10**10, 7, 2.5)  # the clock was set back since
    radio.send([slow, quick, past])
    wait_until(lambda: len(taps) == 3)
    board.close()
    radio.send([slow])  # nobody listens any more
    radio.close()

    assert [tap[0] for tap, _ in taps] == [7, 24, 3]
    for ((*what, ago_s, lit_s, woke), at_ns), knock in zip(taps[1:], (quick, slow), strict=True):
        assert (*what, lit_s, woke) == knock[1:5]
        assert at_ns >= knock.report_ns == knock.time_ns + round(1e9 * knock.told_s) + LINK_NS
        assert ago_s >= knock.told_s + 0.9e-3


def test_the_blocks_of_the_twin_do_what_their_board_says(make_lights):
    radio = Radio()
    lamps = Lamps(radio)
    assert lamps.advance(0.0, 1.0, [(0.9, 3)])[0][3] == pytest.approx(
        0.75 * math.exp(-0.1 / 17.3), rel=1e-3
    )
    lights = make_lights(decay_s=0.5, tap_threshold_mg=20, peak=0.8)
    told = []

    def threshold():
        told.append(lamps.advance(1.0, 1.0, [])[1])
        return told[-1] and told[-1].threshold

    wait_until(lambda: threshold() == 320)
    seen(lights, 9, time.time_ns())
    wait_until(lambda: lights.twin.fake.levels()[9])
    light, _ = lamps.advance(10.0, 10.0, [])
    assert light[9] == pytest.approx(0.6, abs=0.01) and np.count_nonzero(light) == 1
    lights.twin.fake.unplug()
    wait_until(lambda: not radio.linked)
    radio.close()
    before, after = (lamps.advance(10.5, t, [])[0][9] for t in (10.5, 11.5))
    assert after == pytest.approx(before * math.exp(-1 / 17.3), rel=1e-3)

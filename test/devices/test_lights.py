# SPDX-License-Identifier: Apache-2.0
"""What the blocks really show, read from the board at the other end of the line."""

import time

import numpy as np
import pytest
from support.waiting import wait_until

from eol_ros.devices.board.fake import FakeBoard
from eol_ros.devices.board.lights import Lights, Played
from eol_ros.devices.board.twin import Felt, Radio, TwinBoard
from eol_ros.errors import ConfigError
from eol_ros.settings import LedsSettings

DAY_NS = 1_700_000_000_000_000_000  # when the replayed run was


@pytest.fixture
def make_lights():
    made = []

    def make(**settings):
        made.append(Lights(LedsSettings(port='twin', **settings)))
        made[-1].start()
        assert wait_until(lambda: made[-1].board.ready)
        return made[-1]

    yield make
    for lights in made:
        lights.close()


def storm(lights, seconds=2.0):
    """A slip of one block every 90 ms; the levels that the board shows, and when."""
    fake, times, shown, at = lights.twin.fake, [], [], 0.0
    began = time.monotonic()
    while (now := time.monotonic() - began) < seconds:
        if now >= at:
            lights.slip(12, time.time_ns())
            at += 0.09
        else:
            lights.frame()
        times.append(now)
        shown.append(fake.levels()[12] / 255)
        time.sleep(0.002)
    return np.array(times), np.array(shown)


def replayed_storm(lights, fake, rate, seconds=2.0):
    """A slip of one block every 400 recorded ms, played at `rate`; as `storm`."""
    times, shown, at, began = [], [], 0.0, time.monotonic()
    while (now := time.monotonic() - began) < seconds:
        if now * rate >= at:
            lights.slip(12, DAY_NS + round(at * 1e9))
            at += 0.4
        lights.frame()
        times.append(now)
        shown.append(fake.levels()[12] / 255)
        time.sleep(0.002)
    return np.array(times), np.array(shown)


def flashes(found):
    """The most pairs of changes in any second."""
    return max(((found >= t) & (found <= t + 1)).sum() // 2 for t in found)


def changes(times, level):
    """When the light has turned round by 10 % or more."""
    found, direction, extreme = [], 0, level[0]
    for t, value in zip(times, level, strict=True):
        if (value - extreme) * direction > 0:
            extreme = value
        elif abs(value - extreme) >= 0.1:
            direction, extreme = (1 if value > extreme else -1), value
            found.append(t)
    return np.array(found)


@pytest.mark.slow
def test_a_storm_of_slips_is_no_strobe_on_the_blocks(make_lights):
    free = changes(
        *storm(
            make_lights(
                decay_s=0.02, flash_limit=False, flash_limit_off_because='to see the difference'
            )
        )
    )
    held = changes(*storm(make_lights(decay_s=0.02)))

    assert flashes(free) > 8
    assert flashes(held) <= 3


@pytest.mark.slow
def test_a_real_board_keeps_its_limit_in_wall_time_at_any_rate():
    """And the twin's does not: it is there to show the levels of the run again."""
    began_ns = time.time_ns()
    played = Played(
        lambda stamp: began_ns + (stamp - DAY_NS) // 4,
        lambda wall: DAY_NS + 4 * (wall - began_ns),
        lambda: 1.0,
    )
    most = {}
    with FakeBoard() as fake:
        for port in ('twin', fake.port):
            lights = Lights(LedsSettings(port=port, decay_s=0.02), played=played)
            lights.start()
            assert wait_until(lambda board=lights.board: board.ready)
            began_ns = time.time_ns()
            board = lights.twin.fake if port == 'twin' else fake
            most[port] = flashes(changes(*replayed_storm(lights, board, 4.0)))
            lights.close()
    assert most['twin'] > 3
    assert most[fake.port] <= 3


def test_levels_that_a_slip_overtakes_are_told_in_their_order(make_lights):
    lights = make_lights()
    now = time.time_ns()
    lights.slip(1, now - 100_000_000)
    told = lights.slip(2, now)

    assert len(told) == 11 and {one.sequence for one in told} == {told[0].sequence}
    assert [one.stamp_ns for one in told] == [0] * 10 + [now]
    faded = [one.white[1] for one in told]
    assert faded == sorted(faded, reverse=True) and faded[0] < 255
    assert [one.white[2] for one in told] == [0] * 10 + [255]
    assert wait_until(lambda: lights.twin.fake.levels()[2] == 255)
    assert sum(a.kind == 'Levels' for a in lights.twin.fake.log) == 3  # one at the start


def test_a_slip_that_was_in_time_is_in_time_when_played_slowly(monkeypatch):
    """30 ms from the stamp to the light are 120 ms at a quarter of the speed."""
    wall_ns = DAY_NS
    monkeypatch.setattr('eol_ros.devices.board.lights.time.time_ns', lambda: wall_ns)
    played = Played(
        lambda stamp: DAY_NS + 4 * (stamp - DAY_NS),
        lambda wall: DAY_NS + (wall - DAY_NS) // 4,
        lambda: 4.0,
    )
    lights = Lights(LedsSettings(port='twin'), played=played)
    for wall_ms in range(0, 2000, 4):
        wall_ns = DAY_NS + wall_ms * 1_000_000
        if wall_ms % 400 == 120:
            lights.slip(wall_ms // 400, wall_ns // 4 + 3 * DAY_NS // 4 - 30_000_000)
        lights.frame()
    lights.close()
    assert lights.glows and lights.frames.late == 0


def test_after_a_jump_back_the_twin_begins_in_the_dark_and_a_real_board_fades():
    played = Played(lambda stamp: stamp, lambda wall: wall, lambda: 1.0)
    with FakeBoard() as fake:
        for port, glows in (('twin', False), (fake.port, True)):
            lights = Lights(LedsSettings(port=port), played=played)
            lights.start()
            assert wait_until(lambda board=lights.board: board.ready)
            lights.slip(1, time.time_ns())
            lights.restart()
            assert lights.glows is glows
            lights.close()


def test_a_slip_is_shown_and_told(make_lights):
    lights = make_lights()
    (sent,) = lights.slip(4, 1_000_000_000)

    assert (sent.stamp_ns, sent.white[4], sent.infrared) == (1_000_000_000, 255, True)
    assert wait_until(lambda: lights.twin.fake.levels()[4] > 0)
    assert lights.values()['sent'] >= 2
    lights.asleep = True
    assert lights.slip(5, 2) == []


def test_the_limit_goes_off_only_with_a_reason():
    with pytest.raises(ConfigError, match='needs a written reason'):
        Lights(LedsSettings(port='twin', flash_limit=False))


def test_the_log_of_the_wire(tmp_path):
    path = tmp_path / 'wire.csv'
    lights = Lights(LedsSettings(port='twin', board_log=str(path)))
    lights.start()
    assert wait_until(lambda: lights.board.ready)
    lights.slip(0, time.time_ns())
    assert wait_until(lambda: 'wire_packets' in lights.values())
    lights.close()
    rows = [line.split(',') for line in path.read_text().split()]

    assert rows[0] == ['time_ns', 'kind', 'sequence', 'stamp_us']
    assert {'Hello', 'Infrared', 'Levels'} <= {row[1] for row in rows}
    assert lights.values()['wire_packets'] == 1
    assert lights.values()['wire_p50_ms'] > 0


def test_the_board_reports_what_the_blocks_of_the_twin_feel():
    board, radio, taps = TwinBoard(), Radio(), []
    board.fake.tap = lambda *tap: taps.append(tap)
    now = time.time_ns()
    radio.send([Felt(now - 20_000_000, 3, 2.5), Felt(now - 5_000_000, 24, 0.25)])
    sigma_s = board.listen()
    board.listen()  # nothing new
    board.close()
    radio.send([Felt(now, 1, 1.0)])  # nobody listens any more
    radio.close()

    assert [(block, strength) for block, strength, _ in taps] == [(3, 2.5), (24, 0.25)]
    ago_s = [ago_s for _, _, ago_s in taps]
    assert ago_s[0] - ago_s[1] == pytest.approx(0.015, abs=0.002) and ago_s[1] >= 0.005
    assert 0 < sigma_s < 1e-3


def test_of_two_boards_in_one_graph_the_first_hears():
    first, second, radio, taps = TwinBoard(), TwinBoard(), Radio(), []
    for name, board in (('first', first), ('second', second)):
        board.fake.tap = lambda *tap, name=name: taps.append(name)
    radio.send([Felt(time.time_ns(), 3, 2.5)])
    second.listen()
    first.listen()
    for end in (first, second, radio):
        end.close()
    assert taps == ['first']

# SPDX-License-Identifier: Apache-2.0
"""Which hop made a grain late: ways put together from times that are known."""

from benchmarks import sound_hops
from benchmarks.sound_hops import Passage, Taken, figures, passages, read_log
from benchmarks.sound_table import _hops

MS = 1_000_000


def test_a_trigger_is_followed_from_its_knock_or_its_image():
    log = [
        Taken(True, 100 * MS, 3, 7, 109 * MS, 110 * MS, 0.001),
        Taken(True, 104 * MS, 3, 8, 109 * MS, 110 * MS, 0.005),  # it had to wait: of a later stamp
        Taken(True, 300 * MS, 3, 7, 309 * MS, 310 * MS, 0.001),  # whose knock was not seen
        Taken(False, 100 * MS, 3, 9, 119 * MS, 120 * MS, -0.002),
        Taken(False, 100 * MS, 4, 9, 119 * MS, 120 * MS, -0.002),  # which was not seen sent
    ]
    sent = {
        (True, 100 * MS, 3, 7): 108 * MS, (True, 104 * MS, 3, 8): 108 * MS,
        (True, 300 * MS, 3, 7): 308 * MS, (False, 100 * MS, 3, 9): 118 * MS,
    }  # fmt: skip
    found = passages(
        log, sent, {100 * MS: (102 * MS, 105 * MS)}, {(3, 100 * MS): (106 * MS, 107 * MS)}
    )
    felt = tuple(ms * MS for ms in (100, 106, 107, 108, 109, 110))
    seen = tuple(ms * MS for ms in (100, 102, 105, 118, 119, 120))
    assert found == [
        Passage(True, felt, 0.001), Passage(True, felt, 0.005), Passage(False, seen, -0.002)
    ]  # fmt: skip


def test_the_hop_that_took_unusually_long_made_it_late():
    usual = (0, 5, 6, 7, 8, 9)
    slow_line, slow_sound = (0, 15, 16, 17, 18, 19), (0, 5, 6, 7, 14, 15)

    def of(way, spare_s, second):
        return Passage(True, tuple(ms * MS + second * 1000 * MS for ms in way), spare_s)

    ways = [of(usual, 0.002, k) for k in range(8)]
    ways += [of(slow_line, -0.008, 8), of(slow_sound, -0.004, 9), of(slow_sound, -0.004, 10)]
    stood = [(9.010, 9.012), (20.0, 21.0)]
    found = figures(ways, stood, 0)['felt']
    assert (found['triggers'], found['late'], found['late_while_it_stood']) == (11, 3, 1)
    assert found['latest_ms'] == 8.0
    assert {hop: one['made_late'] for hop, one in found['hops'].items()} == {
        'board': 1, 'motion': 0, 'grains': 0, 'sound': 2, 'mixer': 0
    }  # fmt: skip
    assert found['hops']['board']['p50'] == 5 and found['hops']['board']['most'] == 15
    assert figures(ways, None, 0)['felt']['late_while_it_stood'] is None
    (line,) = _hops({'felt': found})
    assert line.startswith('felt: 3 of 11 late, by 8.0 ms at most (1 of them in a standstill)')
    assert 'sound 1.00 / ' in line and '(made 2 late)' in line


def test_a_log_that_is_being_written_is_read_to_its_last_whole_line(tmp_path):
    path = tmp_path / 'triggers.csv'
    rows = [
        'felt,stamp_ns,block,grain,came_ns,taken_ns,spare_s',
        '1,100,3,7,109,110,-0.0015', '0,200,255,9,209,210,0.02', '1,300,3,7,30',
    ]  # fmt: skip
    path.write_text('\n'.join(rows))
    assert read_log(path) == [
        Taken(True, 100, 3, 7, 109, 110, -0.0015),
        Taken(False, 200, 255, 9, 209, 210, 0.02),
    ]
    assert set(sound_hops.HOPS) == {'felt', 'seen'}

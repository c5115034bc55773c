# SPDX-License-Identifier: Apache-2.0
"""eol bench graph: whose light is counted as whose, on messages made by hand."""

import types

import pytest
from eol_msgs.msg import BlockTap, FeltSlip, LedCommand, Slip

from benchmarks import graph as bench
from eol_ros.devices.board.fake import Arrival
from eol_ros.ros.stamps import to_msg

T0, MS = 1_700_000_000_000_000_000, 1_000_000


def stamped(message, stamp_ns):
    message.header.stamp = to_msg(stamp_ns)
    return message


@pytest.fixture
def graph():
    """Block 3 feels its slip and lights itself, block 4 is only seen, block 5 goes unseen."""
    felt, seen = T0, T0 + 500 * MS
    knock = felt + MS // 10
    slip = lambda kind, block, onset, stamp, tapped: stamped(  # noqa: E731
        Slip(kind=kind, block=block, onset=to_msg(onset), tapped=tapped), stamp
    )
    messages = {
        'block_taps': [stamped(BlockTap(block=3), knock), stamped(BlockTap(block=4), T0 - 90 * MS)],
        'led_commands': [
            stamped(LedCommand(sent=to_msg(felt + 2 * MS)), knock),
            LedCommand(sent=to_msg(felt + 12 * MS)),  # it fades
            stamped(LedCommand(sent=to_msg(seen + 22 * MS)), seen + 15 * MS),
        ],
        'felt_slips': [
            stamped(FeltSlip(kind=kind, block=3, onset=to_msg(knock)), knock)
            for kind in (FeltSlip.KIND_PROVISIONAL, FeltSlip.KIND_CONFIRMED)
        ],
        'slips': [
            slip(Slip.KIND_START, 3, felt + 3 * MS, felt + 15 * MS, False),
            slip(Slip.KIND_START, 4, seen - 4 * MS, seen + 15 * MS, False),
            slip(Slip.KIND_STOP, 3, knock, felt + 300 * MS, True),
            slip(Slip.KIND_STOP, 4, seen + 2 * MS, seen + 300 * MS, False),
        ],
    }
    key = (seen + 15 * MS) // 1000 % 2**32
    packets = {key: Arrival(seen + 22 * MS, 'Light', 1, key)}
    return types.SimpleNamespace(
        watch=types.SimpleNamespace(messages=messages.__getitem__), first_light=lambda: packets
    )


BEGUN = [(T0, 3), (T0 + 500 * MS, 4), (T0 + 600 * MS, 5)]


def test_light_of_slips_that_were_felt_and_of_those_only_seen(graph):
    felt, seen = bench.light_latencies(graph, BEGUN)
    assert felt == pytest.approx([2.0])
    assert seen == pytest.approx([22.0])


def test_onsets_by_the_camera_at_the_start_and_by_the_knock_at_the_stop(graph):
    errors = bench.onset_errors(graph, BEGUN)
    assert errors['START'] == {'rms': pytest.approx((25 / 2) ** 0.5, abs=0.01), 'count': 2}
    assert errors['knock'] == {'rms': pytest.approx(0.1), 'count': 1}
    assert errors['STOP, felt'] == {'rms': pytest.approx(0.1), 'count': 1}

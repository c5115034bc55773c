# SPDX-License-Identifier: Apache-2.0
"""Frames of the radio on the line between the emulated bridge and the blocks."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.core.serial_protocol import ProtocolError
from eol_ros.devices.board.firmware import FRAME, frame_from_air, frame_to_air

FRAMES = st.binary(min_size=FRAME, max_size=FRAME)


@given(FRAMES, st.integers(0, 255))
def test_a_frame_comes_back(frame, sequence):
    data = frame_to_air(frame, sequence)
    assert data[0] == data[-1] == 0
    assert frame_from_air(data[1:-1]) == frame


@given(FRAMES, st.data())
def test_a_frame_cut_by_a_reset_is_none(frame, data):
    whole = frame_to_air(frame, 7).strip(b'\0')
    cut = data.draw(st.integers(1, len(whole) - 1))
    for part in (whole[:cut], whole[cut:]):
        with pytest.raises(ProtocolError):
            frame_from_air(part)

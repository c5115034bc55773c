# SPDX-License-Identifier: Apache-2.0
"""The software board; test_board.py and test_lights.py speak to it as the host does."""

import math
import os

import pytest

from eol_ros.core import serial_protocol as p
from eol_ros.core.light.bridge import Bridge
from eol_ros.devices.board.fake import FakeBoard, obey
from eol_ros.errors import ConfigError


def test_a_log_that_cannot_be_written_is_refused(tmp_path):
    os.mkfifo(tmp_path / 'pipe')  # which nobody reads
    for name, why in (('pipe', 'a pipe or device'), ('gone/log.csv', 'cannot be written')):
        with pytest.raises(ConfigError, match=why):
            FakeBoard(log_file=str(tmp_path / name))


@pytest.fixture
def bridge():
    one = Bridge()
    one.link(0.0, True)
    obey(one, 0.0, p.Lighting(p.BY_ITSELF | p.LIMITED, 255, 182))
    return one


def test_without_a_bridge_blocks_flash_and_fade_slowly(bridge):
    bridge.link(2.0, False)
    bridge.felt(3.0, 5)
    assert bridge.levels(3.3)[5] == pytest.approx(math.exp(-0.3 / 4), abs=0.01)
    bridge.link(3.3, True)
    assert bridge.levels(5.5)[5] < 0.15


def test_while_a_block_is_silent_that_might_flash_nothing_falls(bridge):
    bridge.hear(2.0, 20, False)
    bridge.felt(3.0, 5)
    assert bridge.levels(3.5)[5] == pytest.approx(math.exp(-0.5 / 4), abs=0.01)
    bridge.hear(3.5, 20, True)
    assert bridge.levels(5.5)[5] < 0.15

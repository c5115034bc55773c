# SPDX-License-Identifier: Apache-2.0
"""The bridge's own program, compiled for this machine: blocks that have the same number."""

import ctypes

import pytest
from support.native import library

from eol_ros.core import serial_protocol as protocol

# Seconds of statuses, each `every_us` after the one before; returns the flags that are told last.
DRIVER = """
#include "bridge.h"
#include <string.h>
static eol_bridge bridge;
static uint64_t now_us;
void begin(void) { now_us = 1000000; eol_bridge_begin(&bridge, now_us); }
int after(double seconds, double every_us)
{
    uint8_t frame[EOL_FRAME], byte, kind;
    const uint8_t *body;
    size_t size;
    eol_decoder line;
    memset(&line, 0, sizeof line);
    int flags = -1;
    uint64_t end_us = now_us + (uint64_t)(seconds * 1e6);
    double due_us = (double)now_us;
    for (; now_us < end_us; now_us += 1000) {
        if (every_us > 0 && (double)now_us >= due_us) {
            due_us += every_us;
            memset(frame, 0, sizeof frame);
            frame[0] = EOL_FRAME_STATUS;
            frame[1] = 6;
            frame[5] = 2, frame[6] = 2, frame[7] = EOL_LINKED;
            eol_bridge_heard(&bridge, now_us, frame);
        }
        while (eol_bridge_says(&bridge, now_us, frame)) {}
        while (eol_bridge_sends(&bridge, &byte))
            if (eol_decode(&line, byte, &kind, &body, &size))
                if (kind == EOL_BLOCK_STATUS && body[0] == 6) flags = body[6];
    }
    return flags;
}
"""


@pytest.fixture
def bridge(tmp_path):
    made = library(tmp_path, DRIVER, 'bridge/bridge.c', 'bridge/flash.c', 'bridge/local.c')
    made.after.argtypes = ctypes.c_double, ctypes.c_double
    made.begin()
    return made


@pytest.mark.parametrize('every_us', [1e6, 0.9e6])  # a block's oscillator is 10 % fast at most
def test_one_block_is_one(bridge, every_us):
    assert bridge.after(60.0, every_us) == protocol.LINKED


def test_two_blocks_of_one_number_are_told_and_the_end_of_that_too(bridge):
    bridge.after(20.0, 1e6)
    assert bridge.after(20.0, 0.5e6) == protocol.LINKED | protocol.TWICE
    assert bridge.after(30.0, 1e6) == protocol.LINKED  # one of them was given its own


def test_two_that_fall_silent_are_two_until_one_is_heard(bridge):
    bridge.after(20.0, 0.5e6)
    assert bridge.after(30.0, 0.0) == protocol.TWICE
    assert bridge.after(5.0, 1e6) == protocol.LINKED | protocol.TWICE
    assert bridge.after(20.0, 1e6) == protocol.LINKED


def test_a_fifth_of_their_statuses_may_be_lost(bridge):
    """Two that speak at the same time are not heard."""
    assert bridge.after(30.0, 0.625e6) == protocol.LINKED | protocol.TWICE

# SPDX-License-Identifier: Apache-2.0
"""The twin's table with its firmware: an emulated block beside compiled ones; the rehearsal."""

import struct
from pathlib import Path

import numpy as np
import pytest
from support import needs
from support.emulated import WORD, built
from support.running import Graph
from support.true_slips import FPS, Twin
from support.waiting import wait_until

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.physics.twin.accelerometer import Accelerometers
from eol_ros.devices.board.block import LEARN
from eol_ros.devices.board.bluepill import KNOCK
from eol_ros.devices.board.firmware import (
    EMULATED,
    EmulatedBlock,
    FirmwareBoard,
    NativeBlocks,
)
from eol_ros.devices.board.twin import LIVE, REST, Chunk
from eol_ros.errors import DeviceMissing
from eol_ros.settings import TwinSettings

pytestmark = [
    pytest.mark.firmware,
    needs.marker(
        'gcc-avr', 'libsimavr-dev', 'gcc-arm-none-eabi', 'libnewlib-arm-none-eabi',
        'libunicorn-dev',
    ),
]  # fmt: skip
WORDS = struct.pack('<BBBHIIB', WORD, 1, 255, 350, 2**25 - 1, 0, 0).ljust(18, b'\0')


@pytest.fixture(autouse=True)
def firmware():
    return built()


def knocks(frames):
    return [struct.unpack('<BBBHHHB', f[:10]) for f in frames if f[0] == KNOCK]


def test_the_emulated_block_reports_what_a_compiled_one_does():
    """Both get the same chunks of the twin's samples, a millisecond at a time."""
    twin = Twin(5, 0.3)
    sensors = Accelerometers(TwinSettings(seed=5), always=True)
    rest = sensors.at_rest(LEARN + 288)
    chunks = [[] for _ in range(N_BLOCKS)]
    for begin_s, end_s in twin.images(round(8 * FPS)):
        moves = bool(twin.rim.velocity.any())
        keep = np.ones(N_BLOCKS, bool)
        for s in sensors.advance(begin_s, end_s, twin.table.trace, moves, keep):
            chunks[s.block].append(s)
    busiest = max(range(N_BLOCKS), key=lambda b: max(np.ptp(c.xy) for c in chunks[b]))
    native, emulated = NativeBlocks(), EmulatedBlock(EMULATED)
    native.feel(Chunk(EMULATED, REST, 0, 1 / 1344, rest[busiest]), 0.0)
    emulated.rest(rest[busiest])
    told, said = [], []
    begin_s = 1.0  # the emulated one has learnt by then
    for s in chunks[busiest]:
        first_s = begin_s + s.first_s
        native.feel(Chunk(EMULATED, LIVE, 0, s.period_s, s.xy), first_s)
        emulated.feel(first_s, s.period_s, s.xy)
    for ms in range(1, 9200):
        now_s = ms * 1e-3
        if ms % 2 == 0:
            native.hear(WORDS, 0)
            emulated.hear(WORDS)
        told += [(now_s, k) for k in knocks(native.run(now_s, 2**N_BLOCKS - 1)[1])]
        said += [(now_s, k) for k in knocks(emulated.run(now_s, True))]

    assert len(told) >= 3
    assert len(said) == len(told)
    for (heard_s, own), (other_s, other) in zip(told, said, strict=True):
        assert own[1] == other[1] == EMULATED
        assert other[4] == pytest.approx(own[4], rel=0.05, abs=2)  # its clock is another one
        onset_s, other_onset_s = heard_s - own[3] * 1e-6, other_s - other[3] * 1e-6
        assert other_onset_s == pytest.approx(onset_s, abs=2.5e-3)
        assert own[5] < 20_000 and other[5] < 20_000  # both lit themselves


def test_what_is_missing_is_one_line(monkeypatch, tmp_path):
    from eol_ros.devices.board import firmware

    monkeypatch.setattr(firmware, 'BUILT', tmp_path)
    with pytest.raises(DeviceMissing, match='make firmware'):
        FirmwareBoard()


@pytest.mark.timeout(600)
def test_the_rehearsal_runs_on_its_firmware(tmp_path):
    """Everything starts; the emulated block and others report their slips through the bridge."""
    scene = Path('firmware/rehearsal.yaml').resolve()
    copy = tmp_path / 'firmware.yaml'
    copy.write_text(
        f'include: {scene}\nscene: firmware\nnodes:\n  sound: {{device: wav}}\n'
        '  panel: {port: 0}\n'
    )
    watched = ('blocks', 'slips', 'block_taps')
    graph = Graph(copy, tmp_path / 'bags', watched, keep=('block_taps',))
    try:
        graph.wait_until_ok(300)
        wait_until(lambda: len(graph.watch.seen['slips']) > 20, 120)
        tapped = wait_until(lambda: blocks(graph) if EMULATED in blocks(graph) else None, 240)
        wait_until(lambda: len(blocks(graph)) > 5, 120)
        assert tapped
    finally:
        code = graph.stop()
    assert code == 0


def blocks(graph):
    from eol_msgs.msg import BlockTap
    from rclpy.serialization import deserialize_message

    return {deserialize_message(raw, BlockTap).block for raw in graph.watch.raw['block_taps']}

# SPDX-License-Identifier: Apache-2.0
"""The rehearsal with blocks and bridge that run their own firmware."""

from pathlib import Path

import pytest
from support import needs
from support.emulated import built
from support.running import Graph
from support.waiting import wait_until

from eol_ros.devices.board import firmware
from eol_ros.errors import DeviceMissing

pytestmark = [
    pytest.mark.firmware,
    needs.marker('gcc-arm-none-eabi', 'libnewlib-arm-none-eabi', 'libunicorn-dev', 'gcc-avr'),
]


def test_what_is_missing_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr(firmware, 'BUILT', tmp_path)
    with pytest.raises(DeviceMissing, match='make firmware'):
        firmware.FirmwareBoard()


@pytest.mark.timeout(600)
def test_the_rehearsal_runs_on_its_firmware(tmp_path):
    """Everything starts; blocks report their slips through the emulated bridge."""
    built()
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
        wait_until(lambda: len(blocks(graph)) > 5, 240)
    finally:
        code = graph.stop()
    assert code == 0


def blocks(graph):
    from eol_msgs.msg import BlockTap
    from rclpy.serialization import deserialize_message

    return {deserialize_message(raw, BlockTap).block for raw in graph.watch.raw['block_taps']}

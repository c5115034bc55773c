# SPDX-License-Identifier: Apache-2.0
"""A machine with too much else to do: nobody is killed for it, and what is lost is counted.

Variants that take minutes run in `make soak`.
"""

import time

import pytest
import yaml
from support.bags import counted_losses
from support.running import Graph, busy, stand_in

from eol_ros.analysis import open_bag

pytestmark = [pytest.mark.live, pytest.mark.slow, pytest.mark.timeout(600)]


def settled(graph):
    """Return the status once two reports, which come each second, agree on what was lost."""
    counted, deadline = None, time.monotonic() + 60
    while time.monotonic() < deadline:
        status = graph.status()
        values = {row['node']: row['values'] for row in status['nodes']}
        before, counted = counted, (
            values['tracker']['missing'], values['twin']['missed'], values['recorder']['lost'],
        )  # fmt: skip
        if counted == before:
            return status
        time.sleep(2.5)
    raise AssertionError(f'images are still lost without load: {graph.status()}')


def loaded(folder, count):
    """Run the rehearsal beside `count` busy processes; return its last status and its bags."""
    path = stand_in('rehearsal', folder, film=None, bag=None)
    values = yaml.safe_load(path.read_text())
    values['nodes']['sound']['device'] = 'wav'
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    with Graph(path, folder / 'bags') as graph:
        graph.wait_until_ok()
        with busy(count):
            time.sleep(120)
        deadline = time.monotonic() + 60
        while graph.node('recorder')['values']['queue_mb'] > 1 or graph.node('twin')['level']:
            assert time.monotonic() < deadline, graph.status()
            time.sleep(0.5)
        status = settled(graph)
        status['end_ns'] = time.time_ns()
        assert graph.stop() == 0
    return status, [p for p in (folder / 'bags').iterdir() if p.is_dir()]


def check(status, bags):
    assert status['restarts'] == 0
    assert len(bags) == 1
    bag = open_bag(bags[0])
    nodes = {row['node']: row['values'] for row in status['nodes']}
    lost = counted_losses(bag)

    # Every image that should have been is in the bag's blocks, or was counted by somebody.
    blocks = bag.table('blocks')
    blocks = blocks[blocks['stamp'].astype('int64') < status['end_ns']]
    stamps = blocks['stamp'].astype('int64')
    images = round((stamps[-1] - stamps[0]) * 60 / 1e9) + 1
    tracked = int(blocks['image'][-1]) - int(blocks['image'][0]) + 1
    assert images - tracked == nodes['tracker']['missing'], nodes['twin']
    assert nodes['tracker']['missing'] >= nodes['twin']['missed']
    print(
        f'{images} images, {nodes["twin"]["missed"]} missed by the twin, '
        f'{images - tracked - nodes["twin"]["missed"]} lost on the way; recorder: {lost}'
    )


@pytest.mark.soak
@pytest.mark.parametrize('count', [8, 20])
def test_two_minutes_beside_busy_processes(tmp_path, count):
    check(*loaded(tmp_path, count))

# SPDX-License-Identifier: Apache-2.0
"""Scenes of other tables than the paper's, as a person starts them."""

import os
import subprocess
import sys

import numpy as np
import pytest
from support.domains import next_domain

from eol_ros import scene as scenes
from eol_ros.analysis.bag import open_bag
from eol_ros.analysis.recorded_settings import recorded_table
from eol_ros.analysis.retrack import retrack
from eol_ros.core.table import Table
from eol_ros.streams import tables

DOMAIN = next_domain()
OF_3_BY_4 = 'include: rehearsal\ntable: {rows: 3, columns: 4, absent: [5]}\n'


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_scene_of_another_table_runs_and_its_recording_is_proved(tmp_path):
    name = tmp_path / '3x4.yaml'
    name.write_text(OF_3_BY_4)
    command = ['run', str(name), '--for', '8', '--bag', str(tmp_path / 'bags')]
    done = subprocess.run(
        [sys.executable, '-m', 'eol_ros', *command], capture_output=True, text=True, check=False,
        env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)}, timeout=240,
    )  # fmt: skip
    table = Table.of(scenes.load(name).table)
    assert done.returncode == 0, done.stderr
    assert f'{table.count} of {table.count} blocks seen' in done.stdout + done.stderr
    bag = open_bag(tmp_path / 'bags')
    assert recorded_table(bag) == table
    (told,) = tables.RECORD.each(bag.table('table'))
    assert (told.rows, told.columns, tuple(told.absent)) == (
        table.rows, table.columns, table.absent,
    )  # fmt: skip
    blocks = bag.table('blocks')['blocks']
    assert blocks.shape[1] == table.cells
    assert blocks['seen'][:, table.ids].mean() > 0.5 and not blocks['seen'][:, ~table.present].any()
    assert len(bag.table('slips')) and set(bag.table('slips')['block']) <= set(table.ids.tolist())
    light = bag.table('led_commands')['white']
    assert light.shape[1] == table.cells and not light[:, ~table.present].any()
    truth = bag.table('truth')
    assert truth['x'].shape[1] == table.cells and not truth['moving'][:, ~table.present].any()
    found = retrack(bag)
    proved = {name: topic.proved for name, topic in found.topics.items() if name != 'blocks'}
    assert proved['slips'] and proved['grain_triggers']  # images are kept around slips alone
    assert not any(topic.different for topic in found.topics.values())
    assert np.isfinite(bag.table('blocks')['blocks']['x'][-1, table.ids]).all()

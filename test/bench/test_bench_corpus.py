# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from benchmarks import corpus as bench
from eol_ros import cli
from eol_ros.core.sound.descriptors import HOP
from eol_ros.core.sound.ice import ice
from eol_ros.devices.audio import audio_file


@pytest.mark.slow
def test_figures_are_complete_and_within_bounds(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(bench, 'COUNTS', (100,))
    audio_file.write(tmp_path / 'a.wav', ice(2.0, 16000, 2), 16000, 'PCM_16')
    (tmp_path / 'bad.wav').write_text('no sound')
    words = ['bench', 'corpus', str(tmp_path), '--table-seconds', '15', '--json']
    assert cli.main(words) == 0
    out, err = capsys.readouterr()
    figures = json.loads(out)
    assert figures['machine']['vector_bits'] >= 128
    assert 'left out' in err and figures['descriptors']['sounds'] == 1
    assert figures['descriptors']['times_real_time']['eol'] > 0
    assert [row['hop'] for row in figures['hop']] == list(bench.HOPS)
    errors = [row['periodicity_rms'] for row in figures['hop']]
    assert errors[0] == 0 and errors[2] < errors[4]
    assert figures['layout'][0]['empty_cells'] == 0
    assert figures['layout'][0]['kendall_tau_x'] > 0.7
    moving = figures['selection'][0]
    assert moving['still_triggers_per_s'] == 0 and moving['moving_triggers_per_s'] > 0
    assert [row['images_per_s'] for row in figures['slips']] == [60, 120]
    assert all(row['slips'] > 5 for row in figures['slips'])
    from eol_ros.core.sound import descriptors

    assert descriptors.HOP == HOP  # what was varied is put back
    for name in ('librosa', 'essentia'):
        pytest.importorskip(name, reason=f'oracle: pip install {name}')
    assert figures['descriptors']['centroid_relative_difference']['worst'] < 1e-3
    assert figures['descriptors']['periodicity_difference']['mean'] < 0.02

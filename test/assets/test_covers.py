# SPDX-License-Identifier: Apache-2.0
"""python -m assets.covers: files as a slicer reads them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from assets.covers import __main__ as covers
from eol_ros.cli import run_verb
from eol_ros.devices.files import stl_file


def main(words):
    return run_verb(covers, 'assets.covers', words)


def scene(folder, **table):
    path = folder / 'other.yaml'
    path.write_text(json.dumps({'scene': 'other', 'table': table, 'nodes': {'twin': {}}}))
    return str(path)


def test_body_and_covers_are_those_of_the_scene(tmp_path, capsys):
    path = scene(tmp_path, rows=3, columns=3, block_side_m=0.06, body_height_m=0.04, absent=[4])
    assert main(['--output', str(tmp_path), '--cells=2', '--scene', path, '--json']) == 0
    listed = json.loads(capsys.readouterr().out)
    assert len(listed['covers']) == 9  # one for each place, as `eol calibrate` reads them
    body = stl_file.load(listed['body']).reshape(-1, 3)
    assert np.ptp(body, axis=0) == pytest.approx([60, 60, 40])


def test_writes_watertight_covers_that_fit(tmp_path, capsys):
    trimesh = pytest.importorskip('trimesh')
    assert main(['--output', str(tmp_path), '--cells', '10', '--json']) == 0
    told = capsys.readouterr()
    listed = json.loads(told.out)
    assert f'eol calibrate ... --covers {tmp_path} --cover-gap 0.034' in told.err
    assert len(listed['covers']) == 25 and cv2.imread(listed['picture']) is not None
    body = trimesh.load_mesh(listed['body'])
    assert body.is_watertight and body.extents == pytest.approx([84, 84, 34])
    meshes = {}
    for cover in listed['covers']:
        mesh = trimesh.load_mesh(cover['file'])
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert len(mesh.faces) == cover['facets']
        assert mesh.volume / 1e3 == pytest.approx(cover['plastic_cm3'], abs=0.01)
        assert mesh.extents[:2] == pytest.approx([84, 84])
        meshes[cover['row'], cover['column']] = stl_file.load(cover['file']).reshape(-1, 3)
    for (row, col), points in meshes.items():
        if col < 4:
            east = points[points[:, 0] == 42.0][:, 1:]
            west = meshes[row, col + 1]
            west = west[west[:, 0] == -42.0][:, 1:]
            assert np.array_equal(np.unique(east, axis=0), np.unique(west, axis=0))


def test_a_height_map_of_ones_own_and_sizes(tmp_path, capsys):
    picture = tmp_path / 'ramp.png'
    cv2.imwrite(str(picture), np.tile(np.linspace(0, 65535, 40).astype(np.uint16), (30, 1)))
    out = tmp_path / 'out'
    sizes = ['--cells=4', '--skirt=5', '--relief=30', '--lip=0']
    sizes += ['--scene', scene(tmp_path, rows=2, columns=2, block_side_m=0.06)]
    assert main(['--output', str(out), '--heightmap', str(picture), *sizes]) == 0
    names = capsys.readouterr().out.split()
    assert [Path(n).name for n in names] == [*(f'cover-0{k}.stl' for k in range(4)), 'covers.png']
    left, right = (stl_file.load(n) for n in names[:2])
    assert np.ptp(left[..., 0]) == pytest.approx(60)
    assert left[..., 2].max() == pytest.approx(20, abs=0.01)  # half of the ramp
    assert right[..., 2].max() == pytest.approx(35)


@pytest.mark.parametrize(
    ('words', 'code', 'says'),
    [
        (['--wall', '60'], 2, 'no room'),
        (['--skirt', '5'], 2, 'too low for the shoulder above a lip, which is 3.8 mm high'),
        (['--body', '41'], 2, 'a body of 41 mm leaves no room for a lip'),
        (['--clearance', '-1'], 2, '--clearance: -1 is outside 0 to 1000'),
        (['--cells', '0'], 2, '--cells: 0 is outside 1 to 512'),
        (['--scene', 'nowhere.yaml'], 78, 'nowhere.yaml'),
        (['--seed', '-1'], 2, '--seed: -1 is'),
        (['--heightmap', 'nowhere.png'], 69, 'nowhere.png: no such file'),
        (['--heightmap', __file__], 78, 'not an image'),
    ],
)
def test_mistakes_are_one_line(tmp_path, capsys, words, code, says):
    assert main(['--output', str(tmp_path / 'o'), *words]) == code
    text = capsys.readouterr().err
    assert says in text and text.count('\n') == 1

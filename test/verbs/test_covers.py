# SPDX-License-Identifier: Apache-2.0
"""eol covers: files as a slicer reads them."""

import json

import cv2
import numpy as np
import pytest

from eol_ros.cli import main
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.devices.files import stl_file
from eol_ros.errors import ConfigError


def test_writes_watertight_covers_that_fit(tmp_path, capsys):
    trimesh = pytest.importorskip('trimesh')
    assert main(['covers', '--output', str(tmp_path), '--cells', '10', '--json']) == 0
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
    sizes = ['--rows=1', '--cols=2', '--cells=4', '--side=60', '--skirt=5', '--relief=30']
    sizes += ['--lip=0']
    assert main(['covers', '--output', str(out), '--heightmap', str(picture), *sizes]) == 0
    names = capsys.readouterr().out.split()
    assert [n.rsplit('/', 1)[1] for n in names] == ['cover-00.stl', 'cover-01.stl', 'covers.png']
    left, right = (stl_file.load(n) for n in names[:2])
    assert left[..., 2].max() == pytest.approx(20, abs=0.01)  # half of the ramp
    assert right[..., 2].max() == pytest.approx(35)


def test_names_of_many_covers_are_in_order_of_their_ids(tmp_path, capsys):
    """`eol calibrate` reads them so, and takes covers of the side of its table only."""
    sizes = ['--rows=8', '--cols=13', '--cells=1', '--side=50', '--lip=0']
    assert main(['covers', '--output', str(tmp_path), *sizes]) == 0
    told = capsys.readouterr()
    names = told.out.split()[:-1]
    assert len(names) == 104 and names == sorted(names)
    assert f'--covers {tmp_path}' in told.err and '--cover-gap' not in told.err
    meshes = [stl_file.load(name) for name in names]
    assert len(CoverOutlines.of_meshes(meshes, 0.0, 0.05).land_mm) == 104
    with pytest.raises(ConfigError, match='a mesh is 50 wide; covers are 84 mm'):
        CoverOutlines.of_meshes(meshes, 0.0)


@pytest.mark.parametrize(
    ('words', 'code', 'says'),
    [
        (['--wall', '60'], 2, 'no room'),
        (['--skirt', '5'], 2, 'too low for the shoulder above a lip, which is 3.8 mm high'),
        (['--body', '41'], 2, 'a body of 41 mm leaves no room for a lip'),
        (['--clearance', '-1'], 2, 'lip, body and clearance must be 0 mm or more'),
        (['--cells', '0'], 2, '--cells: 0 is outside 1 to 512'),
        (['--rows', '99'], 2, '--rows: 99 is'),
        (['--seed', '-1'], 2, '--seed: -1 is'),
        (['--heightmap', 'nowhere.png'], 69, 'nowhere.png: no such file'),
        (['--heightmap', __file__], 78, 'not an image'),
    ],
)
def test_mistakes_are_one_line(tmp_path, capsys, words, code, says):
    assert main(['covers', '--output', str(tmp_path / 'o'), *words]) == code
    text = capsys.readouterr().err
    assert says in text and text.count('\n') == 1


def test_the_folder_cannot_be_made(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert main(['covers', '--output', str(tmp_path / 'file')]) == 78
    assert '--output' in capsys.readouterr().err

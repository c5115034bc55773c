# SPDX-License-Identifier: Apache-2.0
"""A film with its truth, from its folder to its figures, and folders that are refused."""

import json

import numpy as np
import pytest
from support.paper import rest_lattice

from eol_ros import cli
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.devices.files import calibration_file


def film(folder, images=14):
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 5)
    at, still = rest_lattice(), np.zeros(25)
    frames = np.array([renderer.render(*at.T, still, k) for k in range(images)])
    np.save(folder / 'frames.npy', frames)
    pose = np.column_stack([at, still])
    np.savez(
        folder / 'truth.npz', t=np.arange(images) / 60, world=np.repeat(pose[None], images, 0),
        visible=np.ones((images, 25)),
    )  # fmt: skip
    calibration_file.save(folder / 'calibration.yaml', Calibration.ideal())


def test_a_film_from_its_folder_to_its_figures(tmp_path, capsys):
    film(tmp_path)
    assert cli.main(['bench', 'vision', '--truth', str(tmp_path), '--json']) == 0
    found = json.loads(capsys.readouterr().out)['truth'][str(tmp_path)]
    assert found['whole'] == 1.0
    assert found['rms_px'] < 0.015
    assert found['switches'] == found['wrong_place'] == 0


@pytest.mark.parametrize(
    ('spoil', 'words'),
    [
        (lambda f: (f / 'truth.npz').unlink(), 'no truth.npz'),
        (lambda f: np.savez(f / 'truth.npz', t=np.zeros(3)), 'world'),
        (lambda f: (f / 'truth.npz').write_text('xx'), 'truth.npz: '),
        (lambda f: (f / 'frames.npy').write_text('xx'), 'frames.npy: '),
        (lambda f: np.save(f / 'frames.npy', np.zeros((14, 8, 9), np.uint8)), '(14, 8, 9) uint8'),
        (lambda f: np.save(f / 'frames.npy', np.zeros((14, 800, 1280))), 'float64, not (n, 800'),
        (
            lambda f: np.savez(
                f / 'truth.npz',
                t=np.full(14, np.nan),
                world=np.zeros((14, 25, 3)),
                visible=np.ones((14, 25)),
            ),
            't has values that are not finite',
        ),
        (
            lambda f: np.savez(f / 'truth.npz', t=np.zeros(3), world=0.0, visible=0.0),
            't is (3,), not (14,)',
        ),
    ],
)
def test_a_folder_of_another_kind_is_refused(tmp_path, spoil, words, capsys):
    film(tmp_path)
    spoil(tmp_path)
    assert cli.main(['bench', 'vision', '--truth', str(tmp_path)]) == 2
    assert words in capsys.readouterr().err

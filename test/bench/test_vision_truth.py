# SPDX-License-Identifier: Apache-2.0
"""Films with their truth: figures of answers made by hand, and a film from file to table."""

import json

import numpy as np
import pytest
from support.paper import rest_lattice

from benchmarks import vision_truth
from eol_ros import cli
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.devices.files import calibration_file

AT = Calibration.ideal().to_pixels(rest_lattice())


def scored(change, images=4):
    seen, px = np.ones((images, 25), bool), np.repeat(AT[None], images, axis=0)
    visible = np.ones((images, 25))
    change(seen, px, visible)
    return vision_truth.score(seen, px, np.repeat(AT[None], images, axis=0), visible)


def test_a_perfect_answer():
    assert scored(lambda *_: None) == {
        'whole': 1.0, 'rms_px': 0.0, 'partly': None, 'rms_partly_px': None, 'hidden_reported': 0,
        'hidden': 0, 'wrong_place': 0, 'switches': 0,
    }  # fmt: skip


def test_each_kind_of_fault_is_counted():
    def change(seen, px, visible):
        seen[0, 3] = False  # one whole block of 100 - 3 is missed
        px[:, :, 0] += 0.3  # the rms of one coordinate of two
        visible[1, 7], visible[2, 8], visible[3, 9] = 0.1, 0.7, 0.1
        seen[3, 9] = False
        px[2, 1] += 40.0

    figures = scored(change)
    assert figures['whole'] == pytest.approx(96 / 97)
    assert figures['rms_px'] == pytest.approx(0.3 / np.sqrt(2))
    assert figures['partly'] == 1.0
    assert (figures['hidden_reported'], figures['hidden'], figures['wrong_place']) == (1, 2, 1)


def test_two_blocks_that_exchange_names_are_two_switches():
    def change(seen, px, visible):
        px[2:, [4, 5]] = px[2:, [5, 4]]

    assert scored(change)['switches'] == 2


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
        (lambda f: np.save(f / 'frames.npy', np.zeros((14, 800, 1280))), 'float64, not (n, 800'),
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

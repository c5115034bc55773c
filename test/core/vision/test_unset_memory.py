# SPDX-License-Identifier: Apache-2.0
"""No position depends on memory that nobody has set: the tracker with that memory poisoned."""

import ast
import os
import shutil
import subprocess
import sys

import pytest
from support.checkout import ROOT

# Arms, darkness and blocks that nobody finds again: what is judged before it is fitted.
TRACK = """
import hashlib
import numpy as np
from eol_ros.core.table import Table
from support.clutter import Cluttered, clutter_calibration
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings
rest = Table().rest
for level, mirror in (('ordinary', True), ('hard', False)):
    camera = clutter_calibration(level)
    camera = camera.in_mirror() if mirror else camera
    renderer = Cluttered(level, camera, 3)
    tracker = Tracker(TrackerSettings(), camera)
    x, y = (rest + np.random.default_rng(1).normal(0, 3e-3, rest.shape)).T
    digest = hashlib.sha256()
    for k in range(150):
        moved = 0.01 * np.clip((k - 80) / 20, 0, 1) * (np.arange(25) % 3 == 0)
        image = renderer.render(x + moved, y, np.full(25, 0.02 * np.sin(max(k - 60, 0) / 20)), k)
        if 120 <= k < 124:
            image[:] = 9
        found = tracker.update(k / 60, image)
        for values in (found.px, found.world, found.yaw, found.seen, found.sigma_m):
            digest.update(np.ascontiguousarray(values).tobytes())
    print(level, digest.hexdigest())
"""


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_no_position_depends_on_memory_that_nobody_set(tmp_path):
    """A patch that was gathered again was judged by what an earlier one had left behind it."""
    found = {poisoned(tmp_path / str(k), poison) for k, poison in enumerate(('1e30', '-5.0'))}

    assert len(found) == 1


class Poison(ast.NodeTransformer):
    """Fills each array of floats that is made without values."""

    def __init__(self, value):
        self.value, self.count = value, 0

    def visit_Call(self, node):
        self.generic_visit(node)
        if ast.unparse(node.func) != 'np.empty':
            return node
        shape, kind = (*map(ast.unparse, node.args), 'np.float64')[:2]
        if 'float' not in kind:
            return node
        self.count += 1
        return ast.parse(f'np.full({shape}, {kind}({self.value}), {kind})', mode='eval').body


def poisoned(folder, value):
    """What TRACK prints with `value` in memory that nobody set."""
    without = shutil.ignore_patterns('__pycache__')
    shutil.copytree(ROOT / 'eol_ros', folder / 'eol_ros', ignore=without)
    poison = Poison(value)
    for path in (folder / 'eol_ros' / 'core' / 'vision' / 'appearance').glob('*.py'):
        path.write_text(ast.unparse(poison.visit(ast.parse(path.read_text()))))
    assert poison.count > 15
    done = subprocess.run(
        [sys.executable, '-c', TRACK], cwd=folder, capture_output=True, text=True,
        env=os.environ
        | {'PYTHONPATH': f'{folder}:{ROOT / "test"}', 'EOL_CACHE': str(folder / 'cache')},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout

# SPDX-License-Identifier: Apache-2.0
"""eol warm: compile what a first run would have to wait for."""

import sys
import time
from pathlib import Path

import eol_ros
from eol_ros.verbs.progress import track

HELP = 'Compile the loops of twin, tracker and sound into the cache, and make the ice recording.'
EXAMPLES = ['eol warm', 'eol warm --anew']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--anew', action='store_true',
                        help='forget what was compiled: an inner loop has been edited')


def run(args):
    """Warm one part after the other."""
    if args.anew:  # the compiler's cache does not notice a change in a file that another imports
        for file in Path(eol_ros.__file__).parent.rglob('__pycache__/*.nb?'):
            file.unlink()
    print('compiling (a minute, once)', file=sys.stderr)
    for part in track((_twin, _tracker, _sound, _ice), 'compiling'):
        part()
    return 0


def _twin():
    import numpy as np

    from eol_ros.core.physics.live import LiveTable
    from eol_ros.core.vision.renderer import Renderer, RenderOptions

    table = LiveTable(0)
    table.advance(0.0, 1 / 60, np.zeros(3), np.zeros(3))
    Renderer(RenderOptions(), None, 0).render(table.x, table.y, table.yaw, 0)


def _tracker():
    import numpy as np

    from eol_ros.core.geometry import N_BLOCKS, rest_lattice
    from eol_ros.core.vision.calibration import Calibration
    from eol_ros.core.vision.renderer import Renderer, RenderOptions
    from eol_ros.core.vision.tracker import Tracker
    from eol_ros.settings import TrackerSettings

    Tracker(TrackerSettings(), Calibration.ideal()).warm_up()
    # and one that has to calibrate itself, from blocks at rest
    tracker, renderer = Tracker(TrackerSettings(), None), Renderer(RenderOptions(), None, 0)
    for k in range(120):
        x, y = rest_lattice().T
        tracker.update(k / 60, renderer.render(x, y, np.zeros(N_BLOCKS), k))


def _sound():
    import numpy as np

    from eol_ros.core.sound.clock import set_clock
    from eol_ros.core.sound.meter import Meter
    from eol_ros.core.sound.mixer import Mixer
    from eol_ros.devices.sound_callback import serve

    mixer = Mixer(48000, 2, 64)
    mixer.render(256)
    set_clock(mixer.state, 0.0)
    serve(mixer.address, np.zeros((0, mixer.channels), np.float32), 0)
    Meter(mixer).read()


def _ice():
    from eol_ros.devices.corpus_loader import CorpusLoader, wish_of
    from eol_ros.settings import GrainsSettings

    loader = CorpusLoader()
    wish = wish_of(GrainsSettings())
    if loader.at_once(wish) is None:
        loader.ask(wish)
        while loader.take() is None:
            time.sleep(0.1)
    loader.close()

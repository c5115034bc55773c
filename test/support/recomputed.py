# SPDX-License-Identifier: Apache-2.0
"""Digests of what is recomputed from a recording, made by this process: `python -m ...recomputed`.

`test/core/test_same_bits.py` runs it as on other processors and compares.
"""

import hashlib
import json
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np

SAMPLE = Path(__file__).parents[2] / 'bags' / 'sample'
IMAGES = 80


def digest(*arrays) -> str:
    """Return a short name of the bits of arrays."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def sample() -> dict:
    """Slips, cascades and triggers of the bag that ships, from its blocks."""
    from eol_ros.analysis import open_bag
    from eol_ros.analysis.retrack import retrack

    return {name: [c.verdict, c.first] for name, c in retrack(open_bag(SAMPLE)).topics.items()}


def blocks() -> dict:
    """The twin, its images, and the blocks that the tracker sees in them."""
    from eol_ros.core.physics.twin.play import Play
    from eol_ros.core.vision.calibration.model import Calibration
    from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
    from eol_ros.core.vision.tracker import Tracker
    from eol_ros.settings import TrackerSettings

    play, renderer = Play(5), Renderer(RenderOptions(), None, 0)
    tracker = Tracker(TrackerSettings(), Calibration.ideal())
    table, images, found = [], [], []
    for k in range(IMAGES):
        play.advance((k + 1) / 60)
        t = play.table
        table.append(np.stack([t.x, t.y, t.yaw]))
        images.append(renderer.render(t.x, t.y, t.yaw, k))
        seen = tracker.update((k + 1) / 60, images[-1])
        found.append(digest(seen.world, seen.px, seen.seen, seen.sigma_m, seen.visibility))
    return {'table': digest(*table), 'images': digest(*images), 'blocks': found}


def light() -> dict:
    """The levels of the blocks' light."""
    from eol_ros.core.light.local import FIELD, FIELD_OF_VIEW, new_field

    found = {}
    for limit in (FIELD, FIELD_OF_VIEW):
        rng, field, now_s, out = np.random.default_rng(1), new_field(limit, 0.35), 0.0, []
        for block in rng.integers(0, 25, 400).tolist():
            now_s += float(rng.exponential(0.05))
            field.slip(now_s, block)
            out.append(field.levels(now_s + 0.01))
        found[limit] = digest(*out)
    return found


def sound() -> dict:
    """A corpus of ice, its descriptors and layout, and what the mixer makes of its grains."""
    from assets.ice import ice
    from eol_ros.core.sound import descriptors, layout, ranks, segments
    from eol_ros.core.sound.bank import Bank
    from eol_ros.core.sound.offline import play
    from eol_ros.core.sound.triggers import TRIGGER
    from eol_ros.core.sound.voicing import Voicing, new_mixer
    from eol_ros.settings import SoundSettings

    rate = 24000
    recording = ice(12.0, rate, 3)
    cuts = segments.chop(len(recording), rate, 0.25)
    grains, _ = descriptors.analyse(recording, rate, cuts)
    columns = [grains[name] for name in ('centroid_mean_hz', 'loudness_lufs', 'periodicity_mean')]
    even = layout.even(np.stack([ranks.ranked(axis) for axis in columns[:2]], axis=1))
    settings = SoundSettings(sample_rate=48000, rate_scaling=0.5, filter='low-pass', sub_db=-12.0)
    bank = Bank([recording], np.zeros(len(cuts), int), cuts[:, 0] / rate,
                (cuts[:, 1] - cuts[:, 0]) / rate, rate)  # fmt: skip
    rng = np.random.default_rng(2)
    triggers = np.zeros(60, TRIGGER)
    triggers['time_s'] = np.sort(rng.uniform(0, 1.5, 60))
    triggers['grain'], triggers['block'] = rng.integers(0, len(cuts), 60), rng.integers(0, 25, 60)
    triggers['gain'], triggers['rate'], triggers['pan'] = 0.3, rng.uniform(0.5, 2, 60), 0.2
    triggers['attack_s'] = triggers['release_s'] = 0.01
    rows, _ = Voicing(settings).rows(triggers, bank)
    heard = np.concatenate(list(play(new_mixer(settings), rows, 96000)))
    return {
        'ice': digest(recording),
        'cuts': digest(segments.onset_cut(recording, rate)),
        'descriptors': digest(*columns),
        'layout': digest(even),
        'voices': digest(*(rows[n] for n in rows.dtype.names if n != 'source')),
        'mixer': digest(heard),
    }


def automaton() -> dict:
    """Events of the automaton."""
    from eol_ros.lab.automaton.ofc import Automaton

    events = Automaton.random(32, Fraction(1, 5), 1).run(2000, full=True)
    return {'events': digest(events.size, events.area, events.duration, events.first)}


PARTS = (sample, blocks, light, sound, automaton)

if __name__ == '__main__':
    json.dump({part.__name__: part() for part in PARTS}, sys.stdout)

# SPDX-License-Identifier: Apache-2.0
"""Another corpus while it sounds: selection and mixer together, as the two nodes run them."""

from dataclasses import replace

import numpy as np
import pytest
from support.paper import rest_lattice
from support.quiet_settings import GRAINS

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.layout import lattice
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import play
from eol_ros.core.sound.select import Selector

FS, FPS = 48000, 60
SWAP_S, END_S = 4.0, 8.0


def noise(seed, grains):
    """A corpus of `grains` pieces of noise, and its bank."""
    rows = np.zeros(grains, GRAIN)
    rows['x'], rows['y'] = lattice(grains).T
    rows['start_s'], rows['duration_s'] = 0.25 * np.arange(grains), 0.25
    sound = 0.1 * np.random.default_rng(seed).standard_normal(grains * FS // 4).astype('f4')
    corpus = Corpus((Source(f'{seed}', FS, grains / 4),), rows, digest=str(seed))
    return corpus, Bank([sound], rows['file'], rows['start_s'], rows['duration_s'], FS)


def performance(settings, swap=True):
    """Blocks that never rest; at SWAP_S another corpus. Return samples, and triggers of each."""
    (old, old_bank), (new, new_bank) = noise(1, 160), noise(2, 240)
    selector, found = Selector(settings, old), {False: [], True: []}
    since_s = np.inf
    for k in range(int(END_S * FPS)):
        time_s = k / FPS
        turn = 9 * time_s + np.arange(25)  # 0.3 m/s or so, each at its own phase
        at = rest_lattice() + 0.04 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        if swap and since_s == np.inf and time_s >= SWAP_S - 1:
            since_s = selector.load(new, 1.0)
        rows = selector.update(time_s, *at.T.copy(), np.ones(25, bool), np.full(25, 2e-5))
        found[time_s >= since_s].append(rows)
    banks = {False: old_bank, True: new_bank}
    triggers = {is_new: np.concatenate(rows) for is_new, rows in found.items() if rows}
    voices = [voice_rows(t, banks[is_new], 2) for is_new, t in triggers.items()]
    mixer = Mixer(FS, max_voices=4000, gain_db=-6, governor_db=0)
    samples = np.concatenate(list(play(mixer, np.concatenate(voices), int(END_S * FS))))
    assert mixer.state['dropped'][0] == mixer.state['stolen'][0] == 0
    return samples, triggers, since_s


@pytest.mark.slow
def test_a_swap_neither_dips_nor_bumps_nor_clicks():
    settings = replace(GRAINS, total_cap=10_000, rate_jitter_st=0.0)
    swapped, triggers, since_s = performance(settings)
    steady, _, _ = performance(settings, swap=False)
    assert SWAP_S - 0.1 < since_s < SWAP_S + 0.1
    assert triggers[False]['time_s'].max() < since_s <= triggers[True]['time_s'].min()
    assert len(triggers[False]) > 300 and len(triggers[True]) > 300

    def levels(samples):
        pieces = samples[FS : len(samples) // 4800 * 4800].reshape(-1, 4800, 2)
        return 10 * np.log10((pieces.astype(float) ** 2).mean(axis=(1, 2)))

    usual = levels(steady)
    assert np.abs(levels(swapped) - usual.mean()).max() < np.abs(usual - usual.mean()).max() + 3
    jump = [np.abs(np.diff(samples, 2, axis=0)).max() for samples in (swapped, steady)]
    assert jump[0] < 1.2 * jump[1]

# SPDX-License-Identifier: Apache-2.0
"""The low-passes of the buses: against scipy, and against Brune's formula."""

import numpy as np
import pytest
from scipy.signal import lfilter
from support.sound_reference import noise_bank, rendered

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.buses import pole
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.sound.triggers import TRIGGER

FS = 48000
CORNERS = np.array([20000.0, 4000.0, 500.0])


def with_buses(**options):
    mixer = Mixer(FS, governor_db=0, **{'gain_db': 0, 'buses': 2, **options})
    mixer.set_corners(CORNERS)
    return mixer


def triggers(count):
    t = np.zeros(count, TRIGGER)
    t['time_s'], t['gain'], t['rate'] = 0.01 * np.arange(count), 0.5, 1.0
    t['pan'] = np.linspace(-1, 1, count)
    return t


def test_lows_are_what_a_one_pole_takes_away():
    bank, t = noise_bank(), triggers(2)
    mixer, corners = with_buses(), np.array([30.0, 300.0, 40.0])
    mixer.set_low_corners(corners)
    found = rendered(mixer, voice_rows(t, bank, 2, np.array([0, 2])))
    wanted = 0.0
    for k, bus in enumerate((0, 1)):  # the mix has no high-pass, whatever its corner
        alone = render_all(Mixer(FS, gain_db=0, governor_db=0), t[k : k + 1], bank, FS)
        alone, p, h = alone.astype(float), *(pole(c[bus], FS) for c in (CORNERS, corners))
        if bus:
            alone = lfilter([(1 - p) ** 2], [1, -2 * p, p * p], alone, axis=0)
            alone = lfilter([h, -h], [1, -h], alone, axis=0)
        wanted = wanted + alone
    assert np.abs(found - wanted).max() < 2e-7
    assert not found[-1000:].any()


@pytest.mark.parametrize('bus', [1, 2])
def test_the_spectrum_is_that_of_brunes_source(bus):
    """A short click through a bus against 1 / (1 + (f / f_c)^2), to 10 times the corner."""
    click = np.zeros(FS, 'f4')
    click[FS // 4] = 0.9
    bank = Bank([click], [0], [0.0], [0.5], FS)
    t = triggers(1)
    t['attack_s'] = t['release_s'] = 0.002
    out = rendered(with_buses(), voice_rows(t, bank, 2, np.array([2 * bus])))[:, 0].astype(float)
    plain = rendered(with_buses(), voice_rows(t, bank, 2))[:, 0].astype(float)
    hz = np.fft.rfftfreq(len(out), 1 / FS)
    ratio = np.abs(np.fft.rfft(out)) / np.abs(np.fft.rfft(plain))
    band = (hz > 20) & (hz < min(10 * CORNERS[bus], 8000))
    brune = 1 / (1 + (hz / CORNERS[bus]) ** 2)
    assert np.abs(20 * np.log10(ratio[band] / brune[band])).max() < 1.0


def test_buses_that_nobody_uses_change_no_bit():
    bank, t = noise_bank(), triggers(12)
    rows = voice_rows(t, bank, 2)
    plain = rendered(Mixer(FS, gain_db=0, governor_db=0), rows)
    assert np.array_equal(rendered(with_buses(), rows), plain)


def test_a_voice_on_a_bus_that_the_mixer_lacks_is_refused():
    with pytest.raises(ValueError, match='row 4 of 2'):
        Mixer(FS).push(voice_rows(triggers(1), noise_bank(), 2, np.array([4])))

# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.sound_reference import noise_bank, score

from eol_ros.core.sound.bank import voice_rows
from eol_ros.core.sound.meter import PAIRS, Meter, Spectrum, waveform
from eol_ros.core.sound.mixer import Mixer

FS = 48000


def test_waveform_keeps_every_extreme():
    x = np.random.default_rng(1).standard_normal(FS).astype('f4')
    least, most = waveform(x)
    assert len(least) == len(most) == PAIRS
    assert (least.min(), most.max()) == (x.min(), x.max())
    edges = np.arange(PAIRS + 1) * FS // PAIRS
    assert all(least[i] == x[edges[i] : edges[i + 1]].min() for i in range(PAIRS))
    least, most = waveform(np.ones(10, 'f4'))
    assert (least.shape, most[-10:].min(), most[:-10].max()) == ((PAIRS,), 1, 0)


@pytest.mark.parametrize('hz', [30, 100, 997, 5000, 15000])
def test_spectrum_puts_a_sine_in_its_band_at_its_level(hz):
    spectrum = Spectrum(FS)
    levels = spectrum(0.5 * np.sin(2 * np.pi * hz * np.arange(FS) / FS))
    band = int(np.argmax(levels))
    assert abs(np.log2(spectrum.centres_hz[band] / hz)) < 0.25
    near = (spectrum.centres_hz > hz / 1.5) & (spectrum.centres_hz < hz * 1.5)
    total = 10 * np.log10((10 ** (levels[near] / 10)).sum())
    if hz > 500:  # lower bands are narrower than a bin and share it
        assert total == pytest.approx(-6.02, abs=0.1)
    far = np.abs(np.log2(spectrum.centres_hz / hz)) > 2
    assert levels[far].max() < -60


def test_reading_is_of_what_was_put_out():
    rng = np.random.default_rng(2)
    bank, mixer = noise_bank(), Mixer(FS)
    meter = Meter(mixer)
    silent = meter.read()
    assert (silent.peak_dbfs, silent.voices) == (-120, 0)
    mixer.push(voice_rows(score(rng, 8, 0.1, 1), bank, 2))
    out = mixer.render(FS // 4)
    reading = meter.read()
    assert 10 ** (reading.peak_dbfs / 20) == pytest.approx(np.abs(out).max(), rel=1e-5)
    assert 10 ** (reading.rms_dbfs / 20) == pytest.approx(np.sqrt((out**2).mean()), rel=1e-4)
    assert reading.voices == mixer.state['voices'][0] > 0
    assert reading.time_s == pytest.approx(0.25)
    assert np.array_equal(mixer.recent(FS // 4), out)
    mixer.render(FS)
    meter.read()
    assert meter.read().wave_max.shape == (PAIRS,)

# SPDX-License-Identifier: Apache-2.0
"""Elementary functions and small linear algebra against mpmath, NumPy and SciPy."""

import mpmath
import numpy as np
import pytest
from scipy.signal import butter, freqz, resample_poly, sosfreqz

from assets import butterworth
from eol_ros.core import algebra, elementary, elementary_kernels
from eol_ros.core.compiled import njit
from eol_ros.devices.audio import audio_file

COUNT = 1500
SECTIONS = {'output': 'sos', 'fs': 48000}


def worst_ulp(found, exact, *arguments):
    """Return the greatest error of `found` in units of the last place of the exact value."""
    with mpmath.workprec(140):
        errors = []
        for value, *given in zip(found.tolist(), *(a.tolist() for a in arguments), strict=True):
            truth = exact(*(mpmath.mpf(x) for x in given))
            ulp = mpmath.mpf(float(np.spacing(abs(float(truth)))))
            errors.append(abs(float((mpmath.mpf(value) - truth) / ulp)))
        return max(errors)


def spread(rng, low, high):
    """Return numbers of both signs whose size is even in its logarithm."""
    return rng.uniform(-1, 1, COUNT) * 10.0 ** rng.uniform(low, high, COUNT)


@pytest.mark.parametrize(
    ('name', 'exact', 'draw', 'most'),
    [
        ('exp', mpmath.exp, lambda r: r.uniform(-700, 700, COUNT), 1.0),
        ('exp', mpmath.exp, lambda r: spread(r, -17, 2), 1.0),
        ('exp2', lambda x: mpmath.mpf(2) ** x, lambda r: r.uniform(-1000, 1000, COUNT), 1.0),
        ('exp10', lambda x: mpmath.mpf(10) ** x, lambda r: r.uniform(-300, 300, COUNT), 3.0),
        ('log', mpmath.log, lambda r: abs(spread(r, -300, 300)), 1.0),
        ('log', mpmath.log, lambda r: 1 + spread(r, -12, -0.5), 1.0),
        ('log2', lambda x: mpmath.log(x, 2), lambda r: abs(spread(r, -300, 300)), 3.0),
        ('log10', mpmath.log10, lambda r: abs(spread(r, -300, 300)), 3.0),
        ('sin', mpmath.sin, lambda r: spread(r, -17, 5), 2.0),
        ('cos', mpmath.cos, lambda r: spread(r, -17, 5), 2.0),
        ('tan', mpmath.tan, lambda r: spread(r, -17, 5), 4.0),
    ],
)
def test_it_is_as_near_as_its_docstring_says(name, exact, draw, most):
    x = draw(np.random.default_rng(7))
    assert worst_ulp(getattr(elementary, name)(x), exact, x) <= most


def test_angles_and_lengths():
    rng = np.random.default_rng(8)
    y, x = spread(rng, -9, 9), spread(rng, -9, 9)
    assert worst_ulp(elementary.arctan2(y, x), mpmath.atan2, y, x) <= 3.0
    assert worst_ulp(elementary.hypot(y, x), mpmath.hypot, y, x) <= 2.0
    assert elementary.arctan2([0.0, 1.0, -1.0], [-1.0, 0.0, 0.0]) == pytest.approx(
        [np.pi, np.pi / 2, -np.pi / 2], abs=0
    )


def test_powers():
    x = abs(spread(np.random.default_rng(9), -6, 6))
    assert elementary.power(x, 0.7) == pytest.approx(x**0.7, rel=1e-14)
    assert elementary.power(np.array([0.0, 1.0]), 0.5).tolist() == [0.0, 1.0]
    assert elementary.exp2(np.array([-3.0, 0.0, 10.0])).tolist() == [0.125, 1.0, 1024.0]


def test_the_ends_of_what_a_float_can_be():
    big = np.array([-np.inf, -800.0, 0.0, np.nan])
    assert np.array_equal(elementary.exp(big), [0.0, 0.0, 1.0, np.nan], equal_nan=True)
    with np.errstate(over='ignore'):
        assert elementary.exp(np.array([800.0, np.inf])).tolist() == [np.inf, np.inf]
    log = elementary.log(np.array([0.0, -1.0, np.inf, np.nan, 5e-324]))
    assert log[:1].tolist() == [-np.inf] and np.isnan(log[[1, 3]]).all() and log[2] == np.inf
    assert log[4] == pytest.approx(-744.4400719213812)
    assert np.isnan(elementary.sin(np.array([1e6, np.inf]))).all()


@njit
def _compiled(x, y, out):
    for i in range(x.size):
        out[0, i] = elementary_kernels.exp(x[i])
        out[1, i] = elementary_kernels.log(x[i])
        out[2, i], out[3, i] = elementary_kernels.sincos(x[i])
        out[4, i] = elementary_kernels.arctan2(y[i], x[i])
        out[5, i] = elementary_kernels.exp10(x[i])


@pytest.mark.slow
def test_array_scalar_and_compiled_code_have_the_same_bits():
    rng = np.random.default_rng(10)
    x, y = spread(rng, -17, 4), spread(rng, -17, 4)
    x[:9] = 0.0, -0.0, np.inf, -np.inf, np.nan, 710.1, 709.7, -745.0, -746.5
    out = np.zeros((6, COUNT))
    _compiled(x, y, out)
    with np.errstate(over='ignore', invalid='ignore'):
        arrays = elementary.exp(x), elementary.log(x), *elementary.sincos(x)
        tens = elementary.exp10(x)
    for k, array in zip((0, 1, 2, 3, 5), (*arrays, tens), strict=True):
        assert np.array_equal(array, out[k], equal_nan=True), k
    finite = np.isfinite(x)
    assert np.array_equal(elementary.arctan2(y, x)[finite], out[4][finite])
    scalars = np.array(
        [(elementary.exp(v), elementary.log(v), *elementary.sincos(v)) for v in x.tolist()]
    ).T
    assert np.array_equal(scalars, out[:4], equal_nan=True)


def test_linear_algebra_agrees_with_lapack():
    rng = np.random.default_rng(13)
    a, b, tall = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.random((49, 6))
    assert algebra.matmul(a, b) == pytest.approx(a @ b, rel=1e-13)
    assert algebra.matmul(a, b[:, 0]) == pytest.approx(a @ b[:, 0], rel=1e-13)
    assert algebra.solve(a, b) == pytest.approx(np.linalg.solve(a, b), rel=1e-11)
    assert algebra.inverse(a) == pytest.approx(np.linalg.inv(a), rel=1e-11)
    wanted = np.linalg.lstsq(tall, rng.random((49, 3)), rcond=None)[0]
    assert algebra.least_squares(tall, tall @ wanted) == pytest.approx(wanted, rel=1e-10)
    with pytest.raises(np.linalg.LinAlgError):
        algebra.inverse(np.ones((2, 2)))


@pytest.mark.parametrize('n', [1, 2, 3, 10, 64])
def test_quadrature_agrees_with_numpy(n):
    for found, wanted in zip(
        algebra.gauss_legendre(n), np.polynomial.legendre.leggauss(n), strict=True
    ):
        assert found == pytest.approx(wanted, abs=1e-14)


@pytest.mark.parametrize(('low', 'high'), [(18, 110), (500, 800), (9000, 14400)])
def test_filters_agree_with_scipy(low, high):
    w = np.linspace(0.001, 3.1, 400)
    pairs = [
        (butterworth.band_pass(low, high, 48000), butter(2, [low, high], 'band', **SECTIONS)),
        (butterworth.high_pass(low, 48000), butter(2, low, 'high', **SECTIONS)),
    ]
    for ours, theirs in pairs:
        assert sosfreqz(ours, w)[1] == pytest.approx(sosfreqz(theirs, w)[1], abs=1e-10)
    first = sosfreqz(butterworth.low_pass(low, 48000), w)[1]
    assert first == pytest.approx(freqz(*butter(1, low, fs=48000), w)[1], abs=1e-10)


@pytest.mark.parametrize('rates', [(44100, 48000), (48000, 44100), (96000, 44100), (22050, 48000)])
def test_another_rate_sounds_as_scipy_makes_it(rates):
    sound = np.random.default_rng(14).standard_normal(4000).astype(np.float32)
    wanted = resample_poly(sound.astype(float), rates[1], rates[0])
    found = np.concatenate(list(audio_file.resampled([sound.astype(float)], *rates)))
    assert found == pytest.approx(wanted, abs=2e-6)

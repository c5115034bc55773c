# SPDX-License-Identifier: Apache-2.0
"""Elementary functions with the same bits on every machine.

NumPy and the C library choose their code for exp, log, sin and others by the processor, and differ
in the last bit. These functions use only float64 additions, multiplications and divisions, each
rounded by IEEE 754, in a fixed order. Code whose results are recomputed from a recording, or have a
digest, uses them. The error is at most 2 ulp (`test/core/test_elementary.py`), unless a docstring
says otherwise.

Reductions and polynomials: FDLIBM 5.3 (Sun Microsystems, 1993), e_exp.c, e_log.c, k_sin.c, k_cos.c,
s_atan.c. Arguments are float64 scalars or arrays; the result has their shape. exp and log of a
Python float take a tenth of the time of an array. The functions `..._of` a single float have the
same bits. `elementary_kernels` has compiled versions for loops.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
LN10 = 2.30258509299404568402
LOG10_2_HIGH, LOG10_2_LOW = 3.01029995663611771306e-01, 3.69423907715893078616e-13
LOG2_E = 1.44269504088896338700
LOG2_10 = 3.32192809488736234787
HALF_ROOT = 0.70710678118654752440
# pi / 2 in three parts of 33 bits, and the remainder
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21)
HALF_PI_LEFT = 8.47842766036889956997e-32
TWO_OVER_PI = 6.36619772367581382433e-01
BLOCK = 4096  # values computed at a time: some 32 KB an array
MOST_ANGLE = 1e5  # rad; beyond it the reduction would lose digits
TAN_PI_8 = 0.41421356237309504880
PI_4_HIGH, PI_4_LOW = 7.85398163397448278999e-01, 3.06161699786838301793e-17
_EXP = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05,
    -1.65339022054652515390e-06, 4.13813679705723846039e-08,
)  # fmt: skip
_LOG = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01,
    2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01,
    1.479819860511658591e-01,
)  # fmt: skip
_SIN = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_COS = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
_ATAN = (
    3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
    -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
    6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
    -3.65315727442169155270e-02, 1.62858201153657823623e-02,
)  # fmt: skip


def _in_blocks(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Make `function` process long arrays in blocks that fit the processor's cache."""

    @functools.wraps(function)
    def blocked(x: Any) -> Any:
        if isinstance(x, float) or np.size(x) <= BLOCK:
            return function(x)
        x = np.asarray(x, np.float64)
        flat = np.ravel(x)
        parts = [function(flat[i : i + BLOCK]) for i in range(0, flat.size, BLOCK)]
        return np.concatenate(parts, axis=-1).reshape(*np.shape(parts[0])[:-1], *x.shape)

    return blocked


@_in_blocks
def exp(x: Any) -> Any:
    """Return e to the power `x`; 0 below -746 and inf above 710."""
    if isinstance(x, float):
        return exp_of(float(x))
    x = np.minimum(np.maximum(np.asarray(x, np.float64), -746.0), 710.0)
    n = np.floor(x * LOG2_E + 0.5)
    return _scaled(n, x - n * LN2_HIGH, n * LN2_LOW)


def exp2(x: Any) -> Any:
    """Return 2 to the power `x`; 0 below -1076 and inf above 1024."""
    x = np.minimum(np.maximum(np.asarray(x, np.float64), -1080.0), 1030.0)
    n = np.rint(x)
    r = x - n
    return _scaled(n, r * LN2_HIGH, -r * LN2_LOW)


def exp10(x: Any) -> Any:
    """Return 10 to the power `x`, within 3 ulp; 0 below -325 and inf above 309."""
    x = np.minimum(np.maximum(np.asarray(x, np.float64), -325.0), 309.0)
    n = np.floor(x * LOG2_10 + 0.5)
    y = exp(((x - n * LOG10_2_HIGH) - n * LOG10_2_LOW) * LN10)
    return _times_power_of_2(y, n)


def _scaled(n: Any, high: Any, low: Any) -> Any:
    """Return 2^n e^(high - low), high - low in -0.35..0.35."""
    r = high - low
    t = r * r
    c = r - t * _polynomial(t, _EXP)
    y = 1.0 - ((low - r * c / (2.0 - c)) - high)
    return _times_power_of_2(y, n)


def _times_power_of_2(y: Any, n: Any) -> Any:
    """Return y 2^n; `n` is whole, or nan where y is."""
    return np.ldexp(y, np.where(n == n, n, 0.0).astype(np.int32))[()]


@_in_blocks
def log(x: Any) -> Any:
    """Return the natural logarithm of `x` >= 0; -inf for 0 and nan below it."""
    if isinstance(x, float):
        return log_of(float(x))
    x = np.asarray(x, np.float64)
    usable = (x > 0.0) & (x < np.inf)
    m, k = np.frexp(np.where(usable, x, 1.0))
    small = m < HALF_ROOT
    f = np.where(small, m + m, m) - 1.0
    k = (k - small).astype(np.float64)
    s = f / (2.0 + f)
    z = s * s
    half = 0.5 * f * f
    y = k * LN2_HIGH - ((half - (s * (half + z * _polynomial(z, _LOG)) + k * LN2_LOW)) - f)
    other = np.where(x == 0.0, -np.inf, np.where(x == np.inf, np.inf, np.nan))
    return np.where(usable, y, other)[()]


def log2(x: Any) -> Any:
    """Return the logarithm of `x` to base 2, within 3 ulp, exact for powers of 2."""
    m, k = np.frexp(np.asarray(x, np.float64))
    small = m < HALF_ROOT
    return ((k - small) + log(np.where(small, m + m, m)) * LOG2_E)[()]


def log10(x: Any) -> Any:
    """Return the logarithm of `x` to base 10, within 3 ulp."""
    return log(x) / LN10


def power(x: Any, exponent: Any) -> Any:
    """Return `x` > 0 to the power `exponent`, and 0 for 0.

    The relative error grows by some 1e-16 with each e-fold of the result.
    """
    if isinstance(x, float) and x > 0.0:
        return exp(exponent * log(x))
    positive = np.asarray(x) > 0.0
    return np.where(positive, exp(exponent * log(np.where(positive, x, 1.0))), 0.0)[()]


def hann(n: int) -> np.ndarray:
    """Return the Hann window of `n` > 1 points, zero at both ends, (n,)."""
    return 0.5 - 0.5 * cos(2.0 * np.pi * np.arange(n) / (n - 1))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of complex arrays; NumPy fuses multiply and add on some processors."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), np.complex128)
    out.real = a.real * b.real - a.imag * b.imag
    out.imag = a.real * b.imag + a.imag * b.real
    return out


@_in_blocks
def sincos(x: Any) -> Any:
    """Return sine and cosine of `x` rad, stacked, within 1e-16 + 1 ulp; nan beyond MOST_ANGLE."""
    if isinstance(x, float):
        return sincos_of(float(x))
    x = np.asarray(x, np.float64)
    x = np.where(abs(x) <= MOST_ANGLE, x, np.nan)
    n = np.floor(x * TWO_OVER_PI + 0.5)
    first, second, third = (n * part for part in HALF_PI)
    high = (x - first) - second
    r = high - third
    tail = (high - r) - third - n * HALF_PI_LEFT
    z = r * r
    sine = r + (r * z * _polynomial(z, _SIN) + tail)
    cosine = 1.0 - (0.5 * z - (z * z * _polynomial(z, _COS) - r * tail))
    quarter = np.nan_to_num(n).astype(np.int64) & 3
    odd = (quarter & 1) == 1
    up = np.where(odd, cosine, sine)
    along = np.where(odd, sine, cosine)
    along = np.where((quarter == 1) | (quarter == 2), -along, along)
    return np.stack([np.where(quarter >= 2, -up, up), along])


def sin(x: Any) -> Any:
    """Return the sine of `x` rad, as `sincos`."""
    return sincos(x)[0]


def cos(x: Any) -> Any:
    """Return the cosine of `x` rad, as `sincos`."""
    return sincos(x)[1]


def tan(x: Any) -> Any:
    """Return the tangent of `x` rad, within 4 ulp away from its poles."""
    sine, cosine = sincos(x)
    return sine / cosine


def arctan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y), -pi..pi rad, within 3 ulp; 0 for (0, 0)."""
    if isinstance(x, float) and isinstance(y, float):
        return arctan2_of(float(y), float(x))
    y, x = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(x, np.float64))
    long, short = np.maximum(abs(x), abs(y)), np.minimum(abs(x), abs(y))
    q = short / np.where(long == 0.0, 1.0, long)
    steep = q > TAN_PI_8
    t = np.where(steep, (q - 1.0) / (q + 1.0), q)
    z = t * t
    angle = t - t * z * _polynomial(z, _ATAN)
    angle = np.where(steep, PI_4_HIGH + (angle + PI_4_LOW), angle)
    angle = np.where(abs(y) > abs(x), 2 * PI_4_HIGH - (angle - 2 * PI_4_LOW), angle)
    angle = np.where(x < 0.0, 4 * PI_4_HIGH - (angle - 4 * PI_4_LOW), angle)
    return np.copysign(angle, y)[()]


def hypot(x: Any, y: Any) -> Any:
    """Return the length of (x, y), within 2 ulp, for squares that neither over- nor underflow."""
    if isinstance(x, float) and isinstance(y, float):
        return math.sqrt(x * x + y * y)
    return np.sqrt(x * x + y * y)


def _polynomial(x: Any, coefficients: tuple[float, ...]) -> Any:
    """Return sum of coefficients[k] x^k."""
    y: Any = coefficients[-1] * x
    for c in coefficients[-2:0:-1]:
        y += c
        y *= x
    y += coefficients[0]
    return y


def exp_of(x: float) -> float:
    """Return `exp` of a float."""
    if not x > -746.0:
        return 0.0 if x == x else x
    if x > 710.0:
        return math.inf
    n = math.floor(x * LOG2_E + 0.5)
    high, low = x - n * LN2_HIGH, n * LN2_LOW
    r = high - low
    t = r * r
    y = 0.0
    for i in range(len(_EXP) - 1, -1, -1):
        y = y * t + _EXP[i]
    c = r - t * y
    y = 1.0 - ((low - r * c / (2.0 - c)) - high)
    return math.ldexp(y, n) if n < 1024 else 2.0 * math.ldexp(y, 1023)


def log_of(x: float) -> float:
    """Return `log` of a float."""
    if x == 0.0:
        return -math.inf
    if not x > 0.0:
        return math.nan
    if x == math.inf:
        return x
    m, k = math.frexp(x)
    if m < HALF_ROOT:
        m, k = m + m, k - 1
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    y = 0.0
    for i in range(len(_LOG) - 1, -1, -1):
        y = y * z + _LOG[i]
    half = 0.5 * f * f
    return k * LN2_HIGH - ((half - (s * (half + z * y) + k * LN2_LOW)) - f)


def sincos_of(x: float) -> tuple[float, float]:
    """Return sine and cosine of a float, as `sincos`."""
    if not abs(x) <= MOST_ANGLE:
        return math.nan, math.nan
    n = math.floor(x * TWO_OVER_PI + 0.5)
    third = n * HALF_PI[2]
    high = (x - n * HALF_PI[0]) - n * HALF_PI[1]
    r = high - third
    tail = (high - r) - third - n * HALF_PI_LEFT
    z = r * r
    y, w = 0.0, 0.0
    for i in range(len(_SIN) - 1, -1, -1):
        y, w = y * z + _SIN[i], w * z + _COS[i]
    sine = r + (r * z * y + tail)
    cosine = 1.0 - (0.5 * z - (z * z * w - r * tail))
    quarter = n & 3
    if quarter == 0:
        return sine, cosine
    if quarter == 1:
        return cosine, -sine
    if quarter == 2:
        return -sine, -cosine
    return -cosine, sine


def arctan2_of(y: float, x: float) -> float:
    """Return `arctan2` of two floats."""
    if x != x or y != y:
        return math.nan
    up, along = abs(y), abs(x)
    long, short = max(along, up), min(along, up)
    q = short / long if long > 0.0 else 0.0
    steep = q > TAN_PI_8
    t = (q - 1.0) / (q + 1.0) if steep else q
    z = t * t
    w = 0.0
    for i in range(len(_ATAN) - 1, -1, -1):
        w = w * z + _ATAN[i]
    angle = t - t * z * w
    if steep:
        angle = PI_4_HIGH + (angle + PI_4_LOW)
    if up > along:
        angle = 2 * PI_4_HIGH - (angle - 2 * PI_4_LOW)
    if x < 0.0:
        angle = 4 * PI_4_HIGH - (angle - 4 * PI_4_LOW)
    return math.copysign(angle, y)

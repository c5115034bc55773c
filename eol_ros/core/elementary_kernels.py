# SPDX-License-Identifier: Apache-2.0
"""The functions of `elementary` for compiled loops: one float64 at a time, with the same bits.

LLVM takes exp, sin and others from the C library, whose bits differ between versions. LLVM neither
reassociates nor fuses operations of this module, even in a loop with `fastmath`.
"""

import math

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.elementary import LN10, LOG2_10, LOG10_2_HIGH, LOG10_2_LOW

exp = njit(cache=True, inner=True)(elementary.exp_of)
log = njit(cache=True, inner=True)(elementary.log_of)
sincos = njit(cache=True, inner=True)(elementary.sincos_of)
arctan2 = njit(cache=True, inner=True)(elementary.arctan2_of)


@njit(cache=True, inner=True)
def sin(x):
    """Return the sine of `x` rad."""
    return sincos(x)[0]


@njit(cache=True, inner=True)
def cos(x):
    """Return the cosine of `x` rad."""
    return sincos(x)[1]


@njit(cache=True, inner=True)
def tan(x):
    """Return the tangent of `x` rad."""
    sine, cosine = sincos(x)
    return sine / cosine


@njit(cache=True, inner=True)
def exp10(x):
    """Return 10 to the power `x`, within 3 ulp; 0 below -325 and inf above 309."""
    if not x > -325.0:
        return 0.0 if x == x else x
    if x > 309.0:
        return math.inf
    n = math.floor(x * LOG2_10 + 0.5)
    return math.ldexp(exp(((x - n * LOG10_2_HIGH) - n * LOG10_2_LOW) * LN10), n)


@njit(cache=True, inner=True)
def log10(x):
    """Return the logarithm of `x` to base 10."""
    return log(x) / LN10

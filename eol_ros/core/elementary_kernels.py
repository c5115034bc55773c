# SPDX-License-Identifier: Apache-2.0
"""The functions of `elementary` for compiled loops: one float64 at a time, with the same bits.

LLVM takes exp, sin and others from the C library, whose bits differ between versions. LLVM neither
reassociates nor fuses operations of this module, even in a loop with `fastmath`.
"""

from eol_ros.core import elementary
from eol_ros.core.compiled import njit

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
    """Return 10 to the power `x`, within 2 |x| + 1 ulp."""
    return exp(x * elementary.LN10)


@njit(cache=True, inner=True)
def log10(x):
    """Return the logarithm of `x` to base 10."""
    return log(x) / elementary.LN10

# SPDX-License-Identifier: Apache-2.0
"""Whether a measurement of the set-up is good enough, and what to do where it is not."""

import math
from collections.abc import Iterable
from typing import NamedTuple

GRADES = ('good', 'usable', 'poor')


class Verdict(NamedTuple):
    """One of GRADES, with the figure and its limits in `why`; `do` is empty where it is good.

    >>> print(Verdict('poor', 'blur 2.4 px', 'turn the lens'))
    poor: turn the lens (blur 2.4 px)
    """

    grade: str
    why: str
    do: str = ''

    def __str__(self) -> str:
        return f'{self.grade}: {self.do} ({self.why})' if self.do else f'{self.grade}: {self.why}'


def judged(
    name: str, value: float, unit: str, limits: tuple[float, float], reason: str, do: str
) -> Verdict:
    """Return the verdict on `value`: good up to the first limit, usable up to the second.

    A value that is not a number is poor.

    >>> print(judged('blur', 1.2, 'px', (1.55, 1.95), 'wider edges are less exact', 'turn it'))
    good: blur 1.2 px; good up to 1.55, usable up to 1.95: wider edges are less exact
    """
    good, usable = limits
    grade = 'good' if value <= good else 'usable' if value <= usable else 'poor'
    shown = f'{value:.3g} {unit}' if math.isfinite(value) else 'not known'
    why = f'{name} {shown}; good up to {good:g}, usable up to {usable:g}: {reason}'
    return Verdict(grade, why, '' if grade == 'good' else do)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the first of the verdicts with the lowest grade."""
    return max(verdicts, key=lambda one: GRADES.index(one.grade))

# SPDX-License-Identifier: Apache-2.0
"""Error against run time of one method, and how both are measured."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np


@dataclasses.dataclass
class Curve:
    """Error against run time of one method.

    Args:
        method, reference: what is measured, against what.
        unit: of the errors; `per` what a time in ms is of.
        points: (label, ms, error) of ours; `peers` of others.
        default: the label of what runs.
        limit: what is known of the best that can be.
        breaks: where it does not hold.
    """

    method: str
    reference: str
    unit: str
    per: str
    default: str
    limit: str
    breaks: str
    points: list[tuple[str, float, float]] = dataclasses.field(default_factory=list)
    peers: list[tuple[str, float, float]] = dataclasses.field(default_factory=list)


def milliseconds(work: Callable[[], Any], repeat: int = 5) -> float:
    """Return the least processor time of `work`, in ms."""
    best = float('inf')
    for _ in range(repeat):
        begin = time.process_time()
        work()
        best = min(best, time.process_time() - begin)
    return best * 1e3


def rms(values: Any) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))

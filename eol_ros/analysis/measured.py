# SPDX-License-Identifier: Apache-2.0
"""Figures of what `eol measure` has fitted."""

from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.analysis.figures import BLUE, GREY, ORANGE
from eol_ros.core.measure.friction import Friction
from eol_ros.core.measure.springs import Springs
from eol_ros.errors import ConfigError


def save(path: str | Path, found: Springs | Friction) -> None:
    """Write the figure of `found`, in the format that the name ends with."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot

    picture, axes = pyplot.subplots(1, 2, figsize=(9, 3.6), layout='constrained')
    if isinstance(found, Springs):
        _springs(axes, found)
    else:
        _friction(axes, found)
    try:
        picture.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ConfigError(f'{path}: cannot be written ({error})') from None
    finally:
        pyplot.close(picture)


def _springs(axes: Any, found: Springs) -> None:
    left, right = axes
    k, pulled = found.stiffness, found.pull - found.missed
    order = np.argsort(found.reach)
    free = pulled - found.friction_n * found.way
    left.plot(1e3 * found.reach[order], free[order], color=GREY, label=f'{k.value:.1f} N/m')
    for way, colour, mark, words in (
        (1, BLUE, '>', 'weight added'),
        (-1, ORANGE, '<', 'taken off'),
    ):
        rows = found.way == way
        for axis, ys in ((left, found.pull), (right, found.missed)):
            axis.plot(1e3 * found.reach[rows], ys[rows], mark, color=colour, label=words)
    right.axhline(0, color=GREY, linewidth=0.8)
    left.set(xlabel='stretch of the springs along the thread, mm', ylabel='weight, N')
    right.set(xlabel='stretch, mm', ylabel='left over by the fit, N')
    left.set_title(f'{k.value:.1f} ± {k.sigma:.1f} N/m', fontsize=10)
    left.legend(fontsize=8)


def _friction(axes: Any, found: Friction) -> None:
    left, right = axes
    for column, estimate, colour, words in (
        (0, found.static, BLUE, 'static'), (1, found.kinetic, ORANGE, 'kinetic'),
    ):  # fmt: skip
        name = ('static', 'kinetic')[column]
        each = [(slip.block, slip.stamp_s, getattr(slip, name)) for slip in found.slips]
        block, stamp_s, mu = np.array(each).T
        left.plot(
            np.searchsorted(found.blocks, block), mu, '.', color=colour, alpha=0.3, markersize=4
        )
        left.plot(
            np.arange(len(found.blocks)), found.each[:, column], '_', color='black', markersize=14
        )
        low, high = estimate.interval(0.95)
        for axis in (left, right):
            axis.axhspan(low, high, color=colour, alpha=0.15, linewidth=0)
        right.plot(stamp_s - stamp_s.min(), mu, '.', color=colour, markersize=4, label=words)
    ticks = range(len(found.blocks))
    left.set(xlabel='block', ylabel='friction', xticks=ticks, xticklabels=found.blocks)
    left.set_title('each slip, the blocks (dashes), 95 % of the mean (bands)', fontsize=10)
    right.set(xlabel='time, s', ylabel='friction')
    right.legend(fontsize=8)

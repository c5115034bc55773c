# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/science.md: each says the command, seeds, spread and runtime it is of."""

import time
from pathlib import Path
from typing import Any

BEGUN_S = time.perf_counter()
FOOT = 0.035  # of the height, which the line at the foot takes


def axes(rows: int, columns: int, size: tuple[float, float], **more: Any) -> tuple[Any, Any]:
    """Return a figure of `size`, inches, with room for the line at its foot; axes (r, c)."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    figure, grid = plt.subplots(
        rows, columns, figsize=size, layout='constrained', squeeze=False, **more
    )
    figure.get_layout_engine().set(rect=(0, FOOT, 1, 1 - FOOT))
    return figure, grid


def save(figure: Any, folder: Path, name: str, said: str, timed: bool = True) -> None:
    """Write NAME.png into `folder`; `said`: command, seeds and spread.

    The runtime is added, where `timed`: not where results of another day are added to.
    """
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    took = f'; {time.perf_counter() - BEGUN_S:.0f} s' if timed else ''
    figure.text(0.995, 0.004, said + took, ha='right', fontsize=6, color='#777777')
    figure.savefig(folder / f'{name}.png', dpi=110)
    plt.close(figure)


def areas(axis: Any, most: int) -> None:
    """Name areas 1 to `most` on a logarithmic axis."""
    ticks = [a for a in (1, 2, 5, 10, 25, 64, 100, 1000) if a <= most]
    axis.set_xticks(ticks, labels=[str(a) for a in ticks])
    axis.minorticks_off()

# SPDX-License-Identifier: Apache-2.0
"""The pictures of benchmarks: curves with error bars, some panels side by side."""

import math
from pathlib import Path

Point = tuple[float, float, float, str]  # x, y, standard deviation of y, label
Curves = dict[str, list[Point]]


def draw(
    path: Path, panels: dict[str, Curves], x: str, y: str, scales: tuple[str, str] = ('log', 'log')
) -> Path:
    """Write the panels, by title, as a picture; curves without labels are joined.

    A y of zero on a logarithmic axis is drawn at the foot of that axis.
    """
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    wide = min(len(panels), 4)
    high = math.ceil(len(panels) / wide)
    figure, axes = plt.subplots(
        high, wide, figsize=(3.4 * wide + 0.8, 3.1 * high), squeeze=False, layout='constrained',
        sharey=len(panels) > 1,
    )  # fmt: skip
    names = list(dict.fromkeys(name.partition(',')[0] for one in panels.values() for name in one))
    heights = [p[1] for one in panels.values() for rows in one.values() for p in rows]
    for axis, (title, curves) in zip(axes.flat, panels.items(), strict=False):
        axis.set(xscale=scales[0], yscale=scales[1], title=title, xlabel=x)
        if scales[1] == 'log' and min(heights, default=1.0) <= 0:
            least = min((height for height in heights if height > 0), default=1e-3)
            axis.set_yscale('symlog', linthresh=least / 2)
        for name, rows in curves.items():
            k = names.index(name.partition(',')[0])
            at, height, deviation, labels = zip(*sorted(rows), strict=True)
            axis.errorbar(
                at, height, deviation if any(deviation) else None, capsize=2, markersize=4,
                label=name, color=f'C{k % 10}', marker='osd^vP*X'[k % 8],
                linestyle='none' if any(labels) else '-',
            )  # fmt: skip
            for where, label in zip(zip(at, height, strict=True), labels, strict=True):
                axis.annotate(
                    label, where, (3, 3), textcoords='offset points', fontsize=7,
                    rotation=0 if where[1] else 40,
                )  # fmt: skip
        axis.tick_params(axis='x', which='minor', labelsize=6, labelrotation=40)
        axis.margins(0.25 if any(p[3] for rows in curves.values() for p in rows) else 0.05)
        axis.grid(alpha=0.3)
        if curves and len(curves) + len(panels) > 2:
            axis.legend(fontsize=6)
    for axis in axes[:, 0]:
        axis.set_ylabel(y)
    for axis in axes.flat[len(panels) :]:
        axis.axis('off')
    figure.savefig(path, dpi=80)
    plt.close(figure)
    return path

# SPDX-License-Identifier: Apache-2.0
"""Plots of `eol bench physics`: error against run time."""

from pathlib import Path

MARKS = {
    'exact': ('o', 'C0'),
    'event': ('s', 'C1'),
    'stepping': ('^', 'C2'),
    'scipy': ('d', 'C3'),
    'mujoco': ('v', 'C4'),
    'pymunk': ('P', 'C5'),
}
FLOOR_M = 1e-17  # an error of exactly zero is drawn here


def draw(result: dict, folder: Path) -> None:
    """Write physics_error.png into `folder`."""
    import matplotlib

    matplotlib.use('Agg')
    folder.mkdir(parents=True, exist_ok=True)
    rows = [r for r in result['own'] + result['rotation'] + result['peers'] if 'error_m' in r]
    names = list(dict.fromkeys(r['scene'] for r in rows))
    wide = len(names) // 3 + 1  # at least one place is left, for the legend
    if names:
        _errors(result, rows, names, wide, folder)


def _errors(result: dict, rows: list[dict], names: list[str], wide: int, folder: Path) -> None:
    """Draw error against run time, one panel a scene."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        3,
        wide,
        figsize=(3 * wide, 8),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout='constrained',
    )
    shown = {}
    for axis, name in zip(axes.flat, names, strict=False):
        for family, (mark, colour) in MARKS.items():
            here = [r for r in rows if r['scene'] == name and r['method'].startswith(family)]
            if here:
                (shown[family],) = axis.loglog(
                    [r['ms'] / r['seconds'] for r in here],
                    [max(r['error_m'], FLOOR_M) for r in here],
                    mark,
                    color=colour,
                    markersize=6,
                )
        beside = [r for r in result['peers'] if r['scene'] == name and 'own_ms' in r]
        if beside and name.endswith(' equal'):
            (shown['ours, in the run of the peers'],) = axis.loglog(
                [r['own_ms'] / r['seconds'] for r in beside],
                [max(r['own_error_m'], FLOOR_M) for r in beside],
                'k*',
                markersize=8,
            )
        axis.set_title(name)
        axis.grid(alpha=0.3)
        axis.tick_params(labelbottom=True)
    for axis in axes[:, 0]:
        axis.set_ylabel('largest error, m')
    for axis in axes[-1]:
        axis.set_xlabel('ms per simulated second')
    for axis in axes.flat[len(names) :]:
        axis.axis('off')
    axes.flat[-1].legend(shown.values(), shown.keys(), loc='center', frameon=False)
    figure.savefig(folder / 'physics_error.png', dpi=90)
    plt.close(figure)

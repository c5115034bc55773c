# SPDX-License-Identifier: Apache-2.0
"""Plots of `eol bench vision`: error against run time, error against noise, error in clutter."""

from pathlib import Path

import numpy as np

from benchmarks.vision_scenes import OURS

_MARKS = {
    OURS: ('o', '#c1272d'),
    'SimpleBlobDetector': ('s', '#4d4d4d'),
    'components + moments': ('^', '#2b6ca3'),
    'contours + minAreaRect': ('v', '#e39c37'),
    'trackpy, quarter size': ('D', '#6a994e'),
}


def draw(result: dict, folder: str) -> list[Path]:
    """Write vision_time.png, vision_noise.png and vision_clutter.png; return what was written."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    plt.rcParams.update(
        {
            'font.size': 10,
            'axes.spines.top': False,
            'axes.spines.right': False,
            'figure.constrained_layout.use': True,
            'savefig.dpi': 110,
        }
    )
    Path(folder).mkdir(parents=True, exist_ok=True)
    written = []
    for name, make in (('time', _time), ('noise', _noise), ('clutter', _clutter)):
        if not (result['clutter'] if name == 'clutter' else result['noise']):
            continue
        figure = make(plt, result)
        written.append(Path(folder) / f'vision_{name}.png')
        figure.savefig(written[-1])
        plt.close(figure)
    return written


def _time(plt, result):
    """Error against run time, clean images at noise L2."""
    entry = result['noise']['L2']
    figure, axes = plt.subplots(figsize=(7, 4.2))
    for name, f in entry['methods'].items():
        mark, colour = _MARKS[name]
        axes.plot(f['ms_median'], f['rms_px'], mark, color=colour, ms=9)
        below = name == 'components + moments'  # beside SimpleBlobDetector
        axes.annotate(
            name,
            (f['ms_median'], f['rms_px']),
            (7, -14 if below else 6),
            textcoords='offset points',
            color=colour,
        )
    axes.axhline(entry['bound_px'], color='k', lw=1, ls='--')
    axes.annotate(
        'Cramer-Rao bound',
        (1, entry['bound_px']),
        (-4, -13),
        ha='right',
        xycoords=('axes fraction', 'data'),
        textcoords='offset points',
    )
    axes.set(
        xscale='log',
        yscale='log',
        xlabel='ms an image, median, one core, 25 blocks',
        ylabel='position error, px RMS per axis',
        title='Clean images, noise L2',
    )
    axes.set_ylim(entry['bound_px'] * 0.5)
    axes.set_xlim(right=axes.get_xlim()[1] * 3)
    return figure


def _noise(plt, result):
    """Error against noise level."""
    levels = list(result['noise'])
    figure, axes = plt.subplots(figsize=(7, 4.2))
    for name, (mark, colour) in _MARKS.items():
        rms = [result['noise'][n]['methods'].get(name, {}).get('rms_px') for n in levels]
        if all(rms):
            axes.plot(levels, rms, marker=mark, color=colour, label=name)
    axes.plot(
        levels,
        [result['noise'][n]['bound_px'] for n in levels],
        'k--',
        lw=1,
        label='Cramer-Rao bound',
    )
    axes.set(
        yscale='log',
        xlabel='noise level',
        ylabel='position error, px RMS per axis',
        title='Clean images, blocks at rest, one image each',
    )
    axes.legend(frameon=False, fontsize=8)
    return figure


def _clutter(plt, result):
    """Error of whole and of partly hidden blocks, per clutter level."""
    levels = list(result['clutter'])
    figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True)
    for panel, key, title in (
        (axes[0], 'rms_px', 'blocks in full sight'),
        (axes[1], 'rms_partly_px', 'blocks 2 to 50 % hidden'),
    ):
        names = list(next(iter(result['clutter'][levels[0]].values())))
        for k, name in enumerate(names):
            colour = _MARKS[name][1]
            for at, level in enumerate(levels):
                values = [
                    m[name][key]
                    for m in result['clutter'][level].values()
                    if m[name][key] is not None
                ]
                if values:
                    x = at + (k - (len(names) - 1) / 2) * 0.15
                    panel.bar(
                        x,
                        np.sqrt(np.mean(np.square(values))),
                        0.14,
                        color=colour,
                        label=name if at == 0 else None,
                    )
        panel.set(yscale='log', title=title)
        panel.set_xticks(range(len(levels)), levels)
    axes[0].set_ylabel('position error, px RMS per axis')
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, frameon=False, fontsize=8, ncols=len(labels), loc='outside lower center'
    )
    return figure

# SPDX-License-Identifier: Apache-2.0
"""A figure of a corpus: what was measured, and the space that the blocks play."""

from pathlib import Path

import numpy as np

from eol_ros.core.sound.corpus import Corpus
from eol_ros.errors import ConfigError, DeviceMissing, pip_install

SHAPES = 'os^DvpP*'  # of the sounds, in turn


def draw(corpus: Corpus, path: Path) -> None:
    """Write PNG, SVG or PDF: descriptors as measured on the left, places in the space on the right.

    Colour is loudness, size is duration, a ring marks a grain with a clear pitch, the shape says of
    which sound it is.
    """
    try:
        from matplotlib import style
        from matplotlib.figure import Figure
        from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter
    except ImportError:
        raise DeviceMissing(f'images need matplotlib: {pip_install("matplotlib")}') from None

    grains = corpus.grains[corpus.placed]
    x, y = grains[corpus.x_name], grains[corpus.y_name]
    loud = np.nan_to_num(grains['loudness_lufs'], nan=-70.0)  # of a corpus made elsewhere
    size = np.clip(60 * grains['duration_s'] / np.median(grains['duration_s']), 8, 300)
    size *= min(1.0, 300 / len(grains)) ** 0.5
    names = f'{Path(corpus.sources[0].path).name}'
    if len(corpus.sources) > 1:
        names += f' and {len(corpus.sources) - 1} more'
    silent = len(corpus) - len(grains)
    low, high = np.percentile(loud, [2, 98])
    pitched = np.isfinite(grains['pitch_hz'])
    with style.context('dark_background'):
        figure = Figure(figsize=(13, 6.2), layout='constrained')
        figure.suptitle(f'{names}: {len(grains)} grains placed, {silent} silent')
        left, right = figure.subplots(1, 2)
        for axes, across, up in ((left, x, y), (right, grains['x'], grains['y'])):
            for number, source in enumerate(corpus.sources):
                of = grains['file'] == number
                dots = axes.scatter(
                    across[of], up[of], s=size[of], c=loud[of], cmap='viridis',
                    vmin=low, vmax=max(high, low + 1e-9), marker=SHAPES[number % len(SHAPES)],
                    edgecolors=np.where(pitched[of], 'white', 'none'), linewidths=0.7,
                    label=Path(source.path).name,
                )  # fmt: skip
            axes.set(xlabel=corpus.x_name, ylabel=corpus.y_name)
        left.set_title('as measured')
        for name, scale, axis in (
            (corpus.x_name, left.set_xscale, left.xaxis),
            (corpus.y_name, left.set_yscale, left.yaxis),
        ):
            if name.endswith('_hz') and len(grains):
                scale('log')
                # 600, 1000, 2000 Hz rather than powers of ten
                axis.set_major_locator(LogLocator(subs=(1, 2, 4, 6)))
                axis.set_major_formatter(ScalarFormatter())
                axis.set_minor_formatter(NullFormatter())
        right.set(
            title='the space, as the blocks reach it', xlim=(0, 1), ylim=(0, 1), aspect='equal'
        )
        if len(corpus.sources) > 1:
            left.legend(fontsize=8, title='white ring: clear pitch', title_fontsize=8)
        figure.colorbar(dots, ax=(left, right), shrink=0.8, label='loudness, LUFS')
        try:
            figure.savefig(path, dpi=110)
        except (OSError, ValueError) as error:
            raise ConfigError(f'{path}: the image cannot be written ({error})') from None

# SPDX-License-Identifier: Apache-2.0
"""Plots of what `eol bench sound` measured."""

from pathlib import Path

PEER_COLOURS = ('#b5483a', '#d98b3f', '#7a6aa8', '#5b8f6b')


def draw(result: dict, folder: Path) -> None:
    """Write sound_speed.png and sound_error.png into `folder`."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    names = [n for n in dict.fromkeys(p['name'] for p in result['peers'] if 'skipped' not in p)]
    colours = dict(zip(names, PEER_COLOURS, strict=False))

    fig, axes = plt.subplots(1, 2, figsize=(9, 3.8), sharey=True, layout='constrained')
    for axis, varied in zip(axes, (False, True), strict=True):
        for cubic, line in ((True, '-'), (False, '--')):
            rows = [
                r for r in result['engine']
                if (r['varied'], r['cubic'], r['overlap']) == (varied, cubic, 400)
            ]  # fmt: skip
            axis.plot(
                [r['block'] for r in rows], [r['voices_per_core'] for r in rows], line, marker='o',
                color='#20507a', label=f'eol_ros, {"cubic" if cubic else "linear"}',
            )  # fmt: skip
        for name in names:
            rows = [
                p for p in result['peers']
                if (p['name'], p.get('overlap'), p.get('varied')) == (name, 400, varied)
            ]  # fmt: skip
            if rows:
                axis.plot(
                    [p['block'] for p in rows], [p['voices_per_core'] for p in rows],
                    marker='s', color=colours[name], label=name,
                )  # fmt: skip
        axis.set(
            xscale='log', xlabel='block, samples', xticks=[64, 128, 256, 512], yscale='log',
            title='speed of reading ' + ('0.5 to 2' if varied else '1'),
        )  # fmt: skip
        axis.set_xticklabels(['64', '128', '256', '512'])
        axis.minorticks_off()
        ticks = (1, 2, 5, 10, 20, 40)
        axis.set_yticks([1000 * t for t in ticks], [f'{t}k' for t in ticks])
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    axes[0].set_ylabel('grains that one core can sound at once')
    fig.savefig(folder / 'sound_speed.png', dpi=110)
    plt.close(fig)

    fig, axis = plt.subplots(figsize=(6.4, 4), layout='constrained')
    for cubic, varied, marker in (
        (True, False, 'o'), (False, False, 's'), (True, True, '^'), (False, True, 'v'),
    ):  # fmt: skip
        rows = [
            r for r in result['engine']
            if (r['cubic'], r['varied'], r['overlap']) == (cubic, varied, 400)
        ]  # fmt: skip
        label = f'eol_ros, {"cubic" if cubic else "linear"}, speed {"0.5-2" if varied else "1"}'
        x = [r['ns_per_voice_sample'] for r in rows]
        axis.plot(x, [r['error_db'] for r in rows], marker=marker, ls=':', label=label)
    for p in result['peers']:
        if (p.get('overlap'), p.get('block')) == (400, 64) and p['error_db'] is not None:
            axis.plot(
                p['ns_per_voice_sample'], p['error_db'], '*' if p['varied'] else 'P', ms=10,
                color=colours[p['name']],
                label=f'{p["name"]}, speed {"0.5-2" if p["varied"] else "1"}',
            )  # fmt: skip
    axis.set(
        xscale='log', xlabel='CPU time, ns a voice and sample',
        ylabel='error against float64, dB',
    )  # fmt: skip
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    fig.savefig(folder / 'sound_error.png', dpi=110)
    plt.close(fig)

# SPDX-License-Identifier: Apache-2.0
"""Many simulated hours of names, each by a seed of its own; what is measured can be kept."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from eol_ros.errors import ConfigError

Figures = dict[str, dict[str, float | None]]  # of each method


def measure(
    one: Callable[[int], Figures], seeds: range, settings: dict[str, Any], kept: Path | None
) -> Figures:
    """Return what `one` measures by all `seeds`, together.

    kept: a file of one line for each seed. What stands there for these `settings` is not measured
    again, and what is measured is added at once. It knows nothing of the program's version.

    Raises:
        ConfigError: a line of `kept` is none of these.
    """
    known = _read(kept) if kept is not None and kept.exists() else []
    found = {line['seed']: line['figures'] for line in known if line['settings'] == settings}
    for done, seed in enumerate(seeds, 1):
        if seed not in found:
            found[seed] = one(seed)
            if kept is not None:
                line = {'seed': seed, 'settings': settings, 'figures': found[seed]}
                with kept.open('a', encoding='utf-8') as file:
                    file.write(json.dumps(line) + '\n')
        lasting = sum(one['lasting_failures_per_hour'] > 0 for one in found[seed].values())
        said = 'a lasting failure' if lasting else 'no lasting failure'
        print(f'seed {seed}, {done} of {len(seeds)}: {said}', file=sys.stderr, flush=True)
    return together([found[seed] for seed in seeds], settings['hours'])


def together(pieces: list[Figures], hours: float) -> Figures:
    """Return means of the figures of `pieces`, each of so many hours, and what failed in all."""
    total, result = hours * len(pieces), {}
    for name in pieces[0]:
        of = [piece[name] for piece in pieces]
        figures = {key: _mean([one[key] for one in of]) for key in of[0]}
        lasting = round(figures['lasting_failures_per_hour'] * total)
        result[name] = figures | {
            'hours': total,
            'switches_per_hour_most': max(one['switches_per_hour'] for one in of),
            'lasting_failures': lasting,
            # Garwood 1936, one side
            'lasting_per_hour_below_95': float(stats.chi2.ppf(0.95, 2 * lasting + 2) / 2 / total),
        }
    return result


def _mean(of: list[float | None]) -> float | None:
    """Return the mean of those that were measured."""
    known = [one for one in of if one is not None]
    return float(np.mean(known)) if known else None


def _read(file: Path) -> list[dict[str, Any]]:
    lines = file.read_text(encoding='utf-8').splitlines()
    found = []
    for number, text in enumerate(lines, 1):
        try:
            line = json.loads(text)
            found.append({key: line[key] for key in ('seed', 'settings', 'figures')})
        except (ValueError, KeyError, TypeError):
            if number == len(lines):  # cut off while it was written: measured again
                continue
            raise ConfigError(
                f'line {number} of {file} is no result of eol bench identity; name another file '
                'with --keep'
            ) from None
    return found

# SPDX-License-Identifier: Apache-2.0
"""Seeds drawn when a bench runs, beside those that a method was developed on."""

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from typing import Any

from benchmarks.machine import tell

OPTION = '--seeds-from-time'


def add_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the option."""
    parser.add_argument(
        OPTION,
        action='store_true',
        help='also measure as many seeds drawn from the time of the run; show both side by side',
    )


def measure(
    seeds_from_time: bool,
    first_seed: int,
    one: Callable[[int], dict[str, Any]],
    as_json: bool,
    table: Callable[[dict[str, Any]], str],
) -> None:
    """Tell what `one` measures from `first_seed` on, and with the option from a drawn one, too.

    The drawn seed is told, so that anybody can repeat its figures with the bench's own option.
    """
    developed = one(first_seed)
    if not seeds_from_time:
        tell(developed, as_json, table)
        return
    drawn = time.time_ns() // 10**6 % 10**9
    print(f'seeds drawn: from {drawn} on', file=sys.stderr, flush=True)
    both = {f'developed on, from {first_seed}': developed, f'drawn, from {drawn}': one(drawn)}
    tell({'seeds': both}, as_json, lambda found: _table(found['seeds'], table))


def _table(both: dict[str, dict[str, Any]], table: Callable[[dict[str, Any]], str]) -> str:
    first, second = ([f'seeds {name}', *table(found).split('\n')] for name, found in both.items())
    width = max(map(len, first))
    rows = itertools.zip_longest(first, second, fillvalue='')
    return '\n'.join(f'{left:{width}} | {right}'.rstrip() for left, right in rows)

# SPDX-License-Identifier: Apache-2.0
"""Two definitions of a cascade on the same events, and what is drawn of them."""

from types import SimpleNamespace

import numpy as np

from benchmarks import definitions


def run_of(*slips):
    """A run of slips (begin, end, block)."""
    rows = sorted([(b, 1, k) for b, _, k in slips] + [(e, 0, k) for _, e, k in slips])
    t, start, block = np.array(rows).T
    return SimpleNamespace(event_t=t, event_start=start.astype(int), event_block=block.astype(int))


def test_neighbours_and_the_gap_make_the_difference():
    # 0 and 1 touch and overlap; 24 slips far off meanwhile; 6 follows 1 after 0.3 s
    run = run_of((0.0, 1.0, 0), (0.5, 1.5, 1), (0.6, 1.2, 24), (1.8, 2.0, 6))

    assert sorted(definitions.by_rest(run)) == [1, 3]
    assert sorted(definitions.by_graph(run, 0.0)) == [1, 1, 2]
    assert sorted(definitions.by_graph(run, 0.5)) == [1, 3]


def test_rows_are_told_and_drawn(tmp_path):
    rng = np.random.default_rng(1)
    each = [rng.choice([1, 2, 12, 25], 400) for _ in range(2)]
    rows = [definitions._row('pull', 0.001, name, each) for name in (definitions.REST, 'gap 0 s')]
    result = {'seeds': 2, 'gap_s': definitions.default_gap_s(), 'rows': rows}

    assert rows[0]['at_least'][0] == 800 and rows[0]['rejected'] == rows[0]['fitted'] == 2
    assert '| pull, 1 mm/s | rest to rest | 800 |' in definitions.table(result)
    assert definitions.default_gap_s() in definitions.GAPS_S
    definitions.draw(result, tmp_path)
    assert (tmp_path / 'definitions.png').stat().st_size > 1000

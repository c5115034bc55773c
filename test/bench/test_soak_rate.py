# SPDX-License-Identifier: Apache-2.0
"""An exhibition finds how fast its readers are, and tells what was lost and what grew."""

import pytest

from benchmarks import soak
from benchmarks.soak import Look
from benchmarks.soak_proof import Held


@pytest.mark.parametrize('grows_mb', [0.0, 60.0])
def test_what_an_exhibition_has_shown(monkeypatch, grows_mb):
    seen = [
        Look(
            30.0 * k,
            {'lost': k // 99, 'late': 2},
            {'motion': Held(20, 8, 100 + grows_mb * k / 720)},
        )
        for k in range(1, 721)
    ]
    looked = iter([None, *seen])  # at first it does not answer
    monkeypatch.setattr(soak, '_look', lambda *_: next(looked))
    monkeypatch.setattr(soak.time, 'sleep', lambda _: None)
    looks = []
    assert len(list(soak._play(None, 60.0, 18_000.0, None, looks))) == 100
    assert looks == seen[:600]
    bags = {'count': 2, 'faults': ['a: damaged']}
    found = soak.figures(looks, 3000.0, bags, ['a fault'])
    assert (found['hours'], found['took_hours'], found['times_real_time']) == (5.0, 0.833, 6.0)
    assert (found['lost'], found['late'], found['underruns']) == (6, 2, 0)
    assert found['growth'][0]['flat'] == (grows_mb == 0) and found['bags'] == {'count': 2}
    assert found['faults'][0] == 'a fault' and found['faults'][-1] == 'a: damaged'
    assert [f.partition(':')[0] for f in found['faults'][1:-1]] == ['motion grows'] * (grows_mb > 0)

# SPDX-License-Identifier: Apache-2.0
"""A worker that completes no round: noticed in time, and only where its watcher ran itself."""

from eol_ros.core.round_watch import HUNG_S, STALLED_S, RoundWatch


def watched(counts):
    watch = RoundWatch()
    for now_s, count in counts:
        watch.look(now_s, count)
    return watch


def test_a_count_that_stands_still_is_stalled_and_then_hung():
    still = [(k, 7) for k in range(20)]
    assert not watched(still[: int(STALLED_S)]).stalled
    assert watched(still[: int(STALLED_S) + 1]).stalled
    assert not watched(still[: int(HUNG_S)]).hung and watched(still[: int(HUNG_S) + 1]).hung


def test_a_count_that_goes_on_or_owes_nothing_is_never_stalled():
    assert watched((k, k) for k in range(60)).still_s == 0.0
    assert watched((k, None) for k in range(60)).still_s == 0.0
    assert watched([*((k, 3) for k in range(60)), (60, 4)]).still_s == 0.0


def test_a_process_that_did_not_run_keeps_its_workers_waiting():
    assert not watched([(0.0, 5), (60.0, 5)]).stalled

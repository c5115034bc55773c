# SPDX-License-Identifier: Apache-2.0
"""Wait for what other threads, processes or nodes bring about; the one loop of all tests."""

import time
from collections.abc import Callable
from typing import Any

import pytest

GENEROUS_S = 60.0  # a busy machine is no fault of the code; only a test that fails waits so long


def wait_until(
    condition: Callable[[], Any],
    seconds: float = GENEROUS_S,
    *,
    turn: Callable[[], Any] = lambda: time.sleep(0.01),
    why: Callable[[], str] = lambda: 'it did not come about',
) -> Any:
    """Return what `condition` returns, as soon as that is true; fail the test with `why` if never.

    turn: what is done between two looks, such as a round of an executor; short.
    """
    end = time.monotonic() + seconds
    while not (found := condition()):
        if time.monotonic() > end:
            pytest.fail(f'{why()} in {seconds:g} s')
        turn()
    return found

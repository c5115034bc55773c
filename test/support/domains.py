# SPDX-License-Identifier: Apache-2.0
"""DDS domains for the graphs that tests start themselves: no two processes of tests share one.

From 1 to 20 are those of the nodes in the tests' own processes (test/conftest.py), from 21 to 59
those that `support.running.Graph` looks among, 100 is that of the secure network.
"""

import itertools
import os

_workers = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
_worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
_share = 40 // _workers
_domains = itertools.cycle(range(60 + _worker * _share, 60 + (_worker + 1) * _share))


def next_domain() -> int:
    """Return a domain that this process has not given for the longest time."""
    return next(_domains)

# SPDX-License-Identifier: Apache-2.0
"""A loopback that nobody else hears, for the simulated camera of `benchmarks/gige.py`."""

import contextlib
import ctypes
import subprocess

from benchmarks.gige import GREY, NAME, Gige, without
from support import needs

__all__ = ['GREY', 'NAME', 'Gige', 'own_network', 'without']

LIBRARY = 'libaravis-0.8-0'
CLONE_NEWNET = 0x40000000


@contextlib.contextmanager
def own_network():
    """Put this thread and those that it starts into a network of its own, where that is allowed."""
    needs.system(LIBRARY, 'iproute2')
    libc = ctypes.CDLL(None, use_errno=True)
    with open('/proc/thread-self/ns/net') as before:
        if libc.unshare(CLONE_NEWNET):
            yield  # no rights: the machine's own loopback does, too
            return
        try:
            subprocess.run(['ip', 'link', 'set', 'lo', 'up'], check=True)
            yield
        finally:
            assert libc.setns(before.fileno(), CLONE_NEWNET) == 0

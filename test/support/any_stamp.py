# SPDX-License-Identifier: Apache-2.0
"""Nodes that use messages of any time, for tests whose stamps are of another day."""

import pytest


def use_any_stamp(patch: pytest.MonkeyPatch) -> None:
    """Let the nodes of this process use messages of any time, until the patch is undone."""
    from eol_ros.ros.node import EolNode
    from eol_ros.streams.checks import ANY_TIME

    patch.setattr(EolNode, 'stamps_span', lambda node: ANY_TIME)

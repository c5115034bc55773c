# SPDX-License-Identifier: Apache-2.0
"""The table that the nodes of a test know, where `support.tables.on_tables` gives it no other."""

import pytest

from eol_ros.core.table import Table


@pytest.fixture
def table():
    return Table()

# SPDX-License-Identifier: Apache-2.0
"""The settings that a bag was recorded with, by the names of today."""

import dataclasses
from typing import Any

import yaml

from eol_ros.analysis.bag import Bag
from eol_ros.settings import by_today
from eol_ros.streams.graph import NODES


def recorded_settings(bag: Bag, node: str) -> dict[str, Any] | None:
    """Return what the bag states of the settings of `node`; None if its scene lacks that node."""
    nodes = (yaml.safe_load(bag.about.get('settings', '')) or {}).get('nodes', {})
    if node not in nodes:
        return None
    kind = NODES[node].settings
    known = {field.name for field in dataclasses.fields(kind)}
    return {k: v for k, v in by_today(kind, nodes[node] or {}).items() if k in known}

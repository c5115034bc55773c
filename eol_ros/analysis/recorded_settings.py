# SPDX-License-Identifier: Apache-2.0
"""The settings that a bag was recorded with, by the names of today."""

import dataclasses
from typing import Any

import yaml

from eol_ros import yaml_text
from eol_ros.analysis.bag import Bag
from eol_ros.core.table import Table
from eol_ros.devices.bag.reader import table_in
from eol_ros.settings import by_today
from eol_ros.streams.graph import NODES


def recorded_table(bag: Bag) -> Table:
    """Return the table that a bag was recorded at; the default where the bag does not say."""
    return Table.of(table_in(bag.about.get('settings', '')) or Table())


def recorded_settings(bag: Bag, node: str) -> Any | None:
    """Return the settings that `node` was recorded with; None where the bag does not say."""
    try:
        values: dict[str, Any] = yaml_text.load(bag.about['settings'])['nodes'][node] or {}
        kind = NODES[node].settings
        known = {field.name for field in dataclasses.fields(kind)}
        found = {k: v for k, v in by_today(kind, values).items() if k in known}
        return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in found.items()})
    except (AttributeError, KeyError, TypeError, yaml.YAMLError):
        return None

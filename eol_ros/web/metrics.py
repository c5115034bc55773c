# SPDX-License-Identifier: Apache-2.0
"""The state of all nodes for Prometheus, in its text format.

The package `prometheus-client` is an extra (`eol_ros[metrics]`): who does not ask
for `/metrics` needs and loads none of it.
"""

import math
from typing import Any

from eol_ros.errors import DeviceMissing, pip_install
from eol_ros.web.notices import LEVELS

CONTENT_TYPE = 'text/plain'
CHARSET = 'utf-8'


def text(states: dict[str, dict[str, Any]], namespace: str) -> bytes:
    """Return the states of nodes, as `notices.Roster.states` has them, as metrics.

    Every value of a status that is a number is one, whatever node it is of: a counter that is new
    needs nothing here. Raises DeviceMissing where prometheus-client is not installed.
    """
    try:
        from prometheus_client import CollectorRegistry, generate_latest
        from prometheus_client.core import GaugeMetricFamily
    except ImportError:
        raise DeviceMissing(
            f'/metrics needs prometheus-client: {pip_install("prometheus-client")}'
        ) from None
    labels = ('namespace', 'node')
    level = GaugeMetricFamily(
        'eol_node_level', '0 ok, 1 warning, 2 error, 3 starting or silent', labels=labels
    )
    rate = GaugeMetricFamily(
        'eol_node_rate_hertz', 'Messages that the node takes or gives in a second', labels=labels
    )
    age = GaugeMetricFamily(
        'eol_node_status_age_seconds', 'Time since the node told how it is', labels=labels
    )
    value = GaugeMetricFamily(
        'eol_node_value', 'A number of the status, by its name', labels=(*labels, 'name')
    )
    for node, state in sorted(states.items()):
        level.add_metric([namespace, node], LEVELS.index(state['level']))
        rate.add_metric([namespace, node], state['rate'])
        age.add_metric([namespace, node], state['age_s'])
        for name, told in sorted(state['values'].items()):
            if isinstance(told, (int, float)) and math.isfinite(told):
                value.add_metric([namespace, node, name], told)

    class Found:
        def collect(self) -> list[GaugeMetricFamily]:
            return [level, rate, age, value]

    registry = CollectorRegistry()
    registry.register(Found())
    return generate_latest(registry)

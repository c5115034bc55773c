# SPDX-License-Identifier: Apache-2.0
"""The parameters of a running node, read from the command line."""

from collections.abc import Sequence
from typing import Any

from eol_ros.errors import DeviceMissing
from eol_ros.ros.session import session
from eol_ros.streams.graph import NAMESPACE

WAIT_S = 5.0


def read(node: str, names: Sequence[str], reach: str, namespace: str = NAMESPACE) -> dict[str, Any]:
    """Return the values of the parameters `names`; raise DeviceMissing where none answers."""
    with session(reach=reach, namespace=namespace) as visit:
        from rclpy.parameter import parameter_value_to_python
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(visit.node, visit.node.resolve_service_name(node))
        if not visit.run(client.services_are_ready, WAIT_S):
            raise DeviceMissing(f'{node} does not run here (--secure and --lan look further)')
        future = client.get_parameters(list(names))
        if not visit.run(future.done, WAIT_S):
            raise DeviceMissing(f'{node} does not answer')
        values = [parameter_value_to_python(value) for value in future.result().values]
    return dict(zip(names, values, strict=True))

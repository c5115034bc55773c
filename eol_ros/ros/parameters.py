# SPDX-License-Identifier: Apache-2.0
"""The parameters of a running node, read and changed from the command line."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from eol_ros.errors import DeviceMissing, EolError
from eol_ros.ros.session import Session, session
from eol_ros.streams.graph import NAMESPACE

WAIT_S = 5.0


def read(node: str, names: Sequence[str], reach: str, namespace: str = NAMESPACE) -> dict[str, Any]:
    """Return the values of the parameters `names`; raise DeviceMissing where none answers."""
    with _asking(node, reach, namespace) as (visit, client):
        from rclpy.parameter import parameter_value_to_python

        found = _answer(node, visit, client.get_parameters(list(names)))
        values = [parameter_value_to_python(value) for value in found.values]
    return dict(zip(names, values, strict=True))


def write(
    node: str, values: dict[str, Any], reach: str = 'local', namespace: str = NAMESPACE
) -> None:
    """Change parameters of a node that takes no requests.

    Raises DeviceMissing where it does not answer, EolError where it refuses.
    """
    with _asking(node, reach, namespace) as (visit, client):
        from rclpy.parameter import Parameter

        asked = [Parameter(name, value=value) for name, value in values.items()]
        for result in _answer(node, visit, client.set_parameters(asked)).results:
            if not result.successful:
                raise EolError(f'{node}: refused, {result.reason}')


@contextmanager
def _asking(node: str, reach: str, namespace: str) -> Iterator[tuple[Session, Any]]:
    with session(reach=reach, namespace=namespace) as visit:
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(visit.node, visit.node.resolve_service_name(node))
        if not visit.run(client.services_are_ready, WAIT_S):
            raise DeviceMissing(f'{node} does not run here (--secure and --lan look further)')
        yield visit, client


def _answer(node: str, visit: Session, future: Any) -> Any:
    if not visit.run(future.done, WAIT_S):
        raise DeviceMissing(f'{node} does not answer')
    return future.result()

# SPDX-License-Identifier: Apache-2.0
"""The parameters of a running node, read and changed from the command line."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from eol_ros.disk import check_file
from eol_ros.errors import ConfigError, DeviceMissing, EolError, nearest
from eol_ros.ros.session import Session
from eol_ros.said import Said, said
from eol_ros.scene import check_value
from eol_ros.settings import fields_of

WAIT_S = 5.0


def checked_live(settings: type, node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `values` as the live settings of `node` have them, of the dataclass `settings`.

    Raises ConfigError that names what cannot be, before rcl refuses it in words of its own.
    """
    fields = fields_of(settings)
    if not values:
        raise ConfigError('names no setting')
    for name in values:
        if name not in fields:
            raise ConfigError(no_setting(node, name, fields))
        if not fields[name].metadata.get('live'):
            raise ConfigError(said('at_start', name=name, node=node))
    return checked(settings, values)


def no_setting(node: str, name: str, known: Iterable[str]) -> Said:
    """Return that `node` has no setting `name`, with the one of `known` that is nearest."""
    return said('no_setting', node=node, name=f'{name}. {nearest(name, known)}')


def checked(settings: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `values` as the dataclass `settings` has them; raise ConfigError that names one."""
    fields = fields_of(settings)
    found = {}
    for name, value in values.items():
        try:
            found[name] = check_value(fields[name], value)
            if fields[name].metadata.get('kind') == 'path':
                for path in found[name] if isinstance(value, (list, tuple)) else (found[name],):
                    check_file(path)
        except ConfigError as error:
            raise ConfigError(said('of_node', node=name, why=error)) from None
    return found


def read(visit: Session, node: str, names: Sequence[str]) -> dict[str, Any]:
    """Return the values of the parameters `names`; raise DeviceMissing where none answers."""
    from rclpy.parameter import parameter_value_to_python

    found = _answer(visit, node, lambda client: client.get_parameters(list(names)))
    return dict(zip(names, map(parameter_value_to_python, found.values), strict=True))


def write(visit: Session, node: str, values: Mapping[str, Any]) -> None:
    """Change parameters of a node that takes no requests.

    Raises DeviceMissing where it does not answer, EolError where it refuses.
    """
    from rclpy.parameter import Parameter

    asked = [Parameter(name, value=value) for name, value in values.items()]
    for result in _answer(visit, node, lambda client: client.set_parameters(asked)).results:
        if not result.successful:
            raise EolError(f'{node}: refused, {result.reason}')


def _answer(visit: Session, node: str, ask: Callable[[Any], Any]) -> Any:
    from rclpy.parameter_client import AsyncParameterClient

    client = AsyncParameterClient(visit.node, visit.node.resolve_service_name(node))
    if not visit.run(client.services_are_ready, WAIT_S):
        raise DeviceMissing(f'{node} does not run here (--secure and --lan find other machines)')
    future = ask(client)
    if not visit.run(future.done, WAIT_S):
        raise DeviceMissing(said('does_not_answer', names=node))
    return future.result()

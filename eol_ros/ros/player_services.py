# SPDX-License-Identifier: Apache-2.0
"""The services of rosbag2_player, for a replay: pause, resume, rate, seek."""

from typing import TYPE_CHECKING, Any

from rosbag2_interfaces.srv import GetRate, IsPaused, Pause, Resume, Seek, SetRate, TogglePaused

from eol_ros.errors import ConfigError
from eol_ros.ros.stamps import to_ns

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode


def serve_player(node: 'EolNode', player: Any) -> None:
    """Make the services of a `BagPlayer`, with the names that they have below rosbag2_player."""

    def pause(on: bool | None) -> Any:
        def switch(_request: Any, response: Any) -> Any:
            player.pause(on)
            return response

        return switch

    def is_paused(_request: Any, response: Any) -> Any:
        response.paused = player.paused
        return response

    def rate(_request: Any, response: Any) -> Any:
        response.rate = float(node.settings.rate)
        return response

    def set_rate(request: Any, response: Any) -> Any:
        try:
            node.change_settings({'rate': request.rate})
            response.success = True
        except ConfigError as error:
            node.get_logger().warning(str(error))
        return response

    def seek(request: Any, response: Any) -> Any:
        response.success = player.seek(to_ns(request.time))
        return response

    for type_, name, callback in (
        (Pause, 'pause', pause(True)),
        (Resume, 'resume', pause(False)),
        (TogglePaused, 'toggle_paused', pause(None)),
        (IsPaused, 'is_paused', is_paused),
        (GetRate, 'get_rate', rate),
        (SetRate, 'set_rate', set_rate),
        (Seek, 'seek', seek),
    ):
        node.create_service(type_, f'~/{name}', callback)

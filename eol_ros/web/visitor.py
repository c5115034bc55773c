# SPDX-License-Identifier: Apache-2.0
"""What one browser says over its WebSocket, checked."""

import math
import time
from typing import Any

from eol_ros.core.budget import Budget
from eol_ros.web import guard, wire
from eol_ros.web.hub import Viewer

MESSAGES_PER_S = 300.0
HOLD_S = 0.25
FASTEST_MPS = 0.6
FASTEST_RADPS = 2.0


class Visitor:
    """Reads a viewer's messages: what it wants to see, its PIN, and its hand on the rim."""

    def __init__(self, routes: Any, request: Any):
        self._routes, self._request = routes, request
        self._viewer: Viewer
        self._budget = Budget(MESSAGES_PER_S)
        self._pushing = False
        self._wants: frozenset[str] = frozenset()
        self.trusted = not routes.pin.needed

    def hello(self, viewer: Viewer) -> str:
        """Take on a viewer; return the first message: who it is and what it may do."""
        self._viewer = viewer
        return wire.text(
            {
                't': 'hello',
                'viewer': self._viewer.number,
                'now': time.time(),
                'pin': self._routes.pin.needed,
                'push': self.may_push,
                'private': sorted(self.private),
                'lattice': self._routes.lattice,
            }
        )

    @property
    def may_push(self) -> bool:
        """Whether this visitor may move the rim."""
        return self.trusted or self._routes.settings.visitors

    @property
    def private(self) -> frozenset[str]:
        """The channels that are kept from this visitor until the PIN is given."""
        if self.trusted:
            return frozenset()
        settings = self._routes.settings
        public = {*settings.public, *(('sound',) if settings.visitors else ())}
        return frozenset(guard.PRIVATE) - public

    def take(self, text: str) -> str:
        """Act on one message; return why it is refused, or an empty string."""
        if not self._budget.take(time.monotonic()):
            return 'too many at once'
        try:
            message = wire.loads(text)
        except ValueError as error:
            return f'not JSON: {error}'
        if not isinstance(message, dict) or len(message) != 1:
            return 'not an object with one key'
        ((kind, value),) = message.items()
        reader = getattr(self, f'_take_{kind}', None)
        return reader(value) if reader else f'{kind[:20]!r} is not known'

    def leave(self) -> None:
        """The browser is gone: take its hand off the rim."""
        if self._pushing:
            self._push((0.0, 0.0, 0.0))

    def _take_wants(self, value: Any) -> str:
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            return 'wants: not a list of names'
        self._wants = frozenset(value)
        self._routes.hub.want(self._viewer, self._wants - self.private)
        return ''

    def _take_pace(self, value: Any) -> str:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= 1:
            return 'pace: not a time of 0 to 1 s'
        self._viewer.pace_s = float(value)
        return ''

    def _take_pin(self, value: Any) -> str:
        if not isinstance(value, str):
            return 'pin: not a text'
        self.trusted = self._routes.pin_state(self._request, value) == 'ok'
        trust = {'t': 'trust', 'ok': self.trusted, 'push': self.may_push}
        self._viewer.tell(wire.text(trust | {'private': sorted(self.private)}))
        self._routes.hub.want(self._viewer, self._wants - self.private)
        return ''

    def _take_rim(self, value: Any) -> str:
        if not isinstance(value, list) or len(value) != 3:
            return 'rim: not three numbers'
        if not all(isinstance(v, (int, float)) and math.isfinite(v) for v in value):
            return 'rim: not three numbers'
        if self.may_push:
            self._push((float(value[0]), float(value[1]), float(value[2])))
        return ''

    def _push(self, velocity: tuple[float, float, float]) -> None:
        vx, vy, yaw_rate = velocity
        too_fast = max(math.hypot(vx, vy) / FASTEST_MPS, abs(yaw_rate) / FASTEST_RADPS, 1.0)
        self._pushing = any(velocity)
        self._routes.bridge.rim(
            f'table-{self._viewer.number}',
            (vx / too_fast, vy / too_fast, yaw_rate / too_fast),
            HOLD_S,
        )

    def _take_ping(self, value: Any) -> str:
        if not isinstance(value, (int, float)) or not math.isfinite(value):
            return 'ping: not a number'
        self._viewer.tell(wire.text({'t': 'pong', 'ping': value, 'now': time.time()}))
        return ''

    def _take_flipped(self, value: Any) -> str:
        match value:
            case ['left' | 'right' as side, int(change), float() | int() as at_ms]:
                self._routes.flipped(side, change, float(at_ms))
                return ''
        return 'flipped: not [side, change, time]'

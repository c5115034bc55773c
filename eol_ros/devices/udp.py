# SPDX-License-Identifier: Apache-2.0
"""Packets out to other programs over UDP.

Only a name that must be resolved has a thread, for a resolver may take seconds.
"""

import ipaddress
import socket
import threading

from eol_ros.devices.address import target as target_of


class UdpOut:
    """Sends to `target`, "HOST:PORT"; raises ConfigError where it is not that.

    A name that does not resolve is looked up again by `resolve`; what is sent meanwhile is lost.
    """

    def __init__(self, target: str):
        self.target, (self._host, self._port) = target, target_of(target)
        self._to: tuple[socket.socket, tuple] | None = None
        self._resolving: threading.Thread | None = None
        self.trouble = ''  # why nothing is sent now
        self.own = '127.0.0.1'  # the address from which it sends
        try:
            ipaddress.ip_address(self._host)
        except ValueError:
            self.resolve()
        else:
            self._resolve()

    def resolve(self) -> None:
        """Look the name up, in a thread, unless it is known."""
        if not self._to and not (self._resolving and self._resolving.is_alive()):
            self._resolving = threading.Thread(target=self._resolve, daemon=True)
            self._resolving.start()

    def _resolve(self) -> None:
        try:
            kind, form, *_, address = socket.getaddrinfo(
                self._host, self._port, type=socket.SOCK_DGRAM
            )[0]
            with socket.socket(kind, form) as probe:
                probe.connect(address)
                self.own = probe.getsockname()[0]
            out = socket.socket(kind, form)
        except (OSError, UnicodeError) as error:
            self.trouble = f'{self.target}: {getattr(error, "strerror", None) or error}'
            return
        out.setblocking(False)
        out.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._to, self.trouble = (out, address), ''

    def send(self, packet: bytes) -> None:
        """Send one packet. A receiver that is not there is no fault of ours."""
        if self._to:
            try:
                self._to[0].sendto(packet, self._to[1])
            except ConnectionRefusedError:
                pass
            except OSError as error:
                self.trouble = f'{self.target}: {error.strerror}'
            else:
                self.trouble = ''

    def close(self) -> None:
        """Let go of the socket."""
        if self._to:
            self._to[0].close()

# SPDX-License-Identifier: Apache-2.0
"""Packets out to other programs over UDP.

Only a name that must be resolved has a thread, for a resolver may take seconds.
"""

import errno
import ipaddress
import socket
import threading

from eol_ros.devices.address import own_address
from eol_ros.devices.address import target as target_of

# Faults of sendto that say nothing of the network card: a full queue, a packet that is too large
OF_A_PACKET = (errno.EAGAIN, errno.ENOBUFS, errno.EMSGSIZE)


class UdpOut:
    """Sends to `target`, "HOST:PORT"; raises ConfigError where it is not that.

    source: IPv4 address of this machine to send from, also the network card of multicast; empty:
    as the routing table says. `resolve` tries again an address that this machine lacks, or lost.

    A name that does not resolve is looked up again by `resolve`; what is sent meanwhile is lost.
    """

    def __init__(self, target: str, source: str = ''):
        self.target, (self._host, self._port) = target, target_of(target)
        self._source = own_address(source)
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
        source, family = self._source, socket.AF_INET if self._source else socket.AF_UNSPEC
        out = None
        try:
            kind, form, *_, address = socket.getaddrinfo(
                self._host, self._port, family, socket.SOCK_DGRAM
            )[0]
            with socket.socket(kind, form) as probe:
                if source:
                    probe.bind((source, 0))
                probe.connect(address)
                self.own = probe.getsockname()[0]
            out = socket.socket(kind, form)
            if source:
                out.bind((source, 0))
                out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(source))
            out.setblocking(False)
            out.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        except (OSError, UnicodeError) as error:
            if out:
                out.close()
            by = f' from {source}' if source else ''
            self.trouble = f'{self.target}{by}: {getattr(error, "strerror", None) or error}'
            return
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
                if self._source and error.errno not in OF_A_PACKET:
                    self.close()  # a card that comes back is another one to its old sockets
            else:
                self.trouble = ''

    def close(self) -> None:
        """Let go of the socket, until `resolve`."""
        if self._to:
            self._to[0].close()
            self._to = None

# SPDX-License-Identifier: Apache-2.0
"""Where other machines are reached."""


def host_and_port(text: str) -> tuple[str, int] | None:
    """Return what HOST:PORT names, [ADDRESS]:PORT for IPv6; None where it is not that."""
    host, _, port = text.rpartition(':')
    good = host and port.isdigit() and 0 < int(port) < 65536
    return (host.strip('[]'), int(port)) if good else None

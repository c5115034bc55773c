# SPDX-License-Identifier: Apache-2.0
"""The certificate of the panel: one PEM file with the certificate (chain) and its private key.

docs/reference/web.md says how `openssl` makes one.
"""

import ssl

from eol_ros.errors import ConfigError


def context(path: str) -> ssl.SSLContext:
    """Return what a server needs to speak TLS 1.2 or newer; raises ConfigError."""
    tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        tls.load_cert_chain(path, password=_no_password)
    except ssl.SSLError as error:
        reason = getattr(error, 'reason', None) or error.strerror or 'unreadable'
        raise ConfigError(
            f'panel.certificate: {path}: {reason.lower().replace("_", " ")}; it must hold a'
            ' certificate and its private key as PEM'
        ) from None
    except OSError as error:
        raise ConfigError(f'panel.certificate: {path}: {error.strerror}') from None
    return tls


def _no_password() -> str:
    """Refuse a key with a password, before OpenSSL asks for it at the terminal."""
    raise ssl.SSLError(1, 'the key has a password')

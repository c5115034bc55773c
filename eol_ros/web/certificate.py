# SPDX-License-Identifier: Apache-2.0
"""The certificate of the panel: one PEM file with the certificate (chain) and its private key.

Serving it takes the standard library alone; making one, and telling until when one is valid, takes
the extra `tls` (pyca/cryptography).
"""

import contextlib
import datetime
import ipaddress
import os
import re
import ssl
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eol_ros.disk import content
from eol_ros.errors import ConfigError, EolError, pip_install

YEARS = 10  # it is trusted because somebody has compared its fingerprint, not because it is young


def context(path: str) -> ssl.SSLContext:
    """Return what a server needs to speak TLS 1.2 or newer; raises ConfigError."""
    tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    load(tls, path)
    return tls


def load(tls: ssl.SSLContext, path: str) -> None:
    """Let `tls` use the certificate and key in a file; raises ConfigError, then nothing changes."""
    trial = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        for each in (trial, tls):
            each.load_cert_chain(path, password=_no_password)
    except ssl.SSLError as error:
        reason = getattr(error, 'reason', None) or error.strerror or 'unreadable'
        raise ConfigError(
            f'panel.certificate: {path}: {reason.lower().replace("_", " ")}; it must hold a'
            ' certificate and its private key as PEM (`eol certificate` makes one)'
        ) from None
    except OSError as error:
        raise ConfigError(
            f'panel.certificate: {path}: {error.strerror}; `eol certificate` makes one'
        ) from None


def _no_password() -> str:
    """Refuse a key with a password, before OpenSSL asks for it at the terminal."""
    raise ssl.SSLError(1, 'the key has a password')


def changed_ns(path: str) -> int:
    """Return when the file was last written; 0: not there."""
    with contextlib.suppress(OSError):
        return os.stat(path).st_mtime_ns if path else 0
    return 0


def make(path: Path, names: Sequence[str], now: datetime.datetime) -> Any:
    """Write a new key and a certificate signed by itself for `names`; return the certificate.

    names: host names and addresses. The file can be read by its owner alone. Raises ConfigError
    for a name that is none, EolError where nothing can be written or the extra is not installed.
    """
    x509, hashes, serialization, ec = _cryptography()
    alternatives = [_alternative(x509, name) for name in names]
    key = ec.generate_private_key(ec.SECP256R1())
    who = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, names[0][:64])])
    built = (
        x509.CertificateBuilder()
        .subject_name(who)
        .issuer_name(who)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=365 * YEARS))
        .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(
            x509.ExtendedKeyUsage([x509.ExtendedKeyUsageOID.SERVER_AUTH]), critical=False
        )
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    text = built.public_bytes(pem) + key.private_bytes(
        pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), 'wb') as file:
            file.write(text)
    except FileExistsError:
        raise ConfigError(
            f'{path}: is there already; remove it first, and every browser will ask again'
        ) from None
    except OSError as error:
        raise ConfigError(f'{path}: {error.strerror}') from None
    return built


def read(path: str) -> Any:
    """Return the (first) certificate of a file; raises ConfigError or EolError."""
    x509, *_ = _cryptography()
    try:
        return x509.load_pem_x509_certificate(content(path))
    except OSError as error:
        raise ConfigError(f'panel.certificate: {path}: {error.strerror}') from None
    except ValueError:
        raise ConfigError(f'panel.certificate: {path}: holds no certificate as PEM') from None


def names_of(found: Any) -> list[str]:
    """Return the host names and addresses that a certificate is for."""
    x509, *_ = _cryptography()
    try:
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [str(name.value) for name in names]


def fingerprint(found: Any) -> str:
    """Return the SHA-256 fingerprint as browsers show it."""
    _, hashes, *_ = _cryptography()
    return ':'.join(f'{byte:02X}' for byte in found.fingerprint(hashes.SHA256()))


def days_left(found: Any, now: datetime.datetime) -> float:
    """Return for how many days a certificate is valid still."""
    return float((found.not_valid_after_utc - now).total_seconds() / 86_400)


def _alternative(x509: Any, name: str) -> Any:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        pass
    parts = name.removeprefix('*.').split('.')
    if not all(re.fullmatch('[A-Za-z0-9-]{1,63}', part) for part in parts) or len(name) > 253:
        raise ConfigError(f'{name!r} is no host name and no address')
    return x509.DNSName(name)


def _cryptography() -> tuple[Any, Any, Any, Any]:
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ModuleNotFoundError:
        raise EolError(f'certificates need cryptography: {pip_install("cryptography")}') from None
    return x509, hashes, serialization, ec

# SPDX-License-Identifier: Apache-2.0
"""Bytes under a password: scrypt (RFC 7914) and AES-256-GCM (NIST SP 800-38D).

The file is MAGIC, salt, nonce and the encrypted bytes with their tag; MAGIC and salt are
authenticated, too. It needs the extra `tls` (pyca/cryptography).
"""

import getpass
import hashlib
import os
import sys
from typing import Any

from eol_ros.disk import content
from eol_ros.errors import ConfigError, EolError, UsageError, pip_install

MAGIC = b'EOL sealed 1\n'
SALT, NONCE = 16, 12  # bytes
# 128 MB and some 0.4 s a guess: OWASP Password Storage Cheat Sheet, scrypt
COST = {'n': 1 << 17, 'r': 8, 'p': 1, 'maxmem': 1 << 28, 'dklen': 32}
SHORTEST = 8  # characters of a password: NIST SP 800-63B


def seal(data: bytes, password: str) -> bytes:
    """Return `data` encrypted; raises EolError where the extra is not installed."""
    salt, nonce = os.urandom(SALT), os.urandom(NONCE)
    head = MAGIC + salt
    return head + nonce + _cipher(password, salt).encrypt(nonce, data, head)


def unseal(data: bytes, password: str) -> bytes:
    """Return what `seal` has encrypted.

    Raises
    ------
    ConfigError
        Another password, or a single bit has changed.
    EolError
        The extra is not installed.
    """
    begin = len(MAGIC) + SALT
    head, nonce, rest = data[:begin], data[begin : begin + NONCE], data[begin + NONCE :]
    cipher = _cipher(password, head[len(MAGIC) :])
    from cryptography.exceptions import InvalidTag

    try:
        return bytes(cipher.decrypt(nonce, rest, head))
    except (InvalidTag, ValueError):
        raise ConfigError('wrong password, or the file is damaged') from None


def ask(file: str | None, new: bool = False) -> str:
    """Return the first line of `file` (`-`: standard input), or what is typed at the terminal.

    new: ask twice at the terminal, and take at least `SHORTEST` characters.

    Raises
    ------
    ConfigError
        `file` cannot be read.
    UsageError
        No terminal, no password, one that is too short, or two that differ.
    """
    if file:
        try:
            given = content(file).decode('utf-8-sig').split('\n')[0].rstrip('\r')
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, 'strerror', None) or 'not text in UTF-8'
            raise ConfigError(f'--password-file {file}: {why}') from None
    elif sys.stdin.isatty():
        try:
            given = getpass.getpass('password: ')
            again = getpass.getpass('repeat the password: ') if new else given
        except EOFError:
            raise UsageError('no password was typed') from None
        if given != again:
            raise UsageError('the two passwords differ')
    else:
        raise UsageError(
            'no terminal to ask for the password: name --password-file FILE (-: standard input)'
        )
    if not given:
        raise UsageError('the password is empty')
    if new and len(given) < SHORTEST:
        raise UsageError(f'a password has at least {SHORTEST} characters')
    return given


def _cipher(password: str, salt: bytes) -> Any:
    try:
        from cryptography.hazmat.primitives.ciphers.aead import AESGCM
    except ImportError:
        raise EolError(f'encryption needs cryptography: {pip_install("cryptography")}') from None
    return AESGCM(hashlib.scrypt(password.encode(), salt=salt, **COST))

# SPDX-License-Identifier: Apache-2.0
"""PJLink class 1: the protocol by which projectors of most makers are switched and asked.

PJLink Specifications, version 1.04 (JBMIA 2013): TCP port 4352, lines of ASCII that end with CR. A
projector greets with `PJLINK 0`, or with `PJLINK 1 RANDOM` where it has a password; then the first
command carries the MD5 of random number and password before it.
"""

import hashlib
import socket
from collections.abc import Iterator, Sequence

from eol_ros.devices import address as addresses
from eol_ros.errors import ConfigError, EolError
from eol_ros.said import said

PORT = 4352
TIMEOUT_S = 3.0
LONGEST = 256  # bytes of a line; the specification allows 136
OFF, ON, COOLING, WARMING = range(4)  # answers to POWR ?
STATES = (said('power_off'), said('power_on'), said('power_cooling'), said('power_warming'))
PARTS = (
    said('which_fan'),
    said('which_lamp'),
    said('which_temperature'),
    said('which_cover'),
    said('which_filter'),
    said('which_else'),
)  # of ERST
ERRORS = {
    'ERR1': 'does not know this command',
    'ERR2': 'does not know this value',
    'ERR3': 'is busy',
    'ERR4': 'has failed',
}


class Unanswered(EolError):
    """A projector is not there, or does not speak PJLink."""


class WrongPassword(Unanswered):
    """A projector has another password, or has one where none was given."""


def host_and_port(address: str) -> tuple[str, int]:
    """Return what HOST or HOST:PORT names; raise ConfigError where it is neither."""
    if found := addresses.host_and_port(address):
        return found
    if not address or ':' in address or any(c.isspace() for c in address):
        raise ConfigError(f'{address!r} is not HOST or HOST:PORT')
    return address, PORT


def converse(address: str, password: str, commands: Sequence[str]) -> list[str]:
    """Send class 1 commands such as `POWR ?` on one connection; return the answer to each.

    An answer is what stands behind the equals sign: a value, `OK`, or one of ERRORS. Raises
    Unanswered, WrongPassword.
    """
    try:
        with socket.create_connection(host_and_port(address), TIMEOUT_S) as line:
            line.settimeout(TIMEOUT_S)
            lines = _lines(line)
            greeting = next(lines).split()
            if greeting[:2] == ['PJLINK', 'ERRA'] or len(greeting) < 2 or greeting[0] != 'PJLINK':
                raise Unanswered(said('no_pjlink'))
            digest = ''
            if greeting[1] == '1' and len(greeting) == 3:
                if not password:
                    raise WrongPassword(said('asks_password'))
                asked = (greeting[2] + password).encode()
                digest = hashlib.md5(asked, usedforsecurity=False).hexdigest()
            found = []
            for command in commands:
                line.sendall(f'{digest}%1{command}\r'.encode('ascii'))
                digest = ''  # only before the first
                found.append(_answer(command[:4], next(lines)))
            return found
    except OSError as error:
        raise Unanswered(said('no_answer', why=error.strerror or error)) from None
    except UnicodeError:  # of a host, such as a..b
        raise Unanswered(said('no_host')) from None


def _answer(name: str, text: str) -> str:
    if text.upper() == 'PJLINK ERRA':
        raise WrongPassword(said('refuses_password'))
    head, equals, value = text.partition('=')
    if not equals or head.upper() != f'%1{name}':
        raise Unanswered(f'answers {text[:40]!r} to {name}')
    return value.strip()


def _lines(line: socket.socket) -> Iterator[str]:
    data = b''
    while True:
        while b'\r' not in data:
            more = line.recv(LONGEST)
            data += more
            if not more or len(data) > LONGEST:
                raise Unanswered(said('no_pjlink') if more else 'hangs up')
        told, _, data = data.partition(b'\r')
        yield told.decode('ascii', 'replace').strip()


def lamp_hours(answer: str) -> list[int]:
    """Return the hours of each lamp by an answer to LAMP ?; none where it does not say."""
    numbers = answer.split()
    return [int(n) for n in numbers[::2]] if all(n.isdigit() for n in numbers) else []


def faults(answer: str) -> tuple[list[str], list[str]]:
    """Return the parts that have failed and those that warn, by an answer to ERST ?."""
    if len(answer) != len(PARTS) or not answer.isdigit():
        return [], []
    told = list(zip(PARTS, answer, strict=True))
    return [part for part, n in told if n == '2'], [part for part, n in told if n == '1']

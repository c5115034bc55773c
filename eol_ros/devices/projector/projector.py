# SPDX-License-Identifier: Apache-2.0
"""One projector, kept on or off from a thread of its own, whatever it was when it was last seen."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from eol_ros.devices.projector.pjlink import (
    COOLING,
    ERRORS,
    OFF,
    ON,
    STATES,
    WARMING,
    Unanswered,
    WrongPassword,
    converse,
    faults,
    lamp_hours,
)
from eol_ros.devices.rounds import Rounds
from eol_ros.said import clauses, said

OBEYS_S = 240.0  # a lamp may take so long to cool down or to warm up
OK, WARN, ERROR = range(3)
NOT_ASKED = said('not_asked')


@dataclass(frozen=True)
class Reading:
    """What a projector said of itself."""

    power: int | None = None
    lamps_h: tuple[int, ...] = ()
    failed: tuple[str, ...] = ()
    warns: tuple[str, ...] = ()
    trouble: str = NOT_ASKED  # why nothing is known, or why it does not obey
    wrong: bool = False  # a person must act


class Projector:
    """Asks one projector how it is, and tells it what it should be until it is so.

    Parameters
    ----------
    address : str
        HOST or HOST:PORT.
    password : str
        Empty where it has none.
    on : bool
        What it should be, now; `want` changes it.
    """

    def __init__(
        self, address: str, password: str, on: bool, clock: Callable[[], float] = time.monotonic
    ):
        self.address = address
        self.reading = Reading()
        self._password, self._clock = password, clock
        self._on, self._since_s = on, clock()
        self._change, self._ended = threading.Event(), False
        self._thread: threading.Thread | None = None
        self.rounds = Rounds()

    def start(self, poll_s: float) -> None:
        """Ask it every `poll_s` seconds from now on, and at once when it should change."""
        name = f'projector {self.address}'
        self._thread = threading.Thread(target=self._run, args=(poll_s,), name=name, daemon=True)
        self._thread.start()

    @property
    def started(self) -> bool:
        """Whether it is being asked."""
        return self._thread is not None

    def want(self, on: bool) -> None:
        """Let it be on or off from now on; does not wait."""
        if on != self._on:
            self._on, self._since_s = on, self._clock()
            self._change.set()

    def end(self) -> None:
        """Ask it no more; it stays as it is."""
        self._ended = True
        self._change.set()

    def look(self) -> None:
        """Ask how it is, and tell it to change where it should be otherwise and can."""
        try:
            power, lamps, errors = converse(
                self.address, self._password, ['POWR ?', 'LAMP ?', 'ERST ?']
            )
            trouble, wrong = '', False
            known = int(power) if power in ('0', '1', '2', '3') else None
            if known is None:
                trouble = ERRORS.get(power, f'says power {power[:20]!r}')
                wrong = power == 'ERR4'
            elif (known, self._on) in ((OFF, True), (ON, False)):
                (said,) = converse(self.address, self._password, [f'POWR {int(self._on)}'])
                if said == 'OK':
                    known = WARMING if self._on else COOLING
                elif said != 'ERR3':  # who is busy is asked again
                    trouble, wrong = ERRORS.get(said, f'says {said[:20]!r}'), said == 'ERR4'
            failed, warns = faults(errors)
            self.reading = Reading(
                known, tuple(lamp_hours(lamps)), tuple(failed), tuple(warns), trouble, wrong
            )
        except Unanswered as error:
            self.reading = Reading(trouble=str(error), wrong=isinstance(error, WrongPassword))

    def level(self) -> int:
        """Return OK, WARN or ERROR."""
        reading = self.reading
        if reading.wrong or reading.failed:
            return ERROR
        return WARN if reading.trouble or reading.warns or self._disobeys() else OK

    def words(self) -> str:
        """Return how it is, for people: `10.0.0.5 on, lamp 1200 h`."""
        reading = self.reading
        if reading.power is None:
            return said('projector', address=self.address, power=reading.trouble)
        parts: list[str] = [STATES[reading.power]]
        if reading.lamps_h:
            hours = ' and '.join(f'{hours} h' for hours in reading.lamps_h)
            parts.append(said('lamp_hours', hours=hours))
        parts += [said('part_failed', which=part) for part in reading.failed]
        parts += [said('part_warns', which=part) for part in reading.warns]
        if reading.trouble:
            parts.append(reading.trouble)
        elif self._disobeys():
            parts.append(said('should_be', which=STATES[self._on]))
        return said('projector', address=self.address, power=clauses(parts, ', '))

    def _disobeys(self) -> bool:
        there = (ON, WARMING) if self._on else (OFF, COOLING)
        return self.reading.power not in there and self._clock() - self._since_s > OBEYS_S

    def _run(self, poll_s: float) -> None:
        while not self._ended:
            self.rounds.done()
            self._change.clear()
            self.look()
            self.rounds.rest()
            self._change.wait(poll_s)
        self.rounds.rest()

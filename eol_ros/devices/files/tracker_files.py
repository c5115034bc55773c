# SPDX-License-Identifier: Apache-2.0
"""What a tracker reads when it begins and keeps when it has learnt: calibration and lamps."""

import math
from dataclasses import replace
from pathlib import Path

from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.image_health import Sizes
from eol_ros.core.vision.requests import DARKNESS, Outcome, packed
from eol_ros.core.vision.states import CALIBRATING, LOST, SEARCHING, TRACKING
from eol_ros.core.vision.tracker import Tracked, Tracker
from eol_ros.disk import read
from eol_ros.errors import EolError
from eol_ros.said import clauses, said
from eol_ros.settings import TrackerSettings

SIZED_EVERY_S = 60.0  # between two looks whether the covers are those of the calibration
TOLD_S = 20.0  # how long the status says what came of a request


def calibration_of(settings: TrackerSettings, table: Table) -> Calibration:
    """Return the calibration that a tracker with these settings begins with.

    Raises:
        ConfigError, DeviceMissing: a file that cannot be read, that contradicts `mirror`, or that
            is of another table.
    """
    if not settings.calibration:
        return Calibration.ideal(mirror=settings.mirror, table=table)
    from eol_ros.devices.files import calibration_file

    return calibration_file.load(settings.calibration, settings.mirror, table)


class TrackerFiles:
    """The files that settings name. `calibration` to begin with; `lamps`, a PNG, or b''.

    A calibration made while running goes beside the old one as NAME.new.yaml: the bags of today say
    that they were made with the old one. Without `keep` nothing is written: what a replay learns
    again is of another day.

    Raises:
        ConfigError, DeviceMissing: a file that cannot be read. A map that is not there yet is none.
    """

    def __init__(self, settings: TrackerSettings, table: Table, keep: bool = True):
        self.settings, self._writes, self._blocks = settings, keep, table.count
        self.calibration, self.lamps = calibration_of(settings, table), b''
        if settings.background and Path(settings.background).exists():
            from eol_ros.devices.files import background_file

            path = Path(settings.background)  # a damaged map is learnt again
            self.lamps = read(path, lambda _: packed(background_file.load(path))) or b''
        self.told: Outcome | None = None  # the last outcome, with where it is kept
        self._seen: Outcome | None = None
        self._until_s = 0.0
        self._sizes: Sizes | None = None
        self._sized = self.calibration  # whose covers were looked at
        self._sized_s = -math.inf
        self._covers = ''  # what is wrong with them, in words

    def look(self, tracker: Tracker, tracked: Tracked) -> None:
        """Notice covers that are not those of the calibration; `words` then says so."""
        if tracked.state != TRACKING or tracked.symmetry_ambiguous or tracker.calibration is None:
            return
        if tracker.calibration is not self._sized:
            self._sizes, self._sized, self._covers = None, tracker.calibration, ''
            self._sized_s = -math.inf
        if self._sizes is None:
            if 0 <= tracked.stamp_s - self._sized_s < SIZED_EVERY_S:
                return
            self._sizes = Sizes(tracker.calibration)
        if self._sizes.add(tracked.world, tracker.sides_px, tracked.visibility):
            self._covers = ''
            if self._sizes.fault():
                self._covers = said('other_covers', spread=f'{self._sizes.spread:.1%}')
            self._sizes, self._sized_s = None, tracked.stamp_s

    def news(self, tracker: Tracker, stamp_s: float) -> Outcome | None:
        """Keep what a request has brought; return its outcome, and where it is kept, once."""
        outcome = tracker.outcome
        if outcome is None or outcome is self._seen:
            return None
        self._seen, self._until_s = outcome, stamp_s + TOLD_S
        kept = '' if outcome.refused else self._keep(tracker, outcome.kind)
        self.told = replace(outcome, text=clauses([outcome.text, kept]))
        return self.told

    def words(self, tracked: Tracked) -> tuple[bool, str]:
        """Return whether all is well, and one line; what came of a request is said for a while."""
        good = tracked.state == TRACKING
        text: str = _troubled(tracked)
        if good:
            text = said('seen', seen=int(tracked.seen.sum()), all=self._blocks)
            if tracked.symmetry_ambiguous:
                good = False
                text = said('ambiguous')
            if self._covers:
                good, text = False, clauses([self._covers, text])
        if tracked.changed:
            good = False
            blocks = ', '.join(map(str, tracked.changed))
            text = clauses([text, said('covers', blocks=blocks)])
        if self.told is not None and tracked.stamp_s < self._until_s:
            return good and not self.told.refused, clauses([self.told.text, text])
        return good, text

    def _keep(self, tracker: Tracker, kind: str) -> str:
        """Write down what was learnt; return where, for people."""
        if not self._writes:
            return ''
        try:
            if kind == DARKNESS:
                if not self.settings.background or tracker.background is None:
                    return ''
                from eol_ros.devices.files import background_file

                background_file.save(self.settings.background, tracker.background)
                return said('kept_in', name=self.settings.background)
            if not self.settings.calibration or tracker.calibration is None:
                return said('until_restart')
            from eol_ros.devices.files import calibration_file

            path = Path(self.settings.calibration).with_suffix('.new.yaml')
            calibration_file.save(path, tracker.calibration)
            return said('kept_in', name=path)
        except EolError as error:
            return said('not_kept', why=error)


def _troubled(tracked: Tracked) -> str:
    """Return in words why nothing is tracked."""
    if tracked.state == SEARCHING:
        return said('searching', why=tracked.why)
    if tracked.state == LOST:
        return said('lost', why=tracked.why)
    if tracked.state == CALIBRATING:
        return said('calibrating', why=tracked.why)
    return said('fault', why=tracked.why)

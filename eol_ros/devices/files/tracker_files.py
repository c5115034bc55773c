# SPDX-License-Identifier: Apache-2.0
"""What a tracker reads when it begins and keeps when it has learnt: calibration and lamps."""

from pathlib import Path

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.requests import packed
from eol_ros.core.vision.states import STATES, TRACKING
from eol_ros.core.vision.tracker import Tracked, Tracker
from eol_ros.errors import EolError
from eol_ros.settings import TrackerSettings

TOLD_S = 20.0  # how long the status says what came of a request


def calibration_of(settings: TrackerSettings) -> Calibration:
    """Return the calibration that a tracker with these settings begins with.

    Raises:
        ConfigError, DeviceMissing: a file that cannot be read, or that contradicts `mirror`.
    """
    if not settings.calibration:
        return Calibration.ideal(mirror=settings.mirror)
    from eol_ros.devices.files import calibration_file

    return calibration_file.load(settings.calibration, settings.mirror)


class TrackerFiles:
    """The files that settings name. `calibration` to begin with; `lamps`, a map as text, or ''.

    A calibration made while running goes beside the old one as NAME.new.yaml: the bags of today say
    that they were made with the old one. Without `keep` nothing is written: what a replay learns
    again is of another day.

    Raises:
        ConfigError, DeviceMissing: a file that cannot be read. A map that is not there yet is none.
    """

    def __init__(self, settings: TrackerSettings, keep: bool = True):
        self.settings, self._writes = settings, keep
        self.calibration, self.lamps = calibration_of(settings), ''
        if settings.background and Path(settings.background).exists():
            from eol_ros.devices.files import background_file

            self.lamps = packed(background_file.load(settings.background))
        self._told = ''
        self._until_s = 0.0

    def words(self, tracker: Tracker, tracked: Tracked) -> tuple[bool, str]:
        """Return whether all is well, and one line; what came of a request is kept and said."""
        if tracker.outcome != self._told:
            self._until_s = tracked.stamp_s + TOLD_S
            if not tracker.refused:
                tracker.outcome += self._keep(tracker)
            self._told = tracker.outcome
        good, text = tracked.state == TRACKING, f'{STATES[tracked.state]}: {tracked.why}'
        if good:
            text = f'{int(tracked.seen.sum())} of 25 blocks seen'
            if tracked.symmetry_ambiguous:
                good = False
                text = 'which way round the lattice lies is open: ids may be turned by 90 deg'
        if tracked.stamp_s < self._until_s:
            return good and not tracker.refused, f'{tracker.outcome}; {text}'
        return good, text

    def _keep(self, tracker: Tracker) -> str:
        """Write down what was learnt; return where, for people."""
        if not self._writes:
            return ''
        try:
            if tracker.outcome.startswith('lamps') and tracker.finder.clutter is not None:
                if not self.settings.background:
                    return ''
                from eol_ros.devices.files import background_file

                background_file.save(self.settings.background, tracker.finder.clutter)
                return f', kept in {self.settings.background}'
            if not self.settings.calibration or tracker.calibration is None:
                return ', until the next start'
            from eol_ros.devices.files import calibration_file

            path = Path(self.settings.calibration).with_suffix('.new.yaml')
            calibration_file.save(path, tracker.calibration)
            return f', kept in {path}'
        except EolError as error:
            return f', but not kept: {error}'

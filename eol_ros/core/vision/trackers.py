# SPDX-License-Identifier: Apache-2.0
"""The tracker that a scene names; only that one is imported."""

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.tracker_base import BaseTracker
from eol_ros.settings import TrackerSettings


def tracker_for(settings: TrackerSettings, calibration: Calibration | None) -> BaseTracker:
    """Return the tracker that `settings.method` names."""
    if settings.method == 'edges':
        from eol_ros.core.vision.tracker import Tracker

        return Tracker(settings, calibration)
    from eol_ros.core.vision.appearance.tracker import AppearanceTracker

    return AppearanceTracker(settings, calibration)

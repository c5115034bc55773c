# SPDX-License-Identifier: Apache-2.0
"""The tracker that a scene names; only that one is imported."""

from typing import TYPE_CHECKING

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.settings import TrackerSettings

if TYPE_CHECKING:
    from eol_ros.core.vision.appearance.tracker import AppearanceTracker
    from eol_ros.core.vision.tracker import Tracker


def tracker_for(
    settings: TrackerSettings, calibration: Calibration | None
) -> 'Tracker | AppearanceTracker':
    """Return the tracker that `settings.method` names."""
    if settings.method == 'edges':
        from eol_ros.core.vision.tracker import Tracker

        return Tracker(settings, calibration)
    from eol_ros.core.vision.appearance.tracker import AppearanceTracker

    return AppearanceTracker(settings, calibration)

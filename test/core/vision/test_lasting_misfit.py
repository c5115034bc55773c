# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.vision.detect.blobs import BLOB
from eol_ros.core.vision.detect.lasting_misfit import LastingMisfit


def show(known, misfit, seconds, rate_hz=60.0):
    """Show 25 blocks with so much misfit each (25,), 0 where it is not in sight."""
    shown = np.flatnonzero(misfit)
    blobs, index = np.zeros(shown.size, BLOB), np.full(25, -1)
    blobs['misfit'], index[shown] = misfit[shown], np.arange(shown.size)
    for _ in range(round(seconds * rate_hz)):
        known.learn(1 / rate_hz, index, blobs)


def test_what_lasts_is_no_scatter_and_what_has_just_come_is():
    known, misfit = LastingMisfit(), np.ones(25)
    misfit[3] = 4.0
    show(known, misfit, 1 / 60)
    assert known.lasting == pytest.approx(1.0)  # nothing is known yet: it may be an arm
    show(known, misfit, 6.0)
    assert known.lasting[3] > 3.4
    misfit[8] = 4.0  # an arm comes over another
    show(known, misfit, 0.2)
    assert known.lasting[8] < 1.1
    misfit[8] = 1.0
    show(known, misfit, 1 / 60)
    assert known.lasting[8] == 1.0  # nothing of what is not there
    assert np.delete(known.lasting, 3) == pytest.approx(1.0)


@pytest.mark.parametrize('rate_hz', [60.0, 120.0])
def test_it_is_known_as_fast_at_any_rate(rate_hz):
    known, misfit = LastingMisfit(), np.full(25, 3.0)
    show(known, misfit, 1.0, rate_hz)

    assert known.lasting == pytest.approx(2.0, abs=0.05)


def test_what_is_known_outlives_hiding_but_no_renaming():
    known, misfit = LastingMisfit(), np.full(25, 3.0)
    show(known, misfit, 10.0)
    hidden = np.zeros(25)
    show(known, hidden, 5.0)
    assert (known.lasting == 1.0).all()  # of a hidden block sigma is another thing
    show(known, misfit, 1 / 60)
    assert (known.lasting > 2.7).all()
    known.renamed(np.arange(25) == 7)
    show(known, misfit, 1 / 60)
    assert known.lasting[7] == 1.0
    assert (np.delete(known.lasting, 7) > 2.7).all()

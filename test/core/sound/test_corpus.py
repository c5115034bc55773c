# SPDX-License-Identifier: Apache-2.0
import numpy as np

from eol_ros.core.sound.bank import playable
from eol_ros.core.sound.triggers import TRIGGER


def test_playable_refuses_each_kind_of_nonsense():
    good = np.zeros(1, TRIGGER)
    good['gain'] = good['rate'] = 1
    assert playable(good, 1).all()
    for field, value in [
        ('grain', 1), ('grain', -1), ('gain', -1), ('gain', np.nan), ('gain', 1e9), ('rate', 0),
        ('rate', np.inf), ('pan', 1.5), ('pan', np.nan), ('attack_s', -1), ('release_s', np.nan),
        ('time_s', np.nan), ('time_s', np.inf),
    ]:  # fmt: skip
        bad = good.copy()
        bad[field] = value
        assert not playable(bad, 1).any(), (field, value)

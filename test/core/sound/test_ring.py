# SPDX-License-Identifier: Apache-2.0
"""Loudspeakers about the table: VBAP against its linear equations."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from support.quiet_settings import SOUND

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.ring import Ring, Speaker, parse
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.sound.voicing import Voicing
from eol_ros.errors import ConfigError

FS = 48000
FIVE = ('centre 0', 'left 30', 'right -30', 'back-left 110', 'back-right -110')


def vbap(speakers, x, y):
    """Pulkki's eq. 7 for every pair of neighbours; that with gains above zero. Then eq. 10."""
    unit = [(-np.sin(np.radians(s.azimuth)), np.cos(np.radians(s.azimuth))) for s in speakers]
    found = []
    for i, j in itertools.combinations(range(len(speakers)), 2):
        turn = (speakers[j].azimuth - speakers[i].azimuth) % 360
        inside = [
            s for s in speakers if 1e-6 < (s.azimuth - speakers[i].azimuth) % 360 < turn - 1e-6
        ]
        outside = [
            s for s in speakers if turn + 1e-6 < (s.azimuth - speakers[i].azimuth) % 360
        ]  # fmt: skip
        if inside and outside:
            continue  # no neighbours
        gains = np.linalg.solve(np.array([unit[i], unit[j]]).T, [x, y])
        if (gains > -1e-12).all():
            found.append((i, j, gains / np.hypot(*gains)))
    return found


@pytest.mark.parametrize('count', [4, 5, 8, 12])
def test_pans_as_vbap_says(count):
    rng = np.random.default_rng(count)
    azimuth = rng.permutation(360 / count * (np.arange(count) + 0.4 * rng.uniform(-1, 1, count)))
    speakers = [Speaker(str(k), float(a)) for k, a in enumerate(azimuth)]
    x, y = rng.uniform(-0.6, 0.6, (2, 200))
    a, b, gain_a, gain_b = Ring(speakers).pan(x, y)
    for k in range(200):
        (i, j, gains), *more = vbap(speakers, x[k], y[k])
        assert not more
        mine = {int(a[k]): float(gain_a[k]), int(b[k]): float(gain_b[k])}
        assert mine == pytest.approx({i: gains[0], j: gains[1]}, abs=1e-6)


def test_where_nobody_stands_the_nearer_has_it():
    ring = Ring(parse(['left 45', 'right -45']))
    a, b, left, right = ring.pan(np.array([-0.3, 0.2]), np.array([-0.3, -0.3]))
    gains = [{int(a[k]): left[k], int(b[k]): right[k]} for k in range(2)]
    assert gains == [{0: 1, 1: 0}, {0: 0, 1: 1}]


def test_a_grain_sounds_where_it_lies_on_the_table():
    settings = replace(SOUND, channels=5, speakers=FIVE)
    places = np.array([[0.0, 0.5], [-0.3, -0.3], [np.nan, np.nan]])
    sound = np.ones(FS, 'f4')
    bank = Bank([sound], [0, 0, 0], [0.0] * 3, [0.5] * 3, FS, places)
    t = np.zeros(3, TRIGGER)
    t['gain'], t['rate'], t['grain'], t['pan'] = 1.0, 1.0, (0, 1, 2), (1, 1, -1)
    rows, _ = Voicing(settings).rows(t, bank)
    loudest = np.where(rows['gain_a'] > rows['gain_b'], rows['channel_a'], rows['channel_b'])
    assert loudest.tolist() == [0, 3, 3]  # ahead; back left; none, so by pan to the left


@pytest.mark.parametrize(
    ('lines', 'what'),
    [
        (['left'], 'is not a loudspeaker: NAME AZIMUTH'),
        (['left x'], 'is not a loudspeaker'),
        (['left nan'], 'is not a loudspeaker'),
        (['left 30 2'], 'is not a loudspeaker'),
        (['left 30', 'left -30'], 'there is a loudspeaker left already'),
        (['left 30', 'right 390'], 'left stands in that direction already'),
    ],
)
def test_refuses_what_cannot_be(lines, what):
    with pytest.raises(ConfigError, match=what):
        parse(lines)

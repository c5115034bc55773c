# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from eol_ros import cli


def test_flashes_of_the_sample_stay_short_under_the_limit_by_view(capsys, tmp_path):
    drawn = tmp_path / 'sheet.svg'
    assert cli.main(['bench', 'light', '--json', '--sheet', str(drawn)]) == 0
    found = json.loads(capsys.readouterr().out)
    whole, _, none, view, *looks, recorded = found['limits']

    assert whole['long_slips'] == view['long_slips'] > 700
    assert whole['flash_median_s'] > 3 and view['flash_median_s'] <= 0.6
    assert view['flash_p90_s'] <= 1.2
    assert view['many_lit'] <= 0.05
    best = found['optimum']
    assert best['delayed'] > 100
    assert best['least_wait_s'] == pytest.approx(best['limiter_wait_s'], rel=0.02)
    lightning, wildfire, embers = looks
    for look in looks:
        assert look['raised'] >= 0.95 and look['most_flashes_per_s'] <= 3
    times_s = [one['flash_median_s'] for one in (lightning, view, wildfire, embers)]
    assert times_s == sorted(times_s)
    assert recorded['limit'] == 'recorded: field'
    assert recorded['flash_median_s'] == pytest.approx(whole['flash_median_s'], abs=0.05)
    assert recorded['raised'] == pytest.approx(whole['raised'], abs=0.02)
    assert view['raised'] >= 0.95
    assert view['order_tau'] > 0.95 and lightning['order_tau'] > 0.9
    assert view['frames_lit'][0] < view['frames_lit'][2]
    assert recorded['frames_lit'] == whole['frames_lit'] and recorded['order_tau'] > 0.95
    assert 0 < view['at_limit'] < none['at_limit']
    assert view['most_flashes_per_s'] <= 3 < none['most_flashes_per_s']
    assert drawn.read_text().count('<path') == 7 * 12 * 25

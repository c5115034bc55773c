# SPDX-License-Identifier: Apache-2.0
import dataclasses

import pytest
from support.quiet_settings import GRAINS

from eol_ros.core.sound.presets import Glide, between
from eol_ros.scene import check_value
from eol_ros.settings import GrainsSettings, live_fields

START = GRAINS
END = GrainsSettings(
    radius=0.2, k=9, mode='chain', gain=0.25, bow_period_s=1.28, playback_rate=0.25, blend=0.0,
    rearm_at_rest=False, weights=('ice 0.5',), ambience_rate=4.0,
)  # fmt: skip


def live(settings):
    return {name: getattr(settings, name) for name in live_fields(type(settings))}


def test_both_ends_are_the_presets():
    a, b = live(START), live(END)
    differ = {name for name in a if a[name] != b[name]}
    assert between(GrainsSettings, a, b, 0.0) == {name: a[name] for name in differ}
    assert between(GrainsSettings, a, b, 1.0) == {name: b[name] for name in differ}
    assert between(GrainsSettings, a, a, 0.5) == {}


@pytest.mark.parametrize('share', [0.1, 0.25, 0.49, 0.5, 0.75, 0.99])
def test_on_the_way_everything_is_a_setting_and_lies_between(share):
    found = between(GrainsSettings, live(START), live(END), share, frozenset(['blend']))
    fields = {f.name: f for f in dataclasses.fields(GrainsSettings)}
    for name, value in found.items():
        assert check_value(fields[name], value) == value, name
    past = share >= 0.5
    assert found['mode'] == ('chain' if past else 'fence')
    assert found['weights'] == (('ice 0.5',) if past else ())
    assert found['blend'] == (0.0 if past else 1.0)  # a corpus is made once on the way
    assert found['rearm_at_rest'] is not past
    assert found['bow_period_s'] == pytest.approx(0.08 * 16**share)
    assert found['playback_rate'] == pytest.approx(0.25**share)
    assert found['radius'] == pytest.approx(0.07 + 0.13 * share)
    assert found['ambience_rate'] == pytest.approx(4 * share)  # from 0: no logarithm
    assert found['k'] == round(3 + 6 * share)


def test_a_glide_tells_each_change_once_and_ends_there():
    start, end = {'grains': live(START), 'sound': {}}, {'grains': live(END)}
    glide = Glide({'grains': GrainsSettings}, start, end, 2.0, frozenset(['blend']))
    at, told = dict(start['grains']), []
    for k in range(100):
        changed = glide.step(0.04 * k)
        assert set(changed) <= {'grains'}
        for name, value in changed.get('grains', {}).items():
            assert at[name] != value
            at[name] = value
            told.append(name)
        if glide.over:
            break
    assert 0.04 * k == pytest.approx(2.0) and at == live(END) == glide.given['grains']
    assert told.count('mode') == told.count('blend') == 1
    assert told.count('gain') == 50
    assert start['grains'] == live(START)

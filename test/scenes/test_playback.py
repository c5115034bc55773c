# SPDX-License-Identifier: Apache-2.0
"""Blocks of a run, played through the graph while recording again, give the run to the last bit.

That images give these blocks is in test/nodes/test_tracker.py, live, and in test_rehearsal.py.
"""

import time

import numpy as np
import pytest
import yaml
from support.running import Graph
from support.waiting import wait_until

from eol_ros.analysis import open_bag

pytestmark = [pytest.mark.live, pytest.mark.slow, pytest.mark.timeout(300)]
CHAIN = {
    'motion': {}, 'leds': {'port': 'twin'}, 'grains': {},
    'sound': {'device': 'wav', 'sub_db': -90.0},  # pulses of the sub voice count as triggers
}  # fmt: skip
# Longer than any pause of a busy machine. `eol bench graph --scenes rehearsal,playback` counts the
# late grains at the latency as shipped.
WAITS = {'latency_s': 0.5, 'tap_latency_s': 0.5}
SECONDS = 3.5  # recorded after the first slip
STATUS_S = 1.1  # each node publishes its status once a second
RATE = 4.0
RESULTS = ('slips', 'cascades', 'grain_triggers')
BY_KNOCK = {'felt_slips': ('kind', 'block', 'onset'), 'felt_triggers': ('grain', 'block', 'stamp')}
LATER = ('log_time', 'publish_time', 'sequence', 'sent')  # of led_commands: of the wire of today


def scene(folder, name, **nodes):
    path = folder / f'{name}.yaml'
    path.write_text(yaml.safe_dump({'scene': name, 'nodes': nodes}))
    return path


def bag_of(folder):
    return open_bag(next(p for p in sorted(folder.iterdir()) if p.is_dir()))


@pytest.fixture(scope='module')
def first(tmp_path_factory):
    """The bag of a short rehearsal."""
    for _ in range(3):
        bag, leds = recorded(tmp_path_factory.mktemp('first'))
        if undisturbed(leds):
            return bag
    pytest.fail(f'disturbed three times: {leds}')


def undisturbed(leds):
    """Return whether light followed all slips: none came late, and the board stayed connected."""
    return not leds['late_slips'] and not leds['dropped'] and leds['connections'] == 1


def recorded(folder):
    """Record a run; return the bag and the status values of `leds`."""
    nodes = {'twin': {}, 'tracker': {}, **CHAIN, 'recorder': {'images': 'none'}}
    watched = ('slips', 'grain_triggers', 'cascades')
    with Graph(scene(folder, 'first', **nodes), folder / 'bags', watched) as graph:
        graph.wait_until_ok()
        wait_until(lambda: all(graph.watch.seen[topic] for topic in watched), 60)
        time.sleep(SECONDS)
        leds = graph.node('leds')['values']
        assert graph.stop() == 0
    return bag_of(folder / 'bags'), leds


def played(first, folder):
    """Play it and record again; return the second bag and what sound and leds say of themselves."""
    folder.mkdir()
    nodes = {'replay': {'bag': str(first.path), 'rate': RATE}, **CHAIN}
    nodes['recorder'] = {'images': 'none'}
    nodes['sound'] = CHAIN['sound'] | WAITS
    with Graph(scene(folder, 'again', **nodes), folder / 'bags', ()) as graph:
        graph.wait_until_ok()
        wait_until(
            lambda: graph.node('replay')['text'].startswith('over'), first.duration_s / RATE + 30
        )
        time.sleep(STATUS_S)
        values = {name: graph.node(name)['values'] for name in ('sound', 'leds')}
        assert graph.stop() == 0
    return bag_of(folder / 'bags'), values


def in_order(table, keys, until):
    """Return what knocks before `until` led to by `keys`, for it comes as knocks come."""
    table = table[table[keys[-1]] < until]
    return table[np.lexsort([table[key] for key in keys])]


def same(one, other):
    """Whether two tables are equal in all that is not of the recorder, to the last bit."""
    names = [n for n in one.dtype.names if n not in LATER]
    return len(one) == len(other) and all(equal(one[n], other[n]) for n in names)


def equal(a, b):
    if a.dtype.names:
        return all(equal(a[n], b[n]) for n in a.dtype.names)
    if a.dtype == object:
        return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b, equal_nan=a.dtype.kind == 'f')


def test_a_run_that_is_played_is_the_run_again(first, tmp_path):
    # Light and sound are the same while nothing comes later than they wait for it.
    for again in range(3):
        second, values = played(first, tmp_path / str(again))
        if undisturbed(values['leds']) and not values['sound']['late']:
            break

    for topic in ('blocks', *RESULTS):
        recorded, again = first.table(topic), second.table(topic)
        assert len(recorded) and same(recorded, again), topic
    for topic, keys in BY_KNOCK.items():
        until = first.table('blocks')['stamp'][-1] - np.timedelta64(200, 'ms')
        recorded, again = (in_order(bag.table(topic), keys, until) for bag in (first, second))
        assert len(recorded) and same(recorded, again), topic
    lit, again = first.table('led_commands'), second.table('led_commands')
    # what came too late since the leds last said so, is not known
    lit = lit[lit['log_time'] < lit['log_time'][-1] - np.timedelta64(round(1e3 * STATUS_S), 'ms')]
    assert np.count_nonzero(lit['white'].sum(1)) > 50
    assert same(lit, again[: len(lit)])  # the last flash may go on to fade: nobody switches it off
    triggers, sound = len(first.table('grain_triggers')), values['sound']
    assert 0 < sound['told_twice'] <= min(sound['felt'], triggers)
    assert sound['triggers'] == triggers + sound['felt'] - sound['told_twice']
    assert sound['late'] == 0
    assert values['sound']['dropped'] == 0
    # On the wall clock; knocks come as long before their images, and those at their stamps.
    assert -100 < values['leds']['wire_p50_ms'] < 1000

# SPDX-License-Identifier: Apache-2.0
"""The sound node in a running graph: what was heard is what is rendered; a card goes and comes."""

import json
import time
import wave

import numpy as np
import pytest
import rclpy
import soundfile
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from support.plugged import plugged
from support.running import Graph
from support.waiting import wait_until

from eol_ros import cli

pytestmark = [pytest.mark.slow, pytest.mark.live]
FS = 48000


def scene(folder):
    """A rehearsal without lights and walls; a latency that no machine is too slow for."""
    nodes = {
        'twin': {'hands': 'nobody'}, 'tracker': {}, 'grains': {'gain': 2.0, 'ambience_rate': 3.0},
        'sound': {'device': 'wav', 'wav': str(folder / 'live.wav'), 'latency_s': 1.0,
                  'fade_in_s': 0.0, 'fade_out_s': 0.0, 'gain_db': 6.0, 'governor_db': 0.0,
                  'rate_scaling': 0.5, 'corner_hz': 6000, 'dynamics_db': 4, 'onset_duck_db': 4,
                  'sub_db': -6, 'room_s': 2, 'speakers': ['left 30', 'right -30']},
        'recorder': {'images': 'none', 'display_period_s': 0.0},
    }  # fmt: skip
    path = folder / 'scene.yaml'
    path.write_text(json.dumps({'scene': 'sound', 'nodes': nodes}))
    return path


def change(domain, node, **values):
    """Set live settings of a running node, as `ros2 param set` does."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    asking = rclpy.create_node('asking', context=context)
    executor.add_node(asking)
    try:
        client = asking.create_client(SetParameters, f'/eol/{node}/set_parameters')
        assert client.wait_for_service(20)
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        future = client.call_async(SetParameters.Request(parameters=parameters))
        executor.spin_until_future_complete(future, 20)
        assert all(r.successful for r in future.result().results)
    finally:
        asking.destroy_node()
        executor.shutdown()
        context.try_shutdown()


def ran(folder):
    """Run the scene until it sounds; return the values of `sound` and the recorder's losses."""
    with Graph(scene(folder), folder / 'bags', watched=('grain_triggers',)) as graph:
        graph.wait_until_ok()  # nothing may slip before the sound has its corpus
        change(graph.domain, 'twin', hands='visitors')
        seen = graph.watch.seen['grain_triggers']
        # hands that pull hard cause so many within a second, which is too short to compare
        wait_until(lambda: len(seen) >= 60 and seen[-1][0] - seen[0][0] > 3e9)
        time.sleep(1.5)  # the last of them sound
        return graph.node('sound')['values'] | {'lost': graph.node('recorder')['values']['lost']}


def test_a_bag_renders_to_the_samples_of_the_live_run(tmp_path):
    """Bit for bit, limiter and all; the live file holds 16 of the bits."""
    for again in range(3):  # a machine that stalls for a second changes the sound
        folder = tmp_path / str(again)
        folder.mkdir()
        values = ran(folder)
        found = {name: values[name] for name in ('lost', 'late', 'dropped', 'unheard', 'underruns')}
        if not any(found.values()):
            break
    assert values['triggers'] >= 60
    assert not any(found.values()), found
    out = folder / 'offline.wav'
    bag = next((folder / 'bags').iterdir())
    words = ['render', str(bag), '--scene', str(folder / 'scene.yaml'), '--output', str(out)]
    assert cli.main(words) == 0
    offline, rate = soundfile.read(out, dtype='float32')
    assert rate == FS and np.abs(offline).max() > 0.5
    wanted = np.round(np.clip(offline, -1, 1) * 32767).astype('<i2')
    with wave.open(str(folder / 'live.wav')) as file:
        live = np.frombuffer(file.readframes(file.getnframes()), '<i2').reshape(-1, 2)
    begins = [int(np.flatnonzero(sound.any(axis=1))[0]) for sound in (live, wanted)]
    live, wanted = live[begins[0] :], wanted[begins[1] :]
    size = min(len(live), len(wanted))
    last = int(np.flatnonzero(live.any(axis=1))[-1])
    assert last > 2 * FS
    size = min(size, last + 1 - FS)  # at its end the run fades, and its last second is not whole
    other = np.flatnonzero((live[:size] != wanted[:size]).any(axis=1))
    assert not other.size, (
        len(other),
        other[:3],
        other[-1],
        size,
        live[other[0]],
        wanted[other[0]],
    )


@pytest.fixture
def card(monkeypatch):
    yield from plugged(monkeypatch, here=False)


def test_a_card_that_goes_and_comes_back(tmp_path, card):
    """Its driver hangs, as JACK's does: the supervisor starts the node again, and only once."""
    sound = {'device': 'system', 'wav': str(tmp_path / 'x.wav')}
    nodes = {'twin': {'hands': 'visitors'}, 'tracker': {}, 'grains': {}, 'sound': sound}
    path = tmp_path / 'loss.yaml'
    path.write_text(json.dumps({'scene': 'loss', 'nodes': nodes}))
    with Graph(path, watched=()) as graph:

        def plays():
            row = graph.node('sound')
            sounds = row['values'].get('triggers', 0) > 0
            return sounds and row['text'].startswith('playing on system')

        graph.wait_until_ok()
        wait_until(plays)
        before = graph.node('sound')['pid']
        card.stop()
        wait_until(lambda: not plays())
        card.start()
        wait_until(plays)
        assert graph.node('sound')['pid'] != before
        assert graph.log.read_text().count('sound has died') == 1

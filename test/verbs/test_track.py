# SPDX-License-Identifier: Apache-2.0
import json

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import Image
from support.bag_samples import bag_of
from support.definitions import HEADER, IMAGE
from support.paper import rest_lattice

from eol_ros import cli
from eol_ros.core.motion.motion import Motion
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.files import calibration_file
from eol_ros.settings import MotionSettings, TrackerSettings

pytestmark = pytest.mark.slow
COUNT, FPS, BEGIN_S = 75, 60.0, 0.905


def truth(k):
    """Places of all blocks in image k: at rest, then block 7 slips 15 mm."""
    xy = rest_lattice()
    since = max(k / FPS - BEGIN_S, 0.0)
    xy[7, 0] += min(1.25 * since**2, 0.015)
    return xy


@pytest.fixture(scope='module')
def stack(tmp_path_factory):
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 5)
    images = np.zeros((COUNT, 800, 1280), np.uint8)
    for k in range(COUNT):
        xy = truth(k)
        images[k] = renderer.render(xy[:, 0], xy[:, 1], np.zeros(25), k)
        if 60 <= k < 66:
            images[k, 180:330, 420:480] = 14
    path = tmp_path_factory.mktemp('track') / 'images.npy'
    np.save(path, images)
    return path


@pytest.fixture(scope='module')
def answer(stack):
    out = stack.with_name('answer.npz')
    assert cli.main(['track', str(stack), '--output', str(out), '--fps', '60']) == 0
    return np.load(out)


def test_with_a_calibration_it_sees_the_same(stack, answer):
    camera, out = stack.with_name('ideal.yaml'), stack.with_name('known.npz')
    calibration_file.save(camera, Calibration.ideal())
    words = ['track', str(stack), '--output', str(out), '--fps', '60', '--calibration', str(camera)]
    assert cli.main(words) == 0
    found = np.load(out)
    for k in range(COUNT):
        seen = found['visible'][k]
        assert seen.sum() == 25 or (60 <= k < 66 and seen.sum() >= 22)  # some are covered
        off = found['world'][k, seen, :2] - truth(k)[seen]
        assert np.abs(off).max() < 1e-4  # m
    assert [row['block'] for row in found['slips']] == [7]


def test_a_scene_of_another_table_than_the_bag_is_refused(tmp_path, capsys):
    image = Image(height=8, width=8, encoding='mono8', step=8, data=bytes(64))
    bag_of(tmp_path / 'run', [('camera/image_raw', image, 0.0)], settings='table: {rows: 3}')
    told = 'run: its table is not that of ring: rows 3, not 5, absent [], not [6, 7, 8'
    for words in (['track'], ['calibrate', 'blocks']):
        assert cli.main([*words, str(tmp_path / 'run'), '--scene', 'ring']) == 78
        assert told in capsys.readouterr().err


def test_shapes_and_what_they_mean(answer):
    assert answer['px'].shape == (COUNT, 25, 2)
    assert answer['yaw'].shape == answer['visible'].shape == (COUNT, 25)
    assert answer['world'].shape == (COUNT, 25, 3)
    assert answer['state'].shape == (COUNT,)
    assert np.array_equal(answer['time'], np.arange(COUNT) / 60)
    assert np.array_equal(np.isnan(answer['px'][..., 0]), ~answer['visible'])


def test_pixels_and_ids_are_right_from_the_first_image(answer):
    ideal = Calibration.ideal()
    for k in range(COUNT):
        seen = answer['visible'][k]
        off = answer['px'][k][seen] - ideal.to_pixels(truth(k))[seen]
        assert np.abs(off).max() < 0.05
    assert answer['visible'][:60].all()


def test_hidden_blocks_are_not_reported(answer):
    hidden = ~answer['visible'][61:65].any(0)
    assert set(np.flatnonzero(hidden)) == {15, 20}


def test_metres_come_from_the_moment_it_has_calibrated_itself(answer):
    state = answer['state']
    first = int(np.argmax(state == 1))
    assert 0 < first < 40
    assert (state[:first] == 3).all()
    assert np.isnan(answer['world'][:first, :, :2]).all()
    for k in range(first, COUNT):
        seen = answer['visible'][k]
        assert np.allclose(answer['world'][k, seen, :2], truth(k)[seen], atol=2e-4)


def test_the_slip_is_found(answer):
    (onset,) = answer['onset']
    assert onset[1] == 7
    assert onset[0] == pytest.approx(BEGIN_S, abs=0.005)
    assert answer['slips']['distance_m'][0] == pytest.approx(0.015, abs=2e-4)
    assert list(answer['cascades']['nucleus']) == [7]


@pytest.fixture(scope='module')
def dropped(stack):
    """The video without 13 images, which are left, and the speed of the slip in the whole video."""
    lost = [*range(20, 30), 40, 57, 58]
    left = np.setdiff1d(np.arange(COUNT), lost)
    path = stack.with_name('dropped.npy')
    np.save(path, np.load(stack)[left])
    calibration_file.save(stack.with_name('ideal.yaml'), Calibration.ideal())
    (slip,) = tracked(stack, '--fps', '60')['slips']
    return path, left, slip['speed_mps']


def tracked(images, *words):
    out = images.with_name('dropped.npz')
    table = images.with_name('ideal.yaml')
    command = ['track', str(images), '--calibration', str(table), '--output', str(out), *words]
    assert cli.main(command) == 0
    return np.load(out)


@pytest.mark.parametrize('unit', ['seconds', 'nanoseconds'])
def test_dropped_images_leave_no_trace_where_stamps_are_given(dropped, tmp_path, unit):
    path, left, speed_mps = dropped
    stamps = tmp_path / 'stamps.txt'
    start_ns = 1_700_000_000_000_000_000 if unit == 'nanoseconds' else 0
    times_ns = start_ns + np.rint(left / FPS * 1e9).astype(np.int64)
    words = times_ns if start_ns else times_ns / 1e9
    stamps.write_text('# mid-exposure\n' + ''.join(f'{w!r}\n' for w in words.tolist()) + '\n')
    answer = tracked(path, '--stamps', str(stamps))
    assert answer['time'].tolist() == (times_ns * 1e-9 if start_ns else times_ns / 1e9).tolist()
    (onset,) = answer['slips']
    assert onset['block'] == 7
    assert onset['onset_s'] - start_ns * 1e-9 == pytest.approx(BEGIN_S, abs=0.005)
    assert onset['speed_mps'] == pytest.approx(speed_mps, rel=0.03)
    for k, world, seen in zip(left, answer['world'], answer['visible'], strict=True):
        assert np.allclose(world[seen, :2], truth(k)[seen], atol=2e-4)
    if start_ns:
        return

    answer = tracked(path, '--fps', '60')  # as if no image were missing
    (onset,) = answer['slips']
    assert abs(onset['onset_s'] - BEGIN_S) > 10 / FPS
    assert onset['speed_mps'] > 1.2 * speed_mps
    late = np.array([truth(t * FPS)[7] for t in answer['time']]) - answer['world'][:, 7, :2]
    assert np.abs(late).max() > 0.01


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('0.0\n0.1\n', ':62 images'),
        ('0.0\n0.1\nsoon\n', ':3: soon is not a time'),
        ('0.0\n0.1\n\nnan\n', ':4: nan is not a time'),
        ('0.0\n1_0.0\n', ':2: 1_0.0 is not a time'),
        ('0.0\n0.2\n0.1\n', ':3: 0.1 does not come after 0.2'),
        ('# s\n0.5\n0.5\n', ':3: 0.5 does not come after 0.5'),
        ('0.5\n1000000000\n', ':2: 1000000000 is in nanoseconds, unlike'),
        ('1\n2\n', ':2: 2 is only 1e-09 s after the line before; seconds need a decimal point'),
    ],
)
def test_stamps_that_are_none(dropped, tmp_path, capsys, text, words):
    stamps = tmp_path / 'stamps.txt'
    stamps.write_text(text)
    assert cli.main(['track', str(dropped[0]), '--stamps', str(stamps)]) == 78
    (error,) = capsys.readouterr().err.strip().splitlines()
    assert all(part in error for part in (str(stamps), *words.rpartition(':')[::2]))


def test_a_film_needs_as_many_stamps_as_it_has_images(stack, tmp_path, capsys):
    film, stamps = tmp_path / 'film.avi', tmp_path / 'stamps.txt'
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*'FFV1'), 60, (1280, 800), False)
    for image in np.load(stack)[:4]:
        writer.write(image)
    writer.release()
    stamps.write_text('0.5\n0.6\n0.65\n')
    assert cli.main(['track', str(film), '--stamps', str(stamps)]) == 78
    assert 'has 3 stamps, but' in capsys.readouterr().err
    stamps.write_text('0.5\n0.6\n0.65\n2.0\n')
    out = tmp_path / 'out.npz'
    assert cli.main(['track', str(film), '--stamps', str(stamps), '--output', str(out)]) == 0
    assert np.load(out)['time'].tolist() == [0.5, 0.6, 0.65, 2.0]
    assert cli.main(['track', str(film), '--stamps', str(stamps), '--fps', '60']) == 2
    assert cli.main(['track', str(film), '--stamps', str(tmp_path / 'none.txt')]) == 69


def test_json(stack, tmp_path, capsys):
    short = tmp_path / 'short.npy'
    np.save(short, np.load(stack)[:12])
    assert cli.main(['track', str(short), '--json']) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary['frames'] == 12
    assert summary['coverage'] == 1.0
    states = summary['states']
    assert set(states) <= {'calibrating', 'tracking'} and sum(states.values()) == 12
    assert 0 < summary['ms_median'] <= summary['ms_p99']


@pytest.fixture(scope='module')
def turned_in_a_mirror(tmp_path_factory):
    """A still table, its blocks turned by 0.3 rad, as a camera above a mirror sees it."""
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 5)
    path = tmp_path_factory.mktemp('mirror') / 'images.npy'
    x, y = rest_lattice().T
    np.save(path, [renderer.render(x, y, np.full(25, 0.3), k)[:, ::-1].copy() for k in range(30)])
    return path


def test_a_film_through_a_mirror(turned_in_a_mirror, tmp_path, capsys):
    out = tmp_path / 'answer.npz'
    words = ['track', str(turned_in_a_mirror), '--output', str(out)]
    assert cli.main([*words, '--mirror']) == 0
    answer = np.load(out)
    assert np.abs(answer['world'][-1, :, :2] - rest_lattice()).max() < 2e-4
    assert np.abs(answer['yaw'][-1] - 0.3).max() < 2e-3

    table = tmp_path / 'table.yaml'
    calibration_file.save(table, Calibration.ideal())
    capsys.readouterr()
    assert cli.main([*words, '--mirror', '--calibration', str(table)]) == 78
    assert 'without a mirror' in capsys.readouterr().err
    calibration_file.save(table, Calibration.ideal(mirror=True))
    assert cli.main([*words, '--calibration', str(table)]) == 0
    assert np.abs(np.load(out)['world'][0, :, :2] - rest_lattice()).max() < 2e-4


def test_same_as_the_live_classes_to_the_bit(stack, answer):
    tracker, motion = Tracker(TrackerSettings(), None), Motion(MotionSettings())
    starts = []
    for k, image in enumerate(np.load(stack)):
        tracked = tracker.update(k / FPS, image)
        assert tracked.yaw.tobytes() == answer['yaw'][k].tobytes()
        assert tracked.world.tobytes() == answer['world'][k, :, :2].tobytes()
        x, y = tracked.world.T
        slips, _ = motion.update(
            k / FPS, x, y, tracked.seen & (tracked.state == 1), tracked.sigma_m
        )
        starts += [s.event.stamp_s for s in slips if s.event.kind == 1]
    assert starts == list(answer['slips']['start_stamp_s'])


def test_folder_and_film_give_the_same_ids(stack, tmp_path):
    images = np.load(stack)[:10]
    folder = tmp_path / 'pictures'
    folder.mkdir()
    film = cv2.VideoWriter(
        str(tmp_path / 'film.avi'), cv2.VideoWriter.fourcc(*'FFV1'), 60, (1280, 800), False
    )
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f'{k:04d}.png'), image)
        film.write(image)
    film.release()
    results = []
    for source in (folder, tmp_path / 'film.avi'):
        out = tmp_path / 'out.npz'
        assert cli.main(['track', str(source), '--output', str(out)]) == 0
        results.append(np.load(out)['px'])
    assert np.array_equal(results[0], results[1])


def test_a_film_that_ends_in_the_middle_of_an_image(stack, tmp_path, capsys):
    whole = tmp_path / 'whole.avi'
    film = cv2.VideoWriter(str(whole), cv2.VideoWriter.fourcc(*'MJPG'), 60, (1280, 800), False)
    for image in np.load(stack)[:12]:
        film.write(image)
    film.release()
    cut = tmp_path / 'cut.avi'
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    out = tmp_path / 'out.npz'
    code = cli.main(['track', str(cut), '--output', str(out)])
    assert code in (0, 78)
    error = capsys.readouterr().err
    if code == 0:
        assert 0 < len(np.load(out)['state']) < 12
    assert str(cut) in error
    assert 'Traceback' not in error


def test_other_bad_wishes(stack, tmp_path, capsys):
    assert cli.main(['track', str(stack), '--fps', '0']) == 2
    assert cli.main(['track', str(stack), '--output', str(tmp_path / 'no' / 'a.npz')]) == 78
    empty = tmp_path / 'empty'
    empty.mkdir()
    assert cli.main(['track', str(empty)]) == 69


TAP = f"""std_msgs/Header header
uint8 block
float32 strength
uint32 board_time_us
float32 sigma
{HEADER}"""


@pytest.mark.parametrize('encoding', ['mono8', '32FC1', 'rgb8'])
def test_a_bag_is_tracked_by_its_own_stamps(stack, tmp_path, capsys, encoding):
    from builtin_interfaces.msg import Time
    from eol_msgs.msg import BlockTap
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import Image

    from eol_ros.devices.bag.mcap_file import BagTopic
    from eol_ros.devices.bag.writer import BagWriter

    topics = [
        BagTopic('/eol/camera/image_raw', 'sensor_msgs/msg/Image', IMAGE),
        BagTopic('/eol/block_taps', 'eol_msgs/msg/BlockTap', TAP),
    ]
    bag = BagWriter(tmp_path / 'bag', topics, {})
    images = np.load(stack)[:8]
    start_ns = 1_700_000_000_000_000_000
    stamps = [start_ns + k * 16_666_667 for k in range(8)]
    for k, (stamp, image) in enumerate(zip(stamps, images, strict=True)):
        message = Image(height=800, width=1280, encoding=encoding, step=1280)
        message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        message.data.frombytes(image.tobytes())
        bag.write('/eol/camera/image_raw', serialize_message(message), stamp, stamp, k + 1)
    tap = BlockTap(block=7, sigma=0.002)
    tap.header.stamp = Time(sec=stamps[2] // 10**9, nanosec=stamps[2] % 10**9)
    bag.write('/eol/block_taps', serialize_message(tap), stamps[3], stamps[3], 1)
    bag.close()
    out = tmp_path / 'out.npz'
    code = cli.main(['track', str(tmp_path / 'bag'), '--output', str(out)])
    if encoding != 'mono8':
        assert code == 78
        why = 'in steps of 1280 bytes: too short' if encoding == 'rgb8' else "image is '32FC1'"
        assert why in capsys.readouterr().err
        return
    assert code == 0
    stamps_file = tmp_path / 'stamps.txt'
    stamps_file.write_text('0.5\n')
    assert cli.main(['track', str(tmp_path / 'bag'), '--stamps', str(stamps_file)]) == 2
    found = np.load(out)
    assert list(found['time']) == [ns * 1e-9 for ns in stamps]
    tracker = Tracker(TrackerSettings(), None)
    for k, (stamp, image) in enumerate(zip(stamps, images, strict=True)):
        tracked = tracker.update(stamp * 1e-9, image)
        assert tracked.px.tobytes() == found['px'][k].tobytes()

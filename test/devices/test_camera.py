# SPDX-License-Identifier: Apache-2.0
"""The camera on real files from real encoders, and on a driver with a script of mishaps."""

import time
from collections import Counter
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from support.fake_camera import FakeCamera, fake_source, number_of
from support.waiting import wait_until

from eol_ros.devices.backoff import Backoff
from eol_ros.devices.camera import ports
from eol_ros.devices.camera.camera import AHEAD, Camera, Pace
from eol_ros.devices.camera.sources import VideoFile, is_file, source_of
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.settings import CameraSettings

W, H = 320, 200


def pictures(n):
    """A bright square that goes its way over a noisy ground."""
    rng = np.random.default_rng(3)
    images = rng.normal(20, 3, (n, H, W)).clip(0, 255).astype(np.uint8)
    for k, image in enumerate(images):
        image[60:106, 10 + 4 * k : 56 + 4 * k] = 200
    return images


def write(path, images, fourcc, fps=60.0):
    colour = images[0].ndim == 3
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter_fourcc(*fourcc), fps, (W, H), isColor=colour
    )
    assert writer.isOpened()
    for image in images:
        writer.write(image)
    writer.release()
    return str(path)


class Watcher:
    """A Camera whose images and states are kept."""

    def __init__(self, source, slow_s=0.0, **options):
        self.images, self.stamps, self.states, self.slow_s = [], [], [], slow_s
        self.camera = Camera(
            source, self.take, self.states.append, backoff=Backoff(0.05, 0.1), **options
        )

    def take(self, stamp_ns, image):
        self.stamps.append(stamp_ns)
        self.images.append(image.copy())
        time.sleep(self.slow_s)

    def kinds(self):
        return [s.kind for s in self.states]

    def __enter__(self):
        self.camera.start()
        return self

    def __exit__(self, *_):
        self.camera.close()


def settings(device='fake', **more):
    return CameraSettings(**{'device': device, 'width': W, 'height': H, 'fps': 200.0} | more)


def live(driver, **more):
    return fake_source(driver, settings(**more))


# Files


def played(path, slow_s=0.0, **more):
    """Return what was seen of a file from its beginning to its end."""
    with Watcher(source_of(settings(str(path), **more)), slow_s, loop=False) as seen:
        wait_until(lambda: seen.camera.state.kind == 'ended')
    return seen


@pytest.mark.parametrize(
    ('name', 'fourcc', 'worst'),
    [('a.avi', 'MJPG', 40), ('a.mkv', 'FFV1', 0), ('b.avi', 'FFV1', 0), ('a.mp4', 'mp4v', 40)],
)
def test_a_file_of_any_encoder_comes_back_whole_and_in_order(tmp_path, name, fourcc, worst):
    images = pictures(30)
    path = write(tmp_path / name, images, fourcc)
    seen = played(path)

    assert len(seen.images) == 30
    assert all(i.shape == (H, W) and i.dtype == np.uint8 for i in seen.images)
    apart = [np.abs(a.astype(int) - b) for a, b in zip(seen.images, images, strict=True)]
    assert max(a.max() for a in apart) <= worst
    assert max(a.mean() for a in apart) <= (2.5 if worst else 0)


def test_a_late_file_catches_up_at_twice_the_rate_and_keeps_its_stamps():
    pace, now, epoch = Pace(100.0), 5_000_000_000, 90_000_000_000
    stamps, goes = [], []
    for k in range(40):
        if k == 10:
            now += 100_000_000  # the machine was elsewhere
        stamp, now = pace.next(now, epoch + now)
        stamps.append(stamp)
        goes.append(now)

    assert set(np.diff(stamps)) == {10_000_000}
    assert stamps[0] == epoch + 5_000_000_000
    assert set(np.diff(goes[:10])) == set(np.diff(goes[30:])) == {10_000_000}
    assert set(np.diff(goes[10:20])) == {5_000_000}
    assert goes[-1] == stamps[-1] - epoch


def test_a_file_that_is_much_too_late_goes_on_from_now():
    pace = Pace(50.0)
    pace.next(0, 0)
    stamp, go = pace.next(10_000_000_000, 10_000_000_000)

    assert stamp == go == 10_000_000_000


def test_a_file_goes_at_its_own_rate_when_the_scene_says_zero(tmp_path):
    path = write(tmp_path / 'a.avi', pictures(6), 'MJPG', fps=50.0)
    before_ns = time.time_ns()
    seen = played(path, fps=0.0)

    assert set(np.diff(seen.stamps)) == {20_000_000}
    assert before_ns <= seen.stamps[0] <= seen.stamps[-1] <= time.time_ns()


def test_a_loop_begins_again_without_a_gap(tmp_path):
    path = write(tmp_path / 'a.mkv', pictures(7), 'FFV1')
    with Watcher(VideoFile(settings(path)), loop=True) as seen:
        wait_until(lambda: len(seen.images) >= 30)

    for k, image in enumerate(seen.images):
        np.testing.assert_array_equal(image, seen.images[k % 7])
    assert len(np.unique(np.array(seen.images[:7]).reshape(7, -1), axis=0)) == 7
    assert seen.camera.opened == 1


def test_a_slow_reader_of_a_file_loses_nothing(tmp_path):
    images = pictures(3 * AHEAD)
    path = write(tmp_path / 'a.mkv', images, 'FFV1')
    seen = played(path, slow_s=0.012)

    np.testing.assert_array_equal(seen.images, images)
    assert seen.camera.dropped == 0


def test_a_file_that_breaks_off_says_where(tmp_path):
    path = write(tmp_path / 'a.avi', pictures(30), 'MJPG')
    whole = (tmp_path / 'a.avi').read_bytes()
    (tmp_path / 'a.avi').write_bytes(whole[: len(whole) // 2])
    seen = played(path)

    assert 5 < len(seen.images) < 25
    assert f'breaks off after {len(seen.images)} of 30 images' in seen.camera.state.text


def colour_square(n):
    images = [np.full((H, W, 3), 20, np.uint8) for _ in range(n)]
    for image in images:
        image[50:100, 50:100] = (0, 0, 255)
    return images


@pytest.mark.parametrize(
    ('make', 'error', 'words'),
    [
        (lambda d: str(d / 'none.avi'), DeviceMissing, 'there is no file'),
        (lambda d: write_text(d / 'x.avi'), ConfigError, 'cannot open'),
        (lambda d: write(d / 'c.avi', colour_square(3), 'MJPG'), ConfigError, 'in colour'),
        (lambda d: write(d / 'c.mkv', colour_square(3), 'FFV1'), ConfigError, 'in colour'),
        (lambda d: write_size(d / 's.avi'), ConfigError, 'is 640x400, the scene says 320x200'),
    ],
)
def test_a_file_that_cannot_be_used_is_one_clear_line(tmp_path, make, error, words):
    path = make(tmp_path)
    with pytest.raises(error, match=words) as caught:
        Camera(VideoFile(settings(path)), lambda *_: None).start()

    assert '\n' not in str(caught.value)
    assert path in str(caught.value)


def write_text(path):
    path.write_text('not a video\n' * 100)
    return str(path)


def write_size(path):
    images = [cv2.resize(i, (640, 400)) for i in pictures(2)]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 60, (640, 400), False)
    for image in images:
        writer.write(image)
    writer.release()
    return str(path)


def test_a_name_is_told_from_a_file():
    assert is_file('films/table.avi') and is_file('table.avi') and is_file('p%03d.png')
    assert not is_file('auto') and not is_file('/dev/video0') and not is_file('OV9281')


# A live camera


@pytest.mark.parametrize('name', ['GREY', 'MJPG'])
def test_either_format_will_do(name):
    driver = FakeCamera(formats=[name])
    with Watcher(live(driver)) as seen:
        wait_until(lambda: len(seen.images) >= 20)

    assert seen.images[0].shape == (H, W)
    assert min(np.diff([number_of(image) for image in seen.images])) > 0
    assert seen.states[0].text == 'fake at 200 images/s'


def test_the_stamp_is_the_drivers_less_half_the_exposure():
    driver = FakeCamera()
    with Watcher(live(driver, exposure_us=4000)) as seen:
        wait_until(lambda: len(seen.images) >= 10)
        arrived_ns = time.time_ns()

    # The driver's stamp is half a millisecond before the grab returns.
    assert seen.camera.source.odd_stamps == 0
    assert seen.stamps[-1] < arrived_ns - 2_400_000
    assert min(np.diff(seen.stamps)) > 0


def test_exposure_is_set_after_the_format_and_read_back():
    driver = FakeCamera(exposure_steps=7)
    source = live(driver, exposure_us=3000)
    source.open()

    order = driver.set_order
    assert order.index(cv2.CAP_PROP_EXPOSURE) > order.index(cv2.CAP_PROP_FOURCC)
    assert source.exposure_us == 2800
    assert source.notes == ['exposure 2800 us, not the 3000 asked for']


def test_a_camera_without_manual_exposure_says_so():
    source = live(FakeCamera(manual_exposure=False))
    source.open()

    assert source.notes == ['the camera keeps its automatic exposure: expect blur']


def test_a_slow_reader_of_a_live_camera_sees_the_newest():
    driver = FakeCamera()
    with Watcher(live(driver), slow_s=0.05) as seen:
        wait_until(lambda: len(seen.images) >= 8 and seen.camera.dropped > 20)
        behind = driver.number - number_of(seen.images[-1])

    assert behind < 30
    assert np.median(np.diff([number_of(i) for i in seen.images[1:]])) > 2


def test_a_repeated_buffer_is_handed_over_once():
    driver = FakeCamera(script={k: ('repeat', 0) for k in (5, 6, 9)})
    with Watcher(live(driver)) as seen:
        wait_until(lambda: len(seen.images) >= 12)

    assert max(Counter(seen.stamps).values()) == 1
    assert seen.camera.source.repeated == 3
    assert not {5, 6, 9} & {number_of(i) for i in seen.images}


def test_a_stall_is_noticed_after_three_image_times_and_passes():
    driver = FakeCamera(script={10: ('stall', 0.2)})
    with Watcher(live(driver)) as seen:
        wait_until(lambda: 'stalled' in seen.kinds())
        wait_until(lambda: seen.kinds()[-1] == 'streaming')

    assert driver.opened == 1
    assert 'for 3 image times' in next(s.text for s in seen.states if s.kind == 'stalled')


def test_an_unplugged_camera_is_opened_again_and_set_again():
    driver = FakeCamera(script={10: ('unplug', 0.12)}, exposure_steps=1)
    with Watcher(live(driver)) as seen:
        wait_until(lambda: 'lost' in seen.kinds())
        wait_until(lambda: seen.kinds()[-1] == 'streaming')
        count = len(seen.images)
        wait_until(lambda: len(seen.images) > count + 3)

    assert seen.camera.opened == 2
    assert driver.opened >= 3  # while it was away, too
    assert driver.set_order.count(cv2.CAP_PROP_EXPOSURE) == 2
    lost = next(s for s in seen.states if s.kind == 'lost')
    assert 'trying again in' in lost.text


@pytest.mark.parametrize('jump', [3600.0, -3600.0, 0.2, -0.05])
def test_a_driver_clock_that_jumps_is_not_believed(jump):
    driver = FakeCamera(script={10: ('jump', jump)})
    with Watcher(live(driver)) as seen:
        wait_until(lambda: len(seen.images) >= 40)
        now_ns = time.time_ns()

    ahead = np.array(seen.stamps) - now_ns
    assert ahead.max() < 0
    assert ahead.min() > -5e9
    assert seen.camera.source.odd_stamps > 0


def test_broken_pictures_mean_a_new_start():
    driver = FakeCamera(formats=['MJPG'], script={5: ('break', 0)})
    with Watcher(live(driver)) as seen:
        wait_until(lambda: len(seen.images) >= 8 and seen.camera.opened == 2)

    assert 'broken JPEG' in next(s.text for s in seen.states if s.kind == 'lost')


@pytest.mark.parametrize(
    ('driver', 'words'),
    [
        (FakeCamera(formats=['YUYV']), "gives 'YUYV' images, not GREY or MJPG"),
        (FakeCamera(width=640), 'gives 640x200 images, the scene says 320x200'),
    ],
)
def test_a_camera_of_another_kind_is_one_clear_line(driver, words):
    with Watcher(live(driver)) as seen:
        wait_until(lambda: seen.states)

    assert seen.states[0].kind == 'wrong'
    assert words in seen.states[0].text


def test_an_absent_camera_is_looked_for(monkeypatch):
    present = SimpleNamespace(here=False)

    def find(name):
        if not present.here:
            raise DeviceMissing('no camera found')
        return '/dev/video9'

    source = fake_source(FakeCamera(), settings('auto'))
    source.find = find
    with Watcher(source) as seen:
        wait_until(lambda: 'lost' in seen.kinds())
        present.here = True
        wait_until(lambda: len(seen.images) > 3)

    assert seen.camera.source.name == '/dev/video9'


# Names


def test_cameras_are_listed_by_stable_name(tmp_path, monkeypatch):
    system, by_id = tmp_path / 'sys', tmp_path / 'by-id'
    by_id.mkdir()
    for k, index in ((0, '0'), (1, '1'), (2, '0')):
        (system / f'video{k}').mkdir(parents=True)
        (system / f'video{k}' / 'name').write_text(f'Cam {k}\n')
        (system / f'video{k}' / 'index').write_text(f'{index}\n')
    (by_id / 'usb-OV9281_77-video-index0').symlink_to('/dev/video2')
    (by_id / 'usb-OV9281_77-video-index1').symlink_to('/dev/video1')

    monkeypatch.setattr(ports, 'BY_ID', by_id)
    monkeypatch.setattr(ports, 'SYSTEM', system)

    assert [(c.name, c.description) for c in ports.list_cameras()] == [
        ('/dev/video0', 'Cam 0'),
        (str(by_id / 'usb-OV9281_77-video-index0'), 'Cam 2'),
    ]

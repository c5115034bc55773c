# SPDX-License-Identifier: Apache-2.0
"""GenICam cameras: the real protocol on a loopback, from the simulated camera of Aravis."""

import re
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest
from support import gige as simulated
from support.gige import GREY, NAME, Gige, own_network, without
from support.waiting import wait_until

from eol_ros.devices.backoff import Backoff
from eol_ros.devices.camera import aravis, genicam
from eol_ros.devices.camera.camera import Camera
from eol_ros.devices.camera.genicam import GenicamCamera
from eol_ros.devices.camera.sources import source_of
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.settings import CameraSettings

W, H = 320, 200
HERE = '127.0.0.1'


def settings(**more):
    given = {'device': f'genicam:{NAME}', 'width': W, 'height': H, 'fps': 100.0}
    return CameraSettings(**given | more)


def camera(**more):
    """A camera that is not looked for with a second of broadcasts."""
    source = GenicamCamera(settings(**more))
    source.find = lambda name: HERE
    return source


@pytest.fixture
def plugged(tmp_path):
    """Plug simulated cameras in; pull out what is left."""
    made = []

    def plug(**more):
        made.append(Gige(tmp_path, **more))
        made[-1].plug()
        return made[-1]

    plug.made = made
    with own_network():
        yield plug
        for one in made:
            one.unplug()


@pytest.fixture
def opened(plugged):
    """Open cameras of ours, in front of a simulated one if there is none, and close them."""
    made = []

    def open_one(**more):
        if not plugged.made:
            plugged()
        made.append(camera(**more))
        made[-1].open()
        return made[-1]

    yield open_one
    for one in made:
        one.close()


def number_of(image):
    return int.from_bytes(image[0, :4].tobytes(), 'little')


def test_it_is_found_by_its_serial_number_and_gives_its_images(plugged):
    plugged()
    listed = aravis.list_cameras()
    [port] = listed
    assert port.name == f'genicam:Aravis-Fake-{NAME}'
    assert port.description == f'Aravis Fake {NAME} at {HERE}, GigEVision'
    with pytest.raises(DeviceMissing, match="no GenICam camera has 'none' in its name"):
        genicam.find_camera('genicam:none')

    source = source_of(settings())
    source.open()
    images = [source.read().image.copy() for _ in range(10)]
    source.close()

    assert source.name == port.name
    assert {i.shape for i in images} == {(H, W)}
    assert min(np.diff([number_of(i) for i in images])) > 0
    assert all((i.ravel()[4:] == GREY).all() for i in images)


def test_what_it_takes_is_told_only_where_it_differs(opened):
    source = opened(exposure_us=2500, gain=3.0, fps=50.0)

    assert source.exposure_us == 2500 and source.fps == 50
    assert len(source.notes) == 1 and 'its clock cannot be read' in source.notes[0]


def in_tenths_of_ms(text):
    """A camera whose exposure has steps of 100 us."""
    return text.replace('>FROM<', '>FROM / 100<').replace('>TO<', '>TO * 100<')


def fixed(text):
    """A camera whose exposure cannot be written."""
    at = text.index('ExposureTimeAbsRegister" NameSpace')
    return text[:at] + text[at:].replace('>RW<', '>RO<', 1)


@pytest.mark.parametrize(
    ('describe', 'exposure_us', 'note'),
    [
        (in_tenths_of_ms, (2500, 2600), r'exposure 2[56]00 us, not the 2570 asked for$'),
        (fixed, (10000,), r'exposure 10000 us, not the 2570 asked for: it refuses \('),
        (
            lambda text: without(text, 'ExposureTimeAbs'),
            (2570,),
            r'exposure cannot be verified: it refuses \(',
        ),
    ],
    ids=['rounds', 'refuses', 'has none'],
)
def test_an_exposure_that_is_not_taken_is_told_in_one_line(
    plugged, opened, describe, exposure_us, note
):
    plugged(describe=describe)
    source = opened(exposure_us=2570)

    assert source.exposure_us in exposure_us
    assert re.match(note, source.notes[0]) and '\n' not in source.notes[0]


def test_a_trigger_is_set_and_verified(opened):
    source = opened(trigger='Line0', fps=0.0)
    assert source._call('get_string', b'TriggerMode') == b'On'
    assert source._call('get_string', b'TriggerSource') == b'Line0'
    assert source.notes[0] == 'triggered by Line0'

    source.close()
    source = opened()  # and taken away again
    assert source._call('get_string', b'TriggerMode') == b'Off'


@pytest.mark.parametrize(
    ('more', 'words'),
    [
        ({'trigger': 'Line7'}, 'has no trigger Line7'),
        ({'width': 4096}, 'gives .* images, the scene says 4096x200'),
        ({'format': 'MJPG'}, 'gives no MJPG: set camera.format'),
    ],
)
def test_what_cannot_be_is_one_line(plugged, more, words):
    plugged()
    source = camera(**more)
    with pytest.raises(ConfigError, match=words) as caught:
        source.open()
    source.close()

    assert '\n' not in str(caught.value)


def test_another_format_is_refused(plugged):
    plugged(describe=lambda text: text.replace('17301505', '17301513').replace('Mono8', 'BayerGR8'))
    source = camera()
    with pytest.raises(ConfigError, match='a monochrome camera is needed'):
        source.open()
    source.close()


def test_its_clock_is_carried_over_within_the_error_that_is_told(plugged, opened):
    """A clock with an origin of its own and 200 ppm fast, asked over the wire."""
    gige = plugged(clock=lambda ns: 10**15 + ns * 10002 // 10000, latch=True)
    source = opened(exposure_us=4000)
    assert 'stamps of its own clock, known to' in source.notes[0]
    found = [source.read() for _ in range(70)]

    # The register is written by a thread: what it holds may be as old as its longest pause.
    ticks = np.array([at for at, _ in gige.latched])
    stale_ns = int(np.diff(ticks).max()) + 1_000_000
    for picture in found:
        begun_ns, exposure_ns = gige.exposed[number_of(picture.image)]
        late_ns = picture.monotonic_ns - (begun_ns + exposure_ns // 2)
        assert exposure_ns == 4_000_000
        assert -source.stamp_error_s * 1e9 <= late_ns <= stale_ns + source.stamp_error_s * 1e9
    assert source.odd_stamps == 0
    assert source.values['stamp_error_us'] < 5000


def test_without_a_clock_to_ask_images_are_late_by_their_delay_and_it_says_so(plugged, opened):
    gige = plugged(clock=lambda ns: 10**15 + ns, readout_ns=6_000_000)
    source = opened(exposure_us=1000)
    found = [source.read() for _ in range(60)]

    assert 'may be late by one and the same time, at most 10 ms' in source.notes[0]
    late_ns = [p.monotonic_ns - sum(gige.exposed[number_of(p.image)]) + 500_000 for p in found[30:]]
    assert min(late_ns) >= 6_000_000  # never earlier than they are
    assert source.values['odd_stamps'] == 0
    assert source.values['stamp_error_us'] >= 10_000


def test_images_with_holes_are_counted_and_kept_back(plugged, opened):
    plugged(lost=0.005)
    source = opened()
    images = [source.read().image for _ in range(40)]
    counts = source.values

    assert all((i.ravel()[4:] == GREY).all() for i in images)
    assert counts['incomplete'] + counts['lost_images'] > 0
    assert counts['lost_packets'] > 0


def test_a_camera_that_hangs_or_ends_is_lost_and_found_again(tmp_path, monkeypatch):
    """As `eol bench soak` pulls it out: its process is stopped, then killed."""
    monkeypatch.setattr(genicam, 'PATIENCE_S', 0.2)
    film = tmp_path / 'film.avi'
    out = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*'MJPG'), 30, (W, H), isColor=False)
    out.write(np.full((H, W), 77, np.uint8))
    out.release()

    def plug():
        one = subprocess.Popen(
            [sys.executable, simulated.__file__, str(film)], stdout=subprocess.PIPE, text=True
        )
        assert one.stdout.readline() == 'ready\n'
        return one

    states, images = [], []
    with own_network():
        gige = plug()
        source = Camera(
            camera(fps=30.0), lambda *a: images.append(a[1]), states.append,
            backoff=Backoff(0.05, 0.1),
        )  # fmt: skip
        source.start()
        try:
            for number in (signal.SIGSTOP, signal.SIGKILL):
                wait_until(lambda: len(images) > 5)
                gige.send_signal(number)
                wait_until(lambda: states[-1].kind == 'lost')
                if number == signal.SIGSTOP:
                    gige.send_signal(signal.SIGCONT)
                else:
                    gige.communicate()
                    gige = plug()
                images.clear()
            wait_until(lambda: len(images) > 5)
        finally:
            source.close()
            gige.kill()
            gige.communicate()
    assert source.opened >= 3  # more where a busy machine keeps an image for PATIENCE_S
    assert np.abs(images[-1].astype(int) - 77).max() < 4


@pytest.mark.soak  # the simulated camera leaves a stranger without an answer: seconds
def test_two_programs_do_not_share_one(plugged):
    plugged()
    first = camera()
    first.open()
    second = camera()
    with pytest.raises(DeviceMissing, match='is used by another program'):
        second.open()
    second.close()
    first.close()


# On every machine


def test_an_address_is_not_looked_for(monkeypatch):
    monkeypatch.setattr(aravis, 'list_cameras', list)
    assert genicam.find_camera('genicam:192.168.7.1') == '192.168.7.1'
    with pytest.raises(DeviceMissing, match='no GenICam camera found: plug it in'):
        genicam.find_camera('genicam:auto')


def test_without_aravis_the_package_is_named(monkeypatch):
    monkeypatch.setattr(aravis, 'LIBRARY', 'libaravis-of-nobody.so')
    aravis.load.cache_clear()
    with pytest.raises(DeviceMissing) as caught:
        source_of(settings())

    assert caught.value.exit_code == 69
    assert str(caught.value) == (
        'GenICam cameras need Aravis, and libaravis-of-nobody.so is not found: '
        'apt-get install libaravis-0.8-0'
    )

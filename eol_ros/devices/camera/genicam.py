# SPDX-License-Identifier: Apache-2.0
"""An industrial camera (GigE Vision, USB3 Vision) through Aravis: every setting is read back."""

import contextlib
import ctypes
import ipaddress
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from eol_ros.core.camera_clock import CameraClock
from eol_ros.devices import ports
from eol_ros.devices.camera import aravis
from eol_ros.devices.camera.aravis import AravisError, Handle
from eol_ros.devices.camera.picture import CLOCK_TRUST_S, Device, Picture, SourceLost
from eol_ros.devices.camera.ports import GENICAM
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.settings import CameraSettings

BUFFERS = 8
PATIENCE_S = 1.0  # without an image, and two image times more: then the camera is looked after
ASK_CLOCK_S = 0.5
FIRST_PINGS = 8
NS = 1_000_000_000
# Names of the same thing in the standard naming convention (SFNC), the newer ones first
RATES = ('ResultingFrameRate', 'AcquisitionResultingFrameRate', 'ResultingFrameRateAbs')
CLOCKS = (
    ('TimestampLatch', 'TimestampLatchValue'),
    ('GevTimestampControlLatch', 'GevTimestampValue'),
)
WRAP_IDS = 65535  # image numbers of GigE Vision 1 are 1 to 65535


def find_camera(wanted: str) -> str:
    """Return the id of the camera that `genicam:`WANTED names; raises DeviceMissing."""
    name = wanted.removeprefix(GENICAM) or 'auto'
    with contextlib.suppress(ValueError):
        return str(ipaddress.ip_address(name))  # also where no broadcast reaches it
    return ports.find('GenICam camera', name, aravis.list_cameras()).removeprefix(GENICAM)


def arrival_ns(came_ns: int) -> int:
    """Return when an image came, monotonic ns; `came_ns`: by the system clock, 0 where unknown."""
    system_ns = time.time_ns()
    now_ns = time.monotonic_ns()  # read last: a pause between the two makes it late, never early
    return min(now_ns, now_ns - (system_ns - came_ns)) if came_ns else now_ns


class GenicamCamera(Device):
    """A camera of 8-bit grey images; stamps of its clock are converted to the host's clock.

    `find` returns the id for a name in the scene. DeviceMissing if Aravis is not installed.
    """

    def __init__(self, settings: CameraSettings):
        super().__init__(settings)
        self.incomplete = self.lost_images = 0
        self.lost_packets = 0  # of this opening
        self.stamp_error_s = 0.0  # of the last image
        self.find: Callable[[str], str] = find_camera
        self._arv = aravis.load()
        self._camera: Any = None
        self._stream: Any = None
        self._gone = False

    @property
    def values(self) -> dict[str, Any]:
        """Return what /diagnostics tells of the camera."""
        return super().values | {
            'incomplete': self.incomplete,
            'lost_images': self.lost_images,
            'lost_packets': self.lost_packets,
            'stamp_error_us': round(self.stamp_error_s * 1e6, 1),
        }

    def open(self) -> None:
        """Open the camera, set everything, read back what it took, and start it."""
        self.close()
        self.notes, self.lost_packets = [], 0
        name = self.find(self._settings.device)
        self.name = f'{GENICAM}{name}'
        self._gone = True  # what does not open may not answer
        try:
            self._camera = self._arv.call('camera_new', name.encode())
            self._device = self._arv.call('camera_get_device', self._camera)
            self._is_gige = bool(self._arv.call('camera_is_gv_device', self._camera))
            if self._is_gige and not self._arv.call('gv_device_is_controller', self._device):
                raise DeviceMissing(f'camera {name} is used by another program')
            # As the vendors' own programs do; some cameras take what their description forbids.
            self._call('set_range_check_policy', aravis.CHECKED)
            self._call('set_access_check_policy', aravis.CHECKED)
            self._set_format()
            self._set_trigger()
            self._set_exposure()
            self._set_gain()
            self._set_rate()
            self._start()
            self._gone = False
        except AravisError as error:
            raise DeviceMissing(f'camera {name} does not open: {error}') from None

    def _has(self, feature: str) -> bool:
        return bool(self._call('is_feature_available', feature.encode()))

    def _call(self, name: str, *args: Any) -> Any:
        return self._arv.call(f'camera_{name}', self._camera, *args)

    def _set_format(self) -> None:
        s, name = self._settings, self.name
        if s.format == 'MJPG':
            raise ConfigError(f'camera {name} gives no MJPG: set camera.format to auto or GREY')
        with contextlib.suppress(AravisError):
            self._call('set_pixel_format_from_string', b'Mono8')
        found = (self._call('get_pixel_format_as_string') or b'other').decode()
        if found != 'Mono8':
            raise ConfigError(
                f'camera {name} gives {found} images, not Mono8: a monochrome camera is needed'
            )
        sensor = self._arv.counts('camera_get_sensor_size', self._camera)
        x = y = 0
        if self._call('is_region_offset_available'):
            # The middle of the sensor, the same pixels each time: the calibration is of these.
            steps = [
                max(self._call(f'get_{axis}_offset_increment'), 1) for axis in ('x', 'y')
            ]  # fmt: skip
            x, y = (
                max(whole - part, 0) // 2 // step * step
                for whole, part, step in zip(sensor, (s.width, s.height), steps, strict=True)
            )
        with contextlib.suppress(AravisError):
            self._call('set_region', x, y, s.width, s.height)
        *_, width, height = self._arv.counts('camera_get_region', self._camera, n=4)
        if (width, height) != (s.width, s.height):
            raise ConfigError(
                f'camera {name} gives {width}x{height} images, the scene says '
                f'{s.width}x{s.height}: set camera.width and camera.height to a size it has '
                f'(its sensor is {sensor[0]}x{sensor[1]})'
            )

    def _set_trigger(self) -> None:
        wanted = self._settings.trigger
        self._call('set_string', b'AcquisitionMode', b'Continuous')
        if not wanted:
            self._call('clear_triggers')
            if self._has('TriggerMode') and self._mode() != 'Off':
                self.notes.append('the camera keeps its trigger on: expect no images without it')
            return
        try:
            self._call('set_trigger', wanted.encode())
            taken = self._call('get_trigger_source').decode()
            on = self._mode() == 'On'
        except AravisError as error:
            raise ConfigError(
                f'camera {self.name} has no trigger {wanted} ({error}): camera.trigger names one '
                f'of its inputs, or is empty'
            ) from None
        if taken != wanted or not on:
            raise ConfigError(
                f'camera {self.name} takes its trigger from {taken if on else "nothing"}, not '
                f'from {wanted}: set camera.trigger to an input that it has'
            )
        self.notes.append(f'triggered by {taken}')

    def _mode(self) -> str:
        return self._call('get_string', b'TriggerMode').decode()

    def _set(self, what: str, unit: str, asked: float) -> float:
        """Set a number; return what the camera has then, and note where that is another."""
        refused = ''
        try:
            self._call(f'set_{what}', asked)
        except AravisError as error:
            refused = f'it refuses ({error})'
        word = what.replace('_time', '').replace('_', ' ')
        try:
            taken = float(self._call(f'get_{what}'))
        except AravisError as error:
            self.notes.append(f'{word} cannot be verified: {refused or error}')
            return asked
        if refused or abs(taken - asked) > 1e-3 * abs(asked) + 1e-9:
            self.notes.append(
                f'{word} {taken:g}{unit}, not the {asked:g} asked for{refused and ": " + refused}'
            )
        return taken

    def _set_exposure(self) -> None:
        if self._call('is_exposure_auto_available'):
            self._call('set_exposure_time_auto', 0)
        self.exposure_us = self._set('exposure_time', ' us', float(self._settings.exposure_us))

    def _set_gain(self) -> None:
        if self._settings.gain < 0:
            return
        if self._call('is_gain_auto_available'):
            self._call('set_gain_auto', 0)
        self._set('gain', '', self._settings.gain)

    def _set_rate(self) -> None:
        s = self._settings
        if s.trigger:
            return
        if s.fps and self._call('is_frame_rate_available'):
            self.fps = self._set('frame_rate', ' images/s', s.fps)
        elif not s.fps:
            self.fps = float(self._call('get_frame_rate')) or self.fps
        for name in RATES:
            if self._has(name):
                possible = float(self._call('get_float', name.encode()))
                if 0 < possible < 0.98 * self.fps:
                    self.notes.append(f'{possible:.4g} images/s, as much as exposure and line let')
                    self.fps = possible
                break

    def _start(self) -> None:
        payload = self._call('get_payload')
        self._stream = self._call('create_stream', None, None)
        if not self._stream:
            raise DeviceMissing(f'camera {self.name} opens no stream')
        for _ in range(BUFFERS):
            self._push(self._arv.call('buffer_new_allocate', payload))
        self._last_ns, self._last_id = 0, None
        self._open_clock()
        self._call('start_acquisition')

    def _push(self, buffer: Handle) -> None:
        self._arv.call('stream_push_buffer', self._stream, buffer)

    # Its clock

    def _open_clock(self) -> None:
        self._clock = CameraClock(1 / self.fps)
        self._latch = next((n for n in CLOCKS if all(map(self._has, n))), None)
        self._tick_hz = NS
        if self._is_gige:
            self._tick_hz = self._arv.call(
                'gv_device_get_timestamp_tick_frequency', self._device
            ) or NS  # fmt: skip
        for _ in range(FIRST_PINGS if self._latch else 0):
            self._ask_clock()
        if self._latch:
            error_us = self._clock.to_host(self._latched_ns).sigma_s * 1e6
            self.notes.append(f'stamps of its own clock, known to {error_us:.0f} us')
        else:
            self.notes.append(
                f'its clock cannot be read: stamps may be late by one and the same time, at most '
                f'{1e3 / self.fps:.3g} ms'
            )

    def _ask_clock(self) -> None:
        latch, value = self._latch or CLOCKS[0]
        sent_ns = time.monotonic_ns()
        self._call('execute_command', latch.encode())
        received_ns = time.monotonic_ns()
        ticks = self._call('get_integer', value.encode())
        self._latched_ns = ticks * NS // self._tick_hz
        self._clock.exchange(sent_ns / NS, self._latched_ns, received_ns / NS)
        self._asked_ns = received_ns

    # Its images

    def read(self) -> Picture | None:
        """Return the next image; None where a trigger keeps it waiting; SourceLost without one."""
        if self._latch and time.monotonic_ns() - self._asked_ns > ASK_CLOCK_S * NS:
            try:
                self._ask_clock()
            except AravisError as error:
                self._lose(str(error))
        deadline_ns = time.monotonic_ns() + round((PATIENCE_S + 2 / self.fps) * NS)
        while (left_ns := deadline_ns - time.monotonic_ns()) > 0:
            buffer = self._arv.call('stream_timeout_pop_buffer', self._stream, left_ns // 1000)
            if not buffer:
                break
            try:
                picture = self._picture(buffer)
            finally:
                self._push(buffer)
            if picture is not None:
                return picture
        if not self._settings.trigger:
            self._lose('it gives no more images')
        try:
            self._call('get_payload')
        except AravisError as error:
            self._lose(str(error))
        return None

    def _lose(self, why: str) -> None:
        self._gone = True
        raise SourceLost(f'camera {self.name}: {why}')

    def _picture(self, buffer: Handle) -> Picture | None:
        """Return the image of a buffer and its stamp; None of one that has holes."""
        arv = self._arv
        arrived_ns = arrival_ns(arv.call('buffer_get_system_timestamp', buffer))
        number = arv.call('buffer_get_frame_id', buffer)
        if self._is_gige:
            counts = arv.counts('gv_stream_get_statistics', self._stream, kind=ctypes.c_uint64)
            self.lost_packets = counts[1]
        if arv.call('buffer_get_status', buffer) != aravis.SUCCESS:
            self.incomplete += 1
            return None
        if self._last_id is not None:
            gap = number - self._last_id
            self.lost_images += (gap if gap >= 0 else gap + WRAP_IDS) - 1 if gap else 0
        self._last_id = number
        size = ctypes.c_size_t()
        data = arv.call('buffer_get_data', buffer, ctypes.byref(size))
        s = self._settings
        if size.value < s.width * s.height:
            raise ConfigError(
                f'camera {self.name} gives images of {size.value} bytes where '
                f'{s.width}x{s.height} grey is meant'
            )
        image = np.frombuffer(
            ctypes.string_at(data, s.width * s.height), np.uint8
        ).reshape(s.height, s.width)  # fmt: skip
        return Picture(self._stamp_ns(arv.call('buffer_get_timestamp', buffer), arrived_ns), image)

    def _stamp_ns(self, device_ns: int, arrived_ns: int) -> int:
        """Return the middle of the exposure, in the host's monotonic time."""
        exposure_ns = int(self.exposure_us * 1000)
        late_ns = exposure_ns if self._settings.stamped_at == 'start' else 0
        stamp_ns = arrived_ns - late_ns  # at the earliest, an image arrives when it is exposed
        if device_ns:
            self._clock.arrival(device_ns, stamp_ns / NS)
        believed = False
        if device_ns and self._clock.ready:
            found = self._clock.to_host(device_ns)
            own_ns = round(found.time_s * NS)
            error_ns = found.sigma_s * NS
            believed = (
                self._last_ns < own_ns <= stamp_ns + error_ns + NS // 1000
                and arrived_ns - own_ns < CLOCK_TRUST_S * NS
            )
            if believed:
                stamp_ns = self._last_ns = own_ns
                self.stamp_error_s = found.sigma_s
        if not believed:
            self.odd_stamps += 1
            self.stamp_error_s = 1 / self.fps
        return stamp_ns + late_ns - exposure_ns // 2

    def close(self) -> None:
        """Stop and give up the camera."""
        handles = self._stream, self._camera
        if all(handles) and not self._gone:
            with contextlib.suppress(AravisError):
                self._call('stop_acquisition')
        self._camera = self._stream = None

        def give_up() -> None:
            for handle in handles:
                self._arv.release(handle)

        if self._gone:  # saying good-bye to a camera that does not hear it takes 10 s
            threading.Thread(target=give_up, name='genicam-give-up', daemon=True).start()
        else:
            give_up()

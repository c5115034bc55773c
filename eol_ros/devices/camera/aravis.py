# SPDX-License-Identifier: Apache-2.0
"""libaravis by ctypes: GigE Vision and USB3 Vision cameras, as far as this project asks them.

Aravis (LGPL) is a system library; nothing of it is loaded before `load` is called.
"""

import ctypes
import threading
from collections.abc import Callable
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_uint64, c_void_p
from typing import Any

from eol_ros.devices.camera.ports import GENICAM
from eol_ros.devices.ports import Port
from eol_ros.errors import DeviceMissing, EolError

LIBRARY, PACKAGE = 'libaravis-0.8.so.0', 'libaravis-0.8-0'
PROTOCOLS = ('GigEVision', 'USB3Vision')
SUCCESS = 0  # ARV_BUFFER_STATUS_SUCCESS
CHECKED = 1  # of ArvRangeCheckPolicy and ArvAccessCheckPolicy

# What each function returns and takes; the GError ** that ends the list of most is passed by `call`
_INT, _TEXT, _POINTER = c_int, c_char_p, c_void_p
_PLAIN: dict[str, tuple[Any, list[Any]]] = {
    'arv_update_device_list': (None, []),
    'arv_get_n_devices': (c_uint, []),
    'arv_get_device_id': (_TEXT, [c_uint]),
    'arv_get_device_address': (_TEXT, [c_uint]),
    'arv_get_device_vendor': (_TEXT, [c_uint]),
    'arv_get_device_model': (_TEXT, [c_uint]),
    'arv_get_device_serial_nbr': (_TEXT, [c_uint]),
    'arv_get_device_protocol': (_TEXT, [c_uint]),
    'arv_camera_get_device': (_POINTER, [_POINTER]),
    'arv_camera_is_gv_device': (_INT, [_POINTER]),
    'arv_camera_set_range_check_policy': (None, [_POINTER, _INT]),
    'arv_camera_set_access_check_policy': (None, [_POINTER, _INT]),
    'arv_gv_device_is_controller': (_INT, [_POINTER]),
    'arv_buffer_new_allocate': (_POINTER, [c_size_t]),
    'arv_stream_push_buffer': (None, [_POINTER, _POINTER]),
    'arv_stream_timeout_pop_buffer': (_POINTER, [_POINTER, c_uint64]),
    'arv_stream_get_statistics': (None, [_POINTER, *[POINTER(c_uint64)] * 3]),
    'arv_gv_stream_get_statistics': (None, [_POINTER, *[POINTER(c_uint64)] * 2]),
    'arv_buffer_get_status': (_INT, [_POINTER]),
    'arv_buffer_get_data': (_POINTER, [_POINTER, POINTER(c_size_t)]),
    'arv_buffer_get_timestamp': (c_uint64, [_POINTER]),
    'arv_buffer_get_system_timestamp': (c_uint64, [_POINTER]),
    'arv_buffer_get_frame_id': (c_uint64, [_POINTER]),
}
_CHECKED: dict[str, tuple[Any, list[Any]]] = {
    'arv_camera_new': (_POINTER, [_TEXT]),
    'arv_camera_get_payload': (c_uint, [_POINTER]),
    'arv_camera_create_stream': (_POINTER, [_POINTER, _POINTER, _POINTER]),
    'arv_camera_start_acquisition': (None, [_POINTER]),
    'arv_camera_stop_acquisition': (None, [_POINTER]),
    'arv_camera_execute_command': (None, [_POINTER, _TEXT]),
    'arv_camera_is_feature_available': (_INT, [_POINTER, _TEXT]),
    'arv_camera_get_integer': (ctypes.c_int64, [_POINTER, _TEXT]),
    'arv_camera_get_float': (c_double, [_POINTER, _TEXT]),
    'arv_camera_get_string': (_TEXT, [_POINTER, _TEXT]),
    'arv_camera_set_string': (None, [_POINTER, _TEXT, _TEXT]),
    'arv_camera_get_sensor_size': (None, [_POINTER, POINTER(_INT), POINTER(_INT)]),
    'arv_camera_set_region': (None, [_POINTER, _INT, _INT, _INT, _INT]),
    'arv_camera_get_region': (None, [_POINTER, *[POINTER(_INT)] * 4]),
    'arv_camera_is_region_offset_available': (_INT, [_POINTER]),
    'arv_camera_get_x_offset_increment': (_INT, [_POINTER]),
    'arv_camera_get_y_offset_increment': (_INT, [_POINTER]),
    'arv_camera_set_pixel_format_from_string': (None, [_POINTER, _TEXT]),
    'arv_camera_get_pixel_format_as_string': (_TEXT, [_POINTER]),
    'arv_camera_is_exposure_auto_available': (_INT, [_POINTER]),
    'arv_camera_set_exposure_time_auto': (None, [_POINTER, _INT]),
    'arv_camera_set_exposure_time': (None, [_POINTER, c_double]),
    'arv_camera_get_exposure_time': (c_double, [_POINTER]),
    'arv_camera_is_gain_auto_available': (_INT, [_POINTER]),
    'arv_camera_set_gain_auto': (None, [_POINTER, _INT]),
    'arv_camera_set_gain': (None, [_POINTER, c_double]),
    'arv_camera_get_gain': (c_double, [_POINTER]),
    'arv_camera_is_frame_rate_available': (_INT, [_POINTER]),
    'arv_camera_set_frame_rate': (None, [_POINTER, c_double]),
    'arv_camera_get_frame_rate': (c_double, [_POINTER]),
    'arv_camera_clear_triggers': (None, [_POINTER]),
    'arv_camera_set_trigger': (None, [_POINTER, _TEXT]),
    'arv_camera_get_trigger_source': (_TEXT, [_POINTER]),
    'arv_gv_device_get_timestamp_tick_frequency': (c_uint64, [_POINTER]),
}


class AravisError(EolError):
    """What the library says of a call that failed."""


class _GError(ctypes.Structure):
    _fields_ = (('domain', ctypes.c_uint32), ('code', c_int), ('message', c_char_p))


class Aravis:
    """The library, its functions declared; `call` turns a GError into an AravisError.

    library, gobject: libaravis and the GObject it is linked against, as ctypes loaded them.
    """

    def __init__(self) -> None:
        self.library = ctypes.CDLL(LIBRARY)
        # Both are in the process already: libaravis is linked against them.
        self._glib = ctypes.CDLL('libglib-2.0.so.0')
        self.gobject = ctypes.CDLL('libgobject-2.0.so.0')
        self._glib.g_error_free.argtypes = [c_void_p]
        self.gobject.g_object_unref.argtypes = [c_void_p]
        for name, (returns, takes) in _PLAIN.items():
            function = getattr(self.library, name)
            function.restype, function.argtypes = returns, takes
        for name, (returns, takes) in _CHECKED.items():
            function = getattr(self.library, name)
            function.restype, function.argtypes = returns, [*takes, POINTER(POINTER(_GError))]

    def call(self, name: str, *args: Any) -> Any:
        """Return what `arv_`NAME(*args) returns; AravisError where it reports an error."""
        name = f'arv_{name}'
        function = getattr(self.library, name)
        if name in _PLAIN:
            return function(*args)
        error = POINTER(_GError)()
        value = function(*args, byref(error))
        if error:
            text = error.contents.message.decode(errors='replace')
            self._glib.g_error_free(error)
            raise AravisError(' '.join(text.split()))
        return value

    def counts(self, name: str, *args: Any, kind: Any = c_int, n: int = 2) -> list[int]:
        """Return the `n` values that a function writes through its last pointers."""
        values = [kind() for _ in range(n)]
        self.call(name, *args, *map(byref, values))
        return [int(v.value) for v in values]

    def release(self, handle: int | None) -> None:
        """Give up one reference to an object."""
        if handle:
            self.gobject.g_object_unref(handle)


_loaded: list[Aravis] = []
_lock = threading.Lock()


def load() -> Aravis:
    """Return the library, loaded once; DeviceMissing names the package where it is absent."""
    with _lock:
        if not _loaded:
            try:
                _loaded.append(Aravis())
            except OSError:
                raise DeviceMissing(
                    f'GenICam cameras need Aravis, and {LIBRARY} is not here: '
                    f'apt-get install {PACKAGE}'
                ) from None
        return _loaded[0]


def list_cameras(library: Callable[[], Aravis] = load) -> list[Port]:
    """Return the GenICam cameras that answer within a second, named as a scene names them."""
    arv = library()
    with _lock:
        arv.call('update_device_list')

        def text(what: str, k: int) -> str:
            return (arv.call(f'get_device_{what}', k) or b'').decode(errors='replace')

        return [
            Port(
                GENICAM + text('id', k),
                text('id', k),
                f'{text("vendor", k)} {text("model", k)} {text("serial_nbr", k)}'
                f' at {text("address", k)}, {text("protocol", k)}',
            )
            for k in range(arv.call('get_n_devices'))
            if text('protocol', k) in PROTOCOLS
        ]

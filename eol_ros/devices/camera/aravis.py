# SPDX-License-Identifier: Apache-2.0
"""libaravis by ctypes: GigE Vision and USB3 Vision cameras, as far as this project asks them.

Aravis (LGPL) is a system library; nothing of it is loaded before `load` is called.
"""

import ctypes
import functools
import threading
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_int64, c_void_p
from typing import Any

from eol_ros.devices.camera.ports import GENICAM
from eol_ros.devices.ports import Port
from eol_ros.errors import DeviceMissing, EolError

LIBRARY, PACKAGE = 'libaravis-0.8.so.0', 'libaravis-0.8-0'
PROTOCOLS = ('GigEVision', 'USB3Vision')
SUCCESS = 0  # ARV_BUFFER_STATUS_SUCCESS
CHECKED = 1  # of ArvRangeCheckPolicy and ArvAccessCheckPolicy


class Handle(c_void_p):
    """A pointer of the library; ctypes would truncate it to an int of 32 bits."""


# Return types of the functions that return no int
_RETURNS: dict[Any, tuple[str, ...]] = {
    Handle: (
        'camera_new', 'camera_get_device', 'camera_create_stream', 'buffer_new_allocate',
        'stream_timeout_pop_buffer', 'buffer_get_data',
    ),
    c_char_p: (
        'get_device_id', 'get_device_address', 'get_device_vendor', 'get_device_model',
        'get_device_serial_nbr', 'get_device_protocol', 'camera_get_string',
        'camera_get_pixel_format_as_string', 'camera_get_trigger_source',
    ),
    c_double: (
        'camera_get_float', 'camera_get_exposure_time', 'camera_get_gain',
        'camera_get_frame_rate',
    ),
    c_int64: (
        'camera_get_integer', 'buffer_get_timestamp', 'buffer_get_system_timestamp',
        'buffer_get_frame_id', 'gv_device_get_timestamp_tick_frequency',
    ),
}  # fmt: skip
# Functions of a camera have a last argument GError **, except these; of the others only one does.
_NO_ERROR = (
    'camera_get_device', 'camera_is_gv_device', 'camera_set_range_check_policy',
    'camera_set_access_check_policy',
)  # fmt: skip


def _has_error(name: str) -> bool:
    of_camera = name.startswith('camera_') and name not in _NO_ERROR
    return of_camera or name == 'gv_device_get_timestamp_tick_frequency'


class AravisError(EolError):
    """What the library says of a call that failed."""


class _GError(ctypes.Structure):
    _fields_ = (('domain', ctypes.c_uint32), ('code', c_int), ('message', c_char_p))


class Aravis:
    """The library; `call` turns a GError into an AravisError.

    library, gobject: libaravis and the GObject it is linked against, as ctypes loaded them.
    """

    def __init__(self) -> None:
        self.library = ctypes.CDLL(LIBRARY)
        # Both are in the process already: libaravis is linked against them.
        self._glib = ctypes.CDLL('libglib-2.0.so.0')
        self.gobject = ctypes.CDLL('libgobject-2.0.so.0')
        self._glib.g_error_free.argtypes = [c_void_p]
        self.gobject.g_object_unref.argtypes = [c_void_p]
        for returns, names in _RETURNS.items():
            for name in names:
                getattr(self.library, f'arv_{name}').restype = returns

    def call(self, name: str, *args: Any) -> Any:
        """Return what `arv_`NAME(*args) returns; AravisError where it reports an error.

        args: handles, bytes, ints of 32 bits, floats, and None for NULL.
        """
        function = getattr(self.library, f'arv_{name}')
        given = [c_double(arg) if isinstance(arg, float) else arg for arg in args]
        if not _has_error(name):
            return function(*given)
        error = POINTER(_GError)()
        value = function(*given, byref(error))
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

    def release(self, handle: Handle | None) -> None:
        """Give up one reference to an object."""
        if handle:
            self.gobject.g_object_unref(handle)


_lock = threading.Lock()  # guards the list of devices


@functools.cache
def load() -> Aravis:
    """Return the library; DeviceMissing names the package where it is absent."""
    try:
        return Aravis()
    except OSError:
        raise DeviceMissing(
            f'GenICam cameras need Aravis, and {LIBRARY} is not found: apt-get install {PACKAGE}'
        ) from None


def list_cameras() -> list[Port]:
    """Return the GenICam cameras that answer within a second, named as a scene names them."""
    arv = load()
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

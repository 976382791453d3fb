"""numpy columns as an Arrow stream, by the C data interface and the PyCapsule interface.

https://arrow.apache.org/docs/format/CDataInterface.html. The structures are built with `ctypes` from the standard
library. Numbers are shared without a copy, texts are copied to a contiguous buffer. The stream has one record batch,
with columns without nulls.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import CFUNCTYPE, POINTER, byref, c_char_p, c_int, c_int64, c_void_p, pointer
from typing import Any

import numpy as np
import numpy.typing as npt


class _Schema(ctypes.Structure):
    pass


class _Array(ctypes.Structure):
    pass


class _Stream(ctypes.Structure):
    pass


_ReleaseSchema = CFUNCTYPE(None, POINTER(_Schema))
_ReleaseArray = CFUNCTYPE(None, POINTER(_Array))
_ReleaseStream = CFUNCTYPE(None, POINTER(_Stream))

_Schema._fields_ = [
    ("format", c_char_p),
    ("name", c_char_p),
    ("metadata", c_char_p),
    ("flags", c_int64),
    ("n_children", c_int64),
    ("children", POINTER(POINTER(_Schema))),
    ("dictionary", c_void_p),
    ("release", _ReleaseSchema),
    ("private_data", c_void_p),
]
_Array._fields_ = [
    ("length", c_int64),
    ("null_count", c_int64),
    ("offset", c_int64),
    ("n_buffers", c_int64),
    ("n_children", c_int64),
    ("buffers", POINTER(c_void_p)),
    ("children", POINTER(POINTER(_Array))),
    ("dictionary", c_void_p),
    ("release", _ReleaseArray),
    ("private_data", c_void_p),
]
_GetSchema = CFUNCTYPE(c_int, POINTER(_Stream), POINTER(_Schema))
_GetNext = CFUNCTYPE(c_int, POINTER(_Stream), POINTER(_Array))
_LastError = CFUNCTYPE(c_void_p, POINTER(_Stream))
_Stream._fields_ = [
    ("get_schema", _GetSchema),
    ("get_next", _GetNext),
    ("get_last_error", _LastError),
    ("release", _ReleaseStream),
    ("private_data", c_void_p),
]

#: Objects that consumers still hold, by a number that the structure carries: shared memory must stay alive.
_lent: dict[int, Any] = {}
_next = iter(range(1, 2**63))


def _lend(things: Any) -> int:
    number = next(_next)
    _lent[number] = things
    return number


def _releasing(kind: Any) -> Any:
    """Returns the function that releases a structure of this kind.

    A consumer may call it at interpreter exit, when the names of this module are gone. So it carries its dependencies,
    and is never freed.
    """

    def release(
        structure: Any,
        lent: Any = _lent,
        clear: Any = ctypes.memset,
        reference: Any = byref,
        size: int = ctypes.sizeof(c_void_p),
    ) -> None:
        own = structure.contents
        # Children that the consumer has not moved out.
        for place in range(getattr(own, "n_children", 0)):
            child = own.children[place]
            if child and child.contents.release:
                child.contents.release(child)
        number = own.private_data
        clear(reference(own, type(own).release.offset), 0, size)
        lent.pop(number, None)

    function = kind(release)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(function))
    return function


_release_schema = _releasing(_ReleaseSchema)
_release_array = _releasing(_ReleaseArray)
_release_stream = _releasing(_ReleaseStream)


class _Column:
    """A column in Arrow's format: its format string and its buffers, the first of which would hold nulls."""

    def __init__(self, name: str, values: npt.NDArray[Any]) -> None:
        self.name = name.encode()
        self.rows = len(values)
        if values.dtype.kind == "U":
            self.format = b"U"
            self.buffers = _texts(values)
        else:
            self.format = b"g"
            self.buffers = [np.ascontiguousarray(values, dtype=np.float64)]

    def fill_schema(self, schema: _Schema) -> None:
        schema.format, schema.name = self.format, self.name
        schema.release, schema.private_data = _release_schema, _lend((self.format, self.name))

    def fill_array(self, array: _Array) -> None:
        places = [None, *(buffer.ctypes.data for buffer in self.buffers)]
        buffers = (c_void_p * len(places))(*places)
        array.length, array.n_buffers = self.rows, len(places)
        array.buffers = ctypes.cast(buffers, POINTER(c_void_p))
        array.release, array.private_data = _release_array, _lend((self.buffers, buffers))


def _texts(values: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
    """Returns the offsets of the texts, and all texts in UTF-8, one after the other."""
    names, places = np.unique(values, return_inverse=True)
    encoded = [str(name).encode() for name in names]
    lengths = np.asarray([len(text) for text in encoded], dtype=np.int64)
    places = places.reshape(-1)
    starts = np.zeros(len(values) + 1, dtype=np.int64)
    if len(values):
        np.cumsum(lengths[places], out=starts[1:])
    data = b"".join([encoded[place] for place in places.tolist()])
    return [starts, np.frombuffer(data or b"\0", dtype=np.uint8)]


def _struct_schema(schema: _Schema, columns: list[_Column]) -> None:
    children = [_Schema() for _ in columns]
    for child, column in zip(children, columns):
        column.fill_schema(child)
    pointers = (POINTER(_Schema) * len(children))(*map(pointer, children))
    schema.format, schema.name, schema.n_children = b"+s", b"", len(children)
    schema.children = ctypes.cast(pointers, POINTER(POINTER(_Schema)))
    schema.release, schema.private_data = _release_schema, _lend((children, pointers))


def _struct_array(array: _Array, columns: list[_Column]) -> None:
    children = [_Array() for _ in columns]
    for child, column in zip(children, columns):
        column.fill_array(child)
    pointers = (POINTER(_Array) * len(children))(*map(pointer, children))
    buffers = (c_void_p * 1)(None)
    array.length = max((column.rows for column in columns), default=0)
    array.n_buffers, array.n_children = 1, len(children)
    array.buffers = ctypes.cast(buffers, POINTER(c_void_p))
    array.children = ctypes.cast(pointers, POINTER(POINTER(_Array)))
    array.release, array.private_data = _release_array, _lend((children, pointers, buffers))


def stream(columns: Mapping[str, npt.NDArray[Any]]) -> Any:
    """Returns the capsule of a stream of these columns."""
    own = [_Column(name, values) for name, values in columns.items()]
    is_done = False

    def get_schema(_: Any, schema: Any) -> int:
        ctypes.memset(schema, 0, ctypes.sizeof(_Schema))
        _struct_schema(schema.contents, own)
        return 0

    def get_next(_: Any, array: Any) -> int:
        nonlocal is_done
        # A structure without a release function ends the stream.
        ctypes.memset(array, 0, ctypes.sizeof(_Array))
        if not is_done:
            _struct_array(array.contents, own)
            is_done = True
        return 0

    def get_last_error(_: Any) -> None:
        return None

    made = _Stream()
    made.get_schema, made.get_next = _GetSchema(get_schema), _GetNext(get_next)
    made.get_last_error = _LastError(get_last_error)
    made.release = _release_stream
    made.private_data = _lend((made.get_schema, made.get_next, made.get_last_error))
    return _capsule(made)


_NAME = b"arrow_array_stream"
_Destructor = CFUNCTYPE(None, c_void_p)


_get_pointer = ctypes.PYFUNCTYPE(c_void_p, c_void_p, c_char_p)(("PyCapsule_GetPointer", ctypes.pythonapi))
#: The streams that capsules point to.
_capsules: dict[int, _Stream] = {}


def _destroy(
    capsule: Any, at: Any = _get_pointer, name: bytes = _NAME, capsules: Any = _capsules, to: Any = pointer
) -> None:
    made = capsules.pop(at(capsule, name), None)
    # A consumer that took the stream has marked it as released.
    if made is not None and made.release:
        made.release(to(made))


_destructor = _Destructor(_destroy)
ctypes.pythonapi.Py_IncRef(ctypes.py_object(_destructor))
_new = ctypes.PYFUNCTYPE(ctypes.py_object, c_void_p, c_char_p, _Destructor)(
    ("PyCapsule_New", ctypes.pythonapi)
)


def _capsule(made: _Stream) -> Any:
    place = ctypes.addressof(made)
    _capsules[place] = made
    return _new(place, _NAME, _destructor)

"""Messages of standard types that palpate publishes, packed as CDR, little-endian.

CDR is the encoding of DDS (OMG, DDSI-RTPS). Numbers are aligned to their size, counted from behind the encapsulation. A
string is its length with the closing zero [bytes] (uint32), then its characters. A sequence is its length (uint32),
then its elements.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Flag, Floats

VECTOR, DIAGNOSTICS = "geometry_msgs/msg/Vector3Stamped", "diagnostic_msgs/msg/DiagnosticArray"
_SECOND = 1_000_000_000  # [ns]
_ENCAPSULATION = b"\x00\x01\x00\x00"  # CDR, little-endian, no options
_FLOAT32 = 7  # by sensor_msgs/PointField
_FLOAT32_SIZE = 4  # [bytes]
_OK, _WARN, _ERROR = 0, 1, 2  # by diagnostic_msgs/DiagnosticStatus
_LEVELS = {"note": _WARN, "doubtful": _WARN, "invalid": _ERROR}


class Cdr:
    """Encoder of one message."""

    def __init__(self) -> None:
        self._data = bytearray()

    def put(self, code: str, *values: float) -> Cdr:
        """Append numbers of one type, each aligned to its size; `code` is the type's code in `struct`."""
        size = struct.calcsize(code)
        for value in values:
            self._data += bytes(-len(self._data) % size) + struct.pack("<" + code, value)
        return self

    def text(self, text: str) -> Cdr:
        """Append a string."""
        return self.block(text.encode() + b"\0")

    def block(self, raw: bytes) -> Cdr:
        """Append a sequence of bytes."""
        self.put("I", len(raw))
        self._data += raw
        return self

    def header(self, stamp: int, frame: str) -> Cdr:
        """Append a std_msgs/Header: time `stamp` [ns] and frame_id."""
        return self.put("i", stamp // _SECOND).put("I", stamp % _SECOND).text(frame)

    @property
    def message(self) -> bytes:
        """The encoded message, with its encapsulation."""
        return _ENCAPSULATION + bytes(self._data)


def legal_name(text: str) -> str:
    """Return a name as ROS 2 allows it in a topic.

    >>> legal_name("casadi-fit")
    'casadi_fit'
    """
    name = re.sub(r"_*[^A-Za-z0-9_]+_*|__+", "_", text).strip("_")
    return name if name and not name[0].isdigit() else f"n{name}"


def pack_vector_stamped(stamp: int, frame: str, numbers: Sequence[float]) -> tuple[str, bytes]:
    """Return the type and the bytes of a geometry_msgs/Vector3Stamped of three numbers; `stamp` [ns]."""
    return VECTOR, Cdr().header(stamp, frame).put("d", *numbers).message


def boolean(value: bool) -> tuple[str, bytes]:
    """Return the type and the bytes of a std_msgs/Bool."""
    return "std_msgs/msg/Bool", Cdr().put("B", value).message


def cloud(stamp: int, frame: str, names: Sequence[str], points: Floats) -> tuple[str, bytes]:
    """Return the type and the bytes of a sensor_msgs/PointCloud2 of points (n, k); `stamp` [ns].

    Each column is a float32 field with the name of `names` (k). The message has header, height, width, fields,
    is_bigendian, point_step [bytes], row_step [bytes], data and is_dense.
    """
    point_count, field_count = points.shape
    point_step = _FLOAT32_SIZE * field_count
    cdr = Cdr().header(stamp, frame).put("I", 1, point_count)
    # Of each field: name, offset [bytes], type, number of elements.
    cdr.put("I", field_count)
    for column, name in enumerate(names):
        cdr.text(name).put("I", _FLOAT32_SIZE * column).put("B", _FLOAT32).put("I", 1)
    is_bigendian, is_dense = False, True
    cdr.put("B", is_bigendian).put("I", point_step, point_step * point_count)
    cdr.block(np.ascontiguousarray(points, "<f4").tobytes()).put("B", is_dense)
    return "sensor_msgs/msg/PointCloud2", cdr.message


def diagnostics(stamp: int, flags: Mapping[str, Sequence[Flag]]) -> tuple[str, bytes]:
    """Return the type and the bytes of a diagnostic_msgs/DiagnosticArray of the flags by track; `stamp` [ns].

    A track has one DiagnosticStatus for each of its flags, and one of level OK if it has none. A status has level,
    name, message, hardware_id and key-value pairs.
    """
    clean_tracks = [track for track, track_flags in flags.items() if not track_flags]
    flagged = [(track, flag) for track, track_flags in flags.items() for flag in track_flags]
    cdr = Cdr().header(stamp, "").put("I", len(flagged) + len(clean_tracks))
    for track in clean_tracks:
        cdr.put("B", _OK).text(f"palpate: {track}").text("no flags").text("palpate").put("I", 0)
    for track, flag in flagged:
        severity = flag.severity or "doubtful"
        cdr.put("B", _LEVELS.get(severity, _WARN)).text(f"palpate: {track}: {flag.code}").text(flag.message)
        cdr.text("palpate").put("I", 1).text("severity").text(severity)
    return DIAGNOSTICS, cdr.message

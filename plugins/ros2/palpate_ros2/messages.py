"""Messages of standard types that palpate publishes, packed as CDR, little-endian."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Flag, Floats

VECTOR, DIAGNOSTICS = "geometry_msgs/msg/Vector3Stamped", "diagnostic_msgs/msg/DiagnosticArray"
_SECOND = 1_000_000_000  # [ns]
_FLOAT32 = 7  # of sensor_msgs/PointField
_LEVELS = {"note": 1, "doubtful": 1, "invalid": 2}  # OK 0, WARN 1, ERROR 2


class Cdr:
    """A message in the making; alignment counts from behind the encapsulation."""

    def __init__(self) -> None:
        self._data = bytearray()

    def put(self, code: str, *values: float) -> Cdr:
        """Numbers of one kind, each aligned to its size."""
        size = struct.calcsize(code)
        for value in values:
            self._data += bytes(-len(self._data) % size) + struct.pack("<" + code, value)
        return self

    def text(self, words: str) -> Cdr:
        """Return a string with its closing zero."""
        raw = words.encode() + b"\0"
        self.put("I", len(raw))
        self._data += raw
        return self

    def block(self, raw: bytes) -> Cdr:
        """Return a sequence of bytes."""
        self.put("I", len(raw))
        self._data += raw
        return self

    def header(self, stamp: int, frame: str) -> Cdr:
        """std_msgs/Header at a time [ns]."""
        return self.put("i", stamp // _SECOND).put("I", stamp % _SECOND).text(frame)

    @property
    def message(self) -> bytes:
        """All of it."""
        return b"\x00\x01\x00\x00" + bytes(self._data)


def legal_name(text: str) -> str:
    """Return a name as ROS 2 allows it in a topic.

    >>> legal_name("casadi-fit")
    'casadi_fit'
    """
    name = re.sub(r"_*[^A-Za-z0-9_]+_*|__+", "_", text).strip("_")
    return name if name and not name[0].isdigit() else f"n{name}"


def pack_vector_stamped(stamp: int, frame: str, numbers: Sequence[float]) -> tuple[str, bytes]:
    """geometry_msgs/Vector3Stamped of three numbers."""
    return VECTOR, Cdr().header(stamp, frame).put("d", *numbers).message


def boolean(value: bool) -> tuple[str, bytes]:
    """std_msgs/Bool."""
    return "std_msgs/msg/Bool", Cdr().put("B", value).message


def cloud(stamp: int, frame: str, names: Sequence[str], points: Floats) -> tuple[str, bytes]:
    """sensor_msgs/PointCloud2 of points (n, k), each column a float32 field of its own."""
    count, width = points.shape
    cdr = Cdr().header(stamp, frame).put("I", 1, count, width)
    for k, name in enumerate(names):
        cdr.text(name).put("I", 4 * k).put("B", _FLOAT32).put("I", 1)
    cdr.put("B", 0).put("I", 4 * width, 4 * width * count)
    cdr.block(np.ascontiguousarray(points, "<f4").tobytes()).put("B", 1)
    return "sensor_msgs/msg/PointCloud2", cdr.message


def diagnostics(stamp: int, flags: Mapping[str, Sequence[Flag]]) -> tuple[str, bytes]:
    """diagnostic_msgs/DiagnosticArray with one status for each track and each of its flags."""
    entries = [(track, flag) for track, found in flags.items() for flag in found]
    clean = [track for track, found in flags.items() if not found]
    cdr = Cdr().header(stamp, "").put("I", len(entries) + len(clean))
    for track in clean:
        cdr.put("B", 0).text(f"palpate: {track}").text("no flags").text("palpate").put("I", 0)
    for track, flag in entries:
        cdr.put("B", _LEVELS.get(flag.severity or "doubtful", 1)).text(f"palpate: {track}: {flag.code}").text(
            flag.message
        )
        cdr.text("palpate").put("I", 1).text("severity").text(flag.severity or "doubtful")
    return DIAGNOSTICS, cdr.message

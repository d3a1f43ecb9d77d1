"""A map as an MCAP file with one message that viewers of robots draw."""

from __future__ import annotations

import io
import struct

import numpy as np

from palpate_maps.map_grid import StiffnessMap

TOPIC = "/palpate/map"
_FLOAT64 = 8
_PART = "\n" + "=" * 80 + "\n"
_DEFINITION = _PART.join(
    [
        "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\nuint32 column_count\n"
        "foxglove_msgs/Vector2 cell_size\nuint32 row_stride\nuint32 cell_stride\n"
        "foxglove_msgs/PackedElementField[] fields\nuint8[] data",
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        "MSG: foxglove_msgs/Vector2\nfloat64 x\nfloat64 y",
        "MSG: foxglove_msgs/PackedElementField\nuint8 UNKNOWN=0\nuint8 UINT8=1\nuint8 INT8=2\nuint8 UINT16=3\n"
        "uint8 INT16=4\nuint8 UINT32=5\nuint8 INT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n"
        "string name\nuint32 offset\nuint8 type",
    ]
)


class _GridMessage:
    """Common data representation, little-endian: numbers stand at multiples of their size."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def number(self, code: str, *values: float) -> None:
        """Numbers of one type of `struct`."""
        size = struct.calcsize(f"<{code}")
        for value in values:
            self._bytes += bytes(-len(self._bytes) % size) + struct.pack(f"<{code}", value)

    def text(self, value: str) -> None:
        """A string, counted with its closing zero."""
        raw = value.encode() + b"\0"
        self.number("I", len(raw))
        self._bytes += raw

    def raw(self, value: bytes) -> None:
        """A sequence of bytes."""
        self.number("I", len(value))
        self._bytes += value

    def message(self) -> bytes:
        """The whole, with its encapsulation."""
        return b"\x00\x01\x00\x00" + bytes(self._bytes)


def map_mcap(field: StiffnessMap, parameter: str, stamp: int = 0) -> bytes:
    """An MCAP file with the map as one ``foxglove_msgs/msg/Grid`` on /palpate/map, at a stamp [ns].

    Fields: the parameter and its standard deviation [SI], NaN where not covered; frame ``work``, rows with y.
    """
    from mcap.writer import CompressionType, Writer

    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library="palpate")
    schema = writer.register_schema("foxglove_msgs/msg/Grid", "ros2msg", _DEFINITION.encode())
    channel = writer.register_channel(TOPIC, "cdr", schema)
    writer.add_message(channel, log_time=stamp, publish_time=stamp, data=grid_message(field, parameter, stamp))
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def grid_message(field: StiffnessMap, parameter: str, stamp: int) -> bytes:
    """The map as one message in CDR."""
    steps = [float(axis[1] - axis[0]) if len(axis) > 1 else 1e-3 for axis in (field.x, field.y)]
    names = (parameter, f"{parameter}_std")
    cdr = _GridMessage()
    cdr.number("i", stamp // 1_000_000_000)
    cdr.number("I", stamp % 1_000_000_000)
    cdr.text("work")
    corner = [float(axis[0]) - step / 2 for axis, step in zip((field.x, field.y), steps, strict=True)]
    cdr.number("d", *corner, 0.0, 0.0, 0.0, 0.0, 1.0)
    cdr.number("I", len(field.x))
    cdr.number("d", *steps)
    cdr.number("I", 8 * len(names) * len(field.x), 8 * len(names), len(names))
    for k, name in enumerate(names):
        cdr.text(name)
        cdr.number("I", 8 * k)
        cdr.number("B", _FLOAT64)
    values = np.stack([field.value, np.where(field.covered, field.std, np.nan)], axis=-1)
    cdr.raw(np.ascontiguousarray(values, "<f8").tobytes())
    return cdr.message()

"""Ports: every signal is looked up once, and everything that reads it uses the same column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from palpate.alignment_settings import AlignmentSettings, Signal
from palpate.device import Stream, address

PLACE = dict.fromkeys("xyz", "m")
TURNS: tuple[Mapping[str, str], ...] = (  # how a pose may state the tool's orientation
    dict.fromkeys(("qx", "qy", "qz", "qw"), "1"),  # quaternion
    dict.fromkeys(("rx", "ry", "rz"), "rad"),  # rotation vector
    dict.fromkeys(("roll", "pitch", "yaw"), "rad"),  # turns about x, y and z, in the order that is stated
)

Streams = Mapping[str, tuple[Stream, ...]]  # by device


@dataclass(frozen=True)
class Port:
    """Place at which a signal is read: one column of one stream of one device."""

    signal: Signal
    device: str
    stream: Stream
    column: int
    limits: tuple[float, float] | None = None  # readings at or beyond these are saturated

    @property
    def key(self) -> tuple[str, str]:
        """Device and stream, as batches name them."""
        return self.device, self.stream.name

    @property
    def unit(self) -> str:
        """Of the readings [SI]."""
        return self.stream.channels[self.column].unit

    @property
    def components(self) -> tuple[int, ...]:
        """Columns of the stream that are in the unit of this one; for an undeclared unit, this column alone."""
        if self.unit == "1":
            return (self.column,)
        names = [channel.name for channel in self.stream.channels]
        columns = [i for i, channel in enumerate(self.stream.channels) if channel.unit == self.unit]
        ends = [names[i][-1:].lower() for i in columns]
        if sorted(ends) == ["x", "y", "z"]:  # a log of others has its columns in any order
            columns.sort(key=lambda i: names[i][-1:].lower())
        return tuple(columns)

    def has(self, units: Mapping[str, str]) -> bool:
        """Return True if the stream has channels of some names, each in its unit."""
        stream_units = {channel.name: channel.unit for channel in self.stream.channels}
        return all(stream_units.get(name) == unit for name, unit in units.items())

    def beside(self, column: int) -> Port:
        """Return another column of the stream, at the same times; the range is that of the force."""
        limits = self.limits if column in self.components else None
        return Port(
            signal=self.signal.model_copy(update={"sign": 1}),
            device=self.device,
            stream=self.stream,
            column=column,
            limits=limits,
        )

    def named(self, channel: str) -> Port:
        """Return the column of the stream that has a name; raises KeyError where none has."""
        names = [item.name for item in self.stream.channels]
        if channel not in names:
            raise KeyError(channel)
        return self.beside(names.index(channel))


@dataclass(frozen=True)
class Ports:
    """The streams of a rig, and where in them each signal is read."""

    streams: Streams
    roles: Mapping[str, Port]

    @classmethod
    def of(cls, settings: AlignmentSettings, streams: Streams) -> Ports:
        """Return the ports of all signals; raises KeyError with a channel that no device has."""
        places = {name: (device, stream, column) for name, device, stream, column in channels(streams)}
        roles = {}
        for role, signal in signals(settings):
            device, stream, column = places[signal.channel]
            limits = stream.channels[column].limits
            if role == "force" and settings.force_limit is not None:
                limits = -settings.force_limit, settings.force_limit
            roles[role] = Port(signal, device, stream, column, limits)
        if settings.is_oriented:
            roles |= _local_ports(settings, roles)
        return cls(streams, roles)

    def __getitem__(self, role: str) -> Port:
        return self.roles[role]


def signals(settings: AlignmentSettings) -> Iterator[tuple[str, Signal]]:
    """Yield every role that has a channel, with its signal."""
    for role in AlignmentSettings.model_fields:
        if isinstance(signal := getattr(settings, role), Signal):
            yield role, signal


def channels(streams: Streams) -> Iterator[tuple[str, str, Stream, int]]:
    """Yield every channel: as a pipeline names it, its device, stream and column."""
    for device, group in streams.items():
        for stream in group:
            for column, channel in enumerate(stream.channels):
                yield address(device, stream, channel), device, stream, column


def _local_ports(settings: AlignmentSettings, roles: Mapping[str, Port]) -> dict[str, Port]:
    """Return by role the ports besides force, position and velocity where the tool turns or the skin is inclined."""
    force, position = roles["force"], roles["position"]
    axes = zip("xyz", force.components, strict=False)
    ports = {f"force {axis}": force.beside(column) for axis, column in axes if column != force.column}
    # A quaternion, a rotation vector, or roll, pitch and yaw: whichever the stream of the position has.
    orientation_names = next((names for names in TURNS if position.has(names)), TURNS[0])
    ports |= {f"orientation {name}": position.named(name) for name in orientation_names}
    if settings.is_projecting:
        ports |= {f"position {axis}": position.named(axis) for axis in "xyz"}
        if "velocity" in roles:
            velocity = roles["velocity"]
            ports |= {f"velocity {axis}": velocity.named(axis) for axis in "xyz"}
            if {"wx", "wy", "wz"} <= {channel.name for channel in velocity.stream.channels}:
                ports |= {f"turn {axis}": velocity.named(f"w{axis}") for axis in "xyz"}
    return ports

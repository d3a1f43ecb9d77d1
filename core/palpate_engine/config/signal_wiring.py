"""Wiring: which channels serve as what, and whether they can."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.device import Channel, Device, KnowsGravity, Stream
from palpate.errors import ConfigurationError, PalpateError, suggest
from palpate.key_mistakes import Mistake

from palpate_engine.alignment import SIGNAL_UNITS, AlignmentSettings, Port, Ports, channels, signals
from palpate_engine.alignment.tool_frame import problems_of
from palpate_engine.safety import SafetySettings

_NORMAL = 2  # column of z in a pose or twist of the work frame, whose z is the surface's normal


def ports_of(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> Ports:
    """Return the port of each signal in the streams of some devices; the names have been checked."""
    return Ports.of(alignment, {name: device.streams for name, device in devices.items()})


def wrong_channels(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> list[Mistake]:
    """Return a mistake for every role whose channel no device has."""
    mistakes = []
    units: dict[str, str] = {}
    for name, device in devices.items():
        try:
            streams = _announced_streams(device)
            units |= {channel: stream.channels[i].unit for channel, _, stream, i in channels({name: streams})}
        except PalpateError as error:
            mistakes.append(Mistake(("device", name), str(error)))
    if mistakes:
        return mistakes
    # A ratio of unit 1 is of any role: its sensor states no unit.
    for role, signal in signals(alignment):
        required_unit = SIGNAL_UNITS.get(role)
        if signal.channel not in units:
            problem = f"no device has a channel {signal.channel!r}{suggest(signal.channel, units)}"
            mistakes.append(Mistake(("alignment", role), problem))
        elif required_unit is not None and units[signal.channel] not in (required_unit, "1"):
            problem = f"{signal.channel!r} is in {units[signal.channel]}, but {role} must be in {required_unit}"
            mistakes.append(Mistake(("alignment", role), problem))
    if not mistakes and alignment.is_oriented:
        # Wired as if the tool did not turn: its orientation may be what is missing.
        unturned = alignment.model_copy(update={"weight": "tared", "normal": None, "surface": None})
        problems = problems_of(alignment, ports_of(unturned, devices))
        mistakes += [Mistake(("alignment", key), problem) for key, problem in problems]
    return mistakes


def _announced_streams(device: Device) -> tuple[Stream, ...]:
    """Return the streams of a device; raises ConfigurationError where its class returns anything else."""
    streams = device.streams
    where = f"{type(device).__name__}.streams"
    if not isinstance(streams, tuple | list) or not all(isinstance(stream, Stream) for stream in streams):
        raise ConfigurationError(f"{where} returns {streams!r}, not a tuple of Stream")
    for stream in streams:
        if not all(isinstance(channel, Channel) for channel in stream.channels):
            raise ConfigurationError(f"{where}: the channels of {stream.name!r} are {stream.channels!r}, not Channel")
    return tuple(streams)


def with_gravity(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> AlignmentSettings:
    """Return the settings; of a tool that turns with the direction of gravity by its arm where none is stated."""
    arm = devices.get(alignment.position.channel.partition(".")[0])
    if not alignment.is_oriented or alignment.gravity is not None or not isinstance(arm, KnowsGravity):
        return alignment
    return alignment.model_copy(update={"gravity": arm.gravity})


def check_wiring(ports: Ports, safety: SafetySettings | None) -> list[Mistake]:
    """Return a mistake for a height that is not along the normal, and for a force limit that the sensor cannot
    reach."""
    mistakes = []
    for role in ("position", "velocity"):
        if role in ports.roles and (problem := _off_the_normal(role, ports[role])) is not None:
            mistakes.append(Mistake(("alignment", role), problem))
    port = ports["force"]
    if safety is not None and port.limits is not None:
        reach = min(map(abs, port.limits))
        if safety.stop_force >= reach:
            problem = (
                f"{safety.stop_force:g} N never comes: {port.signal.channel} is at the end of its range at {reach:g} N"
            )
            mistakes.append(Mistake(("safety", "stop_force"), problem))
    return mistakes


def _off_the_normal(role: str, port: Port) -> str | None:
    """Return why a signal of the work frame is not the one along the normal, out of the material; None where it is."""
    if port.stream.frame != "work" or port.stream.layout not in ("pose", "twist"):
        return None
    name = port.signal.channel
    normal = port.stream.channels[_NORMAL].name
    if port.column != _NORMAL:
        return f"{name} is along the skin; the {role} is the one along the normal, {name.rpartition('.')[0]}.{normal}"
    if port.signal.sign != 1:
        return f"{name} is positive out of the material already, in the work frame: leave sign = -1 out"
    return None

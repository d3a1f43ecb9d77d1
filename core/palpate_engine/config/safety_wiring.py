"""The ``[safety]`` table of a rig: what its devices and its alignment add to it, and what of them contradicts it."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.arm_limits import Shareable
from palpate.device import Device, own_motions
from palpate.key_mistakes import Mistake

from palpate_engine.alignment import AlignmentSettings, Ports
from palpate_engine.safety import SafetySettings


def wire_safety(limits: SafetySettings, alignment: AlignmentSettings, devices: Mapping[str, Device]) -> SafetySettings:
    """Return the limits with the time from a force to braking as this rig has it.

    The sensor's delay is what the file states, or the larger of the force's declared delay and of what its device says
    of its filter. An arm that cannot look at the force by itself goes on for as long as it may be left without word
    from the host: no latency is shorter.
    """
    port = _ports(alignment, devices)["force"]
    delay, sensor = limits.sensor_delay, devices[port.device]
    if delay is None:
        delay = max(alignment.force.delay, port.stream.delay, 0.0)
    shared = isinstance(sensor, Shareable) and port.stream.name in sensor.shared_streams
    blind = 0.0 if shared else max((motion.blind for motion in own_motions(devices).values()), default=0.0)
    return limits.model_copy(update={"sensor_delay": delay, "latency": max(limits.latency, blind)})


def contradictions(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> list[Mistake]:
    """Return a mistake where the depth of an arm that moves is not along its normal."""
    position = _ports(alignment, devices)["position"]
    axis = position.stream.channels[position.column].name
    if position.device not in own_motions(devices) or position.stream.layout != "pose" or axis == "z":
        return []
    problem = f"is {position.signal.channel!r}, but depth is along the normal: expected the z axis of the work frame"
    return [Mistake(("alignment", "position"), problem)]


def _ports(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> Ports:
    return Ports.of(alignment, {name: device.streams for name, device in devices.items()})

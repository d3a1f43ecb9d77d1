"""Preparation of arms before they move: their limits, and no load on the sensor that the tare would hide."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.arm_limits import ForceWatch, SupportsLimits, SupportsSharing
from palpate.device import Link
from palpate.errors import DeviceError

from palpate_engine.alignment import Port
from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.safety import SafetySettings

_MAX_OFFSET_CHANGE = 0.5  # [N] from a known offset; drift and weight of another posture are less: a choice


def send_limits(links: Mapping[str, Link], guard: Guard, limits: SafetySettings) -> None:
    """Send these limits, and where the force is read, to every arm that enforces limits itself."""
    port, contact = guard.force, guard.contact
    assert contact.tare is not None
    channels, tare = contact.components, tuple(contact.tare.tolist())  # columns of the stream, and their tares [N]
    # An arm reads the sensor by itself only through a shared ring of its device.
    source = links.get(port.device)
    shared = source.shared(port.stream.name) if isinstance(source, SupportsSharing) else None
    for arm in links.values():
        if isinstance(arm, SupportsLimits):
            arm.limit(limits.of_an_arm, guard.trip)
            if shared is not None:
                normal = channels.index(port.column), float(port.signal.sign)
                force = channels, tare, limits.stop_force, port.signal.channel, *normal
                torque = contact.torques, tuple(contact.torque_tare.tolist()), limits.torque
                sound = limits.reading_age, guard.rise.sound
                # By position: the fields of a ForceWatch in their order.
                arm.watch_force(ForceWatch(shared, *force, contact.ranges, contact.repeats, *torque, *sound))


def refuse_preload(standstill: float, limits: SafetySettings, port: Port, offset: float | None = None) -> None:
    """Raise DeviceError where what rests on the sensor and the force that stops the motion pass `force` together.

    `standstill` is the mean reading [N] of the sensor at a `port` of the alignment, `offset` its reading without a
    load. Where that is known, what differs from it is force on the skin.
    """
    force = port.signal.channel
    if offset is None:
        on_skin, remark = abs(standstill), "which the tare hides"
    else:
        on_skin = abs(port.signal.sign * standstill - offset)
        remark = f"{on_skin:.2f} N from the known offset"
        if on_skin > _MAX_OFFSET_CHANGE:
            raise DeviceError(
                f"{force} reads {standstill:.2f} N at standstill, {remark}: the tip touches something, or the sensor "
                'was restarted since; lift the tip, or set [alignment] tare = "free-air"'
            )
    if on_skin + limits.stop_force > limits.force:
        raise DeviceError(
            f"{force} reads {standstill:.2f} N at standstill, {remark}: with [safety] stop_force = "
            f"{limits.stop_force:g} N the skin could feel {on_skin + limits.stop_force:.1f} N, over force = "
            f"{limits.force:g} N; free the tip, zero the sensor, or lower stop_force"
        )

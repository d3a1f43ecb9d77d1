"""Making arms ready to move: their limits, the way to the start, and whether the tip is free."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.alignment import Port
from palpate.clocks import clock
from palpate.config import Pipeline
from palpate.device import Arm, Batch, Leadable, Link
from palpate.errors import ConfigurationError, DeviceError
from palpate.limiting import ForceWatch, Limited, Retreating, Sharing
from palpate.pipeline.guard import Guard
from palpate.pipeline.live import LiveLinks
from palpate.pipeline.rig import Rig
from palpate.pipeline.start import check_way
from palpate.safety import SafetySettings
from palpate.trajectory import ForceLed, Trajectory
from palpate.vectors import Floats

_RETREAT, _SPEED = 0.5e-3, 2e-3  # [m], [m/s] of the way that is felt along
_SETTLE, _LISTEN = 0.1, 0.3  # [s] after the retreat; of force that is compared
_LATE = 5.0  # [s] without any reading, after which none is waited for; that they come late is no fault of the sensor
_OFF = 0.5  # [N] from a known offset; drift and weight of another posture are less
_BLOCKS, _SHORTEST = 40, 8  # of the standstill; readings of one
_SIGNIFICANT = 5.0  # standard uncertainties of the difference

Pass = Callable[[Sequence[tuple[str, Batch]]], None]


def hand_limits(links: Mapping[str, Link], guard: Guard, limits: SafetySettings) -> None:
    """Give every arm that enforces limits itself these limits, and where it finds the force."""
    port, contact = guard.force, guard.contact
    assert contact.tare is not None
    channels, tare = contact.components, tuple(contact.tare.tolist())
    source = links.get(port.device)
    shared = source.shared(port.stream.name) if isinstance(source, Sharing) else None
    for arm in links.values():
        if isinstance(arm, Limited):
            arm.limit(limits.of_an_arm, guard.trip)
            if shared is not None:
                normal = channels.index(port.column), float(port.signal.sign)
                force = channels, tare, limits.stop_force, port.signal.channel, *normal
                arm.watch_force(ForceWatch(shared, *force, contact.ranges, contact.repeats))


@dataclass(frozen=True)
class Offset:
    """The sensor's reading in free air [N], sign included, as stated or by a calibration, and why it may not hold."""

    value: float
    doubt: str | None = None

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {"value": self.value, "counts": self.doubt is None, "doubt": self.doubt}


def stored_offset(rig: Rig, live: Mapping[str, Mapping[str, Any]]) -> Offset | None:
    """The offset that the file knows, if any; `live` is what connected devices say of themselves."""
    tare = rig.alignment.tare
    if not isinstance(tare, float):
        return None
    if (
        not isinstance(rig, Pipeline)
        or rig.calibration is None
        or rig.stated is None
        or rig.stated.tare != "calibrated"
    ):
        return Offset(tare)
    flag = rig.calibration.offset_doubt(rig, live)
    return Offset(tare, None if flag is None else flag.message)


def refuse_preload(standstill: float, limits: SafetySettings, port: Port, offset: float | None = None) -> None:
    """Raise DeviceError where what rests on the sensor and the force that stops the motion pass `force` together.

    Where the offset is known, what differs from it is force on the skin.
    """
    force = port.signal.channel
    if offset is None:
        on_skin, what = abs(standstill), "which the tare hides"
    else:
        on_skin = abs(port.signal.sign * standstill - offset)
        what = f"{on_skin:.2f} N from the known offset"
        if on_skin > _OFF:
            raise DeviceError(
                f"{force} reads {standstill:.2f} N at standstill, {what}: the tip touches something, or the sensor was "
                'started anew since; lift the tip, or set [alignment] tare = "free-air"'
            )
    if on_skin + limits.stop_force > limits.force:
        raise DeviceError(
            f"{force} reads {standstill:.2f} N at standstill, {what}: with [safety] stop_force = "
            f"{limits.stop_force:g} N the skin could feel {on_skin + limits.stop_force:.1f} N, over force = "
            f"{limits.force:g} N; free the tip, zero the sensor, or lower stop_force"
        )


@dataclass(frozen=True)
class Felt:
    """What a retreat showed."""

    change: float  # [N] of the force's mean, positive where it fell
    std: float  # [N] standard uncertainty of that change

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {"change": self.change, "std": self.std}


def feel(arms: list[Arm], live: LiveLinks, guard: Guard, pass_on: Pass, stopped: Callable[[], bool]) -> Felt | None:
    """Retreat a little and see whether the force falls; raises DeviceError where it does: the tip was in contact.

    None where no arm can, or where it was `stopped`.
    """
    able = [arm for arm in arms if isinstance(arm, Retreating)]
    if not able:
        return None
    port, name_of_it = guard.force, guard.force.signal.channel
    took = max(arm.retreat(_RETREAT, _SPEED) for arm in able)
    begin = clock().epoch_ns() + round(1e9 * (took + _SETTLE))
    end, heard = begin + round(1e9 * _LISTEN), clock().now()
    after: list[Floats] = []
    latest = 0
    while latest < end and clock().now() < heard + _LATE and not stopped():
        for arrivals in live.until(clock().now() + 0.02):
            pass_on(arrivals)
            for batch in (batch for name, batch in arrivals if (name, batch.stream) == port.key):
                after.append(batch.values[batch.received >= begin, port.column])
                latest, heard = int(batch.received[-1]), clock().now()
    if stopped():
        return None
    felt = compared(guard.standstill_force, np.concatenate(after) if after else np.zeros(0), port.signal.sign)
    if felt is None:
        raise DeviceError(f"{name_of_it} gave nothing usable after a retreat of 0.5 mm: is the sensor well?")
    refuse_contact(felt, name_of_it)
    return felt


def refuse_contact(felt: Felt, force: str) -> None:
    """Raise DeviceError where the force changed by more than its scatter explains."""
    if abs(felt.change) <= _SIGNIFICANT * felt.std:
        return
    what = f"by {abs(felt.change):.3f} N, {abs(felt.change) / max(felt.std, 1e-9):.0f} times its standard uncertainty"
    if felt.change > 0:
        raise DeviceError(
            f"the tip touches something: {force} fell {what}, when the tip retreated by 0.5 mm; lift the tip until it "
            "is free"
        )
    raise DeviceError(
        f"{force} rose {what}, when the tip retreated by 0.5 mm: is something pulling at the cable, or does the sensor "
        "count the other way round ([alignment] force sign = -1)?"
    )


def compared(before: Floats, after: Floats, sign: float) -> Felt | None:
    """The change between two stretches of readings, by means of blocks: they scatter however the noise is coloured.

    None where there are too few readings.
    """
    before, after = (part[np.isfinite(part)] for part in (before, after))
    size = max(len(before) // _BLOCKS, _SHORTEST)
    means = [part[: len(part) // size * size].reshape(-1, size).mean(axis=1) for part in (before, after)]
    if min(map(len, means)) < 3:
        return None
    spread = np.concatenate([part - part.mean() for part in means])
    variance = float(spread @ spread) / (len(spread) - 2)
    std = float(np.sqrt(variance * sum(1.0 / len(part) for part in means)))
    return Felt(sign * float(means[0].mean() - means[1].mean()), std)


def ready(arms: list[Arm], trajectory: Trajectory, limits: SafetySettings) -> None:
    """Raise DeviceError where the way of an arm to the start breaks a limit."""
    for arm in arms:
        refuse_leading(arm, trajectory)
        check_way(arm, trajectory, limits)


def refuse_leading(arm: Arm, trajectory: Trajectory) -> None:
    """Raise ConfigurationError where a force leads the motion, and the arm cannot be led so."""
    if isinstance(trajectory, ForceLed):
        if not isinstance(arm, Leadable):
            raise ConfigurationError(f"a force leads this motion, and {type(arm).__name__} cannot be led by one")
        arm.refuse_law(trajectory.force_law)

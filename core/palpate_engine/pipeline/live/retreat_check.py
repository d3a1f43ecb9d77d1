"""The check before a motion: a tip that is free reads the same force after a small retreat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate.arm_limits import RETREAT, RETREAT_SPEED, SupportsRetreat
from palpate.clocks import clock, host_time_ns
from palpate.errors import DeviceError
from palpate.vectors import Floats

from palpate_engine.pipeline.live.live_run import LiveRun

_SECOND = 1e9  # [ns]
_SETTLE, _LISTEN = 0.1, 0.3  # [s] after the retreat; of force that is compared: a choice (0066)
_LATE = 5.0  # [s] without any reading, after which none is waited for; that they come late is not the sensor's fault
_LOOK = 0.02  # [s] between looks at what has come: a choice
_BLOCKS, _MIN_BLOCK_SIZE = 40, 8  # of the standstill; readings of one: a choice, blocks outlast the noise's memory
_MIN_BLOCKS = 3  # of each stretch, for a scatter
_SIGNIFICANT = 5.0  # standard uncertainties of the difference: a choice (0066)
_MIN_STD = 1e-9  # [N] guards against a division by 0


@dataclass(frozen=True)
class RetreatCheck:
    """Change of the force by a retreat."""

    change: float  # [N] of the force's mean, positive where it fell
    std: float  # [N] standard uncertainty of that change
    drift: float = 0.0  # [N] what the sensor's zero may have drifted by meanwhile

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {"change": self.change, "std": self.std, "drift": self.drift}


def check_tip_is_free(live: LiveRun) -> RetreatCheck | None:
    """Retreat a little and see whether the force falls; raises DeviceError where it does: the tip was in contact.

    None where no arm can, or where the run was stopped.
    """
    arms = [arm for arm in live.arms.values() if isinstance(arm, SupportsRetreat)]
    if not arms:
        return None
    port = live.guard.force
    # The force is compared from when the slowest arm has retreated and its sensor has settled.
    duration = max(arm.retreat(RETREAT, RETREAT_SPEED) for arm in arms)
    begin = host_time_ns() + round(_SECOND * (duration + _SETTLE))
    after = _force_from(live, begin)
    if live.is_stopped:
        return None
    check = compare_readings(live.guard.standstill_force, after, port.signal.sign)
    if check is None:
        raise DeviceError(
            f"{port.signal.channel} gave no valid reading after the retreat of 0.5 mm: check the sensor and its cable"
        )
    # Between the middles of both stretches the zero may have drifted.
    elapsed = (begin - live.guard.standstill_middle) / _SECOND + _LISTEN / 2
    check = replace(check, drift=live.rig.alignment.drift * elapsed)
    refuse_contact(check, port.signal.channel)
    return check


def _force_from(live: LiveRun, begin: int) -> Floats:
    """Return the force's readings (n,) received from an instant [ns] on, for as long as they are compared."""
    port = live.guard.force
    end, heard = begin + round(_SECOND * _LISTEN), clock().now()
    readings: list[Floats] = []
    latest = 0
    while latest < end and clock().now() < heard + _LATE and not live.is_stopped:
        for arrivals in live.links.until(clock().now() + _LOOK):
            live.pass_on(arrivals)
            for device, batch in arrivals:
                if (device, batch.stream) == port.key:
                    readings.append(batch.values[batch.received >= begin, port.column])
                    latest, heard = int(batch.received[-1]), clock().now()
    return np.concatenate(readings) if readings else np.zeros(0)


def refuse_contact(check: RetreatCheck, force: str) -> None:
    """Raise DeviceError where the force changed by more than its scatter and the sensor's drift explain."""
    if abs(check.change) <= _SIGNIFICANT * check.std + check.drift:
        return
    size = abs(check.change)
    step = f"by {size:.3f} N, {size / max(check.std, _MIN_STD):.0f} times its standard uncertainty"
    if check.change > 0:
        raise DeviceError(
            f"the tip touches something: {force} fell {step}, when the tip retreated by 0.5 mm; lift the tip until it "
            "is free"
        )
    raise DeviceError(
        f"{force} rose {step}, when the tip retreated by 0.5 mm: is something pulling at the cable, or does the sensor "
        "count the other way round ([alignment] force sign = -1)?"
    )


def compare_readings(before: Floats, after: Floats, sign: float) -> RetreatCheck | None:
    """Return the change between two stretches of readings, by means of blocks: they scatter however the noise is
    coloured.

    Its variance is that of the block means, pooled, times 1/n1 + 1/n2. None where there are too few readings.
    """
    before, after = (part[np.isfinite(part)] for part in (before, after))
    size = max(len(before) // _BLOCKS, _MIN_BLOCK_SIZE)
    means = [part[: len(part) // size * size].reshape(-1, size).mean(axis=1) for part in (before, after)]
    if min(map(len, means)) < _MIN_BLOCKS:
        return None
    deviations = np.concatenate([part - part.mean() for part in means])
    variance = float(deviations @ deviations) / (len(deviations) - 2)
    std = float(np.sqrt(variance * sum(1.0 / len(part) for part in means)))
    return RetreatCheck(sign * float(means[0].mean() - means[1].mean()), std)

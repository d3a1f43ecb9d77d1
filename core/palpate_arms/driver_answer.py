"""Mistakes of a driver, by method and field: for the person who writes it."""

from __future__ import annotations

import math
from typing import Any

from palpate_arms.arm_driver import ArmReading

_POSE = 6  # numbers: a place [m] and a rotation vector [rad]; speeds and a wrench have as many
_FIELDS = "joints", "joint_speeds", "pose", "twist", "wrench", "status"
_OPTIONAL = "pose", "twist"


def reading_problem(reading: Any, joints: int, status: int) -> str | None:
    """Return the first mistake in a state of an arm with so many joints and channels of status; None without one."""
    if not isinstance(reading, ArmReading):
        return f"its driver's `read` returned {_kind(reading)}; expected an ArmReading, or None where no state is new"
    for field, count in zip(_FIELDS, (joints, joints, _POSE, _POSE, _POSE, status), strict=True):
        values = getattr(reading, field)
        if field in _OPTIONAL and values is None:
            continue
        try:
            if len(values) != count:
                return f"its driver's `read` gives {len(values)} numbers in `{field}`; expected {count}"
            any(map(math.isnan, values))  # anything but numbers raises
        except TypeError:
            return f"its driver's `read` gives {_kind(values)} in `{field}`; expected {count} numbers"
    try:
        math.isnan(reading.stamp)
    except TypeError:
        return f"its driver's `read` gives {_kind(reading.stamp)} as `stamp`; expected the controller's time [s]"
    return None


def _kind(value: Any) -> str:
    """Return the type of a value in words, of a sequence with its first entry that is not a number."""
    if value is None:
        return "None"
    if isinstance(value, list | tuple):
        other = next((entry for entry in value if not isinstance(entry, float | int)), None)
        return f"a {type(value).__name__} with {other!r}"
    return f"a {type(value).__name__}"


def driver_error(error: Exception, driver: Any) -> str | None:
    """Return what a driver's method raised, with its name and place; None of an error that none of them raised."""
    # The outermost call of a method of the driver.
    trace = error.__traceback__
    while trace is not None:
        frame = trace.tb_frame
        if frame.f_locals.get("self") is driver:
            place = f"{frame.f_code.co_filename.rpartition('/')[2]}, line {trace.tb_lineno}"
            return f"its driver's `{frame.f_code.co_name}` failed: {type(error).__name__}: {error} ({place})"
        trace = trace.tb_next
    return None

"""Names of the controller's modes and errors, with their remedies for a person."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_NO_ERRORS = "[]"  # as the client library writes it
LOCKED, IDLE, MOVES, REFLEX, USER_STOP = 0, 1, 2, 4, 5
MODES = {
    LOCKED: "its joints are locked or it is not ready: unlock the joints and activate FCI in Desk",
    IDLE: "idle",
    MOVES: "in motion",
    3: "a person guides it: let go of its buttons",
    REFLEX: "in a reflex",
    USER_STOP: "the user stop is pressed: release it",
    6: "it recovers from an error",
}
MEANINGS = {
    "cartesian_reflex": "the force on the tool was over collision_force",
    "joint_reflex": "the torque of a joint was over collision_torque",
    "communication_constraints_violation": "its commands came too late or not at all",
    "joint_velocity_violation": "a joint was too fast",
    "cartesian_velocity_violation": "the tool was too fast",
    "joint_position_limits_violation": "a joint was at its end",
    "self_collision_avoidance_violation": "it came too near to itself",
    "power_limit_violation": "it took too much power",
    "tau_j_range_violation": "the torque of a joint was beyond its range",
}


def error_names(library: Any) -> list[str]:
    """Return the errors that a client library knows, in a fixed order."""
    return sorted(name for name in dir(library.Errors) if not name.startswith("_"))


def error_bits(errors: Any, names: Sequence[str]) -> int:
    """Return errors as bits: that of place k stands for the k-th name."""
    if str(errors) == _NO_ERRORS:  # in each of a thousand states a second: forty attributes take ten times as long
        return 0
    return sum(1 << place for place, name in enumerate(names) if getattr(errors, name))


def names_of(bits: int, names: Sequence[str]) -> list[str]:
    """Return the names that bits stand for."""
    return [name for place, name in enumerate(names) if bits >> place & 1]


def explained(errors: Sequence[str]) -> str:
    """Return errors by their names, with their meaning where it is known."""
    return ", ".join(f"{name} ({MEANINGS[name]})" if name in MEANINGS else name for name in errors)


def complaint(mode: int, errors: Sequence[str]) -> str | None:
    """Return why a robot in this mode, with these errors, cannot be moved; None where it can."""
    if errors:
        return f"the controller stopped it: {explained(errors)}"
    if mode in (IDLE, MOVES):
        return None
    return MODES.get(mode, f"in mode {mode}, which is not known")

"""What a controller's modes mean, and what a person does about them."""

from __future__ import annotations

STOPPED, PLAYING = 1, 2  # runtime state
NORMAL = 1  # safety mode
_SAFE = (NORMAL, 2)  # and REDUCED
_SAFETY = {
    3: "a protective stop",
    5: "a safeguard stop",
    6: "an emergency stop",
    7: "an emergency stop",
    8: "a safety violation",
    9: "a safety fault",
}
_WAY_OUT = {
    3: "look for its cause, wait 5 s and unlock it on the pendant, then lift the tip in freedrive",
    5: "close the safeguard and reset it, then lift the tip in freedrive",
    6: "release the button, power the arm on, release its brakes, then lift the tip in freedrive",
    7: "release the button, power the arm on, release its brakes, then lift the tip in freedrive",
}
_PAUSES = (3, 4)  # PAUSING, PAUSED


def complaint(modes: tuple[int, int, int], height: float | None) -> str | None:
    """Why the arm cannot continue, from robot mode, safety mode and runtime state; None where it can.

    `height` [m] of the tip over the nominal skin, where it was in motion.
    """
    _, safety, runtime = modes
    stands = "" if height is None else f" The tip stands at a height of {1e3 * height:.1f} mm."
    if safety not in _SAFE:
        what = _SAFETY.get(safety, f"safety mode {safety}")
        way_out = f"; {_WAY_OUT[safety]}." if safety in _WAY_OUT else "."
        return f"the robot is in {what}{way_out}{stands}"
    if runtime in _PAUSES:
        return f"the robot's program was paused on the pendant.{stands}"
    if runtime != PLAYING:
        return f"the robot's program was stopped (pendant, dashboard, watchdog or a pose out of reach).{stands}"
    return None

"""Modes of a controller: their meaning, and what a person does about them."""

from __future__ import annotations

# Numbers of the controller's modes, by Universal Robots' table of RTDE outputs.
STOPPED, PLAYING = 1, 2  # runtime state
NORMAL, REDUCED = 1, 2  # safety mode
RUNNING = 7  # robot mode
_SAFE = (NORMAL, REDUCED)
_FULL_SPEED = 0.995  # share of it, half a step less: sliders move in steps of 1 %
_PERCENT = 100
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
_POWER = "power the arm on and release its brakes on the pendant"
_ROBOT = {
    -1: ("NO_CONTROLLER", "restart the controller"),
    0: ("DISCONNECTED", "look at the pendant for the cause"),
    1: ("CONFIRM_SAFETY", "confirm the safety configuration on the pendant"),
    2: ("BOOTING", "wait until it has started"),
    3: ("POWER_OFF", _POWER),
    4: ("POWER_ON", _POWER),
    5: ("IDLE", _POWER),
    6: ("BACKDRIVE", f"leave backdrive, then {_POWER}"),
    8: ("UPDATING_FIRMWARE", "wait until it is done"),
}
_PAUSES = (3, 4)  # PAUSING, PAUSED
_REDUCED = (
    "reduced mode: a safety plane or a safety input has put the lower limits of its safety configuration in force; "
    "leave the plane or release the input"
)


def complaint(modes: tuple[int, int, int]) -> str | None:
    """Return why the arm cannot continue; None where it can.

    The modes are numbers of the controller: robot mode, safety mode and runtime state.
    """
    robot, safety, runtime = modes
    if safety not in _SAFE:
        condition = _SAFETY.get(safety, f"safety mode {safety}")
        way_out = f"; {_WAY_OUT[safety]}." if safety in _WAY_OUT else "."
        return f"the robot is in {condition}{way_out}"
    if robot != RUNNING:
        name, remedy = _ROBOT.get(robot, (f"mode {robot}", "look at the pendant for the cause"))
        return f"the robot is {name}, not RUNNING; {remedy}."
    if runtime in _PAUSES:
        return "the robot's program was paused on the pendant."
    if runtime != PLAYING:
        return "the robot's program was stopped (pendant, dashboard, watchdog or a pose out of reach)."
    return None


def slowdown(paces: tuple[float, float], safety: int, before: int | None) -> str | None:
    """Return why the arm is slower than it is commanded, or about to be; None where it is not.

    From the speed slider and the controller's own scaling (1 is full speed), its safety mode, and the one `before`, at
    the start of the motion, where there is one.
    """
    slider, scaling = paces
    if not slider >= _FULL_SPEED:  # also where it is not a number
        verb = "is at" if before is None else "was moved to"
        return f"the speed slider {verb} {_PERCENT * slider:.0f} %; set it to 100 % on the pendant"
    if safety == REDUCED and before == NORMAL:
        return f"the robot has changed to {_REDUCED}"
    if not scaling >= _FULL_SPEED:
        reason = f"; it is in {_REDUCED}" if safety == REDUCED else ""
        return (
            f"the controller slows the arm to {_PERCENT * scaling:.0f} % to keep its own limits of speed, force or "
            f"power; use a slower motion, or look at its payload and safety configuration{reason}"
        )
    return None

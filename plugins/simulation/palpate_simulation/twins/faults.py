"""Faults that the twins can simulate, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from palpate import ConfigurationError, clock, suggest

from palpate_simulation.twins.specimen_change import restart_at, soften_specimen

if TYPE_CHECKING:
    from palpate_simulation.twins.world import World

Words = list[str]
Action = Callable[[Any, Words], object]  # on a World

FAULTS = {
    "protective-stop": "the robot stops as after a collision; the program is paused",
    "emergency-stop": "the red button",
    "safeguard-stop": "an open safeguard; the program is paused",
    "pause-program": "the program is paused on the pendant",
    "stop-program": "the program is stopped on the pendant",
    "freeze": "the controller keeps its connections and sends nothing more",
    "thaw": "it sends again",
    "stall SECONDS": "everything stands still for this long; up to 0.5 s is then made up for",
    "stuck-pose": "the controller keeps reporting the pose of this moment, whatever the arm does",
    "nan-pose": "the controller's pose is not a number",
    "pose-offset X Y Z": "the controller reports a pose that is off by this [mm], in the base; its target is right",
    "frame-offset X Y Z": "the same of its target: it takes commands in another frame than that of its poses",
    "state-rate HERTZ": "the controller sends its state so often, at most 500 Hz, and takes commands as before",
    "wrong-speed FACTOR": "the controller reports this many times the tip's speed",
    "stamp-leap SECONDS": "the controller's time-stamps leap ahead by this, or are not numbers for nan",
    "jam": "the arm stands still, whatever is commanded",
    "mute-control": "the command connection is neither read nor answered; the states continue",
    "half-open SECONDS": "the network holds commands back for this long, then they land at once; the states continue",
    "slider FRACTION": "the speed slider is moved: the arm follows more slowly",
    "speed-scaling FRACTION": "the controller slows the arm down, as to keep its own limits of speed, force or power",
    "reduced": "the robot changes to its reduced mode",
    "robot-mode NUMBER": "the robot's mode, 7 in operation; in any other the program ends",
    "close": "the controller ends its connections and takes new ones",
    "reset": "the same by a TCP reset",
    "gone": "the controller closes its ports as well",
    "half": "the controller sends half a packet and nothing more",
    "short-states BYTES": "the controller's states are whole packets that lack so many bytes",
    "message": "the controller sends a text between its states",
    "refuse-start": "the controller refuses to send states to new connections",
    "lack NAME": "the controller does not know an output",
    "deaf": "the controller starts no program",
    "local": "the robot is not in remote control",
    "no-port NUMBER": "a port is closed: 30003, 30004 or 29999",
    "no-greeting": "the dashboard accepts connections and sends nothing",
    "mute": "the controller accepts connections and answers nothing",
    "unplug": "the sensor's cable is pulled",
    "plug-in": "and put back",
    "reboot": "the sensor restarts",
    "silent": "the sensor sends nothing more",
    "end-stream": "the sensor ends its stream and closes its connection; it can be connected to again",
    "stuck-force": "the sensor repeats its latest reading in valid frames, whose time goes on",
    "clipped-force LEVEL": "no axis of the sensor reads more than this force [N], either way",
    "saturated-force LEVEL STD": "the same, with noise of this standard deviation [N] on top",
    "wrapped-force LEVEL": "a force beyond this [N] is read as one from the other end of the range",
    "scaled-force FACTOR": "the sensor reads so many times what it feels",
    "reduced-force FACTOR": "the same, with its own noise",
    "compressed-force": "the sensor reads the square root of a force in newtons, with its own noise",
    "deadened-force LEVEL": "the sensor does not feel the first newtons, either way",
    "forgotten-force SECONDS": "the sensor loses a constant force within this time",
    "old-force SECONDS": "the sensor's values are so old, and its time-stamps fresh",
    "late-readings SECONDS": "the sensor's readings arrive later and later, in the end by this long",
    "late-states SECONDS": "the same for the controller's states",
    "slow SECONDS": "the sensor answers commands with this delay, and starts in 2.5 s",
    "lumps SECONDS": "frames arrive in lumps, as from a USB adapter with this latency timer",
    "raw": "the sensor sends counts of its gauges",
    "throttled": "the sensor reports that it leaves out measurements",
    "overrange": "the sensor reports over range",
    "saturated": "the sensor reports invalid",
    "sound": "the sensor is in order again",
    "corrupt FRACTION": "this share of the frames is damaged on the line",
    "refuse LETTER": "the sensor refuses a command",
    "sign": "the sensor's sign is reversed",
    "push X Y Z": "a hand pushes the tip with this force [N] in the work frame, until the next push; 0 0 0 lets go",
    "twist X Y Z": "a hand twists the tool with this torque [N m] about the axes of the sensor; 0 0 0 lets go",
    "freedrive": "the button is pressed, and at the next time let go: the program ends, the arm gives way to push",
    "lead X Y Z A B C": "in freedrive, a hand leads the tip to a place [mm], the tool turned as by `start`",
    "estop": "the red button is pressed, and at the next time let out, with the power on and the brakes released",
    "slow-stop DECELERATION": "every stop of the robot brakes its joints no harder than this [rad/s^2]",
    "turn X Y Z": "the tool is turned: gravity points along X Y Z in the sensor's frame (the arm does not show it)",
    "mark": "reset the record of how far and fast the arm moved",
    "trace FILE": "write the arm's true motion of the last minute, as a numpy array",
    "start X Y Z A B C": "tip after `restore` [mm], and rotation vector of the tool from the work frame's [deg]",
    "elasticity PASCAL": "of the specimen, from now on",
    "breathe HEIGHT HERTZ": "the skin rises by this [mm] and falls again, so often; 0 0 ends it",
    "cough HEIGHT SECONDS": "the skin rises by this [mm] within so many seconds, and falls back in as long",
    "rise HEIGHT SECONDS": "the skin rises by this [mm] within so many seconds and stays there: a person sits up",
    "restore": "everything is in order again, and the arm where it was at the start",
    "state": "print what the twins did so far",
    "quit": "end",
}


def _set(part: str, name: str, value: Any) -> Action:
    """Return the action that sets a name of a part of the world, such as its sensor."""
    return lambda world, _: setattr(getattr(world, part), name, value)


def _sensor_fault(fault: str) -> Action:
    return _set("sensor", "fault", fault)


def _stalled(world: World, words: Words) -> None:
    world.stalled_until = clock().now() + float(words[0])


def _sound(world: World, _: Words) -> None:
    world.sensor.fault, world.sensor.corruption = None, 0.0
    world.electronics.restore()


def _turned(world: World, words: Words) -> None:
    x, y, z = (float(word) for word in words)
    world.turn_gravity((x, y, z))


def _offset(name: str) -> Action:
    """Return the action that sets an offset of the controller's poses, from millimetres."""
    return lambda world, words: setattr(
        world.controller, name, 1e-3 * np.array([float(words[axis]) for axis in range(3)])
    )


def _pressed(world: World, _: Words) -> None:
    controller = world.controller
    if controller.is_stopped_by_button:
        controller.release_emergency_stop()
    else:
        controller.emergency_stop()


def _begun(world: World, words: Words) -> None:
    world.settings = restart_at(world.settings, [float(word) for word in words])


def _softened(world: World, words: Words) -> None:
    world.settings = soften_specimen(world.settings, float(words[0]))


def _moves(name: str) -> Action:
    """Return the action that moves the skin, by a height in millimetres and a second number."""

    def move(world: World, words: Words) -> None:
        height, pace = (float(word) for word in words)
        getattr(world.skin, name)(1e-3 * height, pace, world.controller.now)

    return move


# What each line does; those that answer something of their own are not among them.
_ACTIONS: dict[str, Action] = {
    "protective-stop": lambda world, _: world.controller.protective_stop(),
    "emergency-stop": lambda world, _: world.controller.emergency_stop(),
    "safeguard-stop": lambda world, _: world.controller.protective_stop(safeguard=True),
    "pause-program": lambda world, _: world.controller.pause(),
    "stop-program": lambda world, _: world.controller.end_program(),
    "freeze": _set("ports", "frozen", True),
    "thaw": _set("ports", "frozen", False),
    "stuck-pose": lambda world, _: world.controller.stick(),
    "nan-pose": _set("controller", "no_number", True),
    "pose-offset": _offset("pose_offset"),
    "frame-offset": _offset("frame_offset"),
    "state-rate": lambda world, words: world.send_states_at(float(words[0])),
    "wrong-speed": lambda world, words: setattr(world.controller, "speed_factor", float(words[0])),
    "stamp-leap": lambda world, words: setattr(world.controller, "stamp_leap", float(words[0])),
    "jam": lambda world, _: setattr(world.controller.arm, "jammed", True),
    "mute-control": _set("ports", "control_mute", True),
    "half-open": lambda world, words: world.ports.hold_back(float(words[0])),
    "slider": lambda world, words: world.controller.move_slider(float(words[0])),
    "speed-scaling": lambda world, words: world.controller.scale_speed(float(words[0])),
    "reduced": lambda world, _: world.controller.reduce(),
    "robot-mode": lambda world, words: world.controller.change_mode(int(words[0])),
    "mark": lambda world, _: world.truth.mark(),
    "trace": lambda world, words: world.truth.write(words[0]),
    "half": _set("ports", "halved", True),
    "short-states": lambda world, words: setattr(world.ports, "missing", int(words[0])),
    "message": lambda world, _: world.ports.say("a text between two states"),
    "refuse-start": _set("controller", "refuses_start", True),
    "lack": lambda world, words: setattr(world.controller, "unknown_output", words[0]),
    "deaf": _set("controller", "deaf", True),
    "local": _set("controller", "remote", False),
    "no-port": lambda world, words: world.ports.shut(int(words[0])),
    "no-greeting": _set("ports", "greets_not", True),
    "mute": _set("ports", "mute", True),
    "slow": lambda world, words: setattr(world.sensor, "reply_time", float(words[0])),
    "lumps": lambda world, words: setattr(world.sensor, "lump_time", float(words[0])),
    "stall": _stalled,
    "close": lambda world, _: world.ports.disconnect(reset=False),
    "reset": lambda world, _: world.ports.disconnect(reset=True),
    "gone": lambda world, _: world.ports.close(),
    "unplug": lambda world, _: world.sensor.unplug(),
    "plug-in": lambda world, _: world.sensor.plug_in(),
    "reboot": lambda world, _: world.sensor.reboot(world.controller.now),
    **{name: _sensor_fault(name) for name in ("silent", "overrange", "saturated", "raw", "throttled")},
    "end-stream": lambda world, _: world.sensor.end(),
    "stuck-force": lambda world, _: world.electronics.stick(),
    "clipped-force": lambda world, words: world.electronics.clip(float(words[0])),
    "saturated-force": lambda world, words: world.electronics.clip(float(words[0]), float(words[1])),
    "wrapped-force": lambda world, limit: world.electronics.wrap(float(limit[0])),
    "scaled-force": lambda world, words: world.electronics.rescale(float(words[0])),
    "reduced-force": lambda world, words: world.electronics.reduce(float(words[0])),
    "compressed-force": lambda world, _: world.electronics.compress(),
    "deadened-force": lambda world, words: world.electronics.deaden(float(words[0])),
    "forgotten-force": lambda world, words: world.electronics.forget(float(words[0])),
    "old-force": lambda world, words: world.electronics.age(float(words[0])),
    "late-readings": lambda world, words: world.sensor.delay.set(float(words[0]), world.controller.now),
    "late-states": lambda world, words: world.ports.late.set(float(words[0]), clock().now()),
    "sound": _sound,
    "corrupt": lambda world, words: setattr(world.sensor, "corruption", float(words[0])),
    "refuse": lambda world, words: world.sensor.refuse(words[0]),
    "sign": lambda world, _: setattr(world.sensor, "sign", -world.sensor.sign),
    "push": lambda world, words: world.hand.push([float(word) for word in words]),
    "twist": lambda world, words: world.hand.twist([float(word) for word in words]),
    "freedrive": lambda world, _: world.hand.freedrive(),
    "lead": lambda world, words: world.hand.lead([float(word) for word in words]),
    "estop": _pressed,
    "slow-stop": lambda world, words: world.controller.slow_stops(float(words[0])),
    "turn": _turned,
    "start": _begun,
    "elasticity": _softened,
    **{name: _moves(name) for name in ("breathe", "cough", "rise")},
    "restore": lambda world, _: world.restore(),
    "quit": lambda world, _: None,
}
_NUMBERS = {
    "turn": "three numbers",
    "push": "three numbers",
    "twist": "three numbers",
    "pose-offset": "three numbers",
    "frame-offset": "three numbers",
    "start": "six numbers",
    "lead": "six numbers",
    "saturated-force": "two numbers",
    **dict.fromkeys(("breathe", "cough", "rise"), "two numbers"),
}  # that an action needs; others one


def apply_fault(world: World, words: list[str]) -> str:
    """Execute a line; answer with the host's monotonic time, or with its error."""
    if words[0] == "state":
        return _state(world)
    try:
        make_fault(world, words)
    except ConfigurationError as error:
        return str(error)
    return f"done {clock().now():.6f} {words[0]}"


def make_fault(world: World, words: list[str]) -> None:
    """Make a fault; raises ConfigurationError for an unknown fault or wrong numbers."""
    name, given = words[0], words[1:]
    if name not in _ACTIONS:
        raise ConfigurationError(f"unknown: {name}{suggest(name, _ACTIONS)}; help lists the commands")
    try:
        _ACTIONS[name](world, given or [""])
    except (ValueError, IndexError) as error:
        raise ConfigurationError(f"{name} needs {_NUMBERS.get(name, 'a number')}, not {' '.join(given)!r}") from error


def _state(world: World) -> str:
    import json

    controller, sensor = world.controller, world.sensor
    facts = {
        "time": clock().now(),
        "now": controller.now,
        "pose": controller.arm.pose,
        "joint_speed": float(np.abs(controller.arm.qd).max()),
        "tip_speed": float(np.linalg.norm(world.velocity)),
        "height": float(world.position[2]),
        "peak_force": world.peak,
        **world.truth.facts(),
        "frames": sensor.sent,
        "frames_dropped": sensor.dropped,
        "eeprom_writes": sensor.eeprom_writes,
        "uploads": controller.uploads,
        "complaints": controller.complaints,
    }
    return "state " + json.dumps(facts)

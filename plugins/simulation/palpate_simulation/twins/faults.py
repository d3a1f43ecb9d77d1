"""Faults that the twins can simulate, by name: what each changes."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from palpate import ConfigurationError, clock, suggest

from palpate_simulation.twins.specimen_change import restart_at, soften_specimen

if TYPE_CHECKING:
    from palpate_simulation.twins.world import World

Arguments = list[str]  # of a fault, as they were typed
Action = Callable[[Any, Arguments], object]  # on a World


def _set(part: str, name: str, value: Any) -> Action:
    """Return the action that sets an attribute of a part of the world, such as its sensor."""
    return lambda world, _: setattr(attrgetter(part)(world), name, value)


def _set_number(part: str, name: str) -> Action:
    """Return the action that sets an attribute of a part of the world to its number."""
    return lambda world, arguments: setattr(attrgetter(part)(world), name, float(arguments[0]))


def _set_sensor_fault(fault: str) -> Action:
    """Return the action that gives the sensor a fault."""
    return _set("sensor", "fault", fault)


def _stall(world: World, arguments: Arguments) -> None:
    """Hold everything up for a time [s]."""
    world.stalled_until = clock().now() + float(arguments[0])


def _repair_sensor(world: World, _: Arguments) -> None:
    """End the faults of the sensor and its electronics."""
    world.sensor.fault, world.sensor.corruption = None, 0.0
    world.electronics.restore()


def _turn_gravity(world: World, arguments: Arguments) -> None:
    """Let gravity point along x, y, z in the sensor's frame."""
    x, y, z = (float(text) for text in arguments)
    world.turn_gravity((x, y, z))


def _set_offset(name: str) -> Action:
    """Return the action that sets an offset of the reported poses, from millimetres."""

    def set_offset(world: World, arguments: Arguments) -> None:
        """Set the offset (3,) [m]."""
        millimetres = [float(arguments[axis]) for axis in range(3)]
        setattr(world.controller.motion, name, 1e-3 * np.array(millimetres))

    return set_offset


def _press_red_button(world: World, _: Arguments) -> None:
    """Press the red button, or let it out again."""
    controller = world.controller
    if controller.is_stopped_by_button:
        controller.release_emergency_stop()
    else:
        controller.emergency_stop()


def _set_start(world: World, arguments: Arguments) -> None:
    """Set place [mm] and rotation vector [deg] of the tool after the next `restore`."""
    world.settings = restart_at(world.settings, [float(text) for text in arguments])


def _soften(world: World, arguments: Arguments) -> None:
    """Give the specimen another elasticity [Pa]."""
    world.settings = soften_specimen(world.settings, float(arguments[0]))


def _move_skin(name: str) -> Action:
    """Return the action that moves the skin by a method of `MovingSkin`, from now on."""

    def move(world: World, arguments: Arguments) -> None:
        """Move by a height in millimetres, and a duration [s] or a rate [Hz]."""
        height, duration_or_rate = (float(text) for text in arguments)
        getattr(world.skin, name)(1e-3 * height, duration_or_rate, world.controller.now)

    return move


# Action of each line but `state` and `help`, which answer something of their own.
_ACTIONS: dict[str, Action] = {
    "protective-stop": lambda world, _: world.controller.protective_stop(),
    "emergency-stop": lambda world, _: world.controller.emergency_stop(),
    "safeguard-stop": lambda world, _: world.controller.protective_stop(safeguard=True),
    "pause-program": lambda world, _: world.controller.pause(),
    "stop-program": lambda world, _: world.controller.end_program(),
    "freeze": _set("ports", "frozen", True),
    "thaw": _set("ports", "frozen", False),
    "stuck-pose": lambda world, _: world.controller.motion.stick(),
    "nan-pose": _set("controller.motion", "is_nan", True),
    "pose-offset": _set_offset("pose_offset"),
    "frame-offset": _set_offset("frame_offset"),
    "state-rate": lambda world, arguments: world.send_states_at(float(arguments[0])),
    "wrong-speed": _set_number("controller.motion", "speed_factor"),
    "stamp-leap": _set_number("controller.motion", "stamp_leap"),
    "jam": _set("controller.arm", "jammed", True),
    "mute-control": _set("ports", "control_mute", True),
    "half-open": lambda world, arguments: world.ports.hold_back(float(arguments[0])),
    "slider": lambda world, arguments: world.controller.move_slider(float(arguments[0])),
    "speed-scaling": lambda world, arguments: world.controller.scale_speed(float(arguments[0])),
    "reduced": lambda world, _: world.controller.reduce(),
    "robot-mode": lambda world, arguments: world.controller.change_mode(int(arguments[0])),
    "mark": lambda world, _: world.truth.mark(),
    "trace": lambda world, arguments: world.truth.write(arguments[0]),
    "half": _set("ports", "halved", True),
    "short-states": lambda world, arguments: setattr(world.ports, "missing", int(arguments[0])),
    "message": lambda world, _: world.ports.say("a text between two states"),
    "refuse-start": _set("controller", "refuses_start", True),
    "lack": lambda world, arguments: setattr(world.controller, "unknown_output", arguments[0]),
    "deaf": _set("controller", "deaf", True),
    "local": _set("controller", "remote", False),
    "no-port": lambda world, arguments: world.ports.shut(int(arguments[0])),
    "no-greeting": _set("ports", "greets_not", True),
    "mute": _set("ports", "mute", True),
    "slow": _set_number("sensor", "reply_time"),
    "lumps": _set_number("sensor", "lump_time"),
    "stall": _stall,
    "close": lambda world, _: world.ports.disconnect(reset=False),
    "reset": lambda world, _: world.ports.disconnect(reset=True),
    "gone": lambda world, _: world.ports.close(),
    "unplug": lambda world, _: world.sensor.unplug(),
    "plug-in": lambda world, _: world.sensor.plug_in(),
    "reboot": lambda world, _: world.sensor.reboot(world.controller.now),
    **{name: _set_sensor_fault(name) for name in ("silent", "overrange", "saturated", "raw", "throttled")},
    "end-stream": lambda world, _: world.sensor.end(),
    "stuck-force": lambda world, _: world.electronics.stick(),
    "clipped-force": lambda world, arguments: world.electronics.clip(float(arguments[0])),
    "saturated-force": lambda world, arguments: world.electronics.clip(float(arguments[0]), float(arguments[1])),
    "wrapped-force": lambda world, arguments: world.electronics.wrap(float(arguments[0])),
    "scaled-force": lambda world, arguments: world.electronics.rescale(float(arguments[0])),
    "reduced-force": lambda world, arguments: world.electronics.reduce(float(arguments[0])),
    "compressed-force": lambda world, _: world.electronics.compress(),
    "deadened-force": lambda world, arguments: world.electronics.deaden(float(arguments[0])),
    "forgotten-force": lambda world, arguments: world.electronics.forget(float(arguments[0])),
    "old-force": lambda world, arguments: world.electronics.age(float(arguments[0])),
    "late-readings": lambda world, arguments: world.sensor.delay.set(float(arguments[0]), world.controller.now),
    "late-states": lambda world, arguments: world.ports.late.set(float(arguments[0]), clock().now()),
    "sound": _repair_sensor,
    "corrupt": _set_number("sensor", "corruption"),
    "refuse": lambda world, arguments: world.sensor.refuse(arguments[0]),
    "sign": lambda world, _: setattr(world.sensor, "sign", -world.sensor.sign),
    "push": lambda world, arguments: world.hand.push([float(text) for text in arguments]),
    "twist": lambda world, arguments: world.hand.twist([float(text) for text in arguments]),
    "freedrive": lambda world, _: world.hand.freedrive(),
    "lead": lambda world, arguments: world.hand.lead([float(text) for text in arguments]),
    "estop": _press_red_button,
    "slow-stop": lambda world, arguments: world.controller.slow_stops(float(arguments[0])),
    "turn": _turn_gravity,
    "start": _set_start,
    "elasticity": _soften,
    **{name: _move_skin(name) for name in ("breathe", "cough", "rise")},
    "restore": lambda world, _: world.restore(),
    "quit": lambda world, _: None,
}
_EXPECTED = {  # of an action that needs more than one number
    "turn": "three numbers",
    "push": "three numbers",
    "twist": "three numbers",
    "pose-offset": "three numbers",
    "frame-offset": "three numbers",
    "start": "six numbers",
    "lead": "six numbers",
    "saturated-force": "two numbers",
    **dict.fromkeys(("breathe", "cough", "rise"), "two numbers"),
}


def apply_fault(world: World, line: list[str]) -> str:
    """Execute a line, split at its spaces; return its answer: the monotonic time [s], the state, or an error."""
    if line[0] == "state":
        return _state(world)
    try:
        make_fault(world, line)
    except ConfigurationError as error:
        return str(error)
    return f"done {clock().now():.6f} {line[0]}"


def make_fault(world: World, line: list[str]) -> None:
    """Make the fault of a line, split at its spaces; raises ConfigurationError for an unknown one or wrong numbers."""
    name, *arguments = line
    if name not in _ACTIONS:
        raise ConfigurationError(f"unknown: {name}{suggest(name, _ACTIONS)}; help lists the commands")
    try:
        _ACTIONS[name](world, arguments or [""])  # an empty text counts as a wrong number
    except (ValueError, IndexError) as error:
        expected = _EXPECTED.get(name, "a number")
        raise ConfigurationError(f"{name} needs {expected}, not {' '.join(arguments)!r}") from error


def _state(world: World) -> str:
    """Return "state" and a JSON object of facts: the present motion, and extremes and counts so far."""
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

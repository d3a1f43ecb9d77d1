"""Faults that the twins can be told to have, by name."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from palpate_devices.twins.scene import begun_at, softened

if TYPE_CHECKING:
    from palpate_devices.twins.bench import World

FAULTS = {
    "protective-stop": "the robot stops as after a collision; the program is paused",
    "emergency-stop": "the red button",
    "safeguard-stop": "an open safeguard; the program is paused",
    "pause-program": "the program is paused on the pendant",
    "stop-program": "the program is stopped on the pendant",
    "freeze": "the controller keeps its connections and sends nothing more",
    "thaw": "it sends again",
    "stall SECONDS": "the whole world stands still for so long",
    "stuck-pose": "the controller goes on to tell the pose of this moment, whatever the arm does",
    "nan-pose": "the controller's pose is no number",
    "jam": "the arm stands, whatever it is told",
    "mute-control": "the connection that commands is neither heard nor answered; the states go on",
    "close": "the controller ends its connections and takes new ones",
    "reset": "the same by a TCP reset",
    "gone": "the controller closes its ports as well",
    "half": "the controller sends half a packet and nothing more",
    "message": "the controller sends a text between its states",
    "refuse-start": "the controller refuses to send states to whoever connects from now on",
    "lack NAME": "the controller does not know an output",
    "deaf": "the controller starts no program",
    "local": "the robot is not in remote control",
    "no-port NUMBER": "nobody listens on a port: 30003, 30004 or 29999",
    "no-greeting": "the dashboard takes connections and says nothing",
    "mute": "the controller takes connections and answers nothing",
    "unplug": "the sensor's cable is pulled",
    "plug-in": "and put back",
    "reboot": "the sensor starts anew",
    "silent": "the sensor sends nothing more",
    "slow SECONDS": "the sensor answers commands so late, and starts in 2.5 s",
    "lumps SECONDS": "frames arrive in lumps, as by a USB adapter whose latency timer is so long",
    "raw": "the sensor sends counts of its gauges",
    "throttled": "the sensor says that it leaves out measurements",
    "overrange": "the sensor says over range",
    "saturated": "the sensor says invalid",
    "sound": "the sensor is all right again",
    "corrupt FRACTION": "so large a part of the frames is damaged on the line",
    "refuse LETTER": "the sensor refuses a command",
    "sign": "the sensor counts the other way round",
    "turn X Y Z": "the tool is turned: gravity points along X Y Z in the sensor's frame (the arm does not show it)",
    "mark": "forget how far and fast the arm was until now",
    "trace FILE": "write what the arm truly did in the last minute, as an array of numpy",
    "start X Y Z A B C": "where `restore` puts the tip [mm], and the tool's rotation vector off the work frame's [deg]",
    "elasticity PASCAL": "of the specimen, from now on",
    "restore": "everything is sound again, and the arm where it was at the start",
    "state": "print what the twins did so far",
    "quit": "end",
}


def apply_fault(world: World, words: list[str]) -> str:
    """Do what a line says; answer with the host's monotonic time, or with what is wrong with it."""
    name, argument = words[0], words[1] if len(words) > 1 else ""
    controller, ports, sensor = world.controller, world.ports, world.sensor
    try:
        match name:
            case "protective-stop":
                controller.protective_stop()
            case "emergency-stop":
                controller.emergency_stop()
            case "safeguard-stop":
                controller.protective_stop(safeguard=True)
            case "pause-program":
                controller.pause()
            case "stop-program":
                controller.end_program()
            case "freeze" | "thaw":
                ports.frozen = name == "freeze"
            case "stuck-pose":
                controller.stick()
            case "nan-pose":
                controller.no_number = True
            case "jam":
                controller.arm.jammed = True
            case "mute-control":
                ports.control_mute = True
            case "mark":
                world.truth.mark()
            case "trace":
                world.truth.write(argument)
            case "half":
                ports.halved = True
            case "message":
                ports.say("a text between two states")
            case "refuse-start":
                controller.refuses_start = True
            case "lack":
                controller.unknown_output = argument
            case "deaf":
                controller.deaf = True
            case "local":
                controller.remote = False
            case "no-port":
                ports.shut(int(argument))
            case "no-greeting":
                ports.greets_not = True
            case "mute":
                ports.mute = True
            case "slow":
                sensor.reply_time = float(argument)
            case "lumps":
                sensor.lump_time = float(argument)
            case "stall":
                world.stalled_until = time.monotonic() + float(argument)
            case "close" | "reset":
                ports.disconnect(reset=name == "reset")
            case "gone":
                ports.close()
            case "unplug":
                sensor.unplug()
            case "plug-in":
                sensor.plug_in()
            case "reboot":
                sensor.reboot(controller.now)
            case "silent" | "overrange" | "saturated" | "raw" | "throttled":
                sensor.fault = name
            case "sound":
                sensor.fault, sensor.corruption = None, 0.0
            case "corrupt":
                sensor.corruption = float(argument)
            case "refuse":
                sensor.refuse(argument)
            case "sign":
                sensor.sign = -sensor.sign
            case "turn":
                x, y, z = (float(word) for word in words[1:])
                world.down = (x, y, z)
            case "start":
                world.settings = begun_at(world.settings, [float(word) for word in words[1:]])
            case "elasticity":
                world.settings = softened(world.settings, float(argument))
            case "restore":
                world.restore()
            case "state":
                return _state(world)
            case "quit":
                pass
            case _:
                return f"unknown: {name}; help lists what there is"
    except ValueError:
        wanted = {"turn": "three numbers", "start": "six numbers"}.get(name, "a number")
        return f"{name} wants {wanted}, not {' '.join(words[1:])!r}"
    return f"done {time.monotonic():.6f} {name}"


def _state(world: World) -> str:
    import json

    import numpy as np

    controller, sensor = world.controller, world.sensor
    facts = {
        "time": time.monotonic(),
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

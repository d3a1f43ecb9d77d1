"""A UR controller in software: modes, program, dashboard, and the state that RTDE sends."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from palpate import ConfigurationError, clock

from palpate_simulation.sensor_wrench import flange_wrench
from palpate_simulation.twins.arm import TICK, SimulatedArm
from palpate_simulation.twins.dashboard import TOO_SOON, dashboard_facts
from palpate_simulation.twins.program import Program
from palpate_simulation.twins.reported_motion import ReportedMotion
from palpate_simulation.twins.rtde import OUTPUTS, ClientSession

VERSION = (5, 12, 4, 1101661)
GREETING = "Connected: Universal Robots Dashboard Server"
# Numbers of RTDE (UR, "Real-Time Data Exchange guide"): states of the program, modes of safety and robot, status bits.
_STOPPED, _PLAYING, _PAUSED = 1, 2, 4
_NORMAL, _REDUCED, _PROTECTIVE, _SAFEGUARD, _EMERGENCY = 1, 2, 3, 5, 7
_SOUND = (_NORMAL, _REDUCED)
_POWER_OFF, _BACKDRIVE, _RUNNING = 3, 6, 7
_SAFETY_BITS = {_NORMAL: 0x1, _REDUCED: 0x2, _PROTECTIVE: 0x404, _SAFEGUARD: 0x410, _EMERGENCY: 0x4C0}
_POWER_ON_BIT, _PROGRAM_BIT = 1, 2
_JOINT_RUNNING = 253
_MAIN_VOLTAGE = 48.0  # [V]
_UNLOCK_TIME = 5.0  # [s] after a protective stop, before which the dashboard refuses to unlock it
_SAFETY_DECELERATION = 80.0  # [rad/s^2] of safety stops (a choice): as hard as servoing may accelerate
_TIME_ROUNDING = 1e-9  # [s] by which an input may be dated after a tick that reads it
_FLANGE = np.eye(4)  # tool that ends at the flange
_SIZES = {"VECTOR6D": 6, "VECTOR3D": 3, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}  # numbers of an output by its type


class Controller:
    """Modes, program, inputs and outputs of a controller: everything but its sockets.

    In a protective stop the program is paused; in an emergency stop it ends and the arm loses its power. Whether a real
    controller says PLAYING for some cycles of a protective stop is not known.
    """

    def __init__(self, arm: SimulatedArm, position_std: float, velocity_std: float, seed: int) -> None:
        """Begin with the power on, without a program; noise of the reported height in [m] and [m/s]."""
        self.arm = arm
        self.motion = ReportedMotion(arm, position_std, velocity_std, seed)
        self.inputs: dict[str, Any] = {}
        self._undated: list[dict[str, Any]] = []  # inputs that were just written
        self._unread: deque[tuple[float, dict[str, Any]]] = deque()  # inputs with their times of arrival [s]
        self._dated_until = 0.0  # [s]
        self.read = 0  # inputs that the latest tick read: more than one, and all but the last have had no effect
        self._owners: dict[str, ClientSession] = {}  # of inputs, by name
        self._program: Program | None = None
        self._runtime, self._safety, self._robot_mode = _STOPPED, _NORMAL, _RUNNING
        self._slider, self._scaling = 1.0, 1.0  # fractions of the speed: by the pendant, and by the controller
        self._stopped_at = 0.0  # [s] of the last protective stop
        self.now = 0.0  # [s] of its own time
        self.force = np.zeros(6)  # [N], [N m] on the tip, as it estimates them
        self.complaints: list[str] = []  # of programs that ended
        self.unknown_output = ""  # an output that this controller does not have
        self.refuses_start = False  # to send states
        self.remote = True  # in remote control
        self.deaf = False  # no program starts
        self.uploads = 0  # programs that were sent to it
        self.pendant_tcp = arm.tcp  # (4, 4) that `restore` sets again
        self.load: tuple[float, tuple[float, ...]] = 0.0, (0.0, 0.0, 0.0)  # [kg] at the flange, its centre [m]
        self._state: dict[str, Any] = {
            name: (0.0,) * _SIZES[type_name] if type_name in _SIZES else 0 for name, type_name in OUTPUTS.items()
        }
        self._state |= {"joint_mode": (_JOINT_RUNNING,) * 6}
        self._state |= {"actual_main_voltage": _MAIN_VOLTAGE, "actual_robot_voltage": _MAIN_VOLTAGE}

    def claim(self, session: ClientSession, name: str) -> bool:
        """Return True if an input belongs to a session; the first that asks gets it."""
        return self._owners.setdefault(name, session) is session

    def release(self, session: ClientSession) -> None:
        """Give the inputs of a session back."""
        self._owners = {name: owner for name, owner in self._owners.items() if owner is not session}

    def write(self, values: dict[str, Any]) -> None:
        """Accept inputs; the first tick after their arrival reads them."""
        self._undated.append(values)
        if self._program is not None and any(name.startswith("input_int_register") for name in values):
            self._program.feed(clock().now())

    def upload(self, text: str) -> None:
        """Start the program of a script, in place of the running one; ignore it where the arm cannot move."""
        self.uploads += 1
        if self._safety in _SOUND and self._robot_mode == _RUNNING and not self.deaf and "def " in text:
            self._program, self._runtime = Program(text, self.arm, self.protective_stop), _PLAYING
            self._program.feed(clock().now())

    def end_program(self) -> None:
        """End the program; the arm comes to rest."""
        if self._program is not None and self._program.complaint:
            self.complaints.append(self._program.complaint)
        self._program, self._runtime = None, _STOPPED
        self.arm.stop()

    def pause(self) -> None:
        """Pause the program; the arm comes to rest."""
        self.arm.stop()
        self._runtime = _PAUSED if self._program is not None else _STOPPED

    def protective_stop(self, safeguard: bool = False) -> None:
        """Stop as after a collision, or as by an open safeguard."""
        self.pause()
        self.arm.stop(_SAFETY_DECELERATION)
        self._safety, self._stopped_at = _SAFEGUARD if safeguard else _PROTECTIVE, self.now

    def reduce(self) -> None:
        """Change to the reduced mode, as by a safety plane or a safety input; the program continues."""
        self._safety = _REDUCED

    def move_slider(self, fraction: float) -> None:
        """Move the speed slider to a fraction (0 to 1); raises ValueError beyond."""
        self._slider = _checked_fraction(fraction)
        self.arm.pace = self._slider * self._scaling

    def scale_speed(self, fraction: float) -> None:
        """Slow the arm down to a fraction (0 to 1), as the controller does for its limits; raises ValueError beyond."""
        self._scaling = _checked_fraction(fraction)
        self.arm.pace = self._slider * self._scaling

    def change_mode(self, number: int) -> None:
        """Change the robot's mode; in any but RUNNING the program ends."""
        self._robot_mode = number
        if number != _RUNNING:
            self.end_program()

    def emergency_stop(self) -> None:
        """Stop as by the red button."""
        self.end_program()
        self.arm.stop(_SAFETY_DECELERATION)
        self._safety = _EMERGENCY

    def release_emergency_stop(self) -> None:
        """Let the red button out, switch the power on and release the brakes."""
        self._safety, self._robot_mode = _NORMAL, _RUNNING

    @property
    def is_stopped_by_button(self) -> bool:
        """True if the red button is pressed."""
        return self._safety == _EMERGENCY

    @property
    def is_sound(self) -> bool:
        """True if no safety stop holds the arm."""
        return self._safety in _SOUND

    @property
    def is_free(self) -> bool:
        """True if the arm is in freedrive."""
        return self._robot_mode == _BACKDRIVE and self.is_sound

    def freedrive(self, free: bool) -> None:
        """Let the arm be led by hand, or hold it again; raises ConfigurationError where a safety stop holds it."""
        if not self.is_sound:
            raise ConfigurationError("freedrive: a safety stop holds the arm; end it first (estop, restore)")
        self.change_mode(_BACKDRIVE if free else _RUNNING)
        self.arm.stop()

    def slow_stops(self, deceleration: float) -> None:
        """Let no stop brake a joint harder than this [rad/s^2]; raises ValueError where that is not positive."""
        if not deceleration > 0.0:
            raise ValueError("expected a deceleration above 0")
        self.arm.brakes = deceleration

    def restore(self, q: Any) -> None:
        """End every stop, program and fault; the arm is at rest at joint angles (n,) [rad]."""
        self.end_program()
        self._undated.clear()
        self._unread.clear()
        self._safety, self._robot_mode = _NORMAL, _RUNNING
        self._slider, self._scaling = 1.0, 1.0
        self.unknown_output, self.refuses_start = "", False
        self.remote, self.deaf = True, False
        self.motion.restore()
        arm = self.arm
        arm.pace, arm.jammed, arm.brakes = 1.0, False, math.inf
        arm.q, arm.qd, arm.tcp = q, np.zeros_like(q), self.pendant_tcp

    def date(self, until: float) -> None:
        """Date the inputs that were just written, up to a time of the controller [s]: evenly since the last ones.

        A controller is not as late as the process that plays it: inputs that the process reads at once after it was
        held up came one after the other, while those that come at once while it is awake did so.
        """
        count = len(self._undated)
        step = max(until - self._dated_until, 0.0) / max(count, 1)
        for i, values in enumerate(self._undated):
            self._unread.append((until - (count - 1 - i) * step, values))
        self._dated_until = until
        self._undated.clear()

    def tick(self) -> None:
        """Advance inputs, program and arm by one tick, 2 ms."""
        self.now += TICK
        self.read = 0
        while self._unread and self._unread[0][0] <= self.now + _TIME_ROUNDING:
            self.inputs |= self._unread.popleft()[1]
            self.read += 1
        # The watchdog counts the host's time: ticks that are caught up in one go leave no room for commands between.
        program = self._program if self._runtime == _PLAYING else None
        if program is not None and not program.step(self.inputs, clock().now()):
            self.end_program()
        self.arm.advance()

    def state(self) -> dict[str, Any]:
        """Return the present outputs of RTDE by name; the dict is the same in every call."""
        is_emergency = self._safety == _EMERGENCY
        power_bit = 0 if is_emergency else _POWER_ON_BIT
        program_bit = _PROGRAM_BIT if self._program is not None and not is_emergency else 0
        self._state |= self.motion.outputs(self.now)
        self._state |= {
            "actual_TCP_force": self.force.tolist(),
            "ft_raw_wrench": flange_wrench(self.arm.tip(_FLANGE)[0], *self.load),
            "robot_mode": _POWER_OFF if is_emergency else self._robot_mode,
            "target_speed_fraction": self._slider,
            "speed_scaling": self._scaling,
            "safety_mode": self._safety,
            "safety_status": self._safety,
            "runtime_state": self._runtime,
            "robot_status_bits": power_bit | program_bit,
            "safety_status_bits": _SAFETY_BITS[self._safety],
        }
        self._state |= self.inputs  # registers are read back
        if self._program is not None:
            self._state |= self._program.outputs
        else:
            self._state["output_int_register_0"] = 0
        return self._state

    def dashboard(self, line: str) -> str:
        """Return the dashboard's answer to a line."""
        if line == "stop":
            self.end_program()
            return "Stopped"
        if line == "play":
            if self._program is not None and self.is_sound:
                self._runtime = _PLAYING
            return "Starting program" if self._runtime == _PLAYING else "Failed to execute: play"
        if line == "unlock protective stop":
            if self.now - self._stopped_at < _UNLOCK_TIME:
                return TOO_SOON
            self._safety = _NORMAL
            return "Protective stop releasing"
        mode = _POWER_OFF if self._safety == _EMERGENCY else self._robot_mode
        modes = mode, self._safety, self._runtime
        facts = dashboard_facts(modes, ".".join(map(str, VERSION)), self.arm.model.name, self.remote)
        return facts.get(line, f"could not understand: '{line}'")


def _checked_fraction(fraction: float) -> float:
    """Return a fraction from 0 to 1; raises ValueError for any other number."""
    if not 0.0 <= fraction <= 1.0:
        raise ValueError("a fraction of the speed is from 0 to 1")
    return fraction

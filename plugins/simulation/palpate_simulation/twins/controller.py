"""A UR controller in software: modes, program, dashboard, and the state that RTDE sends."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, clock
from palpate_kit.kinematics.rotations import pose_of, rotation_matrix

from palpate_simulation.sensor_wrench import flange_wrench
from palpate_simulation.twins.arm import TICK, SimulatedArm
from palpate_simulation.twins.dashboard import TOO_SOON, dashboard_facts
from palpate_simulation.twins.program import Program
from palpate_simulation.twins.rtde import OUTPUTS, ClientSession

VERSION = (5, 12, 4, 1101661)
GREETING = "Connected: Universal Robots Dashboard Server"
_STOPPED, _PLAYING, _PAUSED = 1, 2, 4
_NORMAL, _REDUCED, _PROTECTIVE, _SAFEGUARD, _EMERGENCY = 1, 2, 3, 5, 7
_SOUND = (_NORMAL, _REDUCED)
_POWER_OFF, _BACKDRIVE, _RUNNING = 3, 6, 7
_SAFETY_BITS = {_NORMAL: 0x1, _REDUCED: 0x2, _PROTECTIVE: 0x404, _SAFEGUARD: 0x410, _EMERGENCY: 0x4C0}
_FLANGE = np.eye(4)  # the tool that ends there
_SIZES = {"VECTOR6D": 6, "VECTOR3D": 3, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}


class Controller:
    """Everything but the sockets.

    In a protective stop the program is paused; in an emergency stop it ends and the arm loses its power. Whether a real
    controller says PLAYING for some cycles of a protective stop is not known.
    """

    def __init__(self, arm: SimulatedArm, position_std: float, velocity_std: float, seed: int) -> None:
        self.arm = arm
        self._rng = np.random.default_rng(seed)
        self._noise = position_std, velocity_std
        self.inputs: dict[str, Any] = {}
        self._came: list[dict[str, Any]] = []  # inputs, just written
        self._written: deque[tuple[float, dict[str, Any]]] = deque()  # with the time at which they came, not read yet
        self._dated = 0.0  # until when
        self.read = 0  # inputs that the latest tick read: more than one, and all but the last have had no effect
        self._owners: dict[str, ClientSession] = {}
        self._program: Program | None = None
        self._runtime, self._safety = _STOPPED, _NORMAL
        self._slider, self._scaling = 1.0, 1.0
        self._robot_mode = _RUNNING
        self._stopped_at = 0.0
        self.now = 0.0
        self.force = np.zeros(6)
        self.complaints: list[str] = []
        self.unknown_output = ""  # an output that this controller does not have
        self.refuses_start = False
        self.remote = True  # in remote control
        self.deaf = False  # no program starts
        self.uploads = 0
        self.stuck: list[float] | None = None  # the pose that it keeps reporting
        self.no_number = False  # its pose is not a number
        self.pose_offset, self.frame_offset = np.zeros(3), np.zeros(3)  # [m] of its pose; of its pose and its target
        self.stamp_leap = 0.0  # [s] of its time-stamps
        self.speed_factor = 1.0  # of the tip's speed that it reports
        self.pendant_tcp = arm.tcp
        self.load: tuple[float, tuple[float, ...]] = 0.0, (0.0, 0.0, 0.0)  # [kg] at the flange, its centre [m]
        self._state: dict[str, Any] = {
            name: (0.0,) * _SIZES[kind] if kind in _SIZES else 0 for name, kind in OUTPUTS.items()
        }
        self._state |= {"joint_mode": (253,) * 6}
        self._state |= {"actual_main_voltage": 48.0, "actual_robot_voltage": 48.0}

    def claim(self, session: ClientSession, name: str) -> bool:
        """Return True if an input belongs to a session; the first that asks gets it."""
        return self._owners.setdefault(name, session) is session

    def release(self, session: ClientSession) -> None:
        """Give the inputs of a session back."""
        self._owners = {name: owner for name, owner in self._owners.items() if owner is not session}

    def write(self, values: dict[str, Any]) -> None:
        """Take note of inputs; the first tick after they came reads them."""
        self._came.append(values)
        if self._program is not None and any(name.startswith("input_int_register") for name in values):
            self._program.feed(clock().now())

    def upload(self, text: str) -> None:
        """Start a program, in place of the running one."""
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
        self.arm.stop(80.0)
        self._safety, self._stopped_at = _SAFEGUARD if safeguard else _PROTECTIVE, self.now

    def reduce(self) -> None:
        """Change to the reduced mode, as by a safety plane or a safety input; the program continues."""
        self._safety = _REDUCED

    def move_slider(self, fraction: float) -> None:
        """Move the speed slider to a fraction (0 to 1); raises ValueError beyond."""
        self._slider = _fraction(fraction)
        self.arm.pace = self._slider * self._scaling

    def scale_speed(self, fraction: float) -> None:
        """Slow the arm down to a fraction (0 to 1), as the controller does for its limits; raises ValueError beyond."""
        self._scaling = _fraction(fraction)
        self.arm.pace = self._slider * self._scaling

    def change_mode(self, number: int) -> None:
        """Change the robot's mode; in any but RUNNING the program ends."""
        self._robot_mode = number
        if number != _RUNNING:
            self.end_program()

    def stick(self) -> None:
        """Keep reporting the present pose, and all else as it is."""
        self.stuck = self.arm.pose

    def emergency_stop(self) -> None:
        """Stop as by the red button."""
        self.end_program()
        self.arm.stop(80.0)
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
        """No stop, no program, the arm at rest at joint angles (n,)."""
        self.end_program()
        self._came.clear()
        self._written.clear()
        self._safety, self._robot_mode = _NORMAL, _RUNNING
        self._slider, self._scaling, self.arm.pace = 1.0, 1.0, 1.0
        self.unknown_output, self.refuses_start, self.remote, self.deaf = "", False, True, False
        self.stamp_leap, self.speed_factor = 0.0, 1.0
        self.pose_offset, self.frame_offset = np.zeros(3), np.zeros(3)
        self.stuck, self.no_number, self.arm.jammed, self.arm.brakes = None, False, False, math.inf
        self.arm.q, self.arm.qd, self.arm.tcp = q, np.zeros_like(q), self.pendant_tcp

    def date(self, until: float) -> None:
        """What was just written came by one of its own times [s]: evenly since what came before.

        A controller is not as late as the process that plays it: what that finds at once after it was held up came
        one after the other, while what comes at once while it is awake did so.
        """
        step = max(until - self._dated, 0.0) / max(len(self._came), 1)
        self._written.extend((until - (len(self._came) - 1 - i) * step, v) for i, v in enumerate(self._came))
        self._dated = until
        self._came.clear()

    def tick(self) -> None:
        """Two milliseconds."""
        self.now += TICK
        self.read = 0
        while self._written and self._written[0][0] <= self.now + 1e-9:
            self.inputs |= self._written.popleft()[1]
            self.read += 1
        # The watchdog counts the host's time: ticks that are caught up in one go leave no room for commands between.
        program = self._program if self._runtime == _PLAYING else None
        if program is not None and not program.step(self.inputs, clock().now()):
            self.end_program()
        self.arm.advance()

    def state(self) -> dict[str, Any]:
        """Return the present outputs: joints with their noise, and what follows from the joints."""
        arm = self.arm
        pose, jacobian = arm.tip(arm.tcp)
        # Noise belongs to the joints, so that pose and joints agree; it is scaled to the noise of the height.
        lever = math.hypot(*jacobian[2].tolist()) or 1.0
        noise = self._rng.standard_normal((2, len(arm.q)))
        error, error_rate = noise[0] * (self._noise[0] / lever), noise[1] * (self._noise[1] / lever)
        q, qd, shift = arm.q + error, arm.qd + error_rate, jacobian @ error
        measured = pose.copy()
        measured[:3, 3] += shift[:3] + self.pose_offset + self.frame_offset
        measured[:3, :3] = rotation_matrix(shift[3:].tolist()) @ pose[:3, :3]
        emergency = self._safety == _EMERGENCY
        self._state |= {
            "timestamp": self.now + self.stamp_leap,
            "actual_q": q.tolist(),
            "actual_qd": qd.tolist(),
            "target_q": arm.q.tolist(),
            "target_qd": arm.qd.tolist(),
            "actual_TCP_pose": pose_of(measured),
            "actual_TCP_speed": (self.speed_factor * (jacobian @ qd)).tolist(),
            "target_TCP_pose": _shifted(pose_of(pose), self.frame_offset),
            "actual_TCP_force": self.force.tolist(),
            "ft_raw_wrench": flange_wrench(arm.tip(_FLANGE)[0], *self.load),
            "robot_mode": _POWER_OFF if emergency else self._robot_mode,
            "target_speed_fraction": self._slider,
            "speed_scaling": self._scaling,
            "safety_mode": self._safety,
            "safety_status": self._safety,
            "runtime_state": self._runtime,
            "robot_status_bits": 0 if emergency else 1 | (2 if self._program is not None else 0),
            "safety_status_bits": _SAFETY_BITS[self._safety],
        }
        self._state |= self.inputs  # registers are read back
        if self.stuck is not None:
            self._state["actual_TCP_pose"] = self.stuck
        if self.no_number:
            self._state["actual_TCP_pose"] = [float("nan")] * 6
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
            self._runtime = _PLAYING if self._program is not None and self._safety in _SOUND else self._runtime
            return "Starting program" if self._runtime == _PLAYING else "Failed to execute: play"
        if line == "unlock protective stop":
            if self.now - self._stopped_at < 5.0:
                return TOO_SOON
            self._safety = _NORMAL
            return "Protective stop releasing"
        mode = _POWER_OFF if self._safety == _EMERGENCY else self._robot_mode
        modes = mode, self._safety, self._runtime
        facts = dashboard_facts(modes, ".".join(map(str, VERSION)), self.arm.model.name, self.remote)
        return facts.get(line, f"could not understand: '{line}'")


def _shifted(pose: list[float], offset: Floats) -> list[float]:
    return [*(np.array(pose[:3]) + offset).tolist(), *pose[3:]]


def _fraction(given: float) -> float:
    if not 0.0 <= given <= 1.0:
        raise ValueError("a fraction of the speed is from 0 to 1")
    return given

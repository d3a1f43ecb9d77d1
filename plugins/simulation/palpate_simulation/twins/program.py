"""The program that `ur_rtde` uploads, as the controller runs it: a command register, read at every tick."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from palpate_kit.kinematics.rotations import matrix_of, pose_of

from palpate_simulation.twins.arm import TICK, SimulatedArm

# Commands that stay in the register and are carried out at every tick.
_EVERY_TICK = {6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)}
_READY, _DONE, _END = 1, 2, 255


class Program:
    """A running control program: commands come in `input_int_register_0`, parameters in the double registers.

    Carried out: servoJ/L, speedJ/L, moveJ/L and their stops, watchdog, TCP, kinematics, steadiness, protective stop,
    and what needs no motion (payload, zero of the force sensor). Any other command ends the program, and says so.
    """

    def __init__(self, text: str, arm: SimulatedArm, protect: Callable[[], None]) -> None:
        self._arm = arm
        self._protect = protect
        match = re.search(r"# int register offset\s*(\d+)", text)
        self._offset = int(match[1]) if match else 0
        self._busy: Callable[[], bool] | None = None
        self._executing = False
        self._limit: float | None = None  # [s] between commands, once the watchdog is set
        self._fed = 0.0
        self._operation = 0
        self.zeroed = False
        self.outputs: dict[str, Any] = {}
        self.complaint = ""
        self._say(0)

    def feed(self, now: float) -> None:
        """The command register was written at a time [s]."""
        self._fed = now

    def step(self, inputs: dict[str, Any], now: float) -> bool:
        """One tick; False where the program ends."""
        if self._limit is not None and now - self._fed > self._limit:
            self.complaint = "the watchdog found no command in time"
            return False
        if self._busy is not None:
            if self._busy():
                return True
            self._busy = None
            self._say(_DONE)
        command = int(inputs.get(f"input_int_register_{self._offset}", 0))
        if command in _EVERY_TICK:
            self._say(_READY)
            return self._carry_out(command, inputs)
        if command == 0:
            self._executing = False
            self._say(_READY)
            return True
        if not self._executing:
            self._executing = True
            if command == _END or not self._carry_out(command, inputs):
                return False
            if self._busy is None:
                self._say(_DONE)
        return True

    def _say(self, state: int) -> None:
        self.outputs[f"output_int_register_{self._offset}"] = state

    def _carry_out(self, command: int, inputs: dict[str, Any]) -> bool:
        p = [float(inputs.get(f"input_double_register_{self._offset + i}", 0.0)) for i in range(14)]
        word = int(inputs.get(f"input_int_register_{self._offset + 1}", 0))
        arm, now_fine = self._arm, True
        match command:
            case 11:
                arm.servo(_joints(p), p[9], p[10])
            case 24:
                now_fine = arm.servo_to_pose(p[:6], p[9], p[10])
            case 9:
                arm.run_at(_joints(p))
            case 10:
                now_fine = arm.run_tip_at(p[:6])
            case 1 | 2 | 3 | 4:
                now_fine = self._move(command, p, word)
            case 15 | 16 | 33 | 34:
                arm.stop()
                self._busy = self._until_at_rest
            case 35:
                self._limit = 1.0 / p[0] if p[0] > 0 else None
            case 29:
                arm.tcp = matrix_of(p[:6])
            case 31:
                self._protect()
            case 8:
                self.zeroed = True
            case 26 | 40 | 47 | 36 | 37 | 30 | 46 | 44:
                self._ask(command, p)
            case 17:
                self.outputs |= {"payload": p[0], "payload_cog": tuple(p[1:4])}
            case 7 | 59:
                pass
            case _:
                self.complaint = f"command {command} is not carried out in software"
                return False
        if not now_fine:
            self.complaint = f"command {command}: out of reach"
        return now_fine

    def _until_at_rest(self) -> bool:
        return self._arm.moving

    def _move(self, command: int, p: list[float], asynchronous: int) -> bool:
        arm, speed, acceleration = self._arm, p[6], p[7]
        if command in (1, 4):
            goal: Any = _joints(p)
        else:
            goal = arm.inverse(p[:6])
        if goal is None or speed <= 0 or acceleration <= 0:
            return False
        if command in (1, 2):
            arm.move(goal, speed, acceleration)
        elif not arm.move_linear(pose_of(arm.model.tip(goal.tolist(), arm.tcp)[0]), speed, acceleration):
            return False
        if not asynchronous:
            self._busy = self._until_at_rest
        return True

    def _ask(self, command: int, p: list[float]) -> None:
        answer: list[float] = []
        if command == 26:
            answer = [TICK]
        elif command == 40:
            answer = pose_of(self._arm.tcp)
        elif command == 44:
            tool = matrix_of(p[6:12]) if any(p[6:12]) else self._arm.tcp
            answer = pose_of(self._arm.model.tip(p[:6], tool)[0])
        elif command in (30, 46):
            found = self._arm.inverse(p[:6])
            answer = [] if found is None else found.tolist()
        result = 1 if answer or command in (36, 37) or not self._arm.moving else 0
        self.outputs[f"output_int_register_{self._offset + 1}"] = result
        for i, number in enumerate(answer):
            self.outputs[f"output_double_register_{self._offset + i}"] = number


def _joints(p: list[float]) -> Any:
    import numpy as np

    return np.array(p[:6])

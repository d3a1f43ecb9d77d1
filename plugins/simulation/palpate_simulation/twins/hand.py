"""A hand at the twin's arm: it pushes the tip, leads the arm in freedrive, and presses the red button."""

from __future__ import annotations

import math

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.kinematics.rotations import rotation_matrix
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_simulation.twins.controller import Controller

_DAMPING = 100.0  # [N s/m] of an arm in freedrive: 10 N move its tip at 0.1 m/s
_COLLISION = 150.0  # [N] at the tip that an arm which is not in freedrive takes for a collision
_SPEED, _ACCELERATION = 0.2, 1.0  # [rad/s], [rad/s^2] of the joints, where a hand leads the tip to a place
_ENOUGH = 200  # steps of the inverse kinematics: a hand may turn the tool far


class Hand:
    """What a person does to the arm; forces and places are in the work frame."""

    def __init__(self, controller: Controller, work: WorkFrame, tool: Floats) -> None:
        self._controller, self._work, self._tool = controller, work, tool
        self.release()

    def release(self) -> None:
        """Nobody touches the arm."""
        self.force = np.zeros(3)  # [N] on the tip
        self.torque = np.zeros(3)  # [N m] on the tool, about the axes of the sensor
        self._leads = False

    def push(self, numbers: list[float]) -> None:
        """Push the tip with a force (3,) [N] from now on; raises ValueError."""
        self.force = np.array(_finite(numbers, 3))

    def twist(self, numbers: list[float]) -> None:
        """Twist the tool by a torque (3,) [N m] from now on; raises ValueError."""
        self.torque = np.array(_finite(numbers, 3))

    def freedrive(self) -> None:
        """Press the freedrive button, or let go of it; raises ConfigurationError where the arm is stopped."""
        self._controller.freedrive(not self._controller.is_free)
        self._leads = False

    def lead(self, numbers: list[float]) -> None:
        """Lead the tip in freedrive to a place [mm], the tool turned from the work frame's by a vector [deg].

        Raises ValueError; ConfigurationError where the arm is not in freedrive, or cannot reach it.
        """
        given = np.array(_finite(numbers, 6))
        arm = self._controller.arm
        if not self._controller.is_free:
            raise ConfigurationError("lead: the arm is not in freedrive; type freedrive first")
        goal = self._work.tool_pose(given[:3] / 1e3)
        goal[:3, :3] = goal[:3, :3] @ rotation_matrix(np.radians(given[3:]).tolist())
        q = arm.model.joints_at(goal, self._tool, arm.q, steps=_ENOUGH)
        if q is None:
            raise ConfigurationError("lead: the arm cannot reach that place")
        arm.move(q, _SPEED, _ACCELERATION)
        self._leads = True

    def act(self) -> None:
        """One tick: an arm in freedrive gives way to the force, another one takes a large force for a collision."""
        controller, arm = self._controller, self._controller.arm
        if controller.is_free:
            self._leads = self._leads and arm.moving
            if not self._leads:
                way = self._work.matrix[:3, :3] @ self.force / _DAMPING
                if not arm.run_tip_at([*way.tolist(), 0.0, 0.0, 0.0]):
                    arm.stop()
        elif math.hypot(*self.force.tolist()) > _COLLISION and controller.is_sound:
            controller.protective_stop()


def _finite(numbers: list[float], count: int) -> list[float]:
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError
    return numbers

"""Hand at the twin's arm: it pushes the tip, and leads the arm in freedrive."""

from __future__ import annotations

import math

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.kinematics.rotations import rotation_matrix
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_simulation.twins.controller import Controller

FREEDRIVE_DAMPING = 100.0  # [N s/m] (a choice): 10 N move the tip of an arm in freedrive at 0.1 m/s
COLLISION_FORCE = 150.0  # [N] at the tip (a choice), which stops an arm that is not in freedrive
LEAD_SPEED, LEAD_ACCELERATION = 0.2, 1.0  # [rad/s], [rad/s^2] of the joints that a hand leads (a choice)
INVERSE_STEPS = 200  # of the inverse kinematics (a choice): a hand may turn the tool far


class Hand:
    """Hand of a person at the arm; its forces and positions are in the work frame."""

    def __init__(self, controller: Controller, work: WorkFrame, tool: Floats) -> None:
        self._controller, self._work, self._tool = controller, work, tool
        self.release()

    def release(self) -> None:
        """Let go of the arm."""
        self.force = np.zeros(3)  # [N] on the tip
        self.torque = np.zeros(3)  # [N m] on the tool, about the axes of the sensor
        self._leads = False

    def push(self, numbers: list[float]) -> None:
        """Push the tip with a force (3,) [N] from now on; raises ValueError."""
        self.force = np.array(_checked(numbers, 3))

    def twist(self, numbers: list[float]) -> None:
        """Twist the tool by a torque (3,) [N m] from now on; raises ValueError."""
        self.torque = np.array(_checked(numbers, 3))

    def freedrive(self) -> None:
        """Press the freedrive button, or let go of it; raises ConfigurationError where the arm is stopped."""
        self._controller.freedrive(not self._controller.is_free)
        self._leads = False

    def lead(self, numbers: list[float]) -> None:
        """Lead the tip in freedrive to a position [mm], the tool turned from the work frame's by a vector [deg].

        Raises ValueError unless these are six numbers, ConfigurationError where the arm is not in freedrive, or cannot
        reach the position.
        """
        x, y, z, *rotation = _checked(numbers, 6)
        arm = self._controller.arm
        if not self._controller.is_free:
            raise ConfigurationError("lead: the arm is not in freedrive; type freedrive first")
        goal = self._work.tool_pose(np.array([x, y, z]) / 1e3)
        goal[:3, :3] = goal[:3, :3] @ rotation_matrix(np.radians(rotation).tolist())
        q = arm.model.joints_at(goal, self._tool, arm.q, steps=INVERSE_STEPS)
        if q is None:
            raise ConfigurationError("lead: the arm cannot reach that place")
        arm.move(q, LEAD_SPEED, LEAD_ACCELERATION)
        self._leads = True

    def act(self) -> None:
        """Act for a tick: an arm in freedrive gives way to the force, any other one stops at a large force."""
        controller, arm = self._controller, self._controller.arm
        if controller.is_free:
            self._leads = self._leads and arm.moving
            if not self._leads:
                velocity = self._work.matrix[:3, :3] @ self.force / FREEDRIVE_DAMPING
                if not arm.run_tip_at([*velocity.tolist(), 0.0, 0.0, 0.0]):
                    arm.stop()
        elif math.hypot(*self.force.tolist()) > COLLISION_FORCE and controller.is_sound:
            controller.protective_stop()


def _checked(numbers: list[float], count: int) -> list[float]:
    """Return numbers that are finite and so many; raises ValueError for others."""
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError
    return numbers

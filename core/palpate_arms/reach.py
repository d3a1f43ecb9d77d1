"""The reach of an arm: its joints at every place of a motion, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from palpate import DeviceError, Floats, Trajectory, duration_of, setpoints_at
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import rotation_matrix
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.posture_fence import SINGULAR, is_singular

# Choices.
_STEP = 0.02  # [s] between the setpoints that are checked
_BLOCK = 5000  # of them at a time, which bounds the memory
_SAME_PLACE, _SAME_TURN = 0.2e-3, math.radians(0.2)  # [m], [rad] from the previous place, which shows nothing new
_MAX_CHANGE = 0.5  # [rad] of a joint from one such place to the next; more is another way to hold the arm
_SPEED_SLACK = 1.05  # times a limit, which speeds over a step may reach by rounding
_WAY_SHARES = 9  # places of the way to the start, with both ends
_MM = 1e3  # per metre


@dataclass(frozen=True)
class ArmReach:
    """An arm, its work, and the posture in which it stands."""

    model: ArmModel
    tool: Floats  # (4, 4) tip on the flange
    work: WorkFrame
    joint_speed: float  # [rad/s] at most
    speed: float  # [m/s] of the flange at most, which swings when the tool turns
    links: tuple[tuple[float, ...], tuple[float, ...]]  # corners (3,) [m] of the box of elbow, wrist and flange
    joints: Floats  # (n,) [rad]

    def refuse(self, trajectory: Trajectory) -> None:
        """Raise DeviceError with the first place of a motion at which the arm cannot be, or is near a singular posture.

        Each posture is solved from the previous one by Newton's method, from where the arm stands.
        """
        previous: Floats | None = None
        for time, goal in self._goals(trajectory):
            start = self._on_the_way(self.joints, goal) if previous is None else previous
            joints, place = self.model.joints_at(goal, self.tool, start), self._words(time, goal)
            if joints is None:
                raise DeviceError(f"{place}: it is out of the arm's reach")
            problem = self._posture_problem(joints)
            if problem is None and previous is not None:
                problem = self._change_problem(joints, previous)
            if problem is not None:
                raise DeviceError(f"{place}: {problem}")
            previous = joints

    def _on_the_way(self, joints: Floats, goal: Floats) -> Floats:
        """Return joints on a straight way to the first place, so that it is reached without another posture."""
        begin = self.model.tip(joints.tolist(), self.tool)[0]
        for share in np.linspace(0.0, 1.0, _WAY_SHARES)[1:-1]:
            between = goal.copy()
            between[:3, 3] = begin[:3, 3] + share * (goal[:3, 3] - begin[:3, 3])
            solution = self.model.joints_at(between, self.tool, joints)
            joints = joints if solution is None else solution
        return joints

    def _change_problem(self, q: Floats, previous: Floats) -> str | None:
        """Return the limit that joints or flange would break between two postures (n,) [rad] in a row; else None."""
        change = np.abs(q - previous)
        joint = int(np.argmax(change))
        if change[joint] > _MAX_CHANGE:
            return f"the arm would have to turn {self.model.joints[joint]} over"
        if change[joint] > _SPEED_SLACK * self.joint_speed * _STEP:
            pace = f"{math.degrees(change[joint] / _STEP):.0f} deg/s"
            return f"{self.model.joints[joint]} would turn at {pace}, over {math.degrees(self.joint_speed):g} deg/s"
        ends = [self.model.flange(joints.tolist())[0][:3, 3] for joints in (previous, q)]
        flange_speed = math.dist(*ends) / _STEP
        if flange_speed > _SPEED_SLACK * self.speed:
            return f"the flange would move at {_MM * flange_speed:.0f} mm/s, over {_MM * self.speed:g} mm/s"
        return None

    def _posture_problem(self, q: Floats) -> str | None:
        """Return why the arm must not take a posture (n,) [rad]: ends, a singular one, its links; None where it may."""
        if (text := self.model.end_of(q.tolist())) is not None:
            return text
        _, jacobian, places = self.model.tip_and_places(q.tolist(), self.tool)
        if is_singular(jacobian):
            return SINGULAR
        low, high = self.links
        for name, place in zip(self.model.place_names, places.tolist(), strict=True):
            if not all(lower <= x <= upper for x, lower, upper in zip(place, low, high, strict=True)):
                return f"the {name} would be out of the box of [device.*] links_low and links_high"
        return None

    def _goals(self, trajectory: Trajectory) -> Iterator[tuple[float, Floats]]:
        """Yield times [s] and poses (4, 4) in the base that differ from one another."""
        count = math.ceil(duration_of(trajectory) / _STEP) + 1
        last: tuple[Floats, Floats] | None = None
        for first in range(0, count, _BLOCK):
            times = np.minimum(np.arange(first, min(first + _BLOCK, count)) * _STEP, duration_of(trajectory))
            setpoint = setpoints_at(trajectory, times)
            rotation = np.zeros_like(setpoint.position) if setpoint.rotation is None else setpoint.rotation
            for time, place, turn in zip(times.tolist(), setpoint.position, rotation, strict=True):
                if (
                    last is not None
                    and math.dist(place, last[0]) < _SAME_PLACE
                    and math.dist(turn, last[1]) < _SAME_TURN
                ):
                    continue
                last = place, turn
                # The turn is about the axes of the work frame.
                pose = self.work.tool_pose(place)
                axes = self.work.matrix[:3, :3]
                pose[:3, :3] = axes @ rotation_matrix(turn.tolist()) @ axes.T @ pose[:3, :3]
                yield time, pose

    def _words(self, time: float, goal: Floats) -> str:
        """Return the place of a pose (4, 4) in the base, and its time [s], in words."""
        place = self.work.matrix[:3, :3].T @ (goal[:3, 3] - self.work.matrix[:3, 3])
        axes = ", ".join(f"{_MM * x:.1f}" for x in place)
        return f"the place ({axes}) mm in the work frame, {time:.1f} s after the start"

"""Whether an arm can do the whole of a motion: its joints at every place of it, before anything moves."""

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

_STEP = 0.02  # [s] between the setpoints that are looked at
_STRETCH = 5000  # of them at a time
_NEAR, _NEARLY = 0.2e-3, math.radians(0.2)  # [m], [rad] from the place before, within which nothing new is to be found
_FARTHEST = 0.5  # [rad] of a joint from one such place to the next; more is another way to hold the arm
_SLACK = 1.05


@dataclass(frozen=True)
class ArmReach:
    """An arm in its work, and where it stands."""

    model: ArmModel
    tool: Floats  # (4, 4) tip on the flange
    work: WorkFrame
    joint_speed: float  # [rad/s] at most
    speed: float  # [m/s] of the flange at most, which swings when the tool turns
    links: tuple[tuple[float, ...], tuple[float, ...]]  # corners (3,) [m] of the box of elbow, wrist and flange
    joints: Floats  # (n,) [rad]

    def refuse(self, trajectory: Trajectory) -> None:
        """Raise DeviceError with the first place of a motion at which the arm cannot be, or is near a singular posture.

        Each posture is found from the one before by Newton's method, from where the arm stands.
        """
        q: Floats | None = None
        for time, goal in self._goals(trajectory):
            begin = self._on_the_way(self.joints, goal) if q is None else q
            found, where = self.model.joints_at(goal, self.tool, begin), self._words(time, goal)
            if found is None:
                raise DeviceError(f"{where}: it is out of the arm's reach")
            problem = self._posture_problem(found) or (None if q is None else self._change_problem(found, q))
            if problem is not None:
                raise DeviceError(f"{where}: {problem}")
            q = found

    def _on_the_way(self, joints: Floats, goal: Floats) -> Floats:
        """Joints on a straight way to the first place, so that it is reached without another posture."""
        here = self.model.tip(joints.tolist(), self.tool)[0]
        for share in np.linspace(0.0, 1.0, 9)[1:-1]:
            between = goal.copy()
            between[:3, 3] = here[:3, 3] + share * (goal[:3, 3] - here[:3, 3])
            found = self.model.joints_at(between, self.tool, joints)
            joints = joints if found is None else found
        return joints

    def _change_problem(self, q: Floats, before: Floats) -> str | None:
        """Of two places that follow one another: how fast joints and flange would be."""
        change = np.abs(q - before)
        joint = int(np.argmax(change))
        if change[joint] > _FARTHEST:
            return f"the arm would have to turn {self.model.joints[joint]} over"
        if change[joint] > _SLACK * self.joint_speed * _STEP:
            pace = f"{math.degrees(change[joint] / _STEP):.0f} deg/s"
            return f"{self.model.joints[joint]} would turn at {pace}, over {math.degrees(self.joint_speed):g} deg/s"
        ends = [self.model.flange(joints.tolist())[0][:3, 3] for joints in (before, q)]
        if (pace_of_flange := math.dist(*ends) / _STEP) > _SLACK * self.speed:
            return f"the flange would move at {1e3 * pace_of_flange:.0f} mm/s, over {1e3 * self.speed:g} mm/s"
        return None

    def _posture_problem(self, q: Floats) -> str | None:
        if (text := self.model.end_of(q.tolist())) is not None:
            return text
        _, jacobian, places = self.model.tip_and_places(q.tolist(), self.tool)
        if is_singular(jacobian):
            return SINGULAR
        low, high = self.links
        for name, place in zip(self.model.place_names, places.tolist(), strict=True):
            if not all(least <= x <= most for x, least, most in zip(place, low, high, strict=True)):
                return f"the {name} would be out of the box of [device.*] links_low and links_high"
        return None

    def _goals(self, trajectory: Trajectory) -> Iterator[tuple[float, Floats]]:
        """Times [s] and poses (4, 4) in the base that differ from one another."""
        count = math.ceil(duration_of(trajectory) / _STEP) + 1
        last: tuple[Floats, Floats] | None = None
        for first in range(0, count, _STRETCH):
            times = np.minimum(np.arange(first, min(first + _STRETCH, count)) * _STEP, duration_of(trajectory))
            setpoint = setpoints_at(trajectory, times)
            rotation = np.zeros_like(setpoint.position) if setpoint.rotation is None else setpoint.rotation
            for time, place, turn in zip(times.tolist(), setpoint.position, rotation, strict=True):
                if last is not None and math.dist(place, last[0]) < _NEAR and math.dist(turn, last[1]) < _NEARLY:
                    continue
                last = place, turn
                pose = self.work.tool_pose(place)
                axes = self.work.matrix[:3, :3]
                pose[:3, :3] = axes @ rotation_matrix(turn.tolist()) @ axes.T @ pose[:3, :3]
                yield time, pose

    def _words(self, time: float, goal: Floats) -> str:
        place = self.work.matrix[:3, :3].T @ (goal[:3, 3] - self.work.matrix[:3, 3])
        axes = ", ".join(f"{1e3 * x:.1f}" for x in place)
        return f"the place ({axes}) mm in the work frame, {time:.1f} s after the start"

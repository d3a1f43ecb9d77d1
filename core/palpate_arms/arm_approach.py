"""The way of an arm to the first setpoint of a motion, and why it may not go there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from palpate import ArmLimits, DeviceError, Floats, Setpoint, Trajectory, setpoints_at, surface_of, surface_points
from palpate_kit.kinematics.arm_model import ArmModel, inverse_of
from palpate_kit.kinematics.rotations import rotation_matrix
from palpate_kit.kinematics.work_frame import WorkFrame, agreement

from palpate_arms.arm_settings import ArmSettings
from palpate_arms.arm_states import ArmStates
from palpate_arms.posture_fence import SINGULAR, is_singular
from palpate_arms.reach import ArmReach
from palpate_arms.servo_law import ServoLaw, straight_path
from palpate_arms.station_plane import LEVEL, StationPlane
from palpate_arms.tool_turns import tool_turn, turn_after, turn_from_to

_NO_TURN = 1e-12  # [rad], in place of 0 in a quotient

_END_MARGIN = math.radians(3.0)  # a choice: nearer to its end a joint has no room for the way
_MM = 1e3  # per metre


class ArmApproach:
    """The way from where an arm stands to where a motion begins; methods raise DeviceError, with the arm's title."""

    def __init__(self, settings: ArmSettings, states: ArmStates, model: ArmModel, tool: Floats) -> None:
        self._settings, self._states = settings, states
        self._model, self._tool = model, tool
        self._station: FirstStation | None = None  # of the motion that is about to be made
        self._reached: Trajectory | None = None  # the motion whose places were checked

    @property
    def plane(self) -> StationPlane:
        """The plane of the first station; level as long as none is known."""
        return LEVEL if self._station is None else self._station.plane

    @property
    def place(self) -> Floats:
        """The place (3,) [m] of the tip in the work frame."""
        if self._states.position is None:
            raise self._error("the arm's position is unknown")
        return self._states.position

    def path(self, trajectory: Trajectory, limits: ArmLimits | None) -> tuple[Floats, Setpoint]:
        """Return times (n,) [s] and setpoints of the way from the tip to the first station of a motion.

        The `limits` bound its speeds, where there are any. Raises DeviceError for a way that the arm must not go, and
        for a motion that it cannot follow.
        """
        # The tip is near the start, and the arm in a posture that it may leave.
        settings, position, rotation = self._settings, self.place, self._states.rotation
        station = FirstStation.of(trajectory, settings.work)
        distance = float(np.linalg.norm(station.place - position))
        if distance > settings.start_tolerance:
            place = ", ".join(f"{_MM * x:.1f}" for x in position)
            raise self._error(
                f"the tip is at ({place}) mm in the work frame, {_MM * distance:.1f} mm from where the "
                f"motion starts; bring it within {_MM * settings.start_tolerance:g} mm by hand"
            )
        if (text := self._posture_problem()) is not None:
            raise self._error(text)
        # The limits bound the way, and decide whether the arm can follow the motion at all.
        law = settings.law
        if limits is not None:
            self._refuse_turn(station, limits)
            law = replace(law, approach_speed=min(law.approach_speed, limits.speed))
            law = replace(law, angular_speed=limits.angular_speed)
            self._refuse_fast_retraction(station, limits)
        if station.turn is not None and self._reached is not trajectory:
            self._refuse_unreachable(trajectory, math.inf if limits is None else limits.speed)
        self._station = station
        return start_path(station, position, rotation, law, settings.work)

    def _refuse_turn(self, station: FirstStation, limits: ArmLimits) -> None:
        """Raise where the tool is turned too far from how the motion begins."""
        work, rotation = self._settings.work, self._states.rotation
        # From the first normal, or without one from the work frame.
        turn, advice = agreement(work, rotation)
        reference = "the work frame's orientation"
        if station.turn is not None:
            turn = float(np.linalg.norm(station.turn_from(work, rotation)))
            reference, advice = "the normal of the first place", "turn it to the normal of the first place by hand"
        if turn > limits.orientation:
            raise self._error(
                f"the tool is turned by {math.degrees(turn):.1f} deg from {reference}, "
                f"more than [safety] orientation = {math.degrees(limits.orientation):g} deg; {advice}"
            )

    def _refuse_fast_retraction(self, station: FirstStation, limits: ArmLimits) -> None:
        """Raise DeviceError where a joint is too slow for a retraction that is faster than the motion."""
        settings, speed = self._settings, limits.retract_speed
        if speed <= limits.speed:
            return
        # Joint speeds of the tip along the normal, by the inverse of the Jacobian.
        normal = settings.work.matrix[:3, :3] @ station.plane.normal
        jacobian = self._model.tip(self._states.joints, self._tool)[1]
        speeds = np.abs(inverse_of(jacobian)[:, :3] @ (speed * normal))
        joint = int(np.argmax(speeds))
        if speeds[joint] > settings.joint_speed:
            raise self._error(
                f"at [safety] retract_speed = {_MM * speed:g} mm/s {self._model.joints[joint]} would turn at "
                f"{math.degrees(speeds[joint]):.0f} deg/s, over joint_speed = {math.degrees(settings.joint_speed):g} "
                "deg/s: lower it, raise joint_speed, or bring the arm into another posture"
            )

    def _posture_problem(self) -> str | None:
        """Return why the arm must not set out from the posture in which it stands; None where it may."""
        model, joints = self._model, self._states.joints
        for joint, angle, low, high in zip(model.joints, joints, model.low, model.high, strict=True):
            if not low + _END_MARGIN <= angle <= high - _END_MARGIN:
                end = low if angle < low + _END_MARGIN else high
                return (
                    f"{joint} is at {math.degrees(angle):.0f} deg, near its end at {math.degrees(end):.0f} deg: bring "
                    "the arm into another posture"
                )
        return SINGULAR if is_singular(model.tip(joints, self._tool)[1]) else None

    def _refuse_unreachable(self, trajectory: Trajectory, speed: float) -> None:
        """Raise where the arm cannot go through all of a motion on which the tool turns."""
        settings = self._settings
        links, joints = (settings.links_low, settings.links_high), np.array(self._states.joints)
        reach = ArmReach(self._model, self._tool, settings.work, settings.joint_speed, speed, links, joints)
        try:
            reach.refuse(trajectory)
        except DeviceError as error:
            raise self._error(str(error)) from error
        self._reached = trajectory

    def _error(self, text: str) -> DeviceError:
        """Return an error with the arm's title."""
        return DeviceError(f"{self._settings.title}: {text}")


@dataclass(frozen=True)
class FirstStation:
    """The place at which a motion begins, and the plane of the skin below."""

    place: Floats  # (3,) [m]
    turn: Floats | None  # (3,) of the tool, in its frame; None where it keeps the work frame's orientation
    plane: StationPlane

    @classmethod
    def of(cls, trajectory: Trajectory, work: WorkFrame) -> FirstStation:
        """Return the first station of a motion; raises ConfigurationError where a surface is not known below it."""
        first, surface = setpoints_at(trajectory, np.zeros(1)), surface_of(trajectory)
        place, turn = first.position[0], None if first.rotation is None else work.axes_in_tool @ first.rotation[0]
        if surface is None:
            return cls(place, turn, LEVEL)
        points = surface_points(surface, place[None])
        return cls(place, turn, StationPlane(points.position[0], points.normal[0]))

    def turn_from(self, work: WorkFrame, rotation: Floats) -> Floats:
        """Return the turn (3,) that a tool (3, 3) in the base has still to make, in its own frame."""
        return turn_from_to(tool_turn(work, rotation), np.zeros(3) if self.turn is None else self.turn)


def start_path(
    station: FirstStation, position: Floats, rotation: Floats, law: ServoLaw, work: WorkFrame
) -> tuple[Floats, Setpoint]:
    """Return times (n,) [s] and setpoints of the straight way from a position (3,) [m] to the first station.

    The tool has a `rotation` (3, 3) in the base at its begin, and that of the station at its end, where it states one;
    the `law` bounds speeds and acceleration.
    """
    # A straight way that lasts long enough for the turn as well.
    remaining_turn = station.turn_from(work, rotation)
    angle = float(np.linalg.norm(remaining_turn))
    path = straight_path(position, station.place, law, angle)
    # Axis and turns in the work frame; the turn begins with that of the tool now.
    begin, to_work = tool_turn(work, rotation), work.axes_in_tool.T
    axis = to_work @ rotation_matrix(begin.tolist()) @ (remaining_turn / max(angle, _NO_TURN))
    turns = None
    if station.turn is not None:
        shares = (1.0 - path.remaining_turn).tolist()
        turns = np.array([to_work @ turn_after(begin, remaining_turn * share) for share in shares])
    measuring = np.zeros(len(path.times), bool)
    turning = path.turning[:, None] * axis
    return path.times, Setpoint(path.position, path.velocity, measuring, turns, turning, law.lever)

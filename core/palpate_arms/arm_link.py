"""A connected arm, as the host sees it: a process that servoes, and its reports."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import typer
from palpate import (
    ArmLimits,
    Batch,
    ConfigurationError,
    DeviceError,
    Floats,
    ForceControlled,
    ForceLaw,
    ForceWatch,
    Setpoint,
    SharedReadings,
    Trajectory,
    clock,
    epoch_offset,
    surface_of,
)
from palpate_kit.acquisition.child import Child
from palpate_kit.acquisition.device_clock import ClockMap
from palpate_kit.acquisition.ring import HEAD, ROWS, integers
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import matrix_of, quaternion
from palpate_kit.kinematics.work_frame import agreement

from palpate_arms.arm_rows import RETRACT, STOP
from palpate_arms.arm_settings import ArmSettings
from palpate_arms.fence import SINGULAR, is_singular
from palpate_arms.force_control import refusal
from palpate_arms.lateness import lateness_table
from palpate_arms.reach import ArmReach
from palpate_arms.servo import ServoLaw, straight_path
from palpate_arms.setpoint_buffer import PERIOD, write_setpoints
from palpate_arms.start_path import FirstStation, start_path
from palpate_arms.station_plane import LEVEL

_RATE_SLACK = 0.02  # of it
_POLL = 0.006  # [s]
_BEAT_SLACK = 0.02  # [s]
_SHORTEST_RETREAT = 0.1e-3  # [m]
_FROM_END = math.radians(3.0)  # from which a joint has no room for the way
_DELAY = 0.045  # [s] of states and commands besides the lag
_HEARD = 0.02  # [s] until the servo process has heard of it


def other_rate(rate: float, usual: float) -> str | None:
    """What is said of a controller that sends its state at a rate [Hz] other than the usual; None where it does not."""
    if abs(rate - usual) <= _RATE_SLACK * usual:
        return None
    return (
        f"the controller sends its state at {rate:.0f} Hz in place of {usual:.0f} Hz: the motion is timed by the clock "
        "and recorded more coarsely"
    )


class ArmLink:
    """A connected arm, with limits, retreat, approach, force control, and a report of its health."""

    def __init__(self, settings: ArmSettings, child: Child, identity: dict[str, Any]) -> None:
        self._settings, self._child = settings, child
        self._clock, self._rows = ClockMap(), settings.rows
        self._tool = np.array(identity.pop("tool")).reshape(4, 4)
        self._model = ArmModel.model_validate(identity.pop("arm_model"))
        self._identity = identity
        row = self._rows.row
        self._pose, self._twist = row.span("position", "rotation"), row.span("velocity", "turning")
        self._position: Floats | None = None
        self._joints: list[float] = []  # the latest
        self._rotation = np.eye(3)  # of the tool in the base, the latest
        self._limits: ArmLimits | None = None
        self._stop_force: float | None = None
        self._trip: Callable[[str], None] | None = None
        self._stopped: dict[str, Any] = {}  # why it stopped by itself, and when
        self._turned = np.array([1.0, 1e-3, 1e-6, 1e-9])  # the first quaternion's largest part is positive
        self._states = 0
        usual = 1.0 / PERIOD
        self._other_rate = other_rate(identity.get("state_rate", usual), usual)
        if self._other_rate is not None:
            typer.echo(f"{child.name}: {self._other_rate}", err=True)
        self._first = self._last = 0
        self._lag: float | None = None  # [s] that was seen
        self._mismatch = 0.0
        self._station: FirstStation | None = None  # of the motion that is about to be made
        self._reached: Trajectory | None = None  # the motion whose places were looked at

    @property
    def model(self) -> ArmModel:
        """The kinematic model, as the arm's process has it."""
        return self._model

    @property
    def tool(self) -> Floats:
        """The tip on the flange (4, 4), as the arm's process has it."""
        return self._tool

    def limit(self, limits: ArmLimits, trip: Callable[[str], None]) -> None:
        """Keep these limits from now on; see `palpate.SupportsLimits`."""
        self._limits, self._trip = limits, trip
        self._child.tell("limits", **asdict(limits))

    def watch_force(self, watch: ForceWatch) -> None:
        """Stop by itself at a force; see `palpate.SupportsLimits`."""
        readings = asdict(watch.readings)
        facts = {"channels": watch.channels, "tare": watch.tare, "stop": watch.stop, "name": watch.name}
        facts |= {"normal": watch.normal, "sign": watch.sign, "ranges": watch.ranges, "age": watch.reading_age}
        facts |= {"torques": watch.torques, "torque_tare": watch.torque_tare, "torque": watch.torque}
        facts["sound"] = None if watch.sound is None else asdict(watch.sound)
        facts["repeats"] = None if watch.repeats is None else asdict(watch.repeats)
        self._stop_force = watch.stop
        self._child.hand_over("watch", readings.pop("descriptor"), **readings, **facts)

    def shared(self, stream: str) -> SharedReadings | None:
        """See `palpate.SupportsSharing`: the robot's own wrench."""
        if stream != "robot_wrench":
            return None
        row = self._rows.row
        places = row.size, row["force"].start, row.at("host"), row.at("controller")
        return SharedReadings(self._child.memory, HEAD, ROWS, *places, tick=1)

    def refuse_law(self, law: ForceLaw) -> None:
        """See `palpate.SupportsForceControl`; the process that sends the commands asks again."""
        limits = self._limits
        if limits is None:
            raise ConfigurationError(f"{self._child.name}: force control needs the limits of [safety]")
        text = refusal(law, self._stop_force, limits.speed, limits.acceleration, law.end)
        if text is not None:
            raise ConfigurationError(f"{self._child.name}: {text}")

    def retreat(self, way: float, speed: float) -> float:
        """Go outwards by at most so much; see `palpate.SupportsRetreat`."""
        place = self._known_place()
        if self._limits is not None:
            way = min(way, self._limits.high[2] - float(place[2]))
        if way < _SHORTEST_RETREAT:
            raise DeviceError(
                f"{self._child.name}: the tip is at the top of the workspace, at {1e3 * place[2]:.1f} mm: no "
                "room for the retreat that checks whether it is free; bring it down by hand or raise [safety] high"
            )
        plane = LEVEL if self._station is None else self._station.plane
        self._child.tell("retreat", way=way, speed=speed, foot=plane.foot.tolist(), normal=plane.normal.tolist())
        law = ServoLaw("servo", 0.0, 0.0, speed, speed, self._settings.acceleration)
        return float(self._way_of(place, place + way * plane.normal, law))

    @staticmethod
    def _way_of(begin: Floats, end: Floats, law: ServoLaw) -> float:
        return float(straight_path(begin, end, law).times[-1]) + _HEARD

    def _known_place(self) -> Floats:
        if self._position is None:
            raise DeviceError(f"{self._child.name}: the arm's position is unknown")
        return self._position

    def approach_path(self, trajectory: Trajectory) -> tuple[Floats, Setpoint]:
        """The way to the first setpoint; see `palpate.SupportsApproach`."""
        name, settings, position = self._child.name, self._settings, self._known_place()
        station = FirstStation.of(trajectory, settings.work)
        start = station.place
        away = float(np.linalg.norm(start - position))
        if away > settings.start_tolerance:
            here = ", ".join(f"{1e3 * x:.1f}" for x in position)
            raise DeviceError(
                f"{name}: the tip is at ({here}) mm in the work frame, {1e3 * away:.1f} mm from where the "
                f"motion starts; bring it within {1e3 * settings.start_tolerance:g} mm by hand"
            )
        if (text := self._posture_problem()) is not None:
            raise DeviceError(f"{name}: {text}")
        turn, advice = agreement(settings.work, self._rotation)
        if station.turn is not None:
            turn = float(np.linalg.norm(station.turn_from(settings.work, self._rotation)))
            advice = "turn it to the normal of the first place by hand"
        law = settings.law
        if self._limits is not None:
            if turn > self._limits.orientation:
                wanted = "the work frame's orientation" if station.turn is None else "the normal of the first place"
                raise DeviceError(
                    f"{name}: the tool is turned by {math.degrees(turn):.1f} deg from {wanted}, "
                    f"more than [safety] orientation = {math.degrees(self._limits.orientation):g} deg; {advice}"
                )
            law = replace(law, approach_speed=min(law.approach_speed, self._limits.speed))
            law = replace(law, angular_speed=self._limits.angular_speed)
        if station.turn is not None and self._reached is not trajectory:
            self._refuse_unreachable(trajectory)
        self._station = station
        return start_path(station, position, self._rotation, law, settings.work)

    def _posture_problem(self) -> str | None:
        """Why the arm must not set out from the posture in which it stands; None where it may."""
        model, slack = self._model, _FROM_END
        for joint, angle, low, high in zip(model.joints, self._joints, model.low, model.high, strict=True):
            if not low + slack <= angle <= high - slack:
                where, end = (math.degrees(x) for x in (angle, low if angle < low + slack else high))
                return (
                    f"{joint} is at {where:.0f} deg, near its end at {end:.0f} deg: bring the arm into another posture"
                )
        return SINGULAR if is_singular(model.tip(self._joints, self._tool)[1]) else None

    def _refuse_unreachable(self, trajectory: Trajectory) -> None:
        """Raise DeviceError where the arm cannot go through all of a motion on which the tool turns."""
        settings = self._settings
        links, speed = (settings.links_low, settings.links_high), math.inf
        if self._limits is not None:
            speed = self._limits.speed
        reach = ArmReach(
            self._model, self._tool, settings.work, settings.joint_speed, speed, links, np.array(self._joints)
        )
        try:
            reach.refuse(trajectory)
        except DeviceError as error:
            raise DeviceError(f"{self._child.name}: {error}") from error
        self._reached = trajectory

    def follow(self, trajectory: Trajectory) -> None:
        """Go to the first setpoint, then follow them all."""
        self.approach_path(trajectory)  # refused where it is too far
        law = asdict(trajectory.force_law) if isinstance(trajectory, ForceControlled) else None
        if law is not None and surface_of(trajectory) is not None:
            raise ConfigurationError(
                f"{self._child.name}: a force leads along the work frame's normal, over no surface"
            )
        try:
            with write_setpoints(trajectory, self._settings.work.axes_in_tool) as (file, count):
                self._child.hand_over("follow", file.fileno(), rows=count, law=law)
        except OSError as error:
            raise DeviceError(
                f"{self._child.name}: no room for the setpoints of the motion in {tempfile.gettempdir()}: "
                f"{error.strerror}"
            ) from error

    def stop(self) -> None:
        """Stop where it is."""
        self._child.ring.head[STOP] = 1

    def retract(self) -> None:
        """Brake, and go back along the normal to where the motion began."""
        self._child.ring.head[RETRACT] = 1

    def batches(self) -> Iterator[Batch]:
        """The states as they come, until the motion is over; raises DeviceError as soon as the robot fails."""
        done = False
        early = self._child.ring.early()  # what came while other devices were connected
        host = integers(early, self._rows.row.at("host")) + epoch_offset()
        self._clock.to_host(integers(early, self._rows.row.at("controller")), host)
        while not done:
            for message in self._child.messages():
                if message["say"] == "done":
                    done, self._lag = True, message["lag"]
                if message["say"] == "limit":
                    self._has_stopped(message)
            rows = self._child.ring.read()
            yield from self._batches(rows)
            if not len(rows):
                self._child.check(self._settings.controller_timeout + _BEAT_SLACK)
            clock().sleep(_POLL)
        if self._stopped and self._trip is None:
            raise DeviceError(f"{self._child.name}: {self._stopped['reason']}")

    def _has_stopped(self, message: Mapping[str, Any]) -> None:
        """The servo process has stopped the motion on its own, with the reason."""
        if not self._stopped:
            self._stopped = {"reason": message["text"], "monotonic": message["at"] / 1e9}
        if self._trip is not None:
            self._trip(message["text"])

    def _batches(self, rows: Floats) -> Iterator[Batch]:
        received = integers(rows, self._rows.row.at("host")) + epoch_offset()
        controller = integers(rows, self._rows.row.at("controller"))
        stamps = self._clock.to_host(controller, received)
        pose, twist = self._kinematics(rows)
        if len(rows):
            self._position, self._joints = pose[-1, :3], rows[-1, self._rows.row["joints"]].tolist()
            self._rotation = matrix_of(rows[-1, self._pose].tolist())[:3, :3]
            self._first, self._last = self._first or int(controller[0]), int(controller[-1])
        self._states += len(rows)
        status = np.column_stack([controller / 1e9, rows[:, self._rows.row["status"]]])
        joints = rows[:, self._rows.row.span("joints", "joint_speeds")]
        columns = (pose, twist, joints, rows[:, self._rows.row["setpoint"]], rows[:, self._rows.row["force"]], status)
        for stream, values in zip(self._settings.streams, columns, strict=True):
            yield Batch(stream.name, stamps, received, np.ascontiguousarray(values))

    def _kinematics(self, rows: Floats) -> tuple[Floats, Floats]:
        """Pose (n, 7) and twist (n, 6) of the tip in the work frame."""
        work = self._settings.work.matrix
        turn = work[:3, :3].T
        pose, twist = np.empty((len(rows), 7)), np.empty((len(rows), 6))
        for i, row in enumerate(rows):
            matrix, speed = matrix_of(row[self._pose].tolist()), row[self._twist]
            if self._settings.kinematics == "dh" or i == 0:
                own, jacobian = self._model.tip(row[self._rows.row["joints"]].tolist(), self._tool)
                self._mismatch = max(self._mismatch, float(np.abs(own[:3, 3] - matrix[:3, 3]).max()))
                if self._settings.kinematics == "dh":
                    matrix, speed = own, jacobian @ row[self._rows.row["joint_speeds"]]
            turned = quaternion(turn @ matrix[:3, :3])
            # A tool that looks down is turned by about pi, where the sign of a quaternion is up to chance.
            turned = -turned if float(turned @ self._turned) < 0 else turned
            pose[i, :3], pose[i, 3:], self._turned = turn @ (matrix[:3, 3] - work[:3, 3]), turned, turned
            twist[i, :3], twist[i, 3:] = turn @ speed[:3], turn @ speed[3:]
        return pose, twist

    @property
    def attended(self) -> int:
        """When the arm's process last looked for a state [ns]."""
        return self._child.ring.last_beat() + epoch_offset()

    def _late(self) -> str | None:
        """What is said of an arm that is farther behind its commands than is stated; None where it is not."""
        stated = self._settings.command_lag
        if self._lag is None or self._lag <= stated + _DELAY:
            return None
        return (
            f"the arm follows its commands {1e3 * self._lag:.0f} ms late, and {1e3 * stated:.0f} ms are stated: the "
            "limit of its distance from a command was made of that"
        )

    @property
    def health(self) -> Mapping[str, Any]:
        """What was seen of the robot and of the loop."""
        expected = round((self._last - self._first) / 1e9 / PERIOD) + 1
        turn, _ = agreement(self._settings.work, self._rotation)
        return {
            **self._identity,
            **({"flags": {"device": text}} if (text := self._other_rate or self._late()) else {}),
            **({} if self._lag is None else {"lag_seen": self._lag}),
            **(
                {}
                if self._settings.controller_stiffness is None
                else {"controller_stiffness": self._settings.controller_stiffness}
            ),
            **({"own_stop": self._stopped} if self._stopped else {}),
            "tool_off_by_deg": math.degrees(turn),
            "states": self._states,
            "states_unseen": max(expected - self._states, 0),
            "commands": lateness_table(self._child.ring.head),
            "clock_wander": self._clock.wander,
            "clock_deviation": self._clock.deviation,
            "kinematics_mismatch": self._mismatch,
        }

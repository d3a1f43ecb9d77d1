"""A connected arm on the host's side: a process that servoes, and its reports."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import typer
from palpate import (
    RETREAT,
    RETREAT_SPEED,
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
    UnstoppedArmError,
    clock,
    epoch_offset,
    surface_of,
)
from palpate_engine import TouchSlope, touch_outlier_text
from palpate_kit.acquisition.child import Child
from palpate_kit.acquisition.ring import HEAD, ROWS
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.work_frame import agreement

from palpate_arms.arm_approach import ArmApproach
from palpate_arms.arm_lag import DELAY, deflection
from palpate_arms.arm_rows import RETRACT, STOP
from palpate_arms.arm_settings import ArmSettings
from palpate_arms.arm_states import ArmStates, low_rate
from palpate_arms.driver_time import shortfall_text
from palpate_arms.force_control import refusal
from palpate_arms.handshake_path import StatedArm, outward_path
from palpate_arms.lateness import lateness_table
from palpate_arms.servo_law import own_law, straight_path
from palpate_arms.setpoint_buffer import PERIOD, write_setpoints

# Choices.
_POLL = 0.006  # [s] between two looks at the ring: three states in one batch
_BEAT_SLACK = 0.02  # [s] beyond the controller's time-out, for the process to report what it has noticed itself
_SHORTEST_RETREAT = 0.1e-3  # [m]; a shorter one shows nothing
_HEARD = 0.02  # [s] until the servo process has received the order: it listens every 5 periods
_SECOND = 1e9  # [ns]
_MS = _MM = 1e3  # per second, per metre


class ArmLink:
    """A connected arm, with limits, retreat, approach, force control, and a report of its health."""

    def __init__(self, settings: ArmSettings, child: Child, identity: dict[str, Any]) -> None:
        """Take over tool and model from the facts that the arm's process reported; the others go to the result."""
        self._settings, self._child = settings, child
        self._tool = np.array(identity.pop("tool")).reshape(4, 4)
        self._model = ArmModel.model_validate(identity.pop("arm_model"))
        self._identity = identity
        self._states = ArmStates(settings, self._model, self._tool)
        self._approach = ArmApproach(settings, self._states, self._model, self._tool)
        self._limits: ArmLimits | None = None
        self._stop_force: float | None = None
        self._trip: Callable[[str], None] | None = None
        self._stopped: dict[str, Any] = {}  # reason and time of a stop by itself
        usual = 1.0 / PERIOD  # [Hz] of states: one in each period of the servo loop
        self._low_rate = low_rate(identity.get("state_rate", usual), usual)
        if self._low_rate is not None:
            typer.echo(f"{child.name}: {self._low_rate}", err=True)
        # What its process reported at the end of a motion.
        self._lag: float | None = None  # [s]
        self._driver_time = 0.0  # [s] of each period that its driver takes
        self._stands = False  # 0.1 s of states have shown that the tip stands
        self._has_retreated = False
        self._answers: list[dict[str, float]] = []  # of the arm to its first commands
        self._touches: list[TouchSlope] = []  # of its motion

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
        row = self._settings.rows.row
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
        """Go outwards by at most a way [m] at a speed [m/s]; return the time [s] that takes.

        See `palpate.SupportsRetreat`; raises DeviceError where the workspace leaves no room for it.
        """
        place, plane = self._approach.place, self._approach.plane
        if self._limits is not None:
            way = min(way, self._limits.high[2] - float(place[2]))
        if way < _SHORTEST_RETREAT:
            raise DeviceError(
                f"{self._child.name}: the tip is at the top of the workspace, at {_MM * place[2]:.1f} mm: no "
                "room for the retreat that checks whether it is free; bring it down by hand or raise [safety] high"
            )
        if way <= self._settings.deadband:
            raise DeviceError(
                f"{self._child.name}: the workspace leaves {_MM * way:.2f} mm for the first retreat, and the arm's "
                f"deadband is {_MM * self._settings.deadband:g} mm: bring the tip down by hand or raise [safety] high"
            )
        # The first one of a connection is a handshake, which takes longer.
        self._child.tell("retreat", way=way, speed=speed, foot=plane.foot.tolist(), normal=plane.normal.tolist())
        law = own_law(speed, self._settings.acceleration)
        if self._has_retreated:
            return float(straight_path(place, place + way * plane.normal, law).times[-1]) + _HEARD
        self._has_retreated = True
        return outward_path(place, plane.normal, way, law, self._stated).duration + _HEARD

    @property
    def _stated(self) -> StatedArm:
        """The answer to a command that the settings state of the arm."""
        settings = self._settings
        return StatedArm(settings.command_lag, settings.deadband, settings.controller_stiffness is not None)

    def approach_path(self, trajectory: Trajectory) -> tuple[Floats, Setpoint]:
        """Return the way to the first setpoint; see `palpate.SupportsApproach`."""
        return self._approach.path(trajectory, self._limits)

    def follow(self, trajectory: Trajectory) -> None:
        """Have the arm go to the first setpoint of a motion, then follow them all; it goes on after this returns.

        Raises DeviceError or ConfigurationError for a motion that is refused.
        """
        self.approach_path(trajectory)  # refused where it is too far
        if not self._has_retreated:
            self.retreat(RETREAT, RETREAT_SPEED)  # the first motion of a connection shows that the arm obeys
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
        """Yield the states as they arrive, until the motion is over; raises DeviceError as soon as the robot fails."""
        is_over = False
        self._states.skip(self._child.ring.early())  # what came while other devices were connected
        while not is_over:
            for message in self._child.messages():
                is_over |= message["say"] == "done"
                self._take(message)
            rows = self._child.ring.read()
            yield from self._states.batches(rows)
            if not len(rows):
                self._check_child()
            clock().sleep(_POLL)
        if self._stopped and self._trip is None:
            raise DeviceError(f"{self._child.name}: {self._stopped['reason']}")

    def _take(self, message: Mapping[str, Any]) -> None:
        """Take over a message of the arm's process; raises UnstoppedArmError where a stopped arm does not stand."""
        match message["say"]:
            case "done":
                self._lag, self._driver_time = message["lag"], message["driver_time"]
                self._touches = [TouchSlope(**touch) for touch in message["touches"]]
            case "answers":
                self._answers += message["answers"]
            case "limit":
                self._has_stopped(message)
            case "failing":  # it is being stopped, which takes its time
                self._stop_others(message)
            case "fault":
                self._stands = bool(message["stands"])
                self._stop_others(message)
            case "astray":
                error = UnstoppedArmError(f"{self._child.name}: {message['text']}")
                error.speed = message["speed"]
                raise error

    def _stop_others(self, message: Mapping[str, Any]) -> None:
        """Let the guard know of a fault before the process has ended."""
        if self._trip is not None:
            self._trip(f"{self._child.name}: {message['text']}")

    def _check_child(self) -> None:
        """Raise DeviceError where the arm's process has failed; it knows whether the arm has come to rest."""
        try:
            self._child.check(self._settings.controller_timeout + _BEAT_SLACK)
        except DeviceError as error:
            error.arm_stands = self._stands
            raise

    def _has_stopped(self, message: Mapping[str, Any]) -> None:
        """Take over that the servo process has stopped the motion by itself, with the reason."""
        if not self._stopped:
            self._stopped = {"reason": message["text"], "monotonic": message["at"] / _SECOND}
        if self._trip is not None:
            self._trip(message["text"])

    @property
    def attended(self) -> int:
        """The time [ns] at which the arm's process last looked for a state."""
        return self._child.ring.last_beat() + epoch_offset()

    def _late(self) -> str | None:
        """Return the sentence on an arm that is farther behind its commands than is stated; None where it is not."""
        stated, limits = self._settings.command_lag, self._limits
        if self._lag is None or limits is None:
            return None
        # Beyond the stated lag: delays, and the deflection at the force that stops it, over the speed.
        give = deflection(self._stop_force or 0.0, self._settings.controller_stiffness)
        if self._lag <= stated + DELAY + give / limits.speed:
            return None
        return (
            f"the arm follows its commands {_MS * self._lag:.0f} ms late, and {_MS * stated:.0f} ms are stated: the "
            "limit of its distance from a command was made of that"
        )

    def _flags(self, commands: Mapping[str, Any]) -> dict[str, str]:
        """Return messages by the codes of flags."""
        lost = shortfall_text(commands["periods_lost"], commands["cycles"], commands.get("rate"), self._driver_time)
        device = filter(None, (self._low_rate or self._late(), touch_outlier_text(self._touches)))
        texts = {"device": "; ".join(device) or None, "lost-periods": lost}
        return {code: text for code, text in texts.items() if text is not None}

    @property
    def health(self) -> Mapping[str, Any]:
        """The facts of the robot and of the loop."""
        states, stiffness = self._states, self._settings.controller_stiffness
        # The angle [rad] between the tool and its orientation by the work frame.
        turn, _ = agreement(self._settings.work, states.rotation)
        commands = lateness_table(self._child.ring.head)
        return {
            **self._identity,
            **({"flags": flags} if (flags := self._flags(commands)) else {}),
            **({} if self._lag is None else {"lag_seen": self._lag}),
            **({"handshake": self._answers} if self._answers else {}),
            **({} if stiffness is None else {"controller_stiffness": stiffness}),
            **({"own_stop": self._stopped} if self._stopped else {}),
            "tool_off_by_deg": math.degrees(turn),
            "states": states.count,
            "states_unseen": states.unseen,
            "commands": commands,
            "clock_wander": states.clock.wander,
            "clock_deviation": states.clock.deviation,
            "kinematics_mismatch": states.mismatch,
        }

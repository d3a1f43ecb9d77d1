"""An arm in the process that commands it: its latest state, and commands in the work frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import Floats, clock
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import pose_of, rotation_matrix, rotation_vector
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.arm_driver import ArmDriver, ArmFaultError, ArmReading
from palpate_arms.arm_rows import ArmRows
from palpate_arms.arm_state import ArmState
from palpate_arms.driver_answer import reading_problem
from palpate_arms.driver_time import DriverTime
from palpate_arms.setpoint_buffer import PERIOD
from palpate_arms.tool_turns import tool_turn

# Choices.
_SWING, _FASTEST = 5e-3, 3.0  # [m], [m/s] of a tip: the largest arm that is driven reaches 2 m/s
_MIN_STATES = 10  # from which their rate is determined
_MAX_PERIOD = 0.01  # [s] between states; what an arm does meanwhile is not seen
_PERIOD_SLACK = 1.01  # times that, for an unsteady clock
_FIRST_STATE = 2.0  # [s] at most until the first state
_POSE_NUMBERS = 6  # a place and a rotation vector; a twist has as many


class CommandedArm:
    """A driver, and the state that it last gave; an arm that is observed is not commanded.

    Its constructor may take seconds, and raises what the driver raises; RuntimeError where no states come, or too few.
    """

    def __init__(self, driver: ArmDriver, rows: ArmRows, work: WorkFrame, observe: bool) -> None:
        """Connect the driver, and take the arm over unless that is only to `observe` it; raises what a driver raises.

        `rows` is the layout of the arm's states, `work` the frame of commands. Raises ArmFaultError for a driver of an
        arm with another number of joints.
        """
        self.driver, self.rows, self.observed, self._work = driver, rows, observe, work
        self._out, self._origin = work.matrix[:3, :3], work.matrix[:3, 3]  # from the work frame to the base
        # Turn of the latest command, and the tool's rotation vector in the base then.
        self._orientation: tuple[Floats, list[float]] | None = None
        self.driver_time = DriverTime()
        self.state_period = PERIOD  # [s] from one state to the next
        # The newest state: its time by the controller [s] and by the host [ns], and True if it came in this period.
        self.stamp, self.seen, self.fresh = -1.0, clock().now_ns(), False
        self.state: list[float] = []
        self.leap: float | None = None  # [m] between the last two states, where no arm moves so far
        if driver.model is not None and len(driver.model.joints) != rows.joints:
            raise ArmFaultError(
                f"its class has {rows.joints} `joint_names`, and its `arm_model` {len(driver.model.joints)} joints"
            )
        # Take the arm over, wait for its states, and see that it is the one that is meant.
        driver.connect(observe)
        self.reading = self._first_reading(0.0 if observe else driver.settle)
        driver.identify(self.reading)
        if not observe:
            driver.enable()

    @property
    def tool(self) -> Floats:
        """The tip on the flange (4, 4)."""
        return self.driver.tool

    @property
    def model(self) -> ArmModel:
        """The kinematic model."""
        assert self.driver.model is not None  # or `identify` has refused
        return self.driver.model

    def _first_reading(self, settle: float) -> ArmReading:
        """Return the first state once those of a time [s] have passed; raises RuntimeError without one."""
        deadline, began, stamps = clock().now() + _FIRST_STATE, clock().now(), list[float]()
        while not (fresh := self.poll()) or clock().now() - began < settle:
            if fresh:
                stamps.append(self.stamp)
            if clock().now() > deadline:
                raise RuntimeError("the controller sends no states")
            clock().sleep(PERIOD)
        if not math.isfinite(self.stamp):
            raise RuntimeError("the controller's time-stamp is not a number")
        self._note_rate(stamps)
        return self.reading

    def _note_rate(self, stamps: list[float]) -> None:
        """Note the rate of states by their time-stamps [s]; raises RuntimeError where it is too low to lead an arm."""
        if len(stamps) < _MIN_STATES:
            return
        period = float(np.median(np.diff(stamps)))
        self.driver.facts["state_rate"] = 1.0 / period
        if period > _PERIOD_SLACK * _MAX_PERIOD:
            raise RuntimeError(
                f"the controller sends its state at {1.0 / period:.0f} Hz; at least {1.0 / _MAX_PERIOD:.0f} Hz are "
                "needed"
            )
        self.state_period = max(period, PERIOD)

    def poll(self) -> bool:
        """Take over a new state; return False if there was none. Raises ArmFaultError for one that is malformed."""
        began = clock().now_ns()
        reading = self.driver.read()
        self.driver_time.add_read(began)
        if reading is None:
            return False
        if (text := reading_problem(reading, self.rows.joints, self.rows.status)) is not None:
            raise ArmFaultError(text)
        if reading.stamp == self.stamp:
            return False
        now = clock().now_ns() if reading.seen is None else reading.seen
        values = self._values(reading)
        self.leap = self._leap(reading.stamp, values)
        self.stamp, self.seen, self.state, self.reading, self.fresh = reading.stamp, now, values, reading, True
        return True

    def _values(self, reading: ArmReading) -> list[float]:
        """Return a state in the layout of `ArmRows.state`; what the controller does not send is by the joints."""
        pose, twist = reading.pose, reading.twist
        if pose is None or twist is None:
            model_pose, model_twist = self._by_joints(reading)
            pose = model_pose if pose is None else pose
            twist = model_twist if twist is None else twist
        return [*reading.joints, *reading.joint_speeds, *pose, *twist, *reading.wrench]

    def _by_joints(self, reading: ArmReading) -> tuple[list[float], list[float]]:
        """Return pose and twist (6,) of the tip in the base, by the kinematic model; NaN without finite joints."""
        if not all(map(math.isfinite, (*reading.joints, *reading.joint_speeds))):
            return [math.nan] * _POSE_NUMBERS, [math.nan] * _POSE_NUMBERS
        pose, jacobian = self.model.tip(list(reading.joints), self.tool)
        return pose_of(pose), (jacobian @ np.array(reading.joint_speeds)).tolist()

    @property
    def row(self) -> list[float]:
        """The state as it is recorded: of an arm that is observed by its joints, whatever tool its controller has."""
        if not self.observed:
            return self.state
        pose, twist = self._by_joints(self.reading)
        return [*self.reading.joints, *self.reading.joint_speeds, *pose, *twist, *self.reading.wrench]

    def _leap(self, stamp: float, values: list[float]) -> float | None:
        """Return how far [m] the tip is from its previous place, if that is farther than any arm moves."""
        if not self.state:
            return None
        place = self.rows.state["position"]
        way = math.dist(values[place], self.state[place])
        return way if way > _SWING + _FASTEST * abs(stamp - self.stamp) else None

    @property
    def is_number(self) -> bool:
        """True if joints, pose and speed are finite numbers."""
        return all(map(math.isfinite, self.state[self.rows.motion]))

    def look(self) -> ArmState:
        """Return the newest state; `fresh` if it arrived since the last look."""
        fresh, self.fresh = self.fresh, False
        return self._arm_state(fresh)

    @property
    def motion_state(self) -> ArmState:
        """The newest state, which stays fresh to the next look."""
        return self._arm_state(True)

    def _arm_state(self, fresh: bool) -> ArmState:
        """Return the newest state in the work frame."""
        inwards, state = self._out.T, self.rows.state
        rotation = rotation_matrix(self.state[state["rotation"]])
        velocity = inwards @ np.array(self.state[state["velocity"]])
        return ArmState(self.position, velocity, rotation, self.state[state["joints"]], fresh)

    @property
    def position(self) -> Floats:
        """The place (3,) [m] of the tip in the work frame."""
        return np.asarray(self._out.T @ (np.array(self.state[self.rows.state["position"]]) - self._origin))

    @property
    def pose(self) -> list[float]:
        """The pose of the tip in the base: [m] and rotation vector [rad], as the controller reports it."""
        return self.state[self.rows.pose]

    @property
    def base_place(self) -> Floats:
        """The place (3,) [m] of the tip in the base."""
        return np.array(self.state[self.rows.state["position"]])

    def target_of(self, position: Floats) -> Floats:
        """Return the place in the base (3,) [m] that is sent for a position in the work frame."""
        return np.asarray(self._origin + self._out @ position)

    def turn(self) -> Floats:
        """Return the rotation vector (3,) of the tool from its orientation by the work frame."""
        return tool_turn(self._work, rotation_matrix(self.state[self.rows.state["rotation"]]))

    def feed_watchdog(self) -> None:
        """Let the controller know, without a command, that this process lives; raises ArmFaultError if it cannot."""
        if not self.observed:
            self.driver.keep_alive()

    def servo(self, position: Floats, turn: Floats) -> bool:
        """Send the arm to a position in the work frame and a turn of the tool; True means sent, not done.

        Raises ArmFaultError where the link is lost.
        """
        target = self.target_of(position).tolist()
        # The rotation of a turn is computed once, as most motions keep it.
        if self._orientation is None or not np.array_equal(self._orientation[0], turn):
            rotation = rotation_vector(self._work.tool @ rotation_matrix(turn.tolist()))
            self._orientation = turn.copy(), rotation.tolist()
        self.driver.place = position
        began = clock().now_ns()
        is_sent = self.driver.send([*target, *self._orientation[1]])
        self.driver_time.add_send(began)
        if is_sent is None:
            raise ArmFaultError(
                "its driver's `send` returned None; expected True where the command was sent, else False"
            )
        return is_sent

    @property
    def facts(self) -> dict[str, Any]:
        """The facts of the robot, for the result."""
        return self.driver.facts

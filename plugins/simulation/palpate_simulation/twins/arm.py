"""An arm in software: joints that follow the commands of a program."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.arm_model import ArmModel, solve, tip_of
from palpate_kit.kinematics.rotations import matrix_of, pose_of, rotation_vector
from palpate_kit.kinematics.ur_arm import UR3E

TICK = 0.002  # [s] of a UR controller's loop, 500 Hz
# Joint accelerations [rad/s^2] of servoing, of stops, and of a path (choices: a real controller's are not published).
SERVO_ACCELERATION = 80.0
STOP_DECELERATION = 20.0
PATH_ACCELERATION = 4 * SERVO_ACCELERATION
MIN_DECELERATION = 0.01  # [rad/s^2]: a stop ends (a choice)
NOMINAL_GAIN = 300.0  # of servoing, at which the lag is half the lookahead (a choice)
PATH_LAG_TICKS = 1.5  # in which a joint reaches the next point of a path (a choice, without overshoot)
POSE_ERROR = 1e-8  # [m], [rad] of the joints for a pose (a choice: far below the noise of a pose)
INVERSE_STEPS = 15  # of the inverse kinematics (a choice): from a pose nearby few are needed
SETTLING_TICKS = 10  # at the end of a path (a choice)
MIN_MOVE_SPEED = 1e-4  # [rad/s] or [m/s] of a move (a choice): each ends
STANDSTILL_SPEED = 1e-4  # [rad/s] of the fastest joint, below which the arm is at rest (a choice)
MIN_LENGTH = 1e-12  # [rad] or [m] of a move, guards against a division by 0


@dataclass
class SimulatedArm:
    """Joints with speed and acceleration limits; acceleration is constant within a tick, so motion is smooth.

    Servoing is of first order in joint space with the time constant 0.5 lookahead 300/gain: a choice, since what the
    real controller does is not published.
    """

    q: Floats  # (n,) [rad] joint angles
    tcp: Floats = field(default_factory=lambda: np.eye(4))  # (4, 4) of the tip on the flange
    qd: Floats = field(default_factory=lambda: np.zeros(0))  # (n,) [rad/s]
    model: ArmModel = UR3E
    pace: float = 1.0  # of its speed, by the speed slider and the controller's own scaling
    jammed: bool = False  # it stands still, whatever is commanded
    brakes: float = math.inf  # [rad/s^2] by which its joints stop at most
    own_lag: float | None = None  # [s] of servoing, whatever a client commands
    stiffness: float = math.inf  # [N/m] by which servoing gives way
    push: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) [N] on the tip, in the base
    _mode: str = "hold"  # or servo, speed, move
    _target: Floats = field(default_factory=lambda: np.zeros(0))  # (n,) [rad] of servoing
    _lag: float = 0.05  # [s] of servoing
    _speed: Floats = field(default_factory=lambda: np.zeros(0))  # (n,) [rad/s] to hold
    _path: list[Floats] = field(default_factory=list)  # joint angles (n,) [rad], one for each tick
    _deceleration: float = STOP_DECELERATION
    _posture: tuple[Floats, Floats, Floats] | None = None  # joints, with pose and Jacobian of the flange
    _due_ticks: float = 0.0  # of a path, since its last point

    def __post_init__(self) -> None:
        """Begin at rest."""
        self.qd, self._target, self._speed = (np.zeros_like(self.q) for _ in range(3))

    def servo(self, q: Floats, lookahead: float, gain: float) -> None:
        """Follow joint angles (n,) [rad] with a lag of 0.5 lookahead [s] 300/gain."""
        self._mode, self._target = "servo", q
        self._lag = 0.5 * lookahead * NOMINAL_GAIN / gain if self.own_lag is None else self.own_lag

    def servo_to_pose(self, pose: list[float], lookahead: float, gain: float) -> bool:
        """Follow a pose (6,) of a UR; return False if it is out of reach or not finite."""
        q = self.inverse(pose, self._target if self._mode == "servo" else self.q)
        if q is None:
            return False
        self.servo(q, lookahead, gain)
        return True

    def inverse(self, pose: list[float], near: Floats | None = None) -> Floats | None:
        """Return the joint angles (n,) [rad] of a pose (6,), near others or the present ones; None out of reach."""
        if not all(map(math.isfinite, pose)):
            return None
        near = self.q if near is None else near
        return self.model.joints_at(matrix_of(pose), self.tcp, near, steps=INVERSE_STEPS, tolerance=POSE_ERROR)

    def move(self, q: Floats, speed: float, acceleration: float) -> None:
        """Go to joint angles (n,) [rad] on a straight line in joint space, with a trapezoid of speed."""
        displacement = q - self.q
        length = float(np.abs(displacement).max())
        lengths = trapezoid_lengths(length, speed, acceleration)
        self._mode = "move"
        self._path = [self.q + displacement * (s / max(length, MIN_LENGTH)) for s in lengths]

    def move_linear(self, pose: list[float], speed: float, acceleration: float) -> bool:
        """Go to a pose (6,) on a straight line; return False if part of the line is out of reach."""
        goal, start = matrix_of(pose), self.tip(self.tcp)[0]
        displacement = goal[:3, 3] - start[:3, 3]
        rotation = rotation_vector(goal[:3, :3] @ start[:3, :3].T)
        length = max(float(np.linalg.norm(displacement)), MIN_LENGTH)
        path: list[Floats] = []
        for s in trapezoid_lengths(length, speed, acceleration):
            position = start[:3, 3] + displacement * (s / length)
            matrix = matrix_of([*position.tolist(), *(rotation * (s / length)).tolist()])
            matrix[:3, :3] = matrix[:3, :3] @ start[:3, :3]
            # From the joints of the point before, so that the arm does not change its posture.
            q = self.model.joints_at(matrix, self.tcp, path[-1] if path else self.q, steps=INVERSE_STEPS)
            if q is None:
                return False
            path.append(q)
        self._mode, self._path = "move", path
        return True

    def run_at(self, speed: Floats) -> None:
        """Hold joint speeds (n,) [rad/s]."""
        self._mode, self._speed = "speed", speed

    def run_tip_at(self, twist: list[float]) -> bool:
        """Hold a tip speed (6,) [m/s], [rad/s]; return False if the arm is singular."""
        try:
            self.run_at(solve(self.tip(self.tcp)[1], np.array(twist)))
        except np.linalg.LinAlgError:
            return False
        return True

    def stop(self, deceleration: float = STOP_DECELERATION) -> None:
        """Come to rest with a deceleration of the joints [rad/s^2], or that of the brakes where it is less."""
        self._mode, self._path = "hold", []
        self._deceleration = max(min(deceleration, self.brakes), MIN_DECELERATION)

    @property
    def moving(self) -> bool:
        """True if a move is under way, or the arm has not come to rest."""
        return bool(self._path) or float(np.abs(self.qd).max()) > STANDSTILL_SPEED

    def tip(self, tool: Floats) -> tuple[Floats, Floats]:
        """Return pose (4, 4) and Jacobian (6, n) of the end of a tool (4, 4) on the flange, in the base."""
        if self._posture is None or self._posture[0] is not self.q:
            self._posture = self.q, *self.model.flange(self.q.tolist())
        return tip_of(*self._posture[1:], tool)

    @property
    def pose(self) -> list[float]:
        """Pose of the tip as UR's six numbers: position [m] and rotation vector [rad]."""
        return pose_of(self.tip(self.tcp)[0])

    def advance(self) -> None:
        """Advance by a tick, in which the acceleration of the joints is constant and limited."""
        target_speed, acceleration = self._target_speed()
        change = np.clip(target_speed - self.qd, -acceleration * TICK, acceleration * TICK)
        speed_before = self.qd
        self.qd = np.clip(speed_before + change, -self.model.speed_limits, self.model.speed_limits)
        self.q = self.q + 0.5 * TICK * (speed_before + self.qd)
        if self._mode == "move" and not self._path:
            self.stop()

    def _target_speed(self) -> tuple[Floats, float]:
        """Return the joint speeds (n,) [rad/s] that this tick should reach, and its largest acceleration [rad/s^2]."""
        speed, acceleration = np.zeros_like(self.q), self._deceleration
        if self._mode == "servo":
            # The part of the way that a lag of first order leaves in a tick.
            rate = (1.0 - math.exp(-self.pace * TICK / self._lag)) / TICK
            speed, acceleration = (self._target + self._compliance() - self.q) * rate, SERVO_ACCELERATION
        elif self._mode == "speed":
            speed, acceleration = self._speed * self.pace, SERVO_ACCELERATION
        elif self._mode == "move" and self._path:
            target = self._path.pop(0) if self._is_point_due() else self._path[0]
            speed = (target - self.q) * (self.pace / (PATH_LAG_TICKS * TICK))
            acceleration = PATH_ACCELERATION
        if self.jammed:
            return np.zeros_like(self.q), PATH_ACCELERATION
        return speed, acceleration

    def _compliance(self) -> Floats | float:
        """Return the joint angles (n,) [rad] by which the arm gives way to the force on its tip."""
        if math.isinf(self.stiffness):
            return 0.0
        return solve(self.tip(self.tcp)[1], np.concatenate([self.push / self.stiffness, np.zeros(3)]))

    def _is_point_due(self) -> bool:
        """Return True if the next point of a path is due: in each tick at full pace, less often at a lower one."""
        self._due_ticks += self.pace
        is_due = self._due_ticks >= 1.0
        self._due_ticks -= is_due
        return is_due


def trapezoid_lengths(length: float, speed: float, acceleration: float) -> list[float]:
    """Return the lengths [m] or [rad] covered at each tick of a move of a length, with a trapezoid of speed.

    A move too short for the speed has a triangle. The last ticks repeat the length, for the arm to settle.
    """
    speed = min(max(speed, MIN_MOVE_SPEED), math.sqrt(length * acceleration)) if length > 0 else MIN_MOVE_SPEED
    ramp = speed / acceleration  # [s]
    duration = length / speed + ramp
    lengths = []
    for tick in range(1, math.ceil(duration / TICK) + SETTLING_TICKS + 1):
        t = min(tick * TICK, duration)
        if t < ramp:
            lengths.append(0.5 * acceleration * t * t)
        elif t > duration - ramp:
            lengths.append(length - 0.5 * acceleration * (duration - t) ** 2)
        else:
            lengths.append(speed * (t - 0.5 * ramp))
    return lengths

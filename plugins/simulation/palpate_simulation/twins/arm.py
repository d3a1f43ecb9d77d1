"""An arm in software: joints that follow the commands of a program."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.arm_model import ArmModel, solve, tip_of
from palpate_kit.kinematics.rotations import matrix_of, pose_of, rotation_vector
from palpate_kit.kinematics.ur_arm import UR3E

TICK = 0.002  # [s]
_ACCELERATION = 80.0  # [rad/s^2]; what servoing may ask of a joint
_STOPPING = 20.0  # [rad/s^2]
_NEAR = 1e-8  # [m], [rad] of a pose to the one that was asked for


@dataclass
class SimulatedArm:
    """Joints with speed and acceleration limits; acceleration is constant within a tick, so motion is smooth.

    Servoing is of first order in joint space with the time constant 0.5 lookahead 300/gain: a choice, since what the
    real controller does is not published.
    """

    q: Floats
    tcp: Floats = field(default_factory=lambda: np.eye(4))
    qd: Floats = field(default_factory=lambda: np.zeros(0))
    model: ArmModel = UR3E
    pace: float = 1.0  # of what it does, as of the speed slider and the controller's own scaling
    jammed: bool = False  # it stands still, whatever is commanded
    brakes: float = math.inf  # [rad/s^2] by which its joints stop at most
    own_lag: float | None = None  # [s] of servoing, whatever a client asks for
    stiffness: float = math.inf  # [N/m] by which servoing gives way
    push: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) [N] on the tip, in the base
    _mode: str = "hold"
    _target: Floats = field(default_factory=lambda: np.zeros(0))
    _lag: float = 0.05
    _speed: Floats = field(default_factory=lambda: np.zeros(0))
    _path: list[Floats] = field(default_factory=list)
    _deceleration: float = _STOPPING
    _posture: tuple[Floats, Floats, Floats] | None = None  # joints, and what `flange` gives for them
    _due: float = 0.0  # steps of a path

    def __post_init__(self) -> None:
        self.qd, self._target, self._speed = (np.zeros_like(self.q) for _ in range(3))

    def servo(self, q: Floats, lookahead: float, gain: float) -> None:
        """Follow joint angles."""
        self._mode, self._target = "servo", q
        self._lag = 0.5 * lookahead * 300.0 / gain if self.own_lag is None else self.own_lag

    def servo_to_pose(self, pose: list[float], lookahead: float, gain: float) -> bool:
        """Follow a pose; False where it is out of reach or no pose at all."""
        q = self.inverse(pose, self._target if self._mode == "servo" else self.q)
        if q is None:
            return False
        self.servo(q, lookahead, gain)
        return True

    def inverse(self, pose: list[float], near: Floats | None = None) -> Floats | None:
        """Joint angles for a pose, those nearest to the present ones."""
        if not all(map(math.isfinite, pose)):
            return None
        near = self.q if near is None else near
        return self.model.joints_at(matrix_of(pose), self.tcp, near, steps=15, tolerance=_NEAR)

    def move(self, q: Floats, speed: float, acceleration: float) -> None:
        """Go to joint angles on a straight line in joint space, with a trapezoid of speed."""
        way = q - self.q
        length = float(np.abs(way).max())
        steps = _trapezoid(length, speed, acceleration)
        self._mode, self._path = "move", [self.q + way * (s / max(length, 1e-12)) for s in steps]

    def move_linear(self, pose: list[float], speed: float, acceleration: float) -> bool:
        """Go to a pose on a straight line; False where part of it is out of reach."""
        goal, start = matrix_of(pose), self.tip(self.tcp)[0]
        way = goal[:3, 3] - start[:3, 3]
        turn = rotation_vector(goal[:3, :3] @ start[:3, :3].T)
        length = max(float(np.linalg.norm(way)), 1e-12)
        steps = _trapezoid(length, speed, acceleration)
        path, q = [], self.q
        for s in steps:
            at = [*(start[:3, 3] + way * (s / length)).tolist(), 0.0, 0.0, 0.0]
            matrix = matrix_of([*at[:3], *(turn * (s / length)).tolist()])
            matrix[:3, :3] = matrix[:3, :3] @ start[:3, :3]
            found = self.model.joints_at(matrix, self.tcp, q, steps=15)
            if found is None:
                return False
            q = found
            path.append(q)
        self._mode, self._path = "move", path
        return True

    def run_at(self, speed: Floats) -> None:
        """Hold a joint speed [rad/s]."""
        self._mode, self._speed = "speed", speed

    def run_tip_at(self, twist: list[float]) -> bool:
        """Hold a tip speed; False where the arm is singular."""
        try:
            self.run_at(solve(self.tip(self.tcp)[1], np.array(twist)))
        except np.linalg.LinAlgError:
            return False
        return True

    def stop(self, deceleration: float = _STOPPING) -> None:
        """Come to rest."""
        self._mode, self._path, self._deceleration = "hold", [], max(min(deceleration, self.brakes), 0.01)

    @property
    def moving(self) -> bool:
        """True if a move is under way, or it has not come to rest."""
        return bool(self._path) or float(np.abs(self.qd).max()) > 1e-4

    def tip(self, tool: Floats) -> tuple[Floats, Floats]:
        """Pose (4, 4) and Jacobian (6, 6) of the end of a tool (4, 4); see `kinematics.tip`."""
        if self._posture is None or self._posture[0] is not self.q:
            self._posture = self.q, *self.model.flange(self.q.tolist())
        return tip_of(*self._posture[1:], tool)

    @property
    def pose(self) -> list[float]:
        """Where the tip is, as UR's six numbers."""
        return pose_of(self.tip(self.tcp)[0])

    def advance(self) -> None:
        """One tick."""
        wanted, limit = np.zeros_like(self.q), self._deceleration
        if self._mode == "servo":
            wanted = (self._target + self._give() - self.q) * ((1.0 - math.exp(-self.pace * TICK / self._lag)) / TICK)
            limit = _ACCELERATION
        elif self._mode == "speed":
            wanted, limit = self._speed * self.pace, _ACCELERATION
        elif self._mode == "move" and self._path:
            target = self._path.pop(0) if self._step_is_due() else self._path[0]
            wanted, limit = (target - self.q) * (self.pace / (1.5 * TICK)), 4 * _ACCELERATION
        if self.jammed:
            wanted, limit = np.zeros_like(self.q), 4 * _ACCELERATION
        change = np.clip(wanted - self.qd, -limit * TICK, limit * TICK)
        before = self.qd
        self.qd = np.clip(before + change, -self.model.speed_limits, self.model.speed_limits)
        self.q = self.q + 0.5 * TICK * (before + self.qd)
        if self._mode == "move" and not self._path:
            self.stop()

    def _give(self) -> Floats | float:
        """Joint angles (n,) by which it gives way to the force on its tip."""
        if math.isinf(self.stiffness):
            return 0.0
        return solve(self.tip(self.tcp)[1], np.concatenate([self.push / self.stiffness, np.zeros(3)]))

    def _step_is_due(self) -> bool:
        """Return True if a path goes on in this tick: in each at full pace."""
        self._due += self.pace
        due = self._due >= 1.0
        self._due -= due
        return due


def _trapezoid(length: float, speed: float, acceleration: float) -> list[float]:
    """Way covered at each tick."""
    speed = min(max(speed, 1e-4), math.sqrt(length * acceleration)) if length > 0 else 1e-4
    ramp = speed / acceleration
    total = length / speed + ramp
    times = [min((i + 1) * TICK, total) for i in range(math.ceil(total / TICK) + 10)]  # some ticks to settle
    return [_way(t, total, ramp, speed, acceleration, length) for t in times]


def _way(t: float, total: float, ramp: float, speed: float, acceleration: float, length: float) -> float:
    if t < ramp:
        return 0.5 * acceleration * t * t
    if t > total - ramp:
        return length - 0.5 * acceleration * (total - t) ** 2
    return speed * (t - 0.5 * ramp)

"""Franka's FR3 and Panda as devices."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from palpate import Force, Inertia, Length, Mass, RotationalStiffness, Stiffness, StopModes, Torque
from palpate_arms.arm_device import ArmDevice
from palpate_kit.kinematics.arm_model import ArmModel
from pydantic import Field

from palpate_franka.models import JOINTS, MODELS, POSTURE
from palpate_franka.robot_states import LOCKED, MOVES, REFLEX, USER_STOP

if TYPE_CHECKING:
    from palpate_arms.arm_driver import ArmDriver


class Franka(ArmDevice):
    """A Franka Research 3 or a Panda as an arm, by `franky-control`, which holds it by a Cartesian impedance at 1 kHz.

    The arm gives way to a force by `stiffness`: what counts as depth is the measured pose, never the command. Every
    command keeps the limits of [safety], in the process that commands the arm; the controller's own thresholds, here
    `collision_force` and `collision_torque`, are a second line of defence, whose reflexes are reported by their names
    and from which only a person recovers the arm (`palpate franka-recover`). The controller's estimate of the external
    wrench is the stream `robot_wrench`, estimated; a measurement needs a sensor at the flange. One program at a time
    can be connected. Not tried on a real robot: see the distribution's page.
    """

    maker: ClassVar[str] = "franka"
    joint_names: ClassVar[tuple[str, ...]] = JOINTS
    status_channels: ClassVar[Mapping[str, float]] = {"robot_mode": MOVES, "errors": 0.0, "success_rate": 1.0}
    posture: ClassVar[tuple[float, ...]] = POSTURE
    own_stop: ClassVar[str] = "collision_force"
    has_own_rate: ClassVar[bool] = True  # of a thousand states a second the loop takes 500 at least

    model: Literal["fr3", "panda"] = Field(default="fr3", description="which arm")
    stiffness: Stiffness = Field(
        default=3000.0, ge=200, le=6000, description="of the impedance, by which the arm gives way to a force"
    )
    rotational_stiffness: RotationalStiffness = Field(
        default=80.0, ge=10, le=150, description="of the impedance against turns of the tool"
    )
    friction: tuple[Torque, ...] = Field(
        default=(0.0,) * 7,
        min_length=7,
        max_length=7,
        description="dry friction of each joint that the client compensates, at most 1 N*m",
    )
    gain: float = Field(default=8.0, gt=0, lt=100, description="proportional gain of the PD law, in 1/s")
    collision_force: Force = Field(
        default=30.0, gt=0, le=100, description="external force at which the controller stops by a reflex"
    )
    collision_torque: Torque = Field(
        default=20.0, gt=0, le=87, description="external torque of a joint at which it does"
    )
    payload: Mass | None = Field(
        default=None, gt=0, le=3, description="mounted on the flange besides what Desk knows; left out: nothing is set"
    )
    payload_centre: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="centre of mass of that payload on the flange"
    )
    payload_inertia: tuple[Inertia, ...] = Field(
        default=(1e-3, 1e-3, 1e-3), min_length=3, max_length=3, description="its moments of inertia about x, y and z"
    )
    realtime: Literal["enforce", "ignore"] = Field(
        default="enforce", description='"ignore" connects without a kernel for real time: for a simulator'
    )

    @classmethod
    def driver(cls) -> type[ArmDriver]:
        """Return the driver by the client library."""
        from palpate_franka.driver import FrankaDriver

        return FrankaDriver

    @property
    def arm_model(self) -> ArmModel:
        """Kinematics of the arm's type."""
        return MODELS[self.model]

    @property
    def stop_modes(self) -> StopModes:
        """Modes of a stopped controller: an emergency stop locks the joints, or is the user stop.

        One program at a time is served.
        """
        return StopModes("robot_mode", (LOCKED, USER_STOP), (USER_STOP,), (REFLEX,), single_connection=True)

    @property
    def command_lag(self) -> float:
        """Lag d/k [s] of a spring k [N/m] whose damping is d = 2 sqrt(k) [N s/m], as the client sets it."""
        return 2.0 / math.sqrt(self.stiffness)

    @property
    def controller_stiffness(self) -> float:
        """Stiffness [N/m] of the impedance."""
        return self.stiffness

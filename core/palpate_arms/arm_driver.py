"""The driver of an arm: connect, read a state, send a pose, stop, and the meaning of its states."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import DeviceError, Floats
from palpate_kit.acquisition.device_lock import network_device
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import matrix_of

NO_WRENCH = (math.nan,) * 6
KINEMATICS_TOLERANCE = 5e-3  # [m] from the controller's pose to a nominal model's: real arms differ so far (0246)


class ArmFaultError(Exception):
    """A fault with which the arm cannot go on, for the person at the robot; the motion ends at once, where it is."""


class DeadLinkError(ArmFaultError):
    """The connection to the controller is lost: what is on its way must not be carried out later."""


class GarbledStateError(ArmFaultError):
    """A state that makes no sense, so that nobody knows where the arm is."""


@dataclass(frozen=True)
class ArmReading:
    """One state of an arm, as its controller measured it: never what it was commanded."""

    stamp: float  # [s] of the controller's clock
    joints: Sequence[float]  # (n,) [rad]
    joint_speeds: Sequence[float]  # (n,) [rad/s]
    pose: Sequence[float] | None = None  # of the tip in the base, [m] and rotation vector [rad]; None: by the joints
    twist: Sequence[float] | None = None  # of the tip in the base, [m/s] and [rad/s]; None: by the joints
    wrench: Sequence[float] = NO_WRENCH  # the controller's own estimate, [N] and [N m], in the axes of the base
    status: Sequence[float] = ()  # of the channels that the device calls `status_channels`
    seen: int | None = None  # monotonic time [ns] at which it was there; None: when it is read


class ArmDriver(ABC):
    """One maker's controller, in the process that commands the arm; nothing but palpate's own loop calls it.

    The loop calls `connect`, waits for states, calls `identify` and `enable`, and then every 2 ms `read` and `send` or
    `keep_alive`, none of which may wait; at the end `stop`. It checks every pose that it sends against all limits,
    looks at every state, watches the force and the age of everything, and stops on its own.
    """

    settle = 0.2  # [s], a choice: until states show what `connect` has set
    has_watchdog = False  # whether the controller stops by itself, at once, where commands stay away
    answers_stop = False  # whether `stop` returns only once the controller has answered that it stops

    def __init__(self, settings: Mapping[str, Any], model: ArmModel | None, tool: Floats) -> None:
        self.settings = settings  # of the device, as plain data
        self.model = model  # None: `identify` finds it
        self.tool = tool  # (4, 4) the tip on the flange, as the device's settings have it
        self.facts: dict[str, Any] = {}  # what is known of the robot, by name, for the result
        self.place = np.zeros(3)  # [m] in the work frame, of the command that `send` is called with

    @property
    def reservation(self) -> str:
        """The name of what no other program may use meanwhile: by default the address of the controller."""
        return network_device(str(self.settings["host"]), 0)

    @abstractmethod
    def connect(self, observe: bool) -> None:
        """Connect, and take the arm over at rest unless it is only observed; may wait.

        Raises DeviceError with a sentence where the controller is not ready: its version, its mode, its brakes.
        """

    @abstractmethod
    def read(self) -> ArmReading | None:
        """Return the newest state; None if none arrived since the last call. Raises ArmFaultError."""

    @abstractmethod
    def send(self, pose: Sequence[float]) -> bool:
        """Command a pose of the tip in the base, [m] and rotation vector [rad]; True means sent, not done.

        Raises ArmFaultError where the link is lost.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop where the arm is, and give it back; may wait for the controller."""

    def close(self) -> None:  # noqa: B027  (a link may close with its process)
        """End the connection to an arm that stands."""

    def identify(self, reading: ArmReading) -> None:
        """Check by the first state that this is the arm of the model, with its tool; raises DeviceError."""
        if self.model is None:
            raise DeviceError("its kinematic model is not known")
        if reading.pose is None:
            return
        # The tip by the joints, against the controller's.
        nominal = self.model.tip(list(reading.joints), self.tool)[0]
        distance = float(np.linalg.norm(nominal[:3, 3] - matrix_of(list(reading.pose))[:3, 3]))
        self.facts["nominal_kinematics_off"] = distance
        if distance > KINEMATICS_TOLERANCE:
            raise DeviceError(
                f"the controller reports the tip {1e3 * distance:.1f} mm from where the joints of a {self.model.name} "
                "put it: is this another arm, or another tool?"
            )

    def target(self) -> Sequence[float] | None:
        """Return the pose that the controller holds at rest, in the frame in which `send` commands; None if not known.

        It is asked for once, before anything is sent: where it differs from the pose that was measured, nothing moves.
        """
        return None

    def enable(self) -> None:  # noqa: B027
        """Do what is last before commands are sent, such as starting a watchdog that must be fed."""

    def keep_alive(self) -> None:  # noqa: B027
        """Do what a controller needs in each period without a command."""

    def check(self, reading: ArmReading) -> None:  # noqa: B027
        """Raise ArmFaultError where a state says that the arm cannot go on: its mode, its errors, a reflex by name."""

    def slowdown(self, reading: ArmReading, first: ArmReading | None) -> str | None:
        """Return why the arm is slower than it is commanded; None where it is not.

        `first` is the state at the start of the motion; None: no motion yet.
        """
        return None

    @property
    def connected(self) -> bool:
        """True if the connection that brings states stands."""
        return True

    @property
    def unheard(self) -> float:
        """The time [s] for which the controller has taken none of the commands on their way; 0 if not known."""
        return 0.0

    @property
    def answer_time(self) -> float:
        """The shortest time [s] from a command to the state that shows it was taken; 0 if not known."""
        return 0.0

    @property
    def ahead(self) -> float:
        """The distance [m] of the latest command from what the controller has taken before it; 0 if not known."""
        return 0.0

    def explain(self) -> str | None:
        """Return what else is known about a state that makes no sense; None where nothing is."""
        return None

"""An arm that a person moves in freedrive: this program reads its states and commands nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import ConfigurationError, DeviceError, Floats, clock
from palpate_arms.arm_by_hand import LISTEN, Posture, mean_pose
from palpate_kit.acquisition.computer import host
from palpate_kit.kinematics.rotations import matrix_of
from palpate_kit.kinematics.ur_arm import MODELS, distinguishable
from palpate_kit.protocols.ur_dashboard import probe, refuse_unready

from palpate_devices.ur.client_library import missing_library

_VARIABLES = ["timestamp", "actual_q", "actual_TCP_pose"]
_RAW_WRENCH = "ft_raw_wrench"
# Choices.
_MAX_SILENCE = 1.0  # [s] without a new state
_POLL_INTERVAL = 0.001  # [s]
_MAX_NOMINAL_ERROR = 5e-3  # [m] of the tip, by which a real arm differs from the nominal one (0246)
_MM = 1e3  # per metre


class URByHand:
    """A connected arm (a HandReader).

    Raises DeviceError where it cannot be read, ConfigurationError where its TCP is another.
    """

    def __init__(
        self, address: str, model: str, tcp: Sequence[float], rotation: Sequence[float] | None, weighs: bool
    ) -> None:
        """Connect to a controller to read poses, and the wrench where the flange is weighed (`weighs`).

        The pipeline states the `model` of the arm, and of the tool the place `tcp` (3,) [m] of its tip on the flange,
        and perhaps its rotation vector (3,) [rad]. Raises DeviceError.
        """
        self._name = f"ur at {address}"
        try:
            self.facts = host().controller_facts(address, probe)
            refuse_unready(self.facts, address, by_hand=True)
        except DeviceError as error:
            raise DeviceError(f"ur at {error}") from error
        self._weighs = weighs
        try:
            self._states = host().robot_states(address, [*_VARIABLES, *([_RAW_WRENCH] if weighs else [])])
        except ImportError as error:
            raise DeviceError(f"{self._name}: {missing_library()} ({error})") from error
        except RuntimeError as error:
            raise DeviceError(f"{self._name}: cannot connect: {' '.join(str(error).split())}") from error
        self.tool = self._tool(model, tcp, rotation)

    def _tool(self, model: str, tcp: Sequence[float], rotation: Sequence[float] | None) -> Floats:
        """Return the tool (4, 4) on the flange as it is declared, with the pendant's rotation where none is.

        The pendant's tool is the pose that the controller reports behind the flange of the nominal arm. Raises
        ConfigurationError where its TCP is farther from the declared one than a real arm is from the nominal one.
        """
        self._next_state(-1.0)  # any state: no stamp is below 0
        # The pendant's tool: behind the flange of the arm that the joints show.
        q, pose = list(self._states.getActualQ()), matrix_of(self._states.getActualTCPPose())
        declared = matrix_of([*tcp, *(rotation or (0.0, 0.0, 0.0))])
        arm = MODELS.get(model) or distinguishable(q, declared, pose[:3, 3])[0]
        flange, _ = arm.flange(q)
        pendant = np.linalg.inv(flange) @ pose
        distance = float(np.linalg.norm(pendant[:3, 3] - declared[:3, 3]))
        if distance > _MAX_NOMINAL_ERROR:
            raise ConfigurationError(
                f"{self._name}: the TCP on the pendant is at {_mm(pendant[:3, 3])} on the flange, and tcp says "
                f"{_mm(declared[:3, 3])}: set the pendant's to that, so that the controller reports where the tip is"
            )
        if rotation is None:
            declared[:3, :3] = pendant[:3, :3]
        return declared

    def read(self) -> Posture:
        """Return the mean of pose and wrench over half a second.

        Raises UnsteadyError where the tip moves meanwhile, DeviceError where numbers are missing.
        """
        # Every new state: pose, and wrench where it is weighed.
        rows, stamp, end = [], -1.0, clock().now() + LISTEN
        while clock().now() < end:
            stamp = self._next_state(stamp)
            states: Any = self._states
            rows.append([*states.getActualTCPPose(), *(states.getFtRawWrench() if self._weighs else ())])
        # The mean of both: of a place and a rotation vector, and of what follows them, forces and torques.
        values = np.array(rows)
        if not np.isfinite(values).all():
            raise DeviceError(f"{self._name}: the controller's pose or wrench is not a number")
        tip = mean_pose(values[:, :3], values[:, 3:6])
        wrench = values[:, 6:].mean(axis=0) if self._weighs else None
        return Posture(tip, tip @ np.linalg.inv(self.tool), wrench)

    def _next_state(self, previous_stamp: float) -> float:
        """Wait for a state after that of a stamp [s], and return its stamp; raises DeviceError after 1 s."""
        deadline = clock().now() + _MAX_SILENCE
        while (stamp := float(self._states.getTimestamp())) == previous_stamp or not self._states.isConnected():
            if clock().now() > deadline:
                raise DeviceError(f"{self._name}: the controller is silent")
            clock().sleep(_POLL_INTERVAL)
        return stamp


def _mm(place: Floats) -> str:
    """Return a place (3,) [m] in words, in mm; adding 0 makes -0 a 0."""
    return f"({', '.join(f'{_MM * x:z.1f}' for x in place)}) mm"

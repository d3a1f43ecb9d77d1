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
_RAW = "ft_raw_wrench"
_SILENT = 1.0  # [s] without a new state
_LOOK = 0.001  # [s]
_NOMINAL = 5e-3  # [m] by which a real arm differs from the nominal one


class URByHand:
    """A connected arm (a HandReader).

    Raises DeviceError where it cannot be read, ConfigurationError where its TCP is another.
    """

    def __init__(
        self, address: str, model: str, tcp: Sequence[float], rotation: Sequence[float] | None, weighs: bool
    ) -> None:
        self._name = f"ur at {address}"
        try:
            self.facts = host().controller_facts(address, probe)
            refuse_unready(self.facts, address, by_hand=True)
        except DeviceError as error:
            raise DeviceError(f"ur at {error}") from error
        self._weighs = weighs
        try:
            self._states = host().robot_states(address, [*_VARIABLES, *([_RAW] if weighs else [])])
        except ImportError as error:
            raise DeviceError(f"{self._name}: {missing_library()} ({error})") from error
        except RuntimeError as error:
            raise DeviceError(f"{self._name}: cannot connect: {' '.join(str(error).split())}") from error
        self.tool = self._tool(model, tcp, rotation)

    def _tool(self, model: str, tcp: Sequence[float], rotation: Sequence[float] | None) -> Floats:
        """Return the tool (4, 4) on the flange, by what is declared; the pendant has to have the same."""
        self._next_state(-1.0)
        q, pose = list(self._states.getActualQ()), matrix_of(self._states.getActualTCPPose())
        declared = matrix_of([*tcp, *(rotation or (0.0, 0.0, 0.0))])
        known = MODELS.get(model) or distinguishable(q, declared, pose[:3, 3])[0]
        pendant = np.linalg.inv(known.flange(q)[0]) @ pose
        apart = float(np.linalg.norm(pendant[:3, 3] - declared[:3, 3]))
        if apart > _NOMINAL:
            raise ConfigurationError(
                f"{self._name}: the TCP on the pendant is at {_mm(pendant[:3, 3])} on the flange, and tcp says "
                f"{_mm(declared[:3, 3])}: set the pendant's to that, so that the controller reports where the tip is"
            )
        if rotation is None:
            declared[:3, :3] = pendant[:3, :3]
        return declared

    def read(self) -> Posture:
        """Return the mean over half a second; raises UnsteadyError, DeviceError."""
        rows, stamp, end = [], -1.0, clock().now() + LISTEN
        while clock().now() < end:
            stamp = self._next_state(stamp)
            states: Any = self._states
            rows.append([*states.getActualTCPPose(), *(states.getFtRawWrench() if self._weighs else ())])
        values = np.array(rows)
        if not np.isfinite(values).all():
            raise DeviceError(f"{self._name}: the controller's pose or wrench is not a number")
        tip = mean_pose(values[:, :3], values[:, 3:6])
        wrench = values[:, 6:].mean(axis=0) if self._weighs else None
        return Posture(tip, tip @ np.linalg.inv(self.tool), wrench)

    def _next_state(self, before: float) -> float:
        deadline = clock().now() + _SILENT
        while (stamp := float(self._states.getTimestamp())) == before or not self._states.isConnected():
            if clock().now() > deadline:
                raise DeviceError(f"{self._name}: the controller is silent")
            clock().sleep(_LOOK)
        return stamp


def _mm(place: Floats) -> str:
    return f"({', '.join(f'{1e3 * x + 0.0:.1f}' for x in place)}) mm"

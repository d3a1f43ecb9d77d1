"""The states of an arm, as the host reads them: batches of its streams, in the host's time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Floats, epoch_offset
from palpate_kit.acquisition.device_clock import ClockMap
from palpate_kit.acquisition.ring import integers
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import matrix_of, quaternion

from palpate_arms.arm_settings import ArmSettings
from palpate_arms.setpoint_buffer import PERIOD

Whole = NDArray[np.int64]
_RATE_SLACK = 0.02  # of it


def low_rate(rate: float, usual: float) -> str | None:
    """What is said of a controller that sends its state at a rate [Hz] below the usual; None where it does not."""
    if usual - rate <= _RATE_SLACK * usual:
        return None
    return (
        f"the controller sends its state at {rate:.0f} Hz in place of {usual:.0f} Hz: the motion is timed by the clock "
        "and recorded more coarsely"
    )


class ArmStates:
    """Batches of the states of an arm, and what the latest of them says."""

    def __init__(self, settings: ArmSettings, model: ArmModel, tool: Floats) -> None:
        self._settings, self._model, self._tool = settings, model, tool
        self._rows, self.clock = settings.rows.row, ClockMap()
        self._pose = self._rows.span("position", "rotation")
        self._twist = self._rows.span("velocity", "turning")
        self.position: Floats | None = None  # (3,) of the tip in the work frame, the latest
        self.joints: list[float] = []  # the latest
        self.rotation = np.eye(3)  # of the tool in the base, the latest
        self._turned = np.array([1.0, 1e-3, 1e-6, 1e-9])  # the first quaternion's largest part is positive
        self.count, self._first, self._last = 0, 0, 0
        self.mismatch = 0.0  # [m] between the controller's pose and that of the kinematic model

    @property
    def unseen(self) -> int:
        """How many states of the controller never came."""
        return max(round((self._last - self._first) / 1e9 / PERIOD) + 1 - self.count, 0)

    def skip(self, rows: Floats) -> None:
        """Rows that no run needs, such as those that came while other devices were connected, determine the clock."""
        self._times(rows)

    def batches(self, rows: Floats) -> Iterator[Batch]:
        """Yield a batch of each stream."""
        layout = self._rows
        stamps, controller, received = self._times(rows)
        pose, twist = self._kinematics(rows)
        if len(rows):
            self.position, self.joints = pose[-1, :3], rows[-1, layout["joints"]].tolist()
            self.rotation = matrix_of(rows[-1, self._pose].tolist())[:3, :3]
            self._first, self._last = self._first or int(controller[0]), int(controller[-1])
        self.count += len(rows)
        status = np.column_stack([controller / 1e9, rows[:, layout["status"]]])
        joints = rows[:, layout.span("joints", "joint_speeds")]
        columns = (pose, twist, joints, rows[:, layout["setpoint"]], rows[:, layout["force"]], status)
        for stream, values in zip(self._settings.streams, columns, strict=True):
            yield Batch(stream.name, stamps, received, np.ascontiguousarray(values))

    def _times(self, rows: Floats) -> tuple[Whole, Whole, Whole]:
        """When states (n,) were made, in the host's time and the controller's, and when they came [ns]."""
        received = integers(rows, self._rows.at("host")) + epoch_offset()
        controller = integers(rows, self._rows.at("controller"))
        return self.clock.to_host(controller, received), controller, received

    def _kinematics(self, rows: Floats) -> tuple[Floats, Floats]:
        """Pose (n, 7) and twist (n, 6) of the tip in the work frame."""
        settings, layout = self._settings, self._rows
        work = settings.work.matrix
        turn = work[:3, :3].T
        pose, twist = np.empty((len(rows), 7)), np.empty((len(rows), 6))
        for i, row in enumerate(rows):
            matrix, speed = matrix_of(row[self._pose].tolist()), row[self._twist]
            if settings.kinematics == "dh" or i == 0:
                own, jacobian = self._model.tip(row[layout["joints"]].tolist(), self._tool)
                self.mismatch = max(self.mismatch, float(np.abs(own[:3, 3] - matrix[:3, 3]).max()))
                if settings.kinematics == "dh":
                    matrix, speed = own, jacobian @ row[layout["joint_speeds"]]
            turned = quaternion(turn @ matrix[:3, :3])
            # A tool that looks down is turned by about pi, where the sign of a quaternion is up to chance.
            turned = -turned if float(turned @ self._turned) < 0 else turned
            pose[i, :3], pose[i, 3:], self._turned = turn @ (matrix[:3, 3] - work[:3, 3]), turned, turned
            twist[i, :3], twist[i, 3:] = turn @ speed[:3], turn @ speed[3:]
        return pose, twist

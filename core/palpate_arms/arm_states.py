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
_RATE_SLACK = 0.02  # share of the usual rate, a choice
_SECOND = 1e9  # [ns]
# In place of a quaternion before the first: the first part of that which is not nearly 0 is positive.
_FIRST_SIGN = (1.0, 1e-3, 1e-6, 1e-9)


def low_rate(rate: float, usual: float) -> str | None:
    """Return the sentence on a controller that sends states at a rate [Hz] below the usual; None where it does not."""
    if usual - rate <= _RATE_SLACK * usual:
        return None
    return (
        f"the controller sends its state at {rate:.0f} Hz in place of {usual:.0f} Hz: the motion is timed by the clock "
        "and recorded more coarsely"
    )


class ArmStates:
    """Batches of the states of an arm, and the latest place, joints and orientation."""

    def __init__(self, settings: ArmSettings, model: ArmModel, tool: Floats) -> None:
        self._settings, self._model, self._tool = settings, model, tool
        self._rows, self.clock = settings.rows.row, ClockMap()
        self._pose = self._rows.span("position", "rotation")
        self._twist = self._rows.span("velocity", "turning")
        self.position: Floats | None = None  # (3,) of the tip in the work frame, the latest
        self.joints: list[float] = []  # the latest
        self.rotation = np.eye(3)  # of the tool in the base, the latest
        self._quaternion = np.array(_FIRST_SIGN)  # of the latest state
        self.count, self._first, self._last = 0, 0, 0
        self.mismatch = 0.0  # [m] between the controller's pose and that of the kinematic model

    @property
    def unseen(self) -> int:
        """The number of states of the controller that never came."""
        return max(round((self._last - self._first) / _SECOND / PERIOD) + 1 - self.count, 0)

    def skip(self, rows: Floats) -> None:
        """Map the clock by rows that no run needs, such as those that came while other devices were connected."""
        self._times(rows)

    def batches(self, rows: Floats) -> Iterator[Batch]:
        """Yield a batch of each stream from rows of the ring (n, columns)."""
        layout = self._rows
        # The newest state, for whoever asks where the arm is.
        stamps, controller_times, arrivals = self._times(rows)
        pose, twist = self._kinematics(rows)
        if len(rows):
            self.position, self.joints = pose[-1, :3], rows[-1, layout["joints"]].tolist()
            self.rotation = matrix_of(rows[-1, self._pose].tolist())[:3, :3]
            self._first, self._last = self._first or int(controller_times[0]), int(controller_times[-1])
        self.count += len(rows)
        # Columns of each stream, in the order of the settings.
        status = np.column_stack([controller_times / _SECOND, rows[:, layout["status"]]])
        joints = rows[:, layout.span("joints", "joint_speeds")]
        columns = (pose, twist, joints, rows[:, layout["setpoint"]], rows[:, layout["force"]], status)
        for stream, values in zip(self._settings.streams, columns, strict=True):
            yield Batch(stream.name, stamps, arrivals, np.ascontiguousarray(values))

    def _times(self, rows: Floats) -> tuple[Whole, Whole, Whole]:
        """Return times (n,) [ns] of states, by the host's clock and the controller's, and those of their arrival."""
        arrivals = integers(rows, self._rows.at("host")) + epoch_offset()
        controller_times = integers(rows, self._rows.at("controller"))
        return self.clock.to_host(controller_times, arrivals), controller_times, arrivals

    def _kinematics(self, rows: Floats) -> tuple[Floats, Floats]:
        """Return pose (n, 7), a place and a quaternion, and twist (n, 6) of the tip in the work frame."""
        settings, layout = self._settings, self._rows
        work = settings.work.matrix
        to_work = work[:3, :3].T
        pose, twist = np.empty((len(rows), 7)), np.empty((len(rows), 6))
        for i, row in enumerate(rows):
            # By the controller, or by the joints; the first state of each batch shows how far they differ.
            matrix, speed = matrix_of(row[self._pose].tolist()), row[self._twist]
            if settings.kinematics == "dh" or i == 0:
                by_joints, jacobian = self._model.tip(row[layout["joints"]].tolist(), self._tool)
                self.mismatch = max(self.mismatch, float(np.abs(by_joints[:3, 3] - matrix[:3, 3]).max()))
                if settings.kinematics == "dh":
                    matrix, speed = by_joints, jacobian @ row[layout["joint_speeds"]]
            # A tool that looks down is turned by about pi, where the sign of a quaternion is up to chance.
            orientation = quaternion(to_work @ matrix[:3, :3])
            if float(orientation @ self._quaternion) < 0:
                orientation = -orientation
            self._quaternion = orientation
            pose[i, :3] = to_work @ (matrix[:3, 3] - work[:3, 3])
            pose[i, 3:] = orientation
            twist[i, :3] = to_work @ speed[:3]
            twist[i, 3:] = to_work @ speed[3:]
        return pose, twist

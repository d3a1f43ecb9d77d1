"""An arm as a device, in a process of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from palpate import Link
from palpate_kit.kinematics.rotations import matrix_of

from palpate_arms.arm_settings import ArmSettings

if TYPE_CHECKING:
    from palpate_arms.arm_by_hand import HandReader


class ArmDevice(ArmSettings):
    """An arm; a maker's class adds its own keys, and says which driver and which kinematic model."""

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Return the arm at rest; `follow` sets it in motion."""
        return self._connected(observe=False)

    def observe(self, seed: int) -> AbstractContextManager[Link]:
        """Return the arm as it is observed; a running program continues."""
        return self._connected(observe=True)

    def by_hand(self, weighs: bool) -> AbstractContextManager[HandReader]:
        """Return its reader while a person leads it, for `calibrate teach`; `weighs`: with the wrench in its flange."""
        from palpate_arms.arm_by_hand import observed_by_hand

        return observed_by_hand(self.title, self.observe(0))

    @contextmanager
    def _connected(self, observe: bool) -> Iterator[Link]:
        """Yield the link to the arm, whose driver runs in a process that ends with the connection.

        With `observe` the arm is not taken over: nothing is to move. Raises DeviceError.
        """
        from palpate import DeviceError
        from palpate_kit.acquisition.child import Child

        from palpate_arms.arm_link import ArmLink  # a replay loads nothing of an arm
        from palpate_arms.arm_rows import STOP
        from palpate_arms.arm_worker import MODULE

        try:
            identity = self.identity(observe)
        except DeviceError as error:
            raise DeviceError(f"{self.maker} at {error}") from error
        # `identity` has maker, model and number of the arm.
        task = self._task(identity, observe)
        child = Child(self.title, "robot", MODULE, task, self.rows.row.size, self.sudden_end)
        try:
            yield ArmLink(self, child, {**identity, **child.wait_for("ready", self.start)})
        finally:
            child.ring.head[STOP] = 1
            child.close()

    def _task(self, identity: Mapping[str, str], observe: bool) -> dict[str, Any]:
        """Return the task of the process that runs the arm's driver, as plain data.

        `identity` is the arm's maker, model and number; `observe` is True where nothing is to move.
        """
        from palpate_kit.acquisition.class_place import class_place

        model = self.arm_model
        # What the controller reports while all is well, and while it holds the arm.
        status_settings = {"sound_status": dict(self.status_channels), "stop_modes": None}
        if (modes := self.stop_modes) is not None:
            status_settings["stop_modes"] = asdict(modes)
        limits = {key: getattr(self, key) for key in ("joint_speed", "tracking", "deadband", "links_low", "links_high")}
        return {
            "driver": class_place(self.driver()),
            "settings": {**status_settings, **self.driver_settings(identity, observe)},
            "arm_model": None if model is None else model.model_dump(),
            "tool": matrix_of([*self.tcp, *(self.tcp_rotation or (0.0, 0.0, 0.0))]).ravel().tolist(),
            "joints": len(self.joint_names),
            "status": len(self.status_channels),
            "own": {**limits, "lag": self.command_lag, "stiffness": self.controller_stiffness},
            "law": asdict(self.law),
            "work": self.work.model_dump(),
            "observe": observe,
            "controller_timeout": self.controller_timeout,
            "host_timeout": self.host_timeout,
        }

"""Universal Robots' e-Series as devices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from typing import Any

from palpate import DeviceError, Link
from palpate_kit.acquisition.child import Child
from palpate_kit.acquisition.computer import host
from palpate_kit.protocols.ur_dashboard import probe, refuse_unready, reported_model, reports_payload

from palpate_devices.ur.settings import URSettings

_HINT = ": the client library does that when it loses the link to the controller"


class UR(URSettings):
    """A UR3e, UR5e, UR10e or UR16e of Universal Robots as an arm, by `ur_rtde` in a process of its own.

    Setpoints in the work frame are followed at 500 Hz, by the paper's Cartesian PD law on top of `servoL` or by
    `servoL` alone. The tool is turned to look along the normal on the way to the start, about its tip, and nowhere
    else. Every command keeps the limits of [safety] and those given here, in the process that sends it, which also
    reads the sensor's force and stops by itself. The controller's watchdog is set before anything moves, so that the
    arm stops by itself where commands stay away. Controller time is mapped to the host's clock by the lower
    envelope of the arrival times. Streams: tip (pose and twist in the work frame), joints, setpoint, the robot's own
    wrench (estimated, in the base's orientation: not that of a sensor at the flange), and status.
    """

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The arm at rest; `follow` sets it in motion."""
        return self._connected(observe=False)

    def observe(self, seed: int) -> AbstractContextManager[Link]:
        """Its states; a running program continues."""
        return self._connected(observe=True)

    @contextmanager
    def _connected(self, observe: bool) -> Iterator[Link]:
        from palpate_devices.ur import layout
        from palpate_devices.ur.link import URLink  # a replay loads nothing of an arm

        name = f"ur at {self.host}"
        try:
            identity = host().controller_facts(self.host, probe)
            refuse_unready(identity, self.host)
        except DeviceError as error:
            raise DeviceError(f"ur at {error}") from error
        if self.safety_checksum is not None:
            identity = {**identity, "safety_checksum": self.safety_checksum}
        child = Child(name, "robot", layout.MODULE, self._worker_settings(identity, observe), layout.ROW.size, _HINT)
        try:
            link = URLink(self, child, {**identity, **child.wait_for("ready", self.start)})
            yield link
        finally:
            child.ring.head[layout.STOP] = 1
            child.close()

    def _worker_settings(self, identity: Mapping[str, str], observe: bool) -> dict[str, Any]:
        keys = [
            *("host", "tcp", "tcp_rotation", "payload", "payload_centre"),
            *("lookahead", "servo_gain", "watchdog", "controller_timeout", "host_timeout"),
        ]
        own = ("joint_speed", "tracking", "links_low", "links_high")
        said = reported_model(identity) if self.model == "auto" and observe else self.model
        return {
            **{key: getattr(self, key) for key in keys},
            "own": {**{key: getattr(self, key) for key in own}, "lag": 0.5 * self.lookahead * 300.0 / self.servo_gain},
            "law": asdict(self.law),
            "work": self.work.model_dump(),
            "model": said,
            "observe": observe,
            "load_known": reports_payload(identity),
        }

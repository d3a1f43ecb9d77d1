"""Universal Robots' e-Series as devices."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from palpate import Frequency, Length, Mass, StopModes, Time
from palpate_arms.arm_device import ArmDevice
from palpate_kit.acquisition.computer import host
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.ur_arm import JOINTS, MODELS
from palpate_kit.protocols.ur_dashboard import probe, refuse_unready, reported_model, reports_payload
from pydantic import Field

if TYPE_CHECKING:
    from palpate_arms.arm_by_hand import HandReader
    from palpate_arms.arm_driver import ArmDriver

# Of the lag of `servoL`, 0.5 lookahead 300/gain, as measured on a twin (0215).
_LAG_SHARE, _LAG_GAIN = 0.5, 300.0


class UR(ArmDevice):
    """A UR3e, UR5e, UR10e or UR16e of Universal Robots as an arm, by `ur_rtde` in a process of its own.

    Setpoints in the work frame are followed at 500 Hz, by the paper's Cartesian PD law on top of `servoL` or by
    `servoL` alone. The tool is turned to look along the normal on the way to the start, about its tip, and nowhere
    else. Every command keeps the limits of [safety] and those given here, in the process that sends it, which also
    reads the sensor's force and stops by itself. The controller's watchdog is set before anything moves, so that the
    arm stops by itself where commands stay away. Controller time is mapped to the host's clock by the lower
    envelope of the arrival times. Streams: tip (pose and twist in the work frame), joints, setpoint, the robot's own
    wrench (estimated, in the base's orientation: not that of a sensor at the flange), and status.
    """

    maker: ClassVar[str] = "ur"
    joint_names: ClassVar[tuple[str, ...]] = JOINTS
    # The value of each in regular operation.
    status_channels: ClassVar[Mapping[str, float]] = {
        "robot_mode": 7.0,
        "safety_mode": 1.0,
        "runtime": 2.0,
        "speed_slider": 1.0,
        "speed_scaling": 1.0,
    }
    weighs_flange: ClassVar[bool] = True
    sudden_end: ClassVar[str] = ": the client library does that when it loses the link to the controller"

    model: Literal["auto", "ur3e", "ur5e", "ur10e", "ur16e"] = Field(
        default="auto", description='which arm; "auto": found from joints and tip pose'
    )
    payload: Mass | None = Field(
        default=None, gt=0, le=20, description="everything mounted on the flange; left out: the pendant's setting"
    )
    payload_centre: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="centre of mass of that payload on the flange"
    )
    safety_checksum: str | None = Field(
        default=None,
        pattern=r"^[0-9A-Za-z]{4}([0-9A-Za-z]{4})?$",
        description="of the safety configuration, as the pendant shows it; for the record: no interface reports it",
    )
    lookahead: Time = Field(default=0.03, ge=0.03, le=0.2, description="servoL's lookahead time")
    servo_gain: float = Field(default=1000.0, ge=100, le=2000, description="servoL's gain")
    watchdog: Frequency = Field(default=10.0, ge=1, le=50, description="the arm stops when commands arrive less often")

    @classmethod
    def driver(cls) -> type[ArmDriver]:
        """Return the driver by the client library."""
        from palpate_devices.ur.driver import URDriver

        return URDriver

    @property
    def arm_model(self) -> ArmModel | None:
        """The model of its type, where that is stated."""
        return MODELS.get(self.model)

    @property
    def command_lag(self) -> float:
        """The time constant of `servoL`, 0.5 lookahead 300/gain: measured on a twin, since it is not published."""
        return _LAG_SHARE * self.lookahead * _LAG_GAIN / self.servo_gain

    def identity(self, observe: bool) -> Mapping[str, str]:
        """Return the facts of the dashboard, where all ports answer and the robot is ready; raises DeviceError."""
        facts = host().controller_facts(self.host, probe)
        refuse_unready(facts, self.host)
        return facts if self.safety_checksum is None else {**facts, "safety_checksum": self.safety_checksum}

    def driver_settings(self, identity: Mapping[str, str], observe: bool) -> dict[str, Any]:
        """Return its keys, with the known model, and `load_known`: True if the controller reports the payload."""
        model = reported_model(identity) if self.model == "auto" and observe else self.model
        return {**super().driver_settings(identity, observe), "model": model, "load_known": reports_payload(identity)}

    def by_hand(self, weighs: bool) -> AbstractContextManager[HandReader]:
        """Return a reader by the client library alone, in local control; `weighs`: by the sensor in the flange."""
        from palpate_devices.ur.hand_reader import URByHand

        return nullcontext(
            URByHand(address=self.host, model=self.model, tcp=self.tcp, rotation=self.tcp_rotation, weighs=weighs)
        )

    @property
    def stop_modes(self) -> StopModes | None:
        """By the safety mode; a system's stop counts as the robot's own."""
        return StopModes("safety_mode", (6, 7, 8), (5,))  # emergency stops, violation; safeguard stop

    @property
    def twin_settings(self) -> Mapping[str, str]:
        """The robot of a twin, and where its work is."""
        return {"robot": f'"{"ur3e" if self.model == "auto" else self.model}"', **self.work_settings}

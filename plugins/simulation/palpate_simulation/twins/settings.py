"""Settings of a bench of twins: its addresses, its specimen, and the noise of its measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from palpate import (
    Angle,
    Delay,
    Device,
    File,
    Force,
    ForceDrift,
    Frequency,
    Length,
    Mass,
    Settings,
    Speed,
    Stiffness,
    Time,
    TipMass,
    Twin,
)
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.work_frame import WorkFrame
from pydantic import Field, model_validator

from palpate_simulation.specimen import Specimen
from palpate_simulation.tool_axes import MOUNTING

# "127.evil.example.com" is a name that leads anywhere.
LOOPBACK = r"^127(\.(25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)){3}$"


class TwinArm(Settings):
    """An arm by its kinematic model, which follows its commands with a lag, and may give way to a force."""

    model: ArmModel = Field(description="joints from the base to the flange")
    lag: Time = Field(gt=0, le=0.5, description="how late it follows its commands")
    posture: tuple[Angle, ...] = Field(description="joints from which the posture at the start is found")
    stiffness: Stiffness | None = Field(default=None, gt=0, description="by which its controller gives way to a force")


class BenchSettings(Twin):
    """The table of a bench of twins."""

    host: str = Field(default="127.0.0.1", pattern=LOOPBACK, description="loopback address of the controller")
    port: File = Field(
        default=Path("~/palpate-sensone"),
        validate_default=True,
        description="path of the sensor's port, in a folder in which others cannot write",
    )
    specimen: Specimen = Field(description="what the tip presses on")
    work: WorkFrame = Field(description="work frame of the specimen: as for the robot")
    tcp: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.12), min_length=3, max_length=3, description="tip on the flange"
    )
    sensor: Literal["bota", "ati", "onrobot"] = Field(
        default="bota", description="a SensONE, or a box that speaks RDT at the controller's address"
    )
    sensor_rate: Frequency = Field(default=1000.0, gt=0, le=2000, description="readings per second of such a box")
    robot: Literal["ur3e", "ur5e", "ur10e", "ur16e"] = Field(default="ur3e", description="which arm it is")
    arm: TwinArm | None = Field(default=None, description="another maker's arm, which a rehearsal enters here")
    height: Length = Field(default=0.01, description="height of the tip over the work frame at the start")
    place: tuple[Length, ...] = Field(
        default=(0.0, 0.0), min_length=2, max_length=2, description="place of the tip along the skin at the start"
    )
    tool_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0),
        min_length=3,
        max_length=3,
        description="rotation vector of the tool at the start from the work frame's orientation, in the tool's frame",
    )
    mounting: tuple[Angle, ...] | None = Field(default=None, min_length=3, max_length=3, description=MOUNTING)
    tcp_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="rotation of the tool on the pendant"
    )
    tip_mass: TipMass = Field(default=0.14, gt=0, description="mass of everything mounted behind the sensor")
    centre_of_mass: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="of that mass, in the sensor's frame"
    )
    payload: Mass = Field(default=0.45, gt=0, le=20, description="everything that hangs at the flange")
    payload_centre: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.04), min_length=3, max_length=3, description="centre of that mass on the flange"
    )
    force_delay: Delay = Field(
        default=0.0, ge=0, le=0.1, description="delay of the sensor's readings; has to be declared to an estimator"
    )
    position_std: Length = Field(default=5e-6, ge=0, description="noise of the measured height")
    velocity_std: Speed = Field(default=0.67e-3, ge=0, description="noise of the measured velocity")
    force_std: Force = Field(default=0.05, ge=0, description="noise of the sensor at a sinc length of 64")
    bias: Force = Field(default=0.6, description="offset of the sensor")
    drift: ForceDrift = Field(default=1.5 / 3600, description="drift of the sensor's offset")
    force_limit: Force = Field(default=500.0, gt=0, description="range of the sensor")
    line_time: Time = Field(default=0.0, ge=0, description="delay added by the serial line to the sensor's period")
    sensor_ppm: float = Field(default=20.0, description="rate error of the sensor's clock, in parts per million")
    clock_start: int = Field(default=0, ge=0, description="the sensor's clock [us] at its start; it wraps at 2^32")

    def replaces(self, device: Device) -> bool:
        """Return True for an arm whose controller has this address."""
        return getattr(device, "host", None) == self.host

    @model_validator(mode="after")
    def _refuse_memory(self) -> Self:
        """Return the settings; raises ValueError for a specimen whose model has a memory."""
        if self.specimen.model.memory:
            raise ValueError("a specimen with memory (a model with internal states) is for the sim device only")
        return self

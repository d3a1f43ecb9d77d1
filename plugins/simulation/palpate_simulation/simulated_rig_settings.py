"""The settings of a simulated rig: specimen, tool, arm and sensor."""

from __future__ import annotations

from typing import Literal

from palpate import (
    Angle,
    Delay,
    Device,
    Force,
    ForceDrift,
    Frequency,
    Length,
    Speed,
    Stiffness,
    Time,
    TipMass,
)
from pydantic import Field

from palpate_simulation.specimen import Specimen
from palpate_simulation.tool_axes import MOUNTING


class SimulatedRigSettings(Device):
    """The keys of a simulated rig, which its link works by."""

    specimen: Specimen = Field(description="what the tip presses on")
    tip_mass: TipMass = Field(default=0.14, gt=0, description="mass of everything mounted behind the sensor")
    centre_of_mass: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="of that mass, in the sensor's frame"
    )
    down: tuple[float, ...] = Field(
        default=(0.0, 0.0, -1.0), min_length=3, max_length=3, description="direction of gravity in the work frame"
    )
    tool_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0),
        min_length=3,
        max_length=3,
        description="rotation vector of the tool from one that looks along the normal, in the tool's frame",
    )
    mounting: tuple[Angle, ...] | None = Field(default=None, min_length=3, max_length=3, description=MOUNTING)
    rate: Frequency = Field(default=500.0, gt=0, description="control and sampling rate of the robot")
    gain: float = Field(
        default=20.0, gt=0, allow_inf_nan=False, description="proportional gain of the position loop, in 1/s"
    )
    damping: float = Field(default=0.5, ge=0, lt=10, description="derivative gain of the position loop")
    lag: Time = Field(default=0.01, gt=0, description="time constant of the robot's inner speed loop")
    unrest: Length = Field(
        default=0.0, ge=0, description="standard deviation of the arm's own motion up and down, 0.5 to 20 Hz"
    )
    position_std: Length = Field(default=5e-6, ge=0, description="noise of the measured position")
    velocity_std: Speed = Field(default=0.67e-3, ge=0, description="noise of the measured velocity")
    sensor_rate: Frequency = Field(default=800.0, gt=0, description="sampling rate of the sensor")
    force_std: Force = Field(default=0.05, ge=0, description="white noise of the sensor")
    bias: Force = Field(default=0.6, description="offset of the sensor")
    drift: ForceDrift = Field(default=1.5 / 3600, description="drift of the sensor's offset")
    series_stiffness: Stiffness | None = Field(
        default=None,
        gt=0,
        description="stiffness of robot and sensor, in series with the material; left out: rigid",
    )
    force_limit: Force = Field(default=500.0, gt=0, description="range of the sensor; readings are clipped there")
    force_delay: Delay = Field(
        default=0.0, description="delay of the wrench's stamps; has to be declared to an estimator"
    )
    motion_delay: Delay = Field(
        default=0.0, description="delay of the stamps of pose and twist; has to be declared to an estimator"
    )
    serial_number: str = Field(
        default="SIM-0001", min_length=1, description="serial number of the sensor, as a real one has"
    )
    seed: int | None = Field(default=None, ge=0, description="seed of the noise; left out: that of the run")
    pace: Literal["fast", "real-time"] = Field(
        default="fast", description="as fast as the machine can, or in real time"
    )

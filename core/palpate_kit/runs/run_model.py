"""The tables of ``result.json`` that concern a whole run: where it comes from, its devices, record and streams."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.json_schema import SkipJsonSchema

Number = float | None
Count = Annotated[int, Field(ge=0)]
Absent = SkipJsonSchema[None]  # of a key that may be absent
Open = dict[str, Any]  # whose keys its writer chooses


class Document(BaseModel):
    """A table, in which keys of a later palpate are left alone."""

    model_config = ConfigDict(strict=True)


class RehearsalDocument(Document):
    """Of a run in simulated time against a twin: nothing was measured."""

    twin: str = Field(description="name of its [twin.*] table")
    specimen: Open | None = Field(description="what the tip pressed on, resolved [SI]; null where the twin has none")
    faults: list[str] = Field(description="faults and their times, as given")
    hold_ups: list[str] = Field(description="processes that the computer kept waiting, as given")
    seed: int = Field(description="of the twin's noise")


class LiftDocument(Document):
    """Of a motion that was made above the specimen: nothing was palpated."""

    height: float = Field(description="above the motion of the pipeline [m]")
    pace: float = Field(description="speed in parts of its own")


class StopDocument(Document):
    """Reason for which the guard stopped the arm."""

    reason: str = Field(description="a sentence")
    monotonic: float = Field(description="monotonic time of the host [s]")


class EstimateDelayDocument(Document):
    """Lateness of the estimates."""

    latency: dict[str, Number] | None = Field(description="from a reading to its estimate [s]")
    largest_behind: float = Field(description="[s]")
    until: Number = Field(description="time of the record at which estimating was given up [s]")


class LiveDocument(Document):
    """Of a run that talked to devices."""

    scheduling: str | Absent = Field(None, description="priority that its threads had")
    standstill: Open | None = Field(None, description="found at standstill [N, m/s]")
    offset: Open | None = Field(
        None,
        description="the sensor's reading in free air as it was stored [N], whether it counted before the motion, and "
        "why not",
    )
    felt: Open | None = Field(None, description="what the sensor felt of a retreat before the motion [N]")
    devices: dict[str, Open] | Absent = Field(
        None, description="what each says of itself, by name; a device fills it as it likes"
    )
    largest_backlog: Count | Absent = Field(None, description="most pieces of readings that waited")
    peak_force: Number = Field(None, description="largest tared reading [N]")
    peak_force_untared: Number = Field(None, description="largest reading [N]")
    ended_early: list[str] | Absent = Field(
        None, description="devices that no safety check needs, and whose stream ended before the motion"
    )
    stop: StopDocument | Absent = Field(None, description="why the guard stopped the arm")
    cpu_cores: Number = Field(None, description="CPU that the run used, as cores")
    estimates: EstimateDelayDocument | Absent = Field(None, description="how late estimates were")


class TareDocument(Document):
    """The reading without load that was subtracted."""

    offset: Number = Field(description="[N]")
    std: Number = Field(description="its standard uncertainty [N]")
    noise: Number = Field(description="of one sample [N]")
    until: Number = Field(description="end of the stretch that it was taken from [s]")


class VelocityDelayDocument(Document):
    """Delay of the velocity channel against the position."""

    value: float = Field(description="[s]")
    std: float = Field(description="its standard uncertainty [s]")


class FirstTouchDocument(Document):
    """Place and time of the first touch of the tip."""

    time: float = Field(description="[s]")
    position: float = Field(description="height of the tip [m]")
    by: Literal["change-point", "threshold"] = Field(description="how it was found")
    lag: float = Field(description="of the threshold behind the touch [s]")


class TurnedToolDocument(Document):
    """The weight of a tool that turns, in the axes of the sensor, and the motion in contact."""

    turn: float = Field(description="distance of the mean weights in contact and in the air before it [N]")
    along: float = Field(description="how much more of it is along the normal in contact than in the air [N]")
    weight: float = Field(description="along the normal in contact [N]")
    spread: float = Field(description="rms of the weight about its mean in free air [N]")
    apart: Number = Field(description="how far the readings in free air are from following it, in parts of spread")
    apart_std: float = Field(description="by noise")
    slope: float = Field(description="tangent of the angle between the stated normal and the motion in contact")
    curvature: float = Field(description="mean of the two of the surface in contact [1/m]")
    curvature_std: float = Field(default=0.0, description="standard uncertainty of it, by the surface [1/m]")
    tilt: float = Field(
        default=0.0, description="between the tool's axis and the normal, which 99 % of the contact is below [rad]"
    )


class ControlDocument(Document):
    """The check of the rig that stands behind a run; `palpate calibrate control` made it."""

    file: str = Field(description="the control chart")
    reference: str = Field(description="what was palpated in the check")
    date: str = Field(description="of the check, ISO 8601", json_schema_extra={"format": "date-time"})
    age: float = Field(description="of the check when the run started [s]")
    old: bool = Field(description="older than [run] control_valid")
    checks: Count = Field(description="in the chart")
    e_n: float = Field(description="(x - X)/sqrt(U_x^2 + U_X^2) of the check, expanded uncertainties of k = 2")
    in_control: bool = Field(description="whether E_n, Shewhart's and the EWMA chart find nothing")
    reasons: list[str] = Field(description="what they find, a sentence each")


class RunDocument(Document):
    """Provenance, and what concerns every track."""

    name: str = Field(description="of the run")
    pipeline: str = Field(description="path of the pipeline file")
    command: list[str] = Field(description="words of the command line")
    seed: int | None = Field(description="of everything random")
    versions: dict[str, str] = Field(description="of palpate, Python and the libraries")
    plugins: list[str] = Field(description="that were loaded")
    inputs: dict[str, str] = Field(description="what the run read: SHA-256 by the name of the input")
    host: str = Field(description="name of the computer")
    rehearsal: RehearsalDocument | Absent = Field(None, description="of a run in simulated time against a twin")
    lifted: LiftDocument | Absent = Field(None, description="of a motion that was made above the specimen")
    control: ControlDocument | Absent = Field(None, description="the check of the rig behind it, of [run] control")
    live: LiveDocument | Absent = Field(None, description="of a run that talked to devices")
    started: str = Field(description="date and time, ISO 8601", json_schema_extra={"format": "date-time"})
    duration: float = Field(description="of the computing [s]")
    samples: Count = Field(description="aligned")
    log_duration: float = Field(description="of the record [s]")
    tare: TareDocument | None = Field(description="null where none was taken")
    velocity_delay: VelocityDelayDocument | None = Field(description="null where it cannot be determined")
    turned_tool: TurnedToolDocument | Absent = Field(None, description="where the tool's orientation is read")
    first_touch: FirstTouchDocument | None = Field(description="null where nothing was touched")


class StreamDocument(Document):
    """Readings of one stream."""

    rate: Number = Field(description="from the time-stamps [Hz]")
    samples: Count = Field(description="readings")
    invalid: Count = Field(description="that are not a number")
    duplicates: Count = Field(description="given twice")
    backwards: Count = Field(description="with a time-stamp before their predecessor's")
    gaps: Count = Field(description="stretches without readings")
    saturated: Count = Field(description="at a limit of the channel")

"""Findings of the alignment in a record: free air and tare, the share of the force sideways, turns of the tool."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.stream_health import Health
from palpate.vectors import Floats

_SLOPE_SIGMAS = 3.0  # a choice: standard uncertainties of a slope that are covered


@dataclass(frozen=True)
class AirLine:
    """The force in free air by a line over time: its level, its slope, and the scatter of readings about it."""

    middle: float  # [s]
    level: float  # [N] there
    level_std: float  # [N]
    slope: float  # [N/s]
    slope_std: float  # [N/s]
    noise: float  # [N] standard deviation of one reading
    until: float  # [s]

    def less(self, offset: float) -> AirLine:
        """Return the line of a force less an offset [N]."""
        return replace(self, level=self.level - offset)

    def at(self, time: Floats) -> Floats:
        """Return the force (n,) [N] at times [s]."""
        return self.level + self.slope * (time - self.middle)

    def spread(self, time: Floats) -> Floats:
        """Return the possible error (n,) [N] of the line at times [s], by standard uncertainties of its slope."""
        return _SLOPE_SIGMAS * self.slope_std * np.abs(time - self.middle)


@dataclass(frozen=True)
class Tare:
    """The offset that was subtracted from the force, and the noise of the force there."""

    offset: float  # [N]
    offset_std: float | None  # [N] standard uncertainty of the offset, from the scatter; None where none was measured
    noise: float | None  # [N] standard deviation of one sample in free air
    until: float | None = None  # [s] end of the free air that it comes from
    air: AirLine | None = None  # less the offset, of a record whose own noise says what counts as touch


@dataclass(frozen=True)
class SidewaysShare:
    """Slopes of the two forces across the tool over the force along it: common changes, without any offset."""

    x: float
    y: float
    std: float  # of each

    @property
    def size(self) -> float:
        """The length of both together."""
        return math.hypot(self.x, self.y)


@dataclass(frozen=True)
class TurnedTool:
    """The weight in the axes of the sensor, in the air before contact and in contact, and the motion in contact."""

    turn: float  # [N] distance of the mean weights in contact and in air; 0 where there is one of them only
    along: float  # [N] how much more of it is along the normal in contact than in the air
    weight: float  # [N] along the normal in contact
    spread: float  # [N] rms of the weight about its mean in free air
    apart: float | None  # how far the readings in free air are from following it, in parts of `spread`; None: no turn
    apart_std: float  # by noise
    slope: float  # tangent of the angle between the normal and the motion in contact; 0 without a stated normal
    curvature: float  # [1/m] mean of the skin's two in contact, by its surface
    curvature_std: float  # [1/m] standard uncertainty of it, by its surface
    tilt: float = 0.0  # [rad] between the tool's axis and the normal, which 99 % of the contact is below


@dataclass(frozen=True)
class AlignmentReport:
    """Findings of the alignment in a record."""

    streams: Mapping[str, Health]  # by "device.stream"
    tare: Tare | None
    touch_force: float  # [N]
    first_touch: tuple[float, float] | None  # time [s], position [m]
    touches: int
    air_force: float | None  # [N] mean before the first touch, where it should be none
    samples: int
    missing_force: int  # samples whose force could not be had: gap, saturation, invalid readings
    missing_velocity: int
    duration: float  # [s] between the first sample and the last
    velocity_delay: tuple[float, float] | None  # [s] of the velocity against the position, and its uncertainty
    by_change_point: bool = False  # the first touch is where contact began; else where touch_force was passed
    pull: float = 0.0  # [N] how far below none the force stays for a few samples, at most
    sideways: SidewaysShare | None = None  # of the force; None where its stream has one axis
    turned: TurnedTool | None = None  # of a tool whose orientation is read
    tilt: float = 0.0  # range of the cosine between tool and z of its poses, where the weight counts as constant
    velocity_share: float | None = None  # the velocity in parts of the change of the position; None where not known

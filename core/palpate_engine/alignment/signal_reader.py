"""Readers of signals: force, height and velocity of a tool at the instants of the samples."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import SidewaysShare, TurnedTool
from palpate.device import Batch
from palpate.vectors import Floats

from palpate_engine.alignment.lateral_force import LateralForce
from palpate_engine.alignment.ports import Port, Ports
from palpate_engine.alignment.signal_series import Series

_QUATERNION = ("qx", "qy", "qz", "qw")
_MAX_NORM_ERROR = (
    1e-3  # of the square of a quaternion, off 1: three digits of a log; beyond it is not a rotation: a choice
)


@dataclass(frozen=True)
class ToolSignals:
    """Signals of a tool at the instants of samples (n,); the height also at the instant after them, where it is."""

    height: Floats  # (n,) or (n + 1,) [m]
    force: Floats  # (n,) [N]; NaN where a reading is missing
    velocity: Floats | None  # (n,) [m/s]; None without such a signal
    curvature: Floats  # (n, 2) [1/m], principal curvatures of the skin; (0, 2) where none is asked for


class ToolReport(NamedTuple):
    """The evidence of a record on the direction of its tool: force across it, its turns, its tilt."""

    sideways: SidewaysShare | None = None  # of the force; None where its stream has one axis
    turned: TurnedTool | None = None  # of a tool whose orientation is read
    tilt: float = 0.0  # range of the cosine between tool and z of its poses, where the weight counts as constant


class SignalReader(Protocol):
    """Reads the series of a record, block by block in their order."""

    @abstractmethod
    def feed(self, device: str, batch: Batch) -> None:
        """Take note of the readings of one of a device's streams."""

    @abstractmethod
    def read(self, stamps: NDArray[np.int64], count: int) -> ToolSignals:
        """Return the signals at the first `count` instants [ns], which become samples; the next is for differences."""

    @abstractmethod
    def release(self, contact: NDArray[np.bool_]) -> None:
        """Take note of which of the samples that were read, in their order, are in contact."""

    @property
    @abstractmethod
    def report(self) -> ToolReport:
        """Return the evidence of the record so far."""


class FixedToolReader(SignalReader):
    """Reads one column for each signal: the tool does not turn, or its weight counts as constant.

    Where the position is that of a stage, the tip is higher by what the beam between them yields, force over stiffness.
    """

    def __init__(self, ports: Ports, series: Mapping[str, Series], beam: float | None = None) -> None:
        self._series, self._beam = series, beam
        self._force, self._position = ports["force"], ports["position"].key
        across = [column for column in self._force.components if column != self._force.column]
        self._lateral = LateralForce((self._force.column, across[0], across[1])) if len(across) == 2 else None
        self._tilt = TiltRange(ports["position"])

    def feed(self, device: str, batch: Batch) -> None:
        """Regress the force across the tool, and watch its poses."""
        if self._lateral is not None and (device, batch.stream) == self._force.key:
            self._lateral.feed(batch)
        if (device, batch.stream) == self._position:
            self._tilt.feed(batch)

    def read(self, stamps: NDArray[np.int64], count: int) -> ToolSignals:
        """Return the columns as they are, but for the height of a stage."""
        height = self._series["position"].values[: len(stamps)]
        velocity = self._series["velocity"].at(stamps[:count]) if "velocity" in self._series else None
        force = self._series["force"].at(stamps if self._beam is not None else stamps[:count])
        if self._beam is not None:
            height = height + force / self._beam
        return ToolSignals(height, force[:count], velocity, np.zeros((0, 2)))

    def release(self, contact: NDArray[np.bool_]) -> None:
        """Its account is the same in air and in contact."""

    @property
    def report(self) -> ToolReport:
        """Share of the force that is across the tool, and its tilt."""
        return ToolReport(None if self._lateral is None else self._lateral.share, tilt=self._tilt.width)


class TiltRange:
    """Range over time of cos(tilt), the z component of the tool's axis: 1 - 2 (x^2 + y^2) of a unit quaternion."""

    def __init__(self, position: Port) -> None:
        names = [channel.name for channel in position.stream.channels]
        has_orientation = position.stream.layout == "pose" and set(_QUATERNION) <= set(names)
        self._columns = [names.index(name) for name in _QUATERNION] if has_orientation else []
        self._low, self._high = math.inf, -math.inf

    def feed(self, batch: Batch) -> None:
        """Take in poses."""
        if not self._columns or not len(batch.time):
            return
        x, y, z, w = batch.values[:, self._columns].T
        unit = np.abs(x * x + y * y + z * z + w * w - 1.0) < _MAX_NORM_ERROR
        cosine = (1.0 - 2.0 * (x * x + y * y))[unit]
        if len(cosine):
            self._low, self._high = min(self._low, float(cosine.min())), max(self._high, float(cosine.max()))

    @property
    def width(self) -> float:
        """Width of the range; 0 where no orientation is known."""
        return max(self._high - self._low, 0.0)

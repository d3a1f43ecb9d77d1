"""Trajectories: where the tip goes, known in full before anything moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from palpate.parts import Part
from palpate.vectors import Floats


@dataclass(frozen=True)
class Setpoint:
    """Where the tip shall be at some instants, in the work frame: origin on the skin, z outwards."""

    position: Floats  # (n, 3) [m]
    velocity: Floats  # (n, 3) [m/s]
    measuring: NDArray[np.bool_]  # (n,) in the part of the motion that is meant for estimation
    turning: Floats | None = None  # (n,) [rad/s] of the tool; None: it keeps its orientation
    lever: float = 0.0  # [m] from the tip to what moves farthest when the tool turns about its tip

    @property
    def fastest_turn(self) -> float:
        """[rad/s]."""
        return float(np.abs(self.turning).max(initial=0.0)) if self.turning is not None else 0.0


@dataclass(frozen=True)
class OwnMotion:
    """What an arm does on its own, besides the commanded motion: it goes to the start, and brakes."""

    speed: float  # [m/s] at most, on the way from where it stands to the first setpoint
    distance: float  # [m] that this way may be long
    deceleration: float  # [m/s^2] of braking
    blind: float = 0.0  # [s] that it may go on where the host stands still and it cannot watch the force by itself


class Trajectory(Part, ABC):
    """A motion of the tip that starts and ends at rest."""

    kind: ClassVar[str] = "trajectory"

    @property
    @abstractmethod
    def total_duration(self) -> float:
        """From the first setpoint to the last [s]."""

    @abstractmethod
    def at(self, time: Floats) -> Setpoint:
        """Setpoints at times (n,) [s] since the start; before it and after the end, the resting places."""


@dataclass(frozen=True)
class ForceLaw:
    """How a force leads the tip along the normal; the setpoints are then the envelope, below which it never goes."""

    force: float  # [N] that is held, positive where the tip is pushed out
    begin: float  # [s] of the motion from which on the force leads
    end: float  # [s] from which on the tip leaves
    speed: float  # [m/s] at most, in and out
    acceleration: float  # [m/s^2] at most
    gain: float  # [m/s] for each newton that is missing


@runtime_checkable
class ForceControlled(Protocol):
    """A trajectory that a force leads: only an arm that closes this loop by itself, under all limits, can follow it."""

    @property
    def force_law(self) -> ForceLaw:
        """The law."""
        ...


@runtime_checkable
class Resumable(Protocol):
    """A trajectory that can be gone on with where it was stopped; others can only be done as one."""

    def after(self, elapsed: float) -> Trajectory | None:
        """The motion that does what was not finished when this one was stopped `elapsed` [s] after its start.

        None where nothing whole is left.
        """
        ...

"""Trajectories: where the tip goes, known in full before anything moves."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from palpate.errors import PluginError
from palpate.part_answer import answer_of
from palpate.parts import Part
from palpate.rotation_vectors import turned_axes
from palpate.surface import Surface
from palpate.vectors import Floats, read_only, read_only_view


@dataclass(frozen=True)
class Setpoint:
    """Where the tip shall be at some instants, in the work frame: origin on the skin, z outwards."""

    position: Floats  # (n, 3) [m]
    velocity: Floats  # (n, 3) [m/s]
    measuring: NDArray[np.bool_]  # (n,) in the part of the motion that is meant for estimation
    # Rotation vectors (n, 3) [rad] of the tool from one that looks along -z, in the work frame's axes, and the angular
    # velocity (n, 3) [rad/s] in them; None: it keeps that orientation.
    rotation: Floats | None = None
    angular_velocity: Floats | None = None
    lever: float = 0.0  # [m] from the tip to what moves farthest when the tool turns about its tip

    @property
    def fastest_turn(self) -> float:
        """Largest angular speed |w| of the setpoints [rad/s]; 0 without rotation."""
        if self.angular_velocity is None:
            return 0.0
        return float(np.linalg.norm(self.angular_velocity, axis=1).max(initial=0.0))

    @property
    def axes(self) -> Floats:
        """Directions (n, 3) out of the skin along the tool."""
        if self.rotation is None:
            return np.broadcast_to(np.array([0.0, 0.0, 1.0]), self.position.shape)
        return turned_axes(self.rotation)


@dataclass(frozen=True)
class OwnMotion:
    """What an arm does on its own, besides the commanded motion: it goes to the start, and brakes."""

    speed: float  # [m/s] at most, on the way from where it stands to the first setpoint
    distance: float  # [m] that this way may be long
    deceleration: float  # [m/s^2] of braking
    blind: float = 0.0  # [s] that it may go on where the host stands still and it cannot watch the force by itself
    stop: tuple[str, float] | None = None  # key and force [N] at which its controller stops it, and leaves it there
    followed_speed: float = math.inf  # [m/s] of commands, at which it is as far behind them as it may be


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
class SupportsSurface(Protocol):
    """A trajectory whose depth is that below a surface, along its normal."""

    @property
    def followed(self) -> Surface | None:
        """The surface; None where the skin is the work frame's plane."""
        ...


def surface_of(trajectory: Trajectory) -> Surface | None:
    """The surface that a motion follows, also as part of another one; None if it follows none."""
    inner = getattr(trajectory, "of", None)
    if isinstance(trajectory, SupportsSurface):
        return trajectory.followed
    return surface_of(inner) if isinstance(inner, Trajectory) else None


@runtime_checkable
class Lifted(Protocol):
    """A trajectory that is another one above the specimen: nothing is palpated with it."""

    @property
    def lift(self) -> float:
        """Height above the other one [m]."""
        ...

    @property
    def pace(self) -> float:
        """Speed in parts of that of the other one."""
        ...


@runtime_checkable
class Resumable(Protocol):
    """A trajectory that can be gone on with where it was stopped; others can only be done as one."""

    def after(self, elapsed: float) -> Trajectory | None:
        """The motion that does what was not finished when this one was stopped `elapsed` [s] after its start.

        None where nothing whole is left.
        """
        ...


def setpoints_at(trajectory: Trajectory, time: Floats) -> Setpoint:
    """Setpoints of a trajectory at times (n,) [s] since its start; read-only, as every device is asked about them.

    Raises PluginError naming the trajectory if it raises, or if what it returns is not a finite setpoint for each.
    """
    span = f" at {time[0]:.3f} to {time[-1]:.3f} s" if len(time) else ""
    found = answer_of(trajectory, lambda: trajectory.at(read_only_view(time)), span)
    name, count = _named(trajectory), len(time)
    if not isinstance(found, Setpoint):
        raise PluginError(f"{name}: its `at` returns {type(found).__name__}, not Setpoint")
    forms: dict[str, tuple[int, ...]] = {"position": (count, 3), "velocity": (count, 3), "measuring": (count,)}
    if found.rotation is not None or found.angular_velocity is not None:
        forms |= {"rotation": (count, 3), "angular_velocity": (count, 3)}
    for field, wanted in forms.items():
        values = getattr(found, field)
        if not isinstance(values, np.ndarray) or values.shape != wanted or values.dtype.kind not in "fiub":
            what = (
                f"{values.dtype} of shape {values.shape}" if isinstance(values, np.ndarray) else type(values).__name__
            )
            raise PluginError(f"{name}: {field} for {count} times is {what}; expected an array of numbers {wanted}")
        rows = np.isfinite(values).reshape(count, -1).all(axis=1)
        if not rows.all():
            raise PluginError(f"{name}: a setpoint is not a finite number: {field} at {time[np.argmin(rows)]:.3f} s")
    return read_only(found)


def duration_of(trajectory: Trajectory) -> float:
    """Duration of a trajectory [s]; raises PluginError naming it where it raises, or returns none that is finite."""
    found = answer_of(trajectory, lambda: trajectory.total_duration)
    if not isinstance(found, (int, float, np.floating)) or not math.isfinite(found) or found < 0:
        raise PluginError(f"{_named(trajectory)}: its total_duration is {found!r}; expected a finite number of seconds")
    return float(found)


def _named(trajectory: Any) -> str:
    return f"trajectory {type(trajectory).__name__}"

"""Trajectories: motions of the tip, known in full before anything moves."""

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
    """Commanded positions of the tip at some instants, in the work frame: origin on the skin, z outwards."""

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
        """The largest angular speed |w| of the setpoints [rad/s]; 0 without rotation."""
        if self.angular_velocity is None:
            return 0.0
        return float(np.linalg.norm(self.angular_velocity, axis=1).max(initial=0.0))

    @property
    def axes(self) -> Floats:
        """The directions (n, 3) out of the skin along the tool."""
        if self.rotation is None:
            return np.broadcast_to(np.array([0.0, 0.0, 1.0]), self.position.shape)
        return turned_axes(self.rotation)


@dataclass(frozen=True)
class OwnMotion:
    """The motion of an arm on its own, besides the commanded one: to the start, and braking."""

    speed: float  # [m/s] at most, on the way from where it stands to the first setpoint
    distance: float  # [m] that this way may be long
    deceleration: float  # [m/s^2] of braking
    blind: float = 0.0  # [s] that it may go on where the host stands still and it cannot watch the force by itself
    stop: tuple[str, float] | None = None  # key and force [N] at which its controller stops it, and leaves it there
    followed_speed: float = math.inf  # [m/s] of commands, at which it is as far behind them as it may be
    yield_force: float = math.inf  # [N] at which its controller has given way as far as it may stand off its command


class Trajectory(Part, ABC):
    """A motion of the tip that starts and ends at rest."""

    kind: ClassVar[str] = "trajectory"

    @property
    @abstractmethod
    def total_duration(self) -> float:
        """The time from the first setpoint to the last [s]."""

    @abstractmethod
    def at(self, time: Floats) -> Setpoint:
        """Return setpoints at times (n,) [s] since the start; before it and after the end, the resting places."""


@dataclass(frozen=True)
class ForceLaw:
    """The law by which a force leads the tip along the normal; the setpoints are then the envelope of its depth."""

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
    """Return the surface that a motion follows, also as part of another one; None if it follows none."""
    inner = getattr(trajectory, "of", None)
    if isinstance(trajectory, SupportsSurface):
        return trajectory.followed
    return surface_of(inner) if isinstance(inner, Trajectory) else None


@runtime_checkable
class Lifted(Protocol):
    """A trajectory that is another one above the specimen: nothing is palpated with it."""

    @property
    def lift(self) -> float:
        """The height above the other one [m]."""
        ...

    @property
    def pace(self) -> float:
        """The speed in parts of that of the other one."""
        ...


@runtime_checkable
class Resumable(Protocol):
    """A trajectory that can be gone on with where it was stopped; others can only be done as one."""

    def after(self, elapsed: float) -> Trajectory | None:
        """Return the motion for the unfinished part when this one was stopped `elapsed` [s] after its start.

        None where nothing whole is left.
        """
        ...


def setpoints_at(trajectory: Trajectory, time: Floats) -> Setpoint:
    """Return setpoints of a trajectory at times (n,) [s] since its start; read-only, since every device gets them.

    Of a setpoint, position [m], velocity [m/s], rotation vector [rad] and angular velocity [rad/s] are (n, 3),
    `measuring` is (n,). Raises PluginError naming the trajectory if it raises, or if what it returns is not a finite
    setpoint for each time.
    """
    times_in_words = f" at {time[0]:.3f} to {time[-1]:.3f} s" if len(time) else ""
    setpoint = answer_of(trajectory, lambda: trajectory.at(read_only_view(time)), times_in_words)
    if not isinstance(setpoint, Setpoint):
        raise PluginError(f"{_name(trajectory)}: its `at` returns {type(setpoint).__name__}, not Setpoint")
    count = len(time)
    shapes: dict[str, tuple[int, ...]] = {"position": (count, 3), "velocity": (count, 3), "measuring": (count,)}
    if setpoint.rotation is not None or setpoint.angular_velocity is not None:
        shapes |= {"rotation": (count, 3), "angular_velocity": (count, 3)}
    for field, shape in shapes.items():
        _check_column(trajectory, field, getattr(setpoint, field), shape, time)
    return read_only(setpoint)


def _check_column(trajectory: Trajectory, field: str, values: Any, shape: tuple[int, ...], time: Floats) -> None:
    """Raise PluginError where a field of setpoints is not an array of finite numbers of a shape."""
    name, count = _name(trajectory), len(time)
    is_array = isinstance(values, np.ndarray)
    if not is_array or values.shape != shape or values.dtype.kind not in "fiub":
        kind = f"{values.dtype} of shape {values.shape}" if is_array else type(values).__name__
        raise PluginError(f"{name}: {field} for {count} times is {kind}; expected an array of numbers {shape}")
    is_finite = np.isfinite(values).reshape(count, -1).all(axis=1)
    if not is_finite.all():
        first = time[np.argmin(is_finite)]
        raise PluginError(f"{name}: a setpoint is not a finite number: {field} at {first:.3f} s")


def duration_of(trajectory: Trajectory) -> float:
    """Return the duration of a trajectory [s]; raises PluginError naming it where it raises, or is not finite."""
    duration = answer_of(trajectory, lambda: trajectory.total_duration)
    if not isinstance(duration, (int, float, np.floating)) or not math.isfinite(duration) or duration < 0:
        problem = f"its total_duration is {duration!r}; expected a finite number of seconds"
        raise PluginError(f"{_name(trajectory)}: {problem}")
    return float(duration)


def _name(trajectory: Any) -> str:
    return f"trajectory {type(trajectory).__name__}"

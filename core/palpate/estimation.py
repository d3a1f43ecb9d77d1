"""Estimation: from samples to parameters, as they come or afterwards."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import IntFlag
from operator import attrgetter
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.contact import ContactModel
from palpate.fit_report import FitReport
from palpate.flags import Flag
from palpate.parts import Part
from palpate.vectors import Floats, read_only


@dataclass(frozen=True)
class Samples:
    """A block of samples: the aligned streams at the instants of the position stream.

    The blocks of a run are shared by all of its plugins and read-only; ``replace(samples, force=...)`` is another one.

    Missing force or velocity is NaN. `force` is the reading without tare and weight of the tip; the inertia
    of the tip, mass times acceleration, is still in it, since only a process model knows the acceleration.
    """

    stamp: NDArray[np.int64]  # (n,) [ns] in the record's own clock
    time: Floats  # (n,) [s] since the record's first sample
    interval: Floats  # (n,) [s] since the sample before; 0 at the first
    force: Floats  # (n,) [N] positive where the tip is pushed out
    position: Floats  # (n,) [m] height of the tip, positive out of the material
    velocity: Floats  # (n,) [m/s] of that height
    contact: NDArray[np.bool_]  # (n,) the tip touches the material
    active: NDArray[np.bool_]  # (n,) in contact, and in the part of the motion that is meant for estimation
    lateral: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # (n, 2) [m] x and y of the tip; NaN: not known
    curvature: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # (n, 2) [1/m] of the skin; NaN: not known

    def __post_init__(self) -> None:
        for key in ("lateral", "curvature"):
            if len(getattr(self, key)) != len(self.time):
                object.__setattr__(self, key, np.broadcast_to(np.nan, (len(self.time), 2)))

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | NDArray[Any]) -> Samples:
        return Samples(*[column[rows] for column in _columns(self)])

    @classmethod
    def joined(cls, blocks: Sequence[Samples]) -> Samples:
        """Return one block from several in their order, read-only where there are several."""
        filled = [block for block in blocks if len(block)] or blocks[:1]
        if len(filled) == 1:
            return filled[0]
        return read_only(cls(*[np.concatenate(columns) for columns in zip(*map(_columns, filled), strict=True)]))


_columns = attrgetter(*(f.name for f in fields(Samples)))


class Status(IntFlag):
    """The state of one estimate; 0 where all is well."""

    IDLE = 1  # not tracking: out of contact, or outside the part of the motion meant for estimation
    LIFTED = 2  # the estimated depth is not positive although the sample is in contact
    RESTARTED = 4  # the estimator restarted here: its depth had stayed at or below zero
    DIVERGED = 8  # the numbers stopped being finite or plausible; nothing after this can be used
    BLIND = 16  # a measurement is missing: predicted only
    STIFF = 32  # the contact is too stiff for the estimator's time step
    RESUMED = 64  # carried over a gap in the samples, or a second touch, by the measured position
    WAITING = 128  # gathering samples to start on; nothing is estimated yet
    REPAIRED = 256  # the covariance had lost its positivity to rounding, and was repaired


@dataclass(frozen=True)
class Estimates:
    """A block of estimates, one for each sample; NaN where a sample has none."""

    time: Floats  # (n,) [s]
    values: Floats  # (n, k) [SI] the contact model's parameters
    std: Floats  # (n, k) [SI] standard deviation of each, as the estimator believes it
    surface: Floats  # (n,) [m] height of the untouched surface
    surface_std: Floats  # (n,) [m]
    force: Floats  # (n,) [N] contact force of the model at the estimate
    nis: Floats  # (n,) normalised innovation squared; 1 on average where model and noise are right
    status: NDArray[np.uint32]  # (n,) of Status
    # What only the estimator's own readers know, in plain data that JSON can hold; it goes into result.json as it is.
    details: Mapping[str, Any] = field(default_factory=dict)
    flags: tuple[Flag, ...] = ()  # of the block as a whole; they join those of the track
    # (n,) innovation over its own standard deviation, with its sign; white where model and noise are right. Of a fit it
    # is the residual over the standard deviation of all residuals.
    innovation: Floats = field(default_factory=lambda: np.zeros(0))
    report: FitReport | None = None  # of an offline fit that was made
    timing_included: bool = False  # whether std holds the uncertainty between force and motion already

    def __post_init__(self) -> None:
        if len(self.innovation) != len(self.time):
            object.__setattr__(self, "innovation", np.full(len(self.time), np.nan))
        for flag in self.flags:
            if not isinstance(flag, Flag):
                raise TypeError(f"a flag is a palpate.Flag(code, message), not {flag!r}")

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def idle(cls, samples: Samples, parameters: int) -> Estimates:
        """Return estimates without numbers, for samples that are not tracked."""
        n, nan = len(samples), np.nan
        column, table = np.full(n, nan), np.full((n, parameters), nan)
        status = np.full(n, Status.IDLE, np.uint32)
        return cls(
            samples.time,
            values=table,
            std=table.copy(),
            surface=column,
            surface_std=column.copy(),
            force=column.copy(),
            nis=column.copy(),
            status=status,
        )


@dataclass(frozen=True)
class Problem:
    """The problem of an estimator: the contact model, and the facts of the rig that the alignment knows."""

    model: ContactModel
    tip_mass: float | None  # [kg] of all that hangs behind the sensor; None where it is not declared
    timing_uncertainty: float | None = None  # [s] standard uncertainty between force and motion; None: not declared
    standstill: float | None = None  # [s] at the record's beginning that the tip hangs still in free air; None: unknown
    others: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # parameters of the other models, by their name
    zero_uncertainty: float | None = None  # [N] standard uncertainty that is stated of the zero of the force
    # Source of the zero of the force: the record's own air, a statement, or none.
    force_zero: Literal["air", "stated", "open"] = "air"


class Tracker(Protocol):
    """An estimator at work: its state lives here."""

    def run(self, samples: Samples) -> Estimates:
        """Return estimates for a block of 1..n samples; the same numbers for any division into blocks."""
        ...


class Estimator(Part, ABC):
    """Settings of an estimator; `start` makes the tracker that does the work."""

    kind: ClassVar[str] = "estimator"
    online: ClassVar[bool] = True  # False: it needs all samples in one block
    motion: ClassVar[Literal["position", "velocity", "both"]] = "both"  # what it takes the tip's motion from
    reusable: ClassVar[bool] = False  # True: its tracker learns nothing, so that one serves any number of records

    @property
    def declared_noise(self) -> tuple[float, float] | None:
        """The assumed standard deviations of force [N] and velocity [m/s]; None of an estimator without such."""
        return None

    @property
    def follows_changes(self) -> bool:
        """True if it is set to follow a material that changes along the way, rather than to find one value."""
        return False

    @property
    def robust(self) -> bool:
        """True if single readings that are far off move its estimates little."""
        return False

    @abstractmethod
    def start(self, problem: Problem) -> Tracker:
        """Return a fresh tracker on a problem; raises ConfigurationError where the problem lacks a needed fact."""


@dataclass(frozen=True)
class Moment:
    """One sample of a step function, see `track_by_step`."""

    interval: float  # [s] since the sample before; 0 at the first of a stretch
    force: float  # [N]
    position: float  # [m]
    velocity: float  # [m/s]
    first: bool  # the first active sample, or the first after a pause


@dataclass(frozen=True)
class Belief:
    """The answer of a step function: its estimate after one sample."""

    values: Floats  # (k,)
    std: Floats  # (k,)
    depth: float  # [m]
    depth_std: float  # [m]
    force: float  # [N]
    nis: float = np.nan
    status: int = 0
    innovation: float = np.nan  # over its own standard deviation, with its sign


def track_by_step(parameters: int, step: Callable[[Moment], Belief]) -> Tracker:
    """Return a tracker from a plain function of one sample, called for the active samples in their order.

    The way for a filter in plain numpy: keep the state where you like (a closure, an object), answer a `Belief`.
    """
    return _StepTracker(parameters, step)


class _StepTracker:
    """Calls a step function for each active sample; see `track_by_step`."""

    def __init__(self, parameters: int, step: Callable[[Moment], Belief]) -> None:
        self._parameters = parameters
        self._step = step
        self._paused = True  # True until the first active sample, and after every one that is not active

    def run(self, samples: Samples) -> Estimates:
        """Return the estimates of a block of samples (n,); idle where a sample is not active.

        The first active sample after a pause has an interval of 0.
        """
        estimates = Estimates.idle(samples, self._parameters)
        for i in range(len(samples)):
            if not samples.active[i]:
                self._paused = True
                continue
            interval = 0.0 if self._paused else float(samples.interval[i])
            moment = Moment(
                interval=interval,
                force=float(samples.force[i]),
                position=float(samples.position[i]),
                velocity=float(samples.velocity[i]),
                first=self._paused,
            )
            _write(estimates, i, moment, self._step(moment))
            self._paused = False
        return estimates


def _write(estimates: Estimates, row: int, moment: Moment, belief: Belief) -> None:
    """Write the answer of a step function as the estimate of one sample."""
    estimates.values[row] = belief.values
    estimates.std[row] = belief.std
    estimates.surface[row] = moment.position + belief.depth
    estimates.surface_std[row] = belief.depth_std
    estimates.force[row] = belief.force
    estimates.nis[row] = belief.nis
    estimates.status[row] = belief.status
    estimates.innovation[row] = belief.innovation

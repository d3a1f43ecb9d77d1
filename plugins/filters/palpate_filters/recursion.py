"""A recursive filter as its tracker needs it: output of its step, first state, state at a pause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from palpate import Floats, Layout, Samples, Status
from palpate_kit.kernel import Step

# Marks of a step's output, in the order in which they stand there, and the bit of the status that each one sets.
MARKS = {
    "lifted": Status.LIFTED,
    "restarted": Status.RESTARTED,
    "blind": Status.BLIND,
    "stiff": Status.STIFF,
    "diverged": Status.DIVERGED,
    "repaired": Status.REPAIRED,
}


def output_layout(parameters: int, states: int = 0) -> Layout:
    """Return the layout of a step's output for so many parameters; with `states`, with mean and covariance as well.

    Parameters and their variances, depth [m] below the surface by the measured position and its variance, contact
    force [N], NIS (negative where nothing was measured), the normalised innovation of one measurement (0 where it is
    missing); then 0 or 1 for: depth not positive, restarted, a measurement missing, too stiff, broken numbers,
    covariance repaired.
    """
    numbers = {"values": parameters, "variances": parameters, "depth": 1, "depth_variance": 1, "force": 1}
    marks = dict.fromkeys(MARKS, 1)
    return Layout(**numbers, nis=1, innovation=1, **marks, mean=states, covariance=states * states)


def surprises(outputs: Floats, layout: Layout) -> tuple[Floats, Floats]:
    """Return NIS and normalised innovation (n,) of outputs of `output_layout`; NaN where nothing was measured."""
    nis, innovation = outputs[:, layout.at("nis")], outputs[:, layout.at("innovation")]
    return np.where(nis < 0, np.nan, nis), np.where(innovation == 0, np.nan, innovation)


@dataclass(frozen=True)
class Carry:
    """The end of a stretch of contact, from which the next one continues."""

    state: Floats | None  # the filter's; None before the first stretch
    surface: float  # [m], by the latest estimate


@dataclass(frozen=True)
class Recursion:
    """A filter as its tracker needs it; the step's output is laid out by `output_layout`."""

    step: Step
    parameters: int
    settings: Callable[[float | None, float | None], Floats]  # from force and velocity noise, where measured
    # State for a stretch, and whether it resumes the last one; None where it needs a longer window, and may (True).
    begin: Callable[[Carry, Samples, bool], tuple[Floats, bool] | None]
    inputs: Callable[[Samples, Floats], Floats]  # the step's samples (m, nw), from samples and their intervals


@dataclass(frozen=True)
class FilterStart:
    """The conditions of a filter's start."""

    window: float = 0.0  # [s] of samples gathered before the first estimate
    measure_noise: bool = False
    standstill: float | None = None  # [s] at the beginning of the record in which the tip is known to be at rest


@dataclass(frozen=True)
class ActiveStretch:
    """A filter's pass over some samples without a pause between them."""

    rows: slice  # in the block
    interval: Floats  # (m,) [s], 0 where contact begins
    surprises: tuple[Floats, Floats]  # NIS and normalised innovation (m,); NaN where nothing was measured
    again: Callable[[], tuple[Floats, Floats]]  # the state after them, and the outputs (m, ny): the same bits again

"""Measures by which the tracks of one record are compared, computed alike for every estimator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from palpate.contact import ContactModel, force_over_time
from palpate.errors import RAISED_BY_PARTS
from palpate.estimation import Estimates, Samples
from palpate.evidence.track_tail import acceleration
from palpate.evidence.uncertain_value import UncertainValue, finite_tree
from palpate.vectors import Floats, finite_rows

SETTLED = 0.05  # share of the end value, within which an estimate has settled; a choice
MAX_SAMPLES = 1 << 17  # that are kept of a track, a choice: 262 s at 500 Hz in 4 MB; what follows is not compared
_NORMAL_QUANTILE = 1.96  # of 97.5 %


@dataclass(frozen=True)
class TrackComparison:
    """Measures of one track."""

    # [s] of contact before the first estimate that counts, a choice: no estimator is judged by its guess.
    WARM_UP: ClassVar[float] = 1.0

    prediction_rms: float  # [N] of the predicted force less the measured one; NaN where nothing was predicted
    force_rms: float  # [N] of the measured contact force at the same samples
    predicted: int  # samples that have a prediction
    predictable: int  # samples that any estimator could have predicted
    nis_band: tuple[float, float]  # in which 95 % of the means lie where model and noise are right; NaN without NIS
    settling_times: Mapping[str, float]  # [s] of contact by parameter
    distances: Mapping[str, float] = field(default_factory=dict)  # value less truth, in combined uncertainties

    @property
    def prediction(self) -> float:
        """The error of the prediction as a part of the force."""
        return self.prediction_rms / self.force_rms if self.force_rms > 0 else math.nan

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> TrackComparison:
        """Return the measures that ``result.json`` holds."""

        def numbers(values: Mapping[str, float | None]) -> dict[str, float]:
            return {name: math.nan if value is None else value for name, value in values.items()}

        errors = numbers({key: table[key] for key in ("prediction_rms", "force_rms")})
        low, high = numbers(dict(zip(("low", "high"), table["nis_band"], strict=True))).values()
        return cls(
            **errors,
            predicted=table["predicted"],
            predictable=table["predictable"],
            nis_band=(low, high),
            settling_times=numbers(table["settling_times"]),
            distances=numbers(table["distances"]),
        )

    def table(self) -> dict[str, Any]:
        """Return the measures as in ``result.json``; null for every number that is not finite."""
        table: dict[str, Any] = finite_tree(
            {
                "prediction": self.prediction,
                "prediction_rms": self.prediction_rms,
                "force_rms": self.force_rms,
                "predicted": self.predicted,
                "predictable": self.predictable,
                "nis_band": list(self.nis_band),
                "settling_times": dict(self.settling_times),
                "distances": dict(self.distances),
            }
        )
        return table


@dataclass
class ComparisonRecord:
    """Keeps what the measures of one track need; the same numbers however a record is cut into blocks."""

    _samples: list[Samples] = field(default_factory=list)  # shared by all tracks
    _estimates: list[Floats] = field(default_factory=list)  # (n, k + 1) parameters and surface
    _count: int = 0

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block."""
        rows = slice(0, MAX_SAMPLES - self._count)
        if not len(samples) or rows.stop <= 0:
            return
        self._samples.append(samples[rows])
        self._estimates.append(np.column_stack([estimates.values[rows], estimates.surface[rows]]))
        self._count += len(self._samples[-1])

    def measure(
        self,
        model: ContactModel,
        tip_mass: float,
        values: Mapping[str, UncertainValue],
        nis_count: int,
    ) -> TrackComparison:
        """Return the measures of a track that ends with `values` and a NIS that is a mean of `nis_count` samples."""
        samples = Samples.joined(self._samples) if self._samples else None
        if samples is None or not samples.active.any():
            return TrackComparison(
                prediction_rms=math.nan,
                force_rms=math.nan,
                predicted=0,
                predictable=0,
                nis_band=nis_band(nis_count),
                settling_times={},
            )
        # The contact force, against the model's at the estimate of the sample before.
        estimates = np.concatenate(self._estimates)
        measured = samples.force + tip_mass * acceleration(samples.time, samples.velocity)
        rows = _predictable_rows(samples, measured)
        predicted = predicted_force(model, samples, estimates)
        counted = rows & np.isfinite(predicted)
        error, force = predicted[counted] - measured[counted], measured[counted]
        return TrackComparison(
            prediction_rms=_rms(error),
            force_rms=_rms(force),
            predicted=int(np.count_nonzero(counted)),
            predictable=int(np.count_nonzero(rows)),
            nis_band=nis_band(nis_count),
            settling_times={
                parameter.name: _settling_time(samples, estimates[:, place], values[parameter.name].value)
                for place, parameter in enumerate(model.parameters)
                if not values[parameter.name].places
            },
        )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def _predictable_rows(samples: Samples, measured: Floats) -> NDArray[np.bool_]:
    """Return True (n,) where an estimate of the sample before predicts the force, after the warm-up."""
    active = samples.active
    begin = float(samples.time[int(np.argmax(active))])
    rows = (
        active
        & (samples.time >= begin + TrackComparison.WARM_UP)
        & np.isfinite(measured)
        & np.isfinite(samples.velocity)
    )
    rows[1:] &= active[:-1]
    rows[0] = False
    return rows


def predicted_force(model: ContactModel, samples: Samples, estimates: Floats) -> Floats:
    """Return the force (n,) [N] of the model at the measured motion with the estimates one sample before.

    `estimates` (n, k + 1) are the k parameters, then the height of the surface [m]. A model with memory is integrated
    along the measured motion from the first active sample, before the first estimate with that. NaN without an
    estimate, where the model raises, and where its force is not finite.
    """
    force = np.full(len(samples), np.nan)
    previous = np.vstack([np.full_like(estimates[:1], np.nan), estimates[:-1]])
    is_known = finite_rows(previous)
    if not is_known.any():
        return force
    # Stretches of contact, each with the estimate of the sample before; an unknown one is the next that is known.
    source = np.minimum.accumulate(np.where(is_known, np.arange(len(is_known)), len(is_known))[::-1])[::-1]
    usable = samples.active & np.isfinite(samples.position) & np.isfinite(samples.velocity) & (source < len(is_known))
    # Rows at which a stretch begins and ends, in turn.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(np.int8)))
    for begin, end in edges.reshape(-1, 2):
        rows = slice(int(begin), int(end))
        theta = previous[source[rows]]
        try:
            with np.errstate(all="ignore"):
                force[rows] = force_over_time(
                    model,
                    samples.time[rows],
                    theta[:, -1] - samples.position[rows],
                    -samples.velocity[rows],
                    theta[:, :-1],
                )
        except RAISED_BY_PARTS:  # whatever a third-party model raises at odd parameters
            continue
    return np.where(is_known, force, np.nan)


def _settling_time(samples: Samples, values: Floats, end: float) -> float:
    """Return the time [s] from the first active sample until the values (n,) stay within 5 % of their end.

    NaN where they have no end.
    """
    rows = np.flatnonzero(samples.active)
    away = ~(np.abs(values[rows] - end) <= SETTLED * abs(end))
    if not math.isfinite(end) or away[-1]:
        return math.nan
    last_away = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
    return float(samples.time[rows[last_away]] - samples.time[rows[0]])


def nis_band(count: int) -> tuple[float, float]:
    """Return the bounds in which 95 % of the means of so many squared white innovations lie.

    Their sum is chi-squared with `count` degrees of freedom; its quantiles by Wilson and Hilferty (1931).
    """
    if not count:
        return math.nan, math.nan
    scale = 2.0 / (9.0 * count)
    low, high = (max(1.0 - scale + side * _NORMAL_QUANTILE * math.sqrt(scale), 0.0) ** 3 for side in (-1, 1))
    return low, high


def distances(values: Mapping[str, UncertainValue], truth: Mapping[str, float]) -> dict[str, float]:
    """Return value less truth in combined uncertainties, by name, of those that have both."""
    return {
        name: (value.value - truth[name]) / value.combined
        for name, value in values.items()
        if name in truth and value.combined > 0 and not value.places
    }

"""The `ting-fit` estimator: one loading and one unloading by Ting's (1966) contact that shrinks in unloading."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import (
    ConfigurationError,
    Estimates,
    Estimator,
    FitReport,
    Flag,
    Floats,
    Problem,
    Samples,
    Time,
    Tracker,
    Unknown,
    loading_cycle_force,
    suggest,
    to_si,
)
from palpate_kit.numerics.normal_equations import scaled_inverse
from palpate_kit.terminal.quantities import number_with_unit
from pydantic import Field

from palpate_fits.arm_order import places_in_order
from palpate_fits.identifiability import INDISTINCT

_GRID = 400  # instants at which the model is asked
_REVERSAL = 0.01  # of the depth; a shorter way up before the deepest point is noise, and no second maximum
_MOST_REVERSAL = 5e-5  # [m] of a robot, however deep it goes
_FEWEST = 50  # samples
_AROUND = 0.2  # [s] of air before touch and after lift-off that are fitted, too
_QUANTILE = 1.96  # std of a value is a part of the wider side of the 95 % interval of its logarithm
_USELESS = 0.5  # relative standard deviation
_SURFACE = 0.02  # of the depth: the unit of the surface in the solver


class TingFit(Estimator):
    """A least-squares fit of a linear material to one loading and one unloading, with the surface unknown.

    Minimises the sum of (F_Ting(t) + m d'' - u)^2 over the model's parameters and the surface, with Ting's force: the
    hereditary integral up to t1(t) only, where the contact was as large on the way in. For every model with a
    relaxation modulus; more than one maximum of the depth is refused by name. The standard deviation counts the
    residuals' autocorrelation, and is that of the wider side of an interval that is even over the logarithm. Assumes
    constant nu, no adhesion, and a motion that stays on one place.
    Source: Ting 1966; Lee and Radok 1960.
    """

    online: ClassVar[bool] = False
    motion: ClassVar[Literal["position", "velocity", "both"]] = "position"
    unloading: ClassVar[str] = "ting"

    fixed: dict[str, float | str] = Field(default={}, description="known values, by name of the parameter")
    first_guess: dict[str, float | str] = Field(default={}, description="start values, by name of the parameter")
    smoothing: Time = Field(default=0.02, gt=0, description="window of the local cubic for depth and acceleration")

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker of a whole record; raises ConfigurationError for a model without a relaxation modulus."""
        names = {parameter.name: parameter for parameter in problem.model.parameters}
        values = {}
        for key, table in (("fixed", self.fixed), ("first_guess", self.first_guess)):
            for name, value in table.items():
                if name not in names:
                    raise ConfigurationError(f"estimator ting-fit: {key}: no parameter {name!r}{suggest(name, names)}")
                try:
                    values[key, name] = to_si(value, names[name].unit)
                except ValueError as error:
                    raise ConfigurationError(f"estimator ting-fit: {key}: {name}: {error}") from error
        begin = [
            values.get(("fixed", n), values.get(("first_guess", n), p.start or 1.0)) for n, p in names.items()
        ]  # fmt: skip
        time = np.linspace(0.0, 1.0, 9)
        try:
            loading_cycle_force(problem.model, time, 1e-3 * (1 - np.abs(2 * time - 1)), begin)
        except ValueError as error:
            raise ConfigurationError(f"estimator ting-fit: {error}") from error
        free = np.array([("fixed", name) not in values for name in names])
        return _TingTracker(self, problem, np.array(begin), free)


class _TingTracker:
    """Fits the whole record that `run` is given."""

    def __init__(self, settings: TingFit, problem: Problem, begin: Floats, free: NDArray[np.bool_]) -> None:
        self._settings, self._problem, self._begin, self._free = settings, problem, begin, free

    def run(self, samples: Samples) -> Estimates:
        """Estimates for the whole record; constant over the fitted samples, and idle outside them."""
        idle = Estimates.idle(samples, len(self._begin))
        touched = np.flatnonzero(samples.contact)
        known = np.isfinite(samples.position) & np.isfinite(samples.force)
        if len(touched) < _FEWEST:
            return replace(
                idle, flags=(Flag("too-few-samples", f"{len(touched)} samples in contact, {_FEWEST} needed"),)
            )
        around = (samples.time > samples.time[touched[0]] - _AROUND) & (
            samples.time < samples.time[touched[-1]] + _AROUND
        )
        rows = known & around
        try:
            return self._fitted(samples, rows, idle)
        except ValueError as error:
            return replace(idle, flags=(Flag("not-fitted", str(error)),))

    def _fitted(self, samples: Samples, rows: NDArray[np.bool_], idle: Estimates) -> Estimates:
        from scipy.optimize import least_squares
        from scipy.signal import savgol_filter

        time, model, count = samples.time[rows], self._problem.model, int(self._free.sum())
        step = float(np.median(np.diff(time)))
        window = max(2 * round(self._settings.smoothing / step / 2) + 1, 5)
        height = np.asarray(savgol_filter(samples.position[rows], window, 3), np.float64)
        bend = np.asarray(savgol_filter(samples.position[rows], window, 3, deriv=2, delta=step), np.float64)
        force = samples.force[rows] + (self._problem.tip_mass or 0.0) * bend
        grid = np.linspace(time[0], time[-1], _GRID)
        on_grid = np.interp(grid, time, height)
        first = float(samples.position[np.flatnonzero(samples.contact)[0]])
        deep = max(first - float(height.min()), 1e-12)
        unit, reversal = _SURFACE * deep, min(_REVERSAL * deep, _MOST_REVERSAL)

        def values(x: Floats) -> Floats:
            theta = self._begin.copy()
            theta[self._free] = np.exp(x[:count])
            return theta

        def modelled(x: Floats) -> Floats:
            surface = first + unit * float(x[count])
            pushed = loading_cycle_force(model, grid, surface - on_grid, values(x).tolist(), reversal)
            return np.asarray(np.interp(time, grid, pushed))

        start = self._started(modelled, force, count)
        bounds = np.array([(max(p.lower, 1e-12), p.upper) for p in model.parameters])[self._free]
        low, high = np.append(np.log(bounds[:, 0]), -50.0), np.append(np.log(np.minimum(bounds[:, 1], 1e15)), 50.0)
        found = least_squares(
            lambda x: modelled(x) - force, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high), x_scale="jac",
            diff_step=1e-5,
        )  # fmt: skip
        return self._told(samples, rows, idle, (values(found.x), first + unit * float(found.x[count])), found, unit)

    def _started(self, modelled: Any, force: Floats, count: int) -> Floats:
        """Return the first guess, with all that is a modulus or a viscosity scaled to the force of the record."""
        x = np.append(np.log(self._begin[self._free]), 0.0)
        shape = modelled(x)
        scale = float(shape @ force) / max(float(shape @ shape), 1e-300)
        free = [p for p, free in zip(self._problem.model.parameters, self._free) if free]
        for i, parameter in enumerate(free):
            if parameter.unit in ("Pa", "Pa*s") and scale > 0 and self._free.all():
                x[i] += math.log(scale)
        return np.asarray(x[: count + 1])

    def _told(
        self,
        samples: Samples,
        rows: NDArray[np.bool_],
        idle: Estimates,
        at: tuple[Floats, float],
        found: Any,
        unit: float,
    ) -> Estimates:
        """Estimates, flags and report of a fit that has ended, its surface in a `unit` [m]."""
        theta, surface = at
        order = places_in_order(self._problem.model, theta)
        if self._free.all():
            theta, found.jac = theta[order], found.jac[:, [*order, len(order)]]
        left, n, count = found.fun, len(found.fun), int(self._free.sum())
        lag = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
        effective = max(n * (1 - max(lag, 0.0)) / (1 + max(lag, 0.0)), count + 2.0)
        power = float(left @ left) / max(n - count - 1, 1)
        covariance = scaled_inverse(found.jac.T @ found.jac) * power * n / effective
        spread = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))
        std = np.zeros(len(theta))
        std[self._free] = theta[self._free] * np.expm1(_QUANTILE * spread[:count]) / _QUANTILE
        for column, value in ((idle.values, theta), (idle.std, std)):
            column[rows] = value
        idle.surface[rows], idle.surface_std[rows] = surface, unit * spread[count]
        idle.force[rows] = samples.force[rows] + left
        idle.nis[rows], idle.status[rows] = 1.0, 0
        idle.innovation[rows] = -left / max(math.sqrt(power), 1e-300)
        unknowns = {
            p.name: Unknown(float(theta[i]), p.unit, bool(self._free[i]), float(std[i]), float(std[i]))
            for i, p in enumerate(self._problem.model.parameters)
        }
        unknowns["surface"] = Unknown(surface, "m", True, unit * float(spread[count]), unit * float(spread[count]))
        rss = float(left @ left)
        bic = n * math.log(max(rss / n, 1e-300)) + (count + 2) * math.log(n)
        report = FitReport(
            rss, n, unknowns, aic=bic + (count + 2) * (2 - math.log(n)), bic=bic, basis="ting", autocorrelation=lag,
            effective_samples=effective,
        )  # fmt: skip
        flags = tuple(self._flags(theta, std, covariance[:count, :count] / np.outer(spread, spread)[:count, :count]))
        return replace(idle, report=report, flags=flags)

    def _flags(self, theta: Floats, std: Floats, correlation: Floats) -> Iterator[Flag]:
        """What the record does not determine."""
        parameters = self._problem.model.parameters
        for place in np.flatnonzero(std > _USELESS * np.abs(theta)):
            parameter = parameters[place]
            number, u = (number_with_unit(size, parameter.unit) for size in (theta[place], std[place]))
            text = f"{parameter.name} of {number} has a std of {u}"
            elastic = parameter.role == "elastic"
            effects = {parameter.name: float(std[place])}
            yield Flag("not-identifiable", text) if elastic else Flag("undetermined", text, effects=effects)
        names = [parameters[place].name for place in np.flatnonzero(self._free)]
        for i, j in combinations(range(len(names)), 2):
            if abs(correlation[i, j]) > INDISTINCT:
                text = f"{names[i]} and {names[j]} (correlation {correlation[i, j]:+.5f})"
                yield Flag("hard-to-tell-apart", text, effects={})

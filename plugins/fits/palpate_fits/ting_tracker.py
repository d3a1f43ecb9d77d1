"""The fit of a whole press by Ting's force: start, minimum, uncertainty, flags."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, FitReport, Flag, Floats, Problem, Samples, Unknown, loading_cycle_force
from palpate_kit.numerics.normal_equations import scaled_inverse
from palpate_kit.terminal.quantities import number_with_unit

from palpate_fits.arm_order import places_in_order
from palpate_fits.identifiability import INDISTINCT

# Choices.
_GRID_INSTANTS = 400  # at which the force of the model is computed; between them it is interpolated
_REVERSAL_SHARE = 0.01  # of the depth: a shorter way up before the deepest point is noise, and no second maximum
_MAX_REVERSAL = 5e-5  # [m] of a robot, however deep it goes
_MIN_SAMPLES = 50  # in contact
_MIN_WINDOW = 5  # samples of a local cubic
_AIR_DURATION = 0.2  # [s] of air before touch and after lift-off that is fitted as well
_USELESS_STD = 0.5  # of a value, from which on a flag says that the record does not determine it
_QUANTILE = 1.96  # of a normal law, at 97.5 %: the ends of a 95 % interval
# Numerics of the solver (choices).
_SURFACE_UNIT_SHARE = 0.02  # of the depth: the unit of the surface
_MAX_SURFACE_UNITS = 50.0  # units: one depth, that the surface may be off
_DIFFERENCE_STEP = 1e-5  # of an unknown, for derivatives
_BOUND_MARGIN = 1e-6  # by which the start is inside the bounds
_MIN_PARAMETER, _MAX_PARAMETER = 1e-12, 1e15  # [SI], since the logarithm of a value is an unknown
_MIN_DEPTH = 1e-12  # [m], in place of 0
_SMALLEST = 1e-300  # [N] or [N^2], in a quotient or a logarithm in place of 0: near the smallest double
_EXPECTED_NIS = 1.0  # of a fit, which has no innovations: the mean where model and noise are right


@dataclass(frozen=True)
class _TingSolution:
    """A converged fit: the surface is counted in a unit [m], parameters in their logarithms."""

    theta: Floats  # (k,)
    surface: float  # [m]
    surface_unit: float  # [m]
    residual: Floats  # (n,) [N] model less measured force
    jacobian: Floats  # (n, p + 1) of the residual by the p free logarithms and the surface


@dataclass(frozen=True)
class _SmoothPress:
    """The samples of a press, smoothed."""

    time: Floats  # (n,) [s]
    height: Floats  # (n,) [m]
    force: Floats  # (n,) [N] without the tip's inertia
    touch: float  # [m] height of the first sample in contact


@dataclass(frozen=True)
class _TingUncertainty:
    """Scatter of the residuals of a fit, and the uncertainties that follow."""

    samples: int
    rss: float  # [N^2]
    autocorrelation: float  # of neighbours
    effective_samples: float
    variance: float  # [N^2]
    std: Floats  # (k,) of all parameters, 0 of fixed ones
    surface_std: float  # [m]
    correlation: Floats  # (p, p) of the free logarithms


class TingTracker:
    """Fits the whole record that `run` is given."""

    def __init__(self, smoothing: float, problem: Problem, start: Floats, free: NDArray[np.bool_]) -> None:
        """Take the window [s] of the local cubic, the start (k,), and True (k,) for the parameters that are free."""
        self._smoothing, self._problem, self._start, self._free = smoothing, problem, start, free

    def run(self, samples: Samples) -> Estimates:
        """Return the estimates of the whole record; constant over the fitted samples, and idle outside them."""
        idle = Estimates.idle(samples, len(self._start))
        touching = np.flatnonzero(samples.contact)
        if len(touching) < _MIN_SAMPLES:
            text = f"{len(touching)} samples in contact, {_MIN_SAMPLES} needed"
            return replace(idle, flags=(Flag("too-few-samples", text),))
        # The contact with some air around it.
        is_known = np.isfinite(samples.position) & np.isfinite(samples.force)
        is_late = samples.time > samples.time[touching[0]] - _AIR_DURATION
        is_early = samples.time < samples.time[touching[-1]] + _AIR_DURATION
        rows = is_known & is_late & is_early
        try:
            return self._fitted_estimates(samples, rows, self._solve(samples, rows))
        except ValueError as error:
            return replace(idle, flags=(Flag("not-fitted", str(error)),))

    def _solve(self, samples: Samples, rows: NDArray[np.bool_]) -> _TingSolution:
        """Return the least-squares fit to some samples; raises ValueError where Ting's force has no value.

        The unknowns are the logarithms of the free parameters, and the surface from the first touch on [units].
        """
        from scipy.optimize import least_squares

        model, count = self._problem.model, int(self._free.sum())
        press = self._press(samples, rows)
        grid = np.linspace(press.time[0], press.time[-1], _GRID_INSTANTS)
        grid_height = np.interp(grid, press.time, press.height)
        depth = max(press.touch - float(press.height.min()), _MIN_DEPTH)
        surface_unit, reversal = _SURFACE_UNIT_SHARE * depth, min(_REVERSAL_SHARE * depth, _MAX_REVERSAL)

        def parameters(x: Floats) -> Floats:
            """Return all parameters (k,) of the unknowns."""
            theta = self._start.copy()
            theta[self._free] = np.exp(x[:count])
            return theta

        def model_force(x: Floats) -> Floats:
            """Return Ting's force (n,) [N] at the samples."""
            surface = press.touch + surface_unit * float(x[count])
            grid_force = loading_cycle_force(model, grid, surface - grid_height, parameters(x).tolist(), reversal)
            return np.asarray(np.interp(press.time, grid, grid_force))

        start = self._scaled_start(model_force, press.force, count)
        low, high = self._bounds()
        minimum = least_squares(
            lambda x: model_force(x) - press.force, np.clip(start, low + _BOUND_MARGIN, high - _BOUND_MARGIN),
            bounds=(low, high), x_scale="jac", diff_step=_DIFFERENCE_STEP,
        )  # fmt: skip
        surface = press.touch + surface_unit * float(minimum.x[count])
        return _TingSolution(
            theta=parameters(minimum.x),
            surface=surface,
            surface_unit=surface_unit,
            residual=minimum.fun,
            jacobian=minimum.jac,
        )

    def _press(self, samples: Samples, rows: NDArray[np.bool_]) -> _SmoothPress:
        """Return height and force of some samples, by local cubics over an odd number of them."""
        from scipy.signal import savgol_filter

        time = samples.time[rows]
        interval = float(np.median(np.diff(time)))
        window = max(2 * round(self._smoothing / interval / 2) + 1, _MIN_WINDOW)
        height = np.asarray(savgol_filter(samples.position[rows], window, 3), np.float64)
        acceleration = np.asarray(savgol_filter(samples.position[rows], window, 3, deriv=2, delta=interval), np.float64)
        force = samples.force[rows] + (self._problem.tip_mass or 0.0) * acceleration
        touch = float(samples.position[np.flatnonzero(samples.contact)[0]])
        return _SmoothPress(time, height, force, touch)

    def _bounds(self) -> tuple[Floats, Floats]:
        """Return the bounds (p + 1,) of the logarithms of the free parameters, and of the surface [units]."""
        parameters = self._problem.model.parameters
        bounds = np.array([(max(p.lower, _MIN_PARAMETER), p.upper) for p in parameters])[self._free]
        low = np.append(np.log(bounds[:, 0]), -_MAX_SURFACE_UNITS)
        high = np.append(np.log(np.minimum(bounds[:, 1], _MAX_PARAMETER)), _MAX_SURFACE_UNITS)
        return low, high

    def _scaled_start(self, model_force: Callable[[Floats], Floats], force: Floats, count: int) -> Floats:
        """Return the unknowns to start from, with all moduli and viscosities scaled to the force (n,) [N] read.

        The force is proportional to them together, so the scale is that of least squares. It is left out where a
        parameter is fixed.
        """
        x = np.append(np.log(self._start[self._free]), 0.0)
        shape = model_force(x)
        scale = float(shape @ force) / max(float(shape @ shape), _SMALLEST)
        if scale > 0 and self._free.all():
            for i, parameter in enumerate(self._problem.model.parameters):
                if parameter.unit in ("Pa", "Pa*s"):
                    x[i] += math.log(scale)
        return np.asarray(x[: count + 1])

    def _fitted_estimates(self, samples: Samples, rows: NDArray[np.bool_], solution: _TingSolution) -> Estimates:
        """Return the estimates, flags and report of a converged fit: constant in the rows (n,), idle elsewhere."""
        theta, jacobian = solution.theta, solution.jacobian
        # Relaxation arms that may change places, in the order of their times; a fixed parameter keeps its place.
        if self._free.all():
            order = places_in_order(self._problem.model, theta)
            theta = theta[order]
            jacobian = jacobian[:, [*order, len(order)]]  # the last column is of the surface
        uncertainty = self._uncertainty(solution, theta, jacobian)

        estimates = Estimates.idle(samples, len(theta))
        estimates.values[rows] = theta
        estimates.std[rows] = uncertainty.std
        estimates.surface[rows] = solution.surface
        estimates.surface_std[rows] = uncertainty.surface_std
        estimates.force[rows] = samples.force[rows] + solution.residual
        estimates.nis[rows] = _EXPECTED_NIS
        estimates.status[rows] = 0  # neither idle nor any other state
        noise = max(math.sqrt(uncertainty.variance), _SMALLEST)
        estimates.innovation[rows] = -solution.residual / noise
        flags = tuple(self._flags(theta, uncertainty.std, uncertainty.correlation))
        return replace(estimates, report=self._report(solution.surface, theta, uncertainty), flags=flags)

    def _report(self, surface: float, theta: Floats, uncertainty: _TingUncertainty) -> FitReport:
        """Return the report of a fit with the parameters (k,).

        BIC = n ln(rss/n) + k ln n and AIC = n ln(rss/n) + 2 k, k being the free parameters, the surface and the noise.
        """
        unknowns = {}
        for i, parameter in enumerate(self._problem.model.parameters):
            std = float(uncertainty.std[i])
            unknowns[parameter.name] = Unknown(
                float(theta[i]), parameter.unit, free=bool(self._free[i]), std=std, random=std
            )
        unknowns["surface"] = Unknown(
            surface, "m", free=True, std=uncertainty.surface_std, random=uncertainty.surface_std
        )
        n, count = uncertainty.samples, int(self._free.sum()) + 2
        bic = n * math.log(max(uncertainty.rss / n, _SMALLEST)) + count * math.log(n)
        return FitReport(
            uncertainty.rss,
            n,
            unknowns,
            aic=bic + count * (2 - math.log(n)),
            bic=bic,
            basis="ting",
            autocorrelation=uncertainty.autocorrelation,
            effective_samples=uncertainty.effective_samples,
        )

    def _uncertainty(self, solution: _TingSolution, theta: Floats, jacobian: Floats) -> _TingUncertainty:
        """Return the uncertainties of parameters (k,), by the residual and its slopes (n, p + 1).

        n residuals with the autocorrelation r of neighbours count as n_eff = n (1 - r)/(1 + r) independent ones, as of
        a first-order autoregression; so the covariance is s^2 (J^T J)^-1 n/n_eff.
        """
        residual, n, count = solution.residual, len(solution.residual), int(self._free.sum())
        rss = float(residual @ residual)
        autocorrelation = float(residual[1:] @ residual[:-1]) / max(rss, _SMALLEST)
        positive = max(autocorrelation, 0.0)
        effective_samples = max(n * (1 - positive) / (1 + positive), count + 2.0)  # one more than there are unknowns

        # Covariance of the logarithms and the surface.
        variance = rss / max(n - count - 1, 1)  # the unknowns are `count` parameters and the surface
        covariance = scaled_inverse(jacobian.T @ jacobian) * variance * n / effective_samples
        log_std = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), np.inf))

        # Of a parameter the wider side of the 95 % interval, theta (exp(1.96 u) - 1), is 1.96 standard deviations.
        std = np.zeros(len(theta))
        std[self._free] = theta[self._free] * np.expm1(_QUANTILE * log_std[:count]) / _QUANTILE
        correlation = covariance[:count, :count] / np.outer(log_std, log_std)[:count, :count]
        surface_std = float(solution.surface_unit * log_std[count])
        return _TingUncertainty(
            samples=n,
            rss=rss,
            autocorrelation=autocorrelation,
            effective_samples=effective_samples,
            variance=variance,
            std=std,
            surface_std=surface_std,
            correlation=correlation,
        )

    def _flags(self, theta: Floats, std: Floats, correlation: Floats) -> Iterator[Flag]:
        """Yield the flags of parameters, and pairs of them, that the record does not determine."""
        parameters = self._problem.model.parameters
        for place in np.flatnonzero(std > _USELESS_STD * np.abs(theta)):
            parameter = parameters[place]
            number, uncertainty = (number_with_unit(size, parameter.unit) for size in (theta[place], std[place]))
            text = f"{parameter.name} of {number} has a std of {uncertainty}"
            if parameter.role == "elastic":
                yield Flag("not-identifiable", text)
            else:
                yield Flag("undetermined", text, effects={parameter.name: float(std[place])})
        names = [parameters[place].name for place in np.flatnonzero(self._free)]
        for i, j in combinations(range(len(names)), 2):
            if abs(correlation[i, j]) > INDISTINCT:
                text = f"{names[i]} and {names[j]} (correlation {correlation[i, j]:+.5f})"
                yield Flag("hard-to-tell-apart", text, effects={})

"""What a fit reports: estimates, and the details that go into result.json."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import BudgetRow, Effect, Estimates, Flag, Floats, Term
from palpate_kit.budget.systematic_terms import source_terms
from palpate_kit.numerics.refusal import NotFitted
from palpate_kit.terminal.quantities import number_with_unit

from palpate_fits.bootstrap import block_bootstrap
from palpate_fits.budget import PROBE, TIMING, FitSensitivity, open_row
from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.height_noise import force_noise
from palpate_fits.identifiability import INDISTINCT, condition, identifiability
from palpate_fits.one_speed import OneSpeedInterval, one_speed_intervals
from palpate_fits.profile_likelihood import ProfileIntervals
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import smooth_depth
from palpate_fits.typed_report import fit_report
from palpate_fits.uncertainty import ResidualScatter, mean_uncertainty, scatter
from palpate_fits.unknowns import EXTRAS

_MISFIT = 2.0  # RMS of the residual against its white noise
_TWO_SPEEDS = "Press at two speeds or oscillate, in which a viscosity shows."
_LONG_CORRELATION = 50.0  # samples
_AT_EDGE = 1e-3  # standard deviations
_USELESS = 0.5  # relative standard deviation of an elastic parameter
_AT_ONCE = 65_536  # samples


@dataclass(frozen=True)
class _FitWithUncertainty:
    """A fit with its uncertainty."""

    fit: FitOutcome
    scatter: ResidualScatter
    random: Floats  # (p,) standard uncertainty of the free unknowns from the residuals
    systematic: Floats  # (p,) from everything declared, without timing
    held: NDArray[np.bool_]  # (p,) at a bound
    budget: list[BudgetRow]
    identifiability: dict[str, Any]
    quantile: float
    one_speed: dict[int, OneSpeedInterval]  # by place among the free


def estimates_of(fit: FitOutcome) -> Estimates:
    """Estimates (n,) of a fit, with details and flags."""
    judged = _judge(fit)
    samples, x = fit.samples, fit.solution.x
    rows: Any = slice(None) if fit.rows.all() else fit.rows
    k = len(fit.problem.model.parameters)
    total = _total(judged)
    empty = Estimates.idle(samples, k)
    values, std = empty.values, empty.std
    values[rows], std[rows] = x[:k], total[:k]
    empty.surface[rows], empty.surface_std[rows] = x[k], total[k]
    empty.status[rows] = 0
    flags = (*fit.notes, *_flags(judged, total))
    timed = fit.unknowns.index("delay") in fit.residual.free
    freedom = max(judged.scatter.samples - len(fit.residual.free), 1)
    _reconstruct(fit, judged.scatter.rss / freedom, empty)
    details = _details(judged, total)
    return replace(
        empty, details=details, flags=flags, report=fit_report(details, judged.budget), timing_included=timed
    )


def _reconstruct(fit: FitOutcome, noise: float, estimates: Estimates) -> None:
    """Write contact force, NIS and residual over its size of the fitted samples, some thousand at a time."""
    record, x = fit.record, fit.solution.x
    if record.history is not None or not record.used.all():
        parts: Iterator[tuple[FitRecord, Floats]] = iter([(record, fit.residual.errors(record, x))])
    else:
        pieces = (record.selected(slice(i, i + _AT_ONCE)) for i in range(0, len(record), _AT_ONCE))
        parts = ((piece, fit.residual.errors(piece, x)) for piece in pieces)
    everything, begin = bool(fit.rows.all()), 0
    places = None if everything else np.flatnonzero(fit.rows)
    for part, errors in parts:
        error, force = _reconstruction(fit, part, errors)
        end = begin + len(error)
        rows: Any = slice(begin, end) if places is None else places[begin:end]
        begin = end
        estimates.force[rows] = force
        estimates.nis[rows] = error**2 / noise if noise > 0 else np.nan
        estimates.innovation[rows] = error / np.sqrt(noise) if noise > 0 else np.nan  # of a fit: its residual


def _reconstruction(fit: FitOutcome, record: FitRecord, error: Floats) -> tuple[Floats, Floats]:
    """Weighted residual and contact force of the model (m,) at the fitted samples of a part of the record."""
    x, k = fit.solution.x, len(fit.problem.model.parameters)
    weight = np.where(record.used, record.weight, 1.0)
    bias, slope, mass = (x[k + EXTRAS.index(name)] for name in ("bias", "slope", "tip_mass"))
    force = error / weight + record.force - mass * record.acceleration - bias - slope * record.time
    if not fit.problem.model.memory:
        # What the transition leaves of a force above the surface is not a force.
        delay = x[k + EXTRAS.index("delay")]
        depth = x[k] - record.height - delay * record.rate + 0.5 * delay**2 * record.acceleration
        force = np.where(smooth_depth(depth, 0.0, record.transition)[0] > record.transition, force, 0.0)
    return error[record.used], force[record.used]


def _judge(fit: FitOutcome) -> _FitWithUncertainty:
    from scipy.special import stdtrit

    found = scatter(fit.residual, fit.record, fit.solution.least, fit.loss)
    if fit.problem.model.memory and fit.solution.moved is not None:  # the slopes there are those of another material
        covariance = scatter(fit.residual, fit.record, fit.solution.x, fit.loss).covariance
        found = replace(found, covariance=covariance)
    free = list(fit.residual.free)
    variance = found.covariance.diagonal()
    if not (variance >= 0).all():  # the unknowns cannot be distinguished within rounding
        raise NotFitted("diverged", "the fit ended where the force hardly depends on its unknowns")
    one_speed = dict(one_speed_intervals(fit, found))
    for interval in one_speed.values():
        found = replace(found, covariance=interval.covariance)
    random = np.sqrt(found.covariance.diagonal())
    low, high = fit.unknowns.bounds(free)
    x = fit.solution.x[free]
    held = (x - low < _AT_EDGE * random) | (high - x < _AT_EDGE * random)
    # Near none a viscosity at one speed has no slope of its own: its interval holds what it does to the others.
    is_fixed = held | np.isin(np.arange(len(free)), list(one_speed))
    sensitivities = FitSensitivity(fit.residual, fit.record, fit.solution.x, is_fixed)
    table, systematic = _budget(fit, sensitivities, found)
    names = [fit.unknowns.names[place] for place in free]
    jacobian = sensitivities.jacobian
    if "delay" not in names:
        jacobian = np.column_stack([jacobian, sensitivities.column(fit.unknowns.index("delay"), PROBE)])
        names.append("delay")
    apart = condition(jacobian[:, : len(free)])
    apart |= identifiability(jacobian.T @ jacobian, names, len(free))
    quantile = float(stdtrit(max(found.effective_samples - len(free), 1.0), 0.5 + fit.settings.confidence / 2))
    return _FitWithUncertainty(fit, found, random, systematic, held, table, apart, quantile, one_speed)


def _budget(fit: FitOutcome, found: FitSensitivity, residual: ResidualScatter) -> tuple[list[BudgetRow], Floats]:
    """Rows of the budget, and the standard uncertainty (p,) that all but the random and the timing row add up to."""
    free, names = list(fit.residual.free), fit.unknowns.names
    values = {names[place]: float(fit.solution.x[place]) for place in free}
    places, problem = {name: place for place, name in enumerate(names)}, fit.problem
    random = np.sqrt(residual.covariance.diagonal()).tolist()
    own = {name: Effect.of(value, u) for (name, value), u in zip(values.items(), random, strict=True)}
    of_model = [source for source in fit.sources if source.path or source.name not in places]
    terms = [
        *source_terms(found, of_model),
        *(
            Term(label, std, unit, found.of_parameter(places[name], std))
            for label, name, std, unit in (
                *((one.name, one.name, one.std, one.unit) for one in fit.sources if one not in of_model),
                *_implied(fit),
            )
        ),
        *_of_rounding(fit, residual),
    ]
    rows = [BudgetRow("scatter of the residuals", None, "", own), *(term.row(values) for term in terms)]
    if places["delay"] not in free:
        per_second = found.of_parameter(places["delay"], PROBE) / PROBE
        if (late := problem.timing_uncertainty) is not None:
            rows.append(Term(TIMING, late, "s", per_second * late).row(values))
        else:
            sensitivities = dict(zip(values, per_second.tolist(), strict=True))
            rows.append(open_row(f"{TIMING} (not declared)", "s", sensitivities))
    systematic = np.sqrt(sum((term.shifts**2 for term in terms), np.zeros(len(free))))
    return rows, systematic


def _of_rounding(fit: FitOutcome, residual: ResidualScatter) -> Iterator[Term]:
    """Yield the last digit of the force, where it exceeds the noise: one error q/sqrt(12) for each plateau of readings.

    Errors of plateaus hardly show in the residual of a hold, which has one of them.
    """
    if fit.digit.exceeds_noise(fit.samples.force[fit.rows]):
        shifts = fit.digit.noise * np.sqrt(np.maximum(residual.inverse_normal.diagonal(), 0.0))
        yield Term("last digit of the force", fit.digit.noise, "N", shifts)


def _zero_uncertainty(fit: FitOutcome, air: Floats) -> float:
    """Standard uncertainty [N] of the mean of the air (n,) [N]; a last digit that exceeds the noise is one error."""
    scatter_of_mean = mean_uncertainty(air)
    return math.hypot(scatter_of_mean, fit.digit.noise) if fit.digit.exceeds_noise(air) else scatter_of_mean


def _implied(fit: FitOutcome) -> Iterator[tuple[str, str, float, str]]:
    """Sources that the settings do not name: the zero of the force, and a contact point that is not fitted.

    The zero is as uncertain as is stated; where nobody states it, as the mean of the air before the contact.
    """
    names = {fit.unknowns.names[place] for place in fit.residual.free}
    declared = {source.name for source in fit.sources}
    if not {"bias"} & (names | declared | set(fit.settings.fixed)):
        if stated := fit.problem.zero_uncertainty:
            yield "tare", "bias", stated, "N"
        elif (approach := fit.by_force.approach) is not None:
            yield "tare", "bias", _zero_uncertainty(fit, approach.force[: approach.air]), "N"
    if fit.settings.contact_point != "free":
        yield "contact point", "surface", fit.by_force.points[fit.settings.contact_point].std, "m"


def _included(fit: FitOutcome) -> Iterator[str]:
    """Causes that the standard deviation holds already, by the names that the budget of a run gives them."""
    known = {fit.unknowns.names[place] for place in fit.residual.free} | {source.name for source in fit.sources}
    known |= {label for label, *_ in _implied(fit)}
    for name, cause in (("bias", "tare"), ("tare", "tare"), ("tip_mass", "mass")):
        if name in known:
            yield cause
    yield from (source.path[-1] if source.path else source.name for source in fit.sources)


def _total(judged: _FitWithUncertainty) -> Floats:
    """Standard uncertainty (P,) of all parameters, timing left out; for those that are fixed what is stated, or 0."""
    fit = judged.fit
    total = np.zeros(len(fit.solution.x))
    for source in fit.sources:
        if source.name in fit.unknowns.names:
            total[fit.unknowns.index(source.name)] = source.std
    total[list(fit.residual.free)] = np.hypot(judged.random, judged.systematic)
    if fit.settings.contact_point != "free":
        total[fit.unknowns.index("surface")] = fit.by_force.points[fit.settings.contact_point].std
    return total


def _details(judged: _FitWithUncertainty, total: Floats) -> dict[str, Any]:
    fit, found = judged.fit, judged.scatter
    free, names = list(fit.residual.free), fit.unknowns.names
    count, n = len(free) + 1, found.samples  # the noise is a parameter, too
    likelihood = n * float(np.log(max(found.rss / n, 1e-300)))
    record, used = fit.record, fit.record.used
    lowest = float(np.min(record.height, where=used, initial=np.inf))
    details = {
        "solver": fit.solver,
        "evaluations": fit.solution.evaluations,
        "segment": fit.settings.segment,
        "samples": n,
        "cycles": fit.course.cycles,
        "depth": float(fit.solution.x[fit.unknowns.index("surface")]) - lowest,
        "rate_rms": _rms(record.rate if used.all() else record.rate[used]),
        "smoothing": fit.motion.window,
        "unknowns": _table(judged, total),
        "covariance": {"names": [names[i] for i in free], "matrix": found.covariance.tolist()},
        "rss": found.rss,
        "rms": float(np.sqrt(found.rss / n)),
        "noise": found.noise,
        "aic": likelihood + 2 * count,
        "bic": likelihood + count * float(np.log(n)),
        "autocorrelation": {
            "first": found.first_correlation,
            "time": found.correlation_time,
            "effective_samples": found.effective_samples,
        },
        "confidence": fit.settings.confidence,
        "included": list(_included(fit)),
        "identifiability": judged.identifiability,
        "contact_points": {name: {"surface": p.surface, "std": p.std} for name, p in fit.by_force.points.items()},
        "notes": ["AIC and BIC count every sample as independent; use their order, not their size"],
    }
    if fit.settings.bootstrap:
        details["bootstrap"] = block_bootstrap(
            fit.residual, fit.unknowns, fit.record, fit.solution.x, fit.loss, found, fit.settings.bootstrap,
            fit.settings.seed, fit.settings.confidence,
        )  # fmt: skip
    return details


def _rms(values: Floats) -> float:
    return float(np.sqrt(values @ values / len(values)))


def _table(judged: _FitWithUncertainty, total: Floats) -> dict[str, Any]:
    """By name: value, bounds, and for what is free its uncertainties and interval."""
    fit, free = judged.fit, list(judged.fit.residual.free)
    profile = None
    if fit.settings.profile and free:
        profile = ProfileIntervals(fit.residual, fit.unknowns, fit.record, fit.solution.x, fit.loss)
    table: dict[str, Any] = {}
    for place, item in enumerate(fit.unknowns.items):
        value = float(fit.solution.x[place])
        known: dict[str, Any] = {"value": value, "unit": item.unit, "free": place in free}
        if place in free:
            j = free.index(place)
            random = float(judged.random[j])
            known |= {"std": float(total[place]), "random": random, "systematic": float(judged.systematic[j])}
            known |= {"lower": item.lower, "upper": item.upper, "at_bound": bool(judged.held[j])}
            profiled = profile is not None and (item.name not in EXTRAS or item.name == "surface")
            ends = profile.interval(place, random, judged.quantile) if profile is not None and profiled else None
            if j in judged.one_speed:
                ends = judged.one_speed[j].lower, judged.one_speed[j].upper
            known["interval_by"] = "profile" if ends else "normal"
            known["interval"] = list(ends or (value - judged.quantile * random, value + judged.quantile * random))
        elif total[place]:
            known["std"] = float(total[place])
        table[item.name] = known
    return table


def _misfit(fit: FitOutcome, found: ResidualScatter) -> Iterator[Flag]:
    """Whether the residual is more than the noise in the air, or than its own white noise where there was no air."""
    rms = float(np.sqrt(found.rss / max(found.samples, 1)))
    noise = found.noise if fit.by_force.approach is None else fit.by_force.approach.noise
    noise = math.hypot(noise, fit.digit.noise)
    if fit.by_force.approach is not None and rms > _MISFIT * noise:  # in the air the height's noise is not felt
        surface = fit.unknowns.index("surface")
        noise = float(np.hypot(noise, force_noise(fit.residual, fit.record, fit.solution.x, surface)))
    if noise > 0 and rms > _MISFIT * noise:
        what = f"the residual of {rms:.3g} N is more than noise, {noise:.3g} N: something is not in the model"
        yield Flag("misfit", what)
    if found.correlation_time > _LONG_CORRELATION:
        yield Flag(
            "correlated-residuals",
            f"the residuals are not noise: they correlate over {found.correlation_time:.3g} samples, so "
            f"{found.samples} count as {found.effective_samples:.3g}",
        )


def _is_none(fit: FitOutcome, place: int) -> bool:
    """Return True if a viscosity or damping is at 0, its lower bound: the record shows none of it."""
    parameters = fit.problem.model.parameters
    return place < len(parameters) and parameters[place].role == "viscous" and fit.solution.x[place] <= 0.0


def _flags(judged: _FitWithUncertainty, total: Floats) -> Iterator[Flag]:
    fit, found = judged.fit, judged.scatter
    free, names, x = list(fit.residual.free), fit.unknowns.names, fit.solution.x
    if not fit.solution.converged:
        what = f"the solver {fit.solver} stopped after {fit.solution.evaluations} evaluations"
        yield Flag("not-converged", what)
    for j, place in enumerate(free):
        if j in judged.one_speed and judged.one_speed[j].lower == 0.0:
            most = number_with_unit(judged.one_speed[j].upper, fit.unknowns.items[place].unit)
            text = f"{names[place]} is at most {most}: at one speed it is the height of the surface to first order"
            yield Flag("undetermined", text, effects={names[place]: float(total[place])}, remedy=_TWO_SPEEDS)
        elif judged.held[j] and _is_none(fit, place):
            most = number_with_unit(2 * total[place], fit.unknowns.items[place].unit)
            text = f"{names[place]} is zero, or at most {most}"
            yield Flag("undetermined", text, effects={names[place]: float(total[place])}, remedy=_TWO_SPEEDS)
        elif judged.held[j]:
            by_force = names[place] == "surface" and fit.settings.force_uncertainty is not None
            what = "where the measured force leaves force_uncertainty" if by_force else "a bound"
            text = f"{names[place]} is at {what}, {number_with_unit(x[place], fit.unknowns.items[place].unit, 5)}"
            own = any(parameter.name == names[place] for parameter in fit.problem.model.parameters)
            yield Flag("at-bound", text, effects={names[place]: math.inf} if own else None)
    yield from _misfit(fit, found)
    for name in judged.identifiability["without_effect"]:
        yield Flag("not-identifiable", f"{name} has no effect on the force in this record")
    for pair in judged.identifiability["pairs"]:
        if pair["both_fitted"] and abs(pair["correlation"]) > INDISTINCT:
            found_so = f"{pair['first']} and {pair['second']} (correlation {pair['correlation']:+.5f})"
            yield Flag("hard-to-tell-apart", found_so, effects={})
    for parameter, value, std in zip(fit.problem.model.parameters, x.tolist(), total.tolist(), strict=False):
        if parameter.role == "elastic" and std > _USELESS * abs(value):
            number, u = (number_with_unit(size, parameter.unit) for size in (value, std))
            found_so = f"{parameter.name} of {number} has a std of {u}"
            yield Flag("not-identifiable", found_so)

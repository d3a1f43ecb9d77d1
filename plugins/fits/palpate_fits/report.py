"""The report of a fit: estimates, uncertainties, and the details that go into result.json."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from palpate import Estimates, Floats

from palpate_fits.bootstrap import block_bootstrap
from palpate_fits.fit_flags import fit_flags
from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.fit_uncertainty import FitWithUncertainty, implied_sources, with_uncertainty
from palpate_fits.profile_likelihood import ProfileIntervals
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import smooth_depth
from palpate_fits.typed_report import fit_report
from palpate_fits.unknowns import EXTRAS

_SAMPLES_AT_ONCE = 65_536  # whose forces are reconstructed in one piece (choice: memory)
_SMALLEST_VARIANCE = 1e-300  # [N^2] in a logarithm, in place of 0: near the smallest double


def estimates_of(fit: FitOutcome) -> Estimates:
    """Return the estimates (n,) of a fit, with details and flags."""
    evaluated = with_uncertainty(fit)
    samples, x = fit.samples, fit.solution.x
    rows: Any = slice(None) if fit.rows.all() else fit.rows
    k = len(fit.problem.model.parameters)
    total = _total_std(evaluated)
    # Constant over the fitted samples, idle outside them; the surface follows the k parameters of the model.
    estimates = Estimates.idle(samples, k)
    estimates.values[rows], estimates.std[rows] = x[:k], total[:k]
    estimates.surface[rows], estimates.surface_std[rows] = x[k], total[k]
    estimates.status[rows] = 0  # neither idle nor any other state
    freedom = max(evaluated.scatter.samples - len(fit.residual.free), 1)
    _reconstruct(fit, evaluated.scatter.rss / freedom, estimates)
    details = _details(evaluated, total)
    return replace(
        estimates,
        details=details,
        flags=(*fit.notes, *fit_flags(evaluated, total)),
        report=fit_report(details, evaluated.budget),
        timing_included=fit.unknowns.index("delay") in fit.residual.free,
    )


def _reconstruct(fit: FitOutcome, variance: float, estimates: Estimates) -> None:
    """Write contact force, NIS and standardised residual of the fitted samples into the estimates.

    `variance` [N^2] is that of the residual, which serves as the innovation. A record without a history is worked on in
    pieces.
    """
    record, x = fit.record, fit.solution.x
    if record.history is not None or not record.used.all():
        pieces: Iterator[FitRecord] = iter([record])
    else:
        pieces = (record.selected(slice(i, i + _SAMPLES_AT_ONCE)) for i in range(0, len(record), _SAMPLES_AT_ONCE))
    fitted_rows = None if fit.rows.all() else np.flatnonzero(fit.rows)
    begin = 0
    for piece in pieces:
        error, force = _error_and_force(fit, piece, fit.residual.errors(piece, x))
        end = begin + len(error)
        rows: Any = slice(begin, end) if fitted_rows is None else fitted_rows[begin:end]
        begin = end
        estimates.force[rows] = force
        estimates.nis[rows] = error**2 / variance if variance > 0 else np.nan
        estimates.innovation[rows] = error / np.sqrt(variance) if variance > 0 else np.nan


def _error_and_force(fit: FitOutcome, record: FitRecord, error: Floats) -> tuple[Floats, Floats]:
    """Return weighted residual and contact force of the model (m,) at the fitted samples of a piece of the record.

    The force is the expected reading, error over weight plus measured force, less inertia, bias and drift.
    """
    x, k = fit.solution.x, len(fit.problem.model.parameters)
    weight = np.where(record.used, record.weight, 1.0)
    bias, slope, mass = (x[k + EXTRAS.index(name)] for name in ("bias", "slope", "tip_mass"))
    force = error / weight + record.force - mass * record.acceleration - bias - slope * record.time
    if not fit.problem.model.memory:
        # Above the surface the gradual onset of contact leaves a remainder, which is not a force.
        delay = x[k + EXTRAS.index("delay")]
        depth = x[k] - record.height - delay * record.rate + 0.5 * delay**2 * record.acceleration
        force = np.where(smooth_depth(depth, 0.0, record.transition)[0] > record.transition, force, 0.0)
    return error[record.used], force[record.used]


def _included(fit: FitOutcome) -> Iterator[str]:
    """Yield the causes that the standard deviation includes, by the names that the budget of a run gives them."""
    names = {fit.unknowns.names[place] for place in fit.residual.free}
    names |= {source.name for source in fit.sources}
    names |= {label for label, *_ in implied_sources(fit)}
    for name, cause in (("bias", "tare"), ("tare", "tare"), ("tip_mass", "mass")):
        if name in names:
            yield cause
    yield from (source.path[-1] if source.path else source.name for source in fit.sources)


def _total_std(evaluated: FitWithUncertainty) -> Floats:
    """Return the standard uncertainty (P,) of all parameters without timing; of fixed ones what is stated, or 0."""
    fit = evaluated.fit
    total = np.zeros(len(fit.solution.x))
    for source in fit.sources:
        if source.name in fit.unknowns.names:
            total[fit.unknowns.index(source.name)] = source.std
    total[list(fit.residual.free)] = np.hypot(evaluated.random, evaluated.systematic)
    if fit.settings.contact_point != "free":
        total[fit.unknowns.index("surface")] = fit.by_force.points[fit.settings.contact_point].std
    return total


def _details(evaluated: FitWithUncertainty, total: Floats) -> dict[str, Any]:
    """Return what ``result.json`` has of a fit, with standard uncertainties (P,) of all parameters.

    AIC and BIC are n log(rss/n) + 2 k and n log(rss/n) + k log n, the noise being one of the k parameters.
    """
    fit, scatter = evaluated.fit, evaluated.scatter
    free, names = list(fit.residual.free), fit.unknowns.names
    # n log(rss/n): -2 times the logarithm of the likelihood, but for a constant.
    count, n = len(free) + 1, scatter.samples
    deviance = n * float(np.log(max(scatter.rss / n, _SMALLEST_VARIANCE)))
    # The deepest fitted sample, from which the depth is counted.
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
        "unknowns": _unknowns_table(evaluated, total),
        "covariance": {"names": [names[i] for i in free], "matrix": scatter.covariance.tolist()},
        "rss": scatter.rss,
        "rms": float(np.sqrt(scatter.rss / n)),
        "noise": scatter.noise,
        "aic": deviance + 2 * count,
        "bic": deviance + count * float(np.log(n)),
        "autocorrelation": {
            "first": scatter.first_correlation,
            "time": scatter.correlation_time,
            "effective_samples": scatter.effective_samples,
        },
        "confidence": fit.settings.confidence,
        "included": list(_included(fit)),
        "identifiability": evaluated.identifiability,
        "contact_points": {name: {"surface": p.surface, "std": p.std} for name, p in fit.by_force.points.items()},
        "notes": ["AIC and BIC count every sample as independent; use their order, not their size"],
    }
    if fit.settings.bootstrap:
        details["bootstrap"] = block_bootstrap(
            fit.residual,
            fit.unknowns,
            fit.record,
            fit.solution.x,
            fit.loss,
            correlation_time=scatter.correlation_time,
            repeats=fit.settings.bootstrap,
            seed=fit.settings.seed,
            confidence=fit.settings.confidence,
        )
    return details


def _rms(values: Floats) -> float:
    """Return the root of the mean square of values (n,)."""
    return float(np.sqrt(values @ values / len(values)))


def _unknowns_table(evaluated: FitWithUncertainty, total: Floats) -> dict[str, Any]:
    """Return, by name, each parameter's value, and its uncertainties, bounds and interval where it is free."""
    fit, free = evaluated.fit, list(evaluated.fit.residual.free)
    profile = None
    if fit.settings.profile and free:
        profile = ProfileIntervals(fit.residual, fit.unknowns, fit.record, fit.solution.x, fit.loss)
    table: dict[str, Any] = {}
    for place, item in enumerate(fit.unknowns.items):
        entry: dict[str, Any] = {"value": float(fit.solution.x[place]), "unit": item.unit, "free": place in free}
        if place in free:
            j = free.index(place)
            entry |= {"std": float(total[place]), "random": float(evaluated.random[j])}
            entry |= {"systematic": float(evaluated.systematic[j])}
            entry |= {"lower": item.lower, "upper": item.upper, "at_bound": bool(evaluated.at_bound[j])}
            entry |= _interval_entry(evaluated, profile, place)
        elif total[place]:
            entry["std"] = float(total[place])
        table[item.name] = entry
    return table


def _interval_entry(evaluated: FitWithUncertainty, profile: ProfileIntervals | None, place: int) -> dict[str, Any]:
    """Return the interval of a free unknown, by its likelihood profile where that has ends, else by a normal law.

    Unknowns besides the model's parameters and the surface enter linearly, and need no profile.
    """
    fit = evaluated.fit
    j, name = fit.residual.free.index(place), fit.unknowns.names[place]
    value, random = float(fit.solution.x[place]), float(evaluated.random[j])
    ends = None
    if j in evaluated.one_speed:
        ends = evaluated.one_speed[j].lower, evaluated.one_speed[j].upper
    elif profile is not None and (name not in EXTRAS or name == "surface"):
        ends = profile.interval(place, random, evaluated.quantile)
    if ends is not None:
        return {"interval_by": "profile", "interval": list(ends)}
    half_width = evaluated.quantile * random
    return {"interval_by": "normal", "interval": [value - half_width, value + half_width]}

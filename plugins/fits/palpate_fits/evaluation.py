"""Evaluation of the fit of one log on other logs, and fits of each cycle of a log."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from palpate import ConfigurationError, Problem
from palpate_engine import TrackResult

from palpate_fits.fit_jobs import LogFit

# Settings that an estimator needs to evaluate the fit of one log on another.
_REFIT_SETTINGS = {"fixed", "bounds", "start_at", "profile", "systematic", "contact_point", "solver", "bootstrap"}


def evaluate(logs: Sequence[LogFit], carry: bool) -> list[dict[str, Any]]:
    """Return rows with the residual of each log by the material that was fitted to each other.

    Surface and bias are fitted again on each log; with `carry` the surface is that of the other log as well.
    """
    rows = []
    for source in logs:
        for name, track in source.fitted.items():
            for target in logs:
                if set(type(_track(target, name).estimator).model_fields) >= _REFIT_SETTINGS:
                    row = {"track": name, "fitted_on": source.name, "on": target.name}
                    rows.append(row | _fit_with_material(track, target, name, carry))
    return rows


def _track(log: LogFit, name: str) -> Any:
    """Return the track of a name in a log's pipeline; raises ConfigurationError without one."""
    for track in log.pipeline.tracks:
        if track.name == name:
            return track
    raise ConfigurationError(f"{log.pipeline.path}: has no track {name!r}, so nothing can be evaluated on it")


def _fit_with_material(source: TrackResult, log: LogFit, name: str, carry: bool) -> dict[str, Any]:
    """Return the row of a log's track of a name, fitted with the parameters of the `source` held."""
    track = _track(log, name)
    fixed = {parameter.name: source.parameters[parameter.name].value for parameter in track.model.parameters}
    if carry:
        fixed["surface"] = source.surface.value
    # Surface and bias of the log are free, without bounds, starts, uncertainties and method of the material's fit.
    changes = {
        "fixed": {**track.estimator.fixed, **fixed},
        "bounds": {},
        "start_at": {},
        "profile": False,
        "systematic": {},
        "contact_point": "free",
        "solver": "auto",
        "bootstrap": 0,
    }
    return _refit(log, track, changes)


def _refit(log: LogFit, track: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """Return RSS, RMS, samples, unknowns and flags of a fit under changed settings."""
    alignment = log.pipeline.alignment
    problem = Problem(track.model, alignment.tip_mass, force_zero=alignment.force_zero)
    estimates = track.estimator.model_copy(update=changes).start(problem).run(log.samples)
    report = estimates.report.table() if estimates.report is not None else {"unknowns": {}}
    return {
        **{key: report.get(key) for key in ("rss", "rms", "samples", "unknowns")},
        "flags": [flag.table() for flag in log.pipeline.registry.judged(estimates.flags)],
    }


def each_cycle(log: LogFit) -> Iterable[dict[str, Any]]:
    """Yield every cycle of a log fitted by itself."""
    for name, result in log.fitted.items():
        track = _track(log, name)
        if "segment" not in type(track.estimator).model_fields:
            continue
        for cycle in range(1, (result.report.cycles if result.report else 0) + 1):
            segment = f"{track.estimator.segment}, cycles {cycle}..{cycle}"
            yield {"log": log.name, "track": name, "cycle": cycle} | _refit(log, track, {"segment": segment})

"""What a fit of one log says of others, and of each cycle of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from palpate import ConfigurationError, Problem
from palpate_engine import TrackResult

from palpate_fits.fit_jobs import LogFit

# Settings of an estimator that can evaluate on one log what was found on another.
_REFITTED = {"fixed", "bounds", "start_at", "profile", "systematic", "contact_point", "solver", "bootstrap"}


def evaluate(logs: Sequence[LogFit], carry: bool) -> list[dict[str, Any]]:
    """What the material that was found on one log leaves of the force on another.

    Surface and bias are found again on each log, or with `carry` taken over, too.
    """
    rows = []
    for source in logs:
        for name, track in source.fitted.items():
            for target in logs:
                if set(type(_track(target, name).estimator).model_fields) >= _REFITTED:
                    rows.append(
                        {"track": name, "fitted_on": source.name, "on": target.name} | _left(track, target, name, carry)
                    )
    return rows


def _track(log: LogFit, name: str) -> Any:
    for track in log.pipeline.tracks:
        if track.name == name:
            return track
    raise ConfigurationError(f"{log.pipeline.path}: has no track {name!r}, so nothing can be evaluated on it")


def _left(track: TrackResult, target: LogFit, name: str, carry: bool) -> dict[str, Any]:
    there = _track(target, name)
    fixed = {parameter.name: track.parameters[parameter.name].value for parameter in there.model.parameters}
    if carry:
        fixed["surface"] = track.surface.value
    changes = {
        "fixed": {**there.estimator.fixed, **fixed},
        "bounds": {},
        "start_at": {},
        "profile": False,
        "systematic": {},
    }
    changes |= {"contact_point": "free", "solver": "auto", "bootstrap": 0}
    return _refit(target, there, changes)


def _refit(log: LogFit, track: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """RSS, RMS, surface and parameters of a fit under changed settings."""
    alignment = log.pipeline.alignment
    problem = Problem(track.model, alignment.tip_mass, force_zero=alignment.force_zero)
    estimates = track.estimator.model_copy(update=changes).start(problem).run(log.samples)
    found = estimates.report.table() if estimates.report is not None else {"unknowns": {}}
    return {
        **{key: found.get(key) for key in ("rss", "rms", "samples", "unknowns")},
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

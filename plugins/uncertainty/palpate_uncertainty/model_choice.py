"""Model choice: the record's evidence between models that the stated geometry admits, and their spread."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import Diagnosed, Flag, Floats, TrackEvidence

from palpate_uncertainty.refitted_model import left_by
from palpate_uncertainty.settings import ChoiceSettings

# They apply where a pipeline lets the record choose between models ([choice]).
_WINDOW_TIMES = 5.0  # of the correlation time, at which its sum is cut off (Sokal 1997)
_SAMPLES_PER_LAG = 4  # of an autocovariance, at least (choice)
_SMALLEST_VARIANCE = 1e-300  # in a logarithm, in place of 0: near the smallest double


@dataclass(frozen=True)
class WeightedModels:
    """The weighted candidates of one parameter."""

    weights: Floats  # (m,) that add up to 1
    value: float  # weighted
    within: float  # root of the weighted mean of the candidates' own variances
    spread: float  # of the candidates; not below their unweighted standard deviation

    @property
    def combined(self) -> float:
        """The standard uncertainty of the weighted value."""
        return math.hypot(self.within, self.spread)


def weigh_models(values: Floats, stds: Floats, bic: Floats, effective: float, samples: float) -> WeightedModels:
    """Return values (m,) weighted by exp(-dBIC n_eff/n / 2); the spread is never below their standard deviation.

    n_eff of the n samples are independent: the BIC is that of as many as the residual is worth.
    Sources: Kass and Raftery 1995; Buckland, Burnham and Augustin 1997.
    """
    difference = (bic - bic.min()) * min(effective / max(samples, 1.0), 1.0)
    weights = np.exp(-difference / 2)
    weights = weights / weights.sum()
    mean = float(weights @ values)
    between = math.sqrt(float(weights @ (values - mean) ** 2))
    within = math.sqrt(float(weights @ stds**2))
    return WeightedModels(weights, mean, within, max(between, float(np.std(values, ddof=1))))


def model_choice(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the findings on the tracks of the candidates, by estimator; none without a [choice] table."""
    settings = tracks[0].tables.get("choice") if tracks else None
    if not isinstance(settings, ChoiceSettings):
        return {}
    findings: dict[str, Diagnosed] = {}
    for estimator in dict.fromkeys(track.name.partition("/")[2] for track in tracks):
        group = [track for track in tracks if track.name.partition("/")[2] == estimator]
        group = [track for track in group if _model_of(track) in settings.candidates]
        if len(group) > 1:
            findings |= _group_findings(group, settings.candidates)
    return findings


@dataclass(frozen=True)
class _Evidence:
    """The evidence of a track's residual for its model."""

    bic: float
    samples: float
    effective_samples: float  # of these, that are independent


def _group_findings(group: list[TrackEvidence], candidates: tuple[str, ...]) -> dict[str, Diagnosed]:
    """Return the findings on the tracks of one estimator, by name; `candidates` are the models of the [choice] table.

    Each track of the group has another of these models.
    """
    evidence = [_evidence(track) for track in group]
    bic = np.array([item.bic for item in evidence])
    best = evidence[int(np.argmin(bic))]
    # Each parameter that all candidates have, weighted by the evidence of the best one's samples.
    results: dict[str, WeightedModels] = {}
    for name in _shared_parameters(group):
        values = np.array([_of(track, name, "values") for track in group])
        stds = np.array([_of(track, name, "combined") for track in group])
        stds = np.where(np.isfinite(stds), stds, 0.0)
        results[name] = weigh_models(values, stds, bic, best.effective_samples, best.samples)
    findings = {track.name: _finding(track, group, results, best, bic) for track in group}
    missing = set(candidates) - {_model_of(track) for track in group}
    if missing:
        text = f"[choice] names {', '.join(sorted(missing))}, of which the run has no result"
        flag = Flag("choice-incomplete", text)
        findings = {name: replace(finding, flags=(*finding.flags, flag)) for name, finding in findings.items()}
    return findings


def _model_of(track: TrackEvidence) -> str:
    """Return the name of a track's model."""
    return track.name.partition("/")[0]


def _shared_parameters(group: Sequence[TrackEvidence]) -> list[str]:
    """Return the names of the parameters that all models have."""
    names = [[parameter.name for parameter in track.model.parameters] for track in group]
    return [name for name in names[0] if all(name in other_names for other_names in names)]


def _finding(
    track: TrackEvidence,
    group: list[TrackEvidence],
    results: Mapping[str, WeightedModels],
    best: _Evidence,
    bic: Floats,
) -> Diagnosed:
    """Return the distance of a track's values from the weighted ones, as terms of its budget, and the note on it.

    `results` are the weighted values by parameter, `bic` (m,) that of each track of the group, `best`
    is the evidence of the likeliest.
    """
    terms, table = {}, dict[str, Any]()
    for name, models in results.items():
        terms[name] = math.hypot(models.spread, _of(track, name, "values") - models.value)
        table[name] = {
            "value": models.value,
            "combined": models.combined,
            "within": models.within,
            "spread": models.spread,
        }
    # The weights of the models are the same for every parameter.
    weights = next(iter(results.values())).weights if results else np.zeros(0)
    model_names = [_model_of(other) for other in group]
    weight_by_model = dict(zip(model_names, weights.tolist(), strict=False))
    table["weights"] = weight_by_model
    table["samples"] = best.samples
    table["effective_samples"] = best.effective_samples
    table["bic"] = dict(zip(model_names, bic.tolist(), strict=True))
    # The note: weights, independent samples, and the first parameter's weighted value.
    weight_text = ", ".join(f"{name} {100 * weight:.0f} %" for name, weight in weight_by_model.items())
    sample_text = f"{best.effective_samples:.3g} of {best.samples:.0f} samples independent"
    text = f"the record weights the admitted models {weight_text} ({sample_text})"
    first = next(iter(results), None)
    if first is not None:
        models = results[first]
        text += f"; combined, {first} is {models.value:.4g} ± {models.combined:.2g} {_unit(track, first)}"
    return Diagnosed((Flag("model-choice", text),), terms, frozenset(), table)


def _unit(track: TrackEvidence, name: str) -> str:
    """Return the unit of a parameter."""
    return next(parameter.unit for parameter in track.model.parameters if parameter.name == name)


def _of(track: TrackEvidence, name: str, column: str) -> float:
    """Return a parameter's entry in a column of its track, such as `values`."""
    place = [parameter.name for parameter in track.model.parameters].index(name)
    return float(getattr(track, column)[place])


def _evidence(track: TrackEvidence) -> _Evidence:
    """Return BIC and samples of a track's residual; of a refit for a filter."""
    if track.report is not None and track.report.bic is not None:
        n, effective = track.report.samples, track.report.effective_samples
        return _Evidence(track.report.bic, float(n), float(effective or n))
    residual = left_by(track)
    n = max(len(residual), 1)
    variance = float(np.mean(residual**2))
    unknowns = len(track.model.parameters) + 2  # the surface and the noise, too
    bic = n * math.log(max(variance, _SMALLEST_VARIANCE)) + unknowns * math.log(n)
    return _Evidence(bic, float(n), n / correlation_time(residual))


def correlation_time(residual: Floats) -> float:
    """Return the sum of the autocorrelation from -inf to inf [samples]; at least 1.

    The sum ends at 5 times itself (Sokal 1997).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n = len(residual)
    length = next_fast_len(2 * n)  # padded, so that the ends of the record do not meet
    spectrum = np.abs(np.asarray(rfft(residual - residual.mean(), length))) ** 2
    autocovariance = np.asarray(irfft(spectrum, length))[: max(n // _SAMPLES_PER_LAG, 2)]
    if autocovariance[0] <= 0:
        return 1.0
    time = 1.0 + 2.0 * np.cumsum(autocovariance[1:]) / autocovariance[0]
    is_complete = np.arange(1, len(autocovariance)) >= _WINDOW_TIMES * time
    complete = np.flatnonzero(is_complete)
    return float(max(time[complete[0]] if len(complete) else time[-1], 1.0))

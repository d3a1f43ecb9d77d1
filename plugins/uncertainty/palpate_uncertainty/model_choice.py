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


@dataclass(frozen=True)
class WeightedModels:
    """Candidates of one parameter, weighed."""

    weights: Floats  # (m,) that add up to 1
    value: float  # weighted
    within: float  # root of the weighted mean of the candidates' own variances
    spread: float  # of the candidates; not below their unweighted standard deviation

    @property
    def combined(self) -> float:
        """Standard uncertainty of the weighted value."""
        return math.hypot(self.within, self.spread)


def weigh_models(values: Floats, stds: Floats, bic: Floats, effective: float, samples: float) -> WeightedModels:
    """Values (m,) weighed by exp(-dBIC n_eff/n / 2); the spread is never below their standard deviation.

    Sources: Kass and Raftery 1995; Buckland, Burnham and Augustin 1997, with the BIC of as many independent samples as
    the residual is worth.
    """
    lead = (bic - bic.min()) * min(effective / max(samples, 1.0), 1.0)
    weights = np.exp(-lead / 2)
    weights = weights / weights.sum()
    value = float(weights @ values)
    between = math.sqrt(float(weights @ (values - value) ** 2))
    return WeightedModels(
        weights, value, math.sqrt(float(weights @ stds**2)), max(between, float(np.std(values, ddof=1)))
    )


def model_choice(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Findings on the tracks of the candidates, estimator by estimator; none without a [choice] table."""
    settings = tracks[0].tables.get("choice") if tracks else None
    if not isinstance(settings, ChoiceSettings):
        return {}
    found: dict[str, Diagnosed] = {}
    for estimator in dict.fromkeys(track.name.partition("/")[2] for track in tracks):
        group = [track for track in tracks if track.name.partition("/")[2] == estimator]
        group = [track for track in group if track.name.partition("/")[0] in settings.candidates]
        if len(group) > 1:
            found |= _group(group, settings.candidates)
    return found


def _group(group: list[TrackEvidence], candidates: tuple[str, ...]) -> dict[str, Diagnosed]:
    missing = set(candidates) - {track.name.partition("/")[0] for track in group}
    scores = [_score(track) for track in group]
    bic = np.array([score[0] for score in scores])
    best = int(np.argmin(bic))
    _, samples, effective = scores[best]
    shared = [
        p.name for p in group[0].model.parameters
        if all(p.name in {q.name for q in track.model.parameters} for track in group)
    ]  # fmt: skip
    results: dict[str, WeightedModels] = {}
    for name in shared:
        values, stds = (np.array([_of(track, name, column) for track in group]) for column in ("values", "combined"))
        results[name] = weigh_models(values, np.where(np.isfinite(stds), stds, 0.0), bic, effective, samples)
    found = {track.name: _finding(track, group, results, (samples, effective), bic) for track in group}
    if missing:
        text = f"[choice] names {', '.join(sorted(missing))}, of which the run has no result"
        found = {name: replace(f, flags=(*f.flags, Flag("choice-incomplete", text))) for name, f in found.items()}
    return found


def _finding(
    track: TrackEvidence,
    group: list[TrackEvidence],
    results: Mapping[str, WeightedModels],
    counted: tuple[float, float],
    bic: Floats,
) -> Diagnosed:
    terms, table = {}, dict[str, Any]()
    for name, result in results.items():
        terms[name] = math.hypot(result.spread, _of(track, name, "values") - result.value)
        table[name] = {
            "value": result.value, "combined": result.combined, "within": result.within, "spread": result.spread,
        }  # fmt: skip
    weights = next(iter(results.values())).weights if results else np.zeros(0)
    names = [other.name.partition("/")[0] for other in group]
    by_name = dict(zip(names, weights.tolist(), strict=False))
    table |= {
        "weights": by_name, "samples": counted[0], "effective_samples": counted[1],
        "bic": dict(zip(names, bic.tolist(), strict=True)),
    }  # fmt: skip
    said = ", ".join(f"{name} {100 * weight:.0f} %" for name, weight in by_name.items())
    text = f"the record weights the admitted models {said} ({counted[1]:.3g} of {counted[0]:.0f} samples independent)"
    first = next(iter(results), None)
    if first is not None:
        result = results[first]
        text += f"; combined, {first} is {result.value:.4g} ± {result.combined:.2g} {_unit(track, first)}"
    return Diagnosed((Flag("model-choice", text),), terms, frozenset(), table)


def _unit(track: TrackEvidence, name: str) -> str:
    return next(parameter.unit for parameter in track.model.parameters if parameter.name == name)


def _of(track: TrackEvidence, name: str, column: str) -> float:
    place = [parameter.name for parameter in track.model.parameters].index(name)
    return float(getattr(track, column)[place])


def _score(track: TrackEvidence) -> tuple[float, float, float]:
    """BIC of a track's residual, its samples, and how many of them are independent."""
    if track.report is not None and track.report.bic is not None:
        n, effective = track.report.samples, track.report.effective_samples
        return track.report.bic, float(n), float(effective or n)
    residual = left_by(track)
    n = max(len(residual), 1)
    power = float(np.mean(residual**2))
    unknowns = len(track.model.parameters) + 2  # the surface and the noise, too
    bic = n * math.log(max(power, 1e-300)) + unknowns * math.log(n)
    return bic, float(n), n / correlation_time(residual)


def correlation_time(residual: Floats) -> float:
    """Sum of the autocorrelation from -inf to inf [samples], up to 5 times itself (Sokal 1997); at least 1."""
    from scipy.fft import irfft, next_fast_len, rfft

    n = len(residual)
    length = next_fast_len(2 * n)
    spectrum = np.abs(np.asarray(rfft(residual - residual.mean(), length))) ** 2
    gamma = np.asarray(irfft(spectrum, length))[: max(n // 4, 2)]
    if gamma[0] <= 0:
        return 1.0
    time = 1.0 + 2.0 * np.cumsum(gamma[1:]) / gamma[0]
    enough = np.flatnonzero(np.arange(1, len(gamma)) >= 5.0 * time)
    return float(max(time[enough[0]] if len(enough) else time[-1], 1.0))

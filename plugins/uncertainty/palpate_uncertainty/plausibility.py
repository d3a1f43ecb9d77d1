"""Plausibility: estimates at the end of a track are settled, consistent, and possible for soft material."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from palpate import (
    ContactModel,
    Diagnosed,
    Flag,
    Floats,
    Indenter,
    SampleStore,
    Tail,
    TrackEnd,
    TrackEvidence,
)

from palpate_uncertainty.information_bound import bounds_at_best, correlation, slope_by_chance, steady, white_noise

# Decision 0004: what is left of an estimate's settling is in its uncertainty; a flag is raised beyond these.
_MAX_SETTLING = 0.02  # of a value: slope times time tracked
_MAX_SETTLING_STDS = 3.0  # [standard deviations] of the value
_MAX_CHANCE_SLOPE = 3.5  # [standard deviations] of a slope: of two parameters one in 1000 tracks is beyond by chance
# Choices: wider than chance alone makes them.
_NIS_RANGE = (0.5, 1.6)  # of the mean over the last second; 0.9 to 1.1 would be one by chance alone
_MAX_AUTOCORRELATION = 0.3  # of innovations; 0.1 occurs by chance alone
# Choices: a weak force has to determine the values by itself.
_WEAK_SWING = 5.0  # [standard deviations] of its noise that a force swings by: above, it is not tested
_MAX_RELATIVE_BOUND = 0.2  # of a value: a weak force must determine it to this, by the Cramer-Rao bound
_SOFT_RANGE = (10.0, 1e9)  # [Pa] from the softest gels to hard rubber
_MIN_TAIL = 10  # samples of a tail, to judge whether it has settled; a choice
_MIN_REMAINDER = 1e-3  # of 1 - r, for the effect of a correlation r near 1; a choice


def plausibility(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the findings on each track, from the seconds of which its result is a mean."""
    return {track.name: Diagnosed(_flags(track, track.ending)) for track in tracks if track.ending is not None}


def _flags(track: TrackEvidence, end: TrackEnd) -> tuple[Flag, ...]:
    """Return the flags of the end of one track; one that names the error where its model raises."""
    try:
        return tuple(ending_flags(end, track.kept, track.model, track.estimator.online, track.report is not None))
    except Exception as error:  # of a model that cannot say more than its force: the other tracks are judged
        return (Flag("diagnosis-failed", f"plausibility: {type(error).__name__}: {error}"),)


def ending_flags(end: TrackEnd, kept: SampleStore, model: ContactModel, online: bool, fitted: bool) -> Iterator[Flag]:
    """Yield the flags of the end of one track.

    An offline estimate is one of the whole record: it does not drift, and its first seconds are those that settle.
    `online` is True for an estimator by recursion, `fitted` for a fit; `kept` are samples of the whole track.
    """
    tail, last = end.tail, end.last
    yield from _unit_flags(last, model)
    if online:
        yield from _convergence_flags(end, model)
    else:
        settled = tail.since(float(tail.time[0]) + end.average)
        yield from _innovation_flags(settled, model, last.std[-1], f"after the first {end.average:g} s")
        yield from _colour_flags(settled, model, last.std[-1])
    if not fitted:  # a fit itself flags what its record does not determine
        yield from _force_flags(end, kept, model)
    yield from _validity_flags(model, last)


def _unit_flags(last: Tail, model: ContactModel) -> Iterator[Flag]:
    """Yield a flag for an elasticity that nothing soft has: force or height are in another unit than is stated."""
    for column, parameter in enumerate(model.parameters):
        value = float(last.values[:, column].mean())
        if parameter.role == "elastic" and parameter.unit == "Pa" and not _SOFT_RANGE[0] <= value <= _SOFT_RANGE[1]:
            text = f"{parameter.name} of {value:.3g} Pa is not that of anything soft ({_SOFT_RANGE[0]:g} Pa to 1 GPa)"
            sizes = {p.name: abs(float(last.values[:, k].mean())) for k, p in enumerate(model.parameters)}
            text = f"{text}: are force and height in the units that are declared?"
            yield Flag("implausible", text, effects={**sizes, parameter.name: math.inf})


def _convergence_flags(end: TrackEnd, model: ContactModel) -> Iterator[Flag]:
    """Yield a flag where the estimates have not settled, and those of the innovations.

    The result is a mean over the last seconds, and a track of less than twice as many has not settled. On a sweep
    estimates follow the material from place to place and never settle.
    """
    tail, last, tracked = end.tail, end.last, end.tracked
    if tracked < 2 * end.average or len(tail.time) < _MIN_TAIL:
        yield Flag("not-converged", f"only {tracked:.2g} s were tracked")
        return
    # What each value has still to go, beyond what counts as settled and what chance makes.
    moving: list[str] = []
    effects: dict[str, float] = {}
    by_chance = _MAX_CHANCE_SLOPE * tracked * slope_by_chance(tail)
    for column, parameter in enumerate(model.parameters if not end.is_sweep else ()):
        value, std = float(last.values[:, column].mean()), float(last.std[-1, column])
        settling = float(tail.unsettled(tail.values, tracked)[column])
        if settling > max(_MAX_SETTLING * abs(value), _MAX_SETTLING_STDS * std, float(by_chance[column])):
            moving.append(f"{parameter.name} by {100 * settling / tracked / abs(value):.2f} % a second")
            effects[parameter.name] = settling
    if moving:
        text = f"still moving after {tracked:.3g} s: {', '.join(moving)}"
        yield Flag("not-converged", text, effects=effects, causes=("settling",))
    yield from _innovation_flags(last, model, last.std[-1], f"in the last {end.average:g} s")
    yield from _colour_flags(tail, model, last.std[-1])


def _innovation_flags(tail: Tail, model: ContactModel, std: Floats, when: str) -> Iterator[Flag]:
    """Yield the flag where innovations are not as large as the filter expects: each std (k,) is off by sqrt(NIS)."""
    # With and without hesitations of the arm: these make large innovations, or a large scale of all.
    finite = np.isfinite(tail.nis)
    parts = (tail.nis[finite], tail.nis[finite & steady(tail)])
    nis, *steady_nis = [float(np.mean(part)) for part in parts if len(part)] or [1.0]
    if not any(_NIS_RANGE[0] <= mean <= _NIS_RANGE[1] for mean in (nis, *steady_nis)):
        text = f"NIS of {nis:.2g} {when} where 1 is expected: noise or model is wrong"
        yield Flag("inconsistent", text, effects=_missing_std(model, std, math.sqrt(nis)))


def _colour_flags(tail: Tail, model: ContactModel, std: Floats) -> Iterator[Flag]:
    """Yield the flag where innovations predict one another.

    As an autoregression of the first order with the coefficient r, n of them are worth n (1 - r)/(1 + r), and each
    standard deviation `std` (k,) is too small by the root of that.
    """
    lag, r = correlation(tail)
    if abs(r) > _MAX_AUTOCORRELATION:
        text = f"innovations {lag} samples apart correlate by {r:+.2f}"
        scale = math.sqrt((1.0 + r) / max(1.0 - r, _MIN_REMAINDER))
        yield Flag("coloured-innovations", text, effects=_missing_std(model, std, scale))


def _missing_std(model: ContactModel, std: Floats, scale: float) -> dict[str, float]:
    """Return what the standard deviation (k,) of each parameter lacks where it is too small by a factor `scale`."""
    growth = max(scale - 1.0, 0.0)
    return {parameter.name: growth * size for parameter, size in zip(model.parameters, std.tolist(), strict=True)}


def _force_flags(end: TrackEnd, kept: SampleStore, model: ContactModel) -> Iterator[Flag]:
    """Yield the flag where the force swings too little to determine the track's values.

    A filter knows the samples before its end as well.
    """
    tare, last = end.report.tare, end.last
    noise = tare.noise if tare and tare.noise else white_noise(last)
    swing = float(np.nanmax(last.model_force) - np.nanmin(last.model_force))
    if swing < _WEAK_SWING * noise and not _determines_all(end, kept, model, noise):
        yield Flag("not-identifiable", f"the force swings by {swing:.2g} N against a noise of {noise:.2g} N")


def _determines_all(end: TrackEnd, kept: SampleStore, model: ContactModel, noise: float) -> bool:
    """Return True if the record can determine every parameter estimated."""
    values, bounds = np.abs(end.last.values.mean(axis=0)), bounds_at_best(end.tail, kept, model, noise, end.samples)
    free = [i for i, parameter in enumerate(model.parameters) if parameter.name not in end.held]
    return bool((bounds < _MAX_RELATIVE_BOUND * values)[free].all())


def _validity_flags(model: ContactModel, last: Tail) -> Iterator[Flag]:
    """Yield a flag where the greatest depth is beyond the model's own limits."""
    depth = float(np.max(last.surface - last.position)) if len(last.time) else 0.0
    problem = model.validity(depth) if np.isfinite(depth) and depth > 0 else ""
    if problem:  # where other geometries bound what is beyond, that is a row of the budget and no doubt by itself
        tip = getattr(model, "indenter", None)
        skin = getattr(model, "skin", None)
        by_tip = isinstance(tip, Indenter) and bool(tip.validity(depth) or (skin and skin.validity(tip, depth)))
        bounded = not by_tip and bool(model.other_geometries(depth, last.values.mean(axis=0).tolist()))
        yield Flag("beyond-model-range", problem, effects={} if bounded else None)

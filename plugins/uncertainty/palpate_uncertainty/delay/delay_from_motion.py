"""The delay of the force that a rich motion determines by itself, under several laws of the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Bias, Diagnosed, Flag, Floats, TrackEvidence
from palpate_kit.numerics.normal_equations import standard_errors
from palpate_kit.terminal.quantities import value_with_unit

from palpate_uncertainty.delay.delay_fit import DelayFit, fit_delay, fit_with_delay, variance_inflation
from palpate_uncertainty.delay.response_laws import kelvin_voigt, richer_laws, simple_laws
from palpate_uncertainty.delay.timed_record import TimedRecord, white_noise
from palpate_uncertainty.delay.timing_shift import is_viscous
from palpate_uncertainty.refit import possible, sweeps
from palpate_uncertainty.whiteness import oscillation

_DETERMINED_FACTS = frozenset({"delay"})  # that the motion determines
# Of decision 0153. They apply to a delay that nobody has stated.
_MAX_RELATIVE_STD = 0.3  # of a viscosity with an unknown delay, below which the motion is rich
_MAX_BIC_DIFFERENCE = 10.0  # from the best law, within which one counts by exp(-dBIC/2)
_MAX_BIC_OF_SPREAD = 30.0  # from the best law, within which one spreads the delay where no law is the model's own
_MIN_OTHER_SHARE = 0.2  # of the rate's variance, that more than one line must hold
# Choices: whatever the motion, a short record does not determine a delay.
_MIN_SAMPLES = 1000  # of a record that is looked at
_MIN_CORRECTION = 0.005  # of a value; a smaller one is not written


@dataclass(frozen=True)
class _LawComparison:
    """Several laws, each fitted with its own delay to one record; the first is the law of the model."""

    record: TimedRecord  # with an inertia that is as late as the force
    inflation: float  # variance of a mean of residuals over that of white ones
    fits: Sequence[DelayFit]

    @property
    def model_fit(self) -> DelayFit:
        """The fit of the model's own law."""
        return self.fits[0]

    @cached_property
    def best_bic(self) -> float:
        """The least BIC of all laws."""
        return min(fit.bic for fit in self.fits)

    @cached_property
    def plausible_fits(self) -> list[DelayFit]:
        """The laws that describe the record nearly as well as the best."""
        return [fit for fit in self.fits if fit.bic - self.best_bic < _MAX_BIC_DIFFERENCE]

    def spread(self, deviations: Floats) -> Floats:
        """Return the RMS (k,) of deviations (m, k) of the plausible laws, each by its weight exp(-dBIC/2)."""
        evidence = np.array([np.exp(0.5 * (self.best_bic - fit.bic)) for fit in self.plausible_fits])
        shares = evidence / evidence.sum()
        return np.asarray(np.sqrt(shares @ deviations**2))


def diagnose_delay(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the delay of each track whose timing is not declared, or that estimates it, where the motion is rich."""
    return {track.name: _judge_delay(track) for track in tracks if is_rich(track)}


def is_rich(track: TrackEvidence) -> bool:
    """Return True if a track's motion distinguishes delay and viscosity, and nobody has declared its timing."""
    if not _has_two_parameters(track):
        return False
    if np.count_nonzero(track.kept.used) < _MIN_SAMPLES or sweeps(track) or not possible(track):
        return False
    if one_line(track):
        return False
    # The viscosity's standard deviation if the delay is unknown as well.
    record = TimedRecord.of(track)
    noise, slopes = record.slopes(kelvin_voigt(), record.surface, 0.0, np.zeros(0), track.values)
    viscous = next(i for i, parameter in enumerate(track.model.parameters) if is_viscous(parameter))
    return float(standard_errors(slopes)[viscous]) * noise < _MAX_RELATIVE_STD * float(track.values[viscous])


def _has_two_parameters(track: TrackEvidence) -> bool:
    """Return True for a positive elastic and a positive viscous value without memory, whose timing is not declared."""
    end, model = track.ending, track.model
    if end is None or end.settings.timing_uncertainty is not None or model.memory or model.adhesive:
        return False
    if track.tip_mass is None:  # an inertia that is not subtracted looks like a delay, too
        return False
    roles = [parameter.role for parameter in model.parameters]
    return sorted(str(role) for role in roles) == ["elastic", "viscous"] and bool((track.values > 0).all())


def one_line(track: TrackEvidence) -> bool:
    """Return True if the tip oscillates with one frequency and little else, which is the noise of the motion."""
    used = track.kept.used & np.isfinite(track.kept.position) & np.isfinite(track.kept.velocity)
    time, velocity = track.kept.time[used], track.kept.velocity[used]
    rhythm = oscillation(time, track.kept.position[used])
    if rhythm is None:
        return False
    # The velocity without the sine of that frequency.
    _, phase = rhythm
    columns = np.column_stack([np.sin(phase), np.cos(phase), np.ones(len(velocity))])
    remainder = velocity - columns @ np.linalg.lstsq(columns, velocity, rcond=None)[0]
    noise_variance = white_noise(velocity) ** 2
    return float(np.var(remainder)) - noise_variance < _MIN_OTHER_SHARE * (float(np.var(velocity)) - noise_variance)


def _compare_laws(track: TrackEvidence) -> _LawComparison:
    """Return the fits of the laws that may explain a track's record, each with its own delay."""
    record = TimedRecord.of(track)
    elastic = next(i for i, parameter in enumerate(track.model.parameters) if parameter.role == "elastic")

    # The model's own law gives the delay of the inertia and the correlation of the residuals.
    law = kelvin_voigt()
    first = fit_delay(record, law, 1.0)  # as if the residuals were white
    record = record.with_inertia(first.delay)
    _, residual = record.solved(law, first.surface, first.delay, np.zeros(0))  # no nonlinear parameters
    inflation = variance_inflation(residual)

    fits = [fit_delay(record, law, inflation) for law in simple_laws(record, elastic)]
    comparison = _LawComparison(record, inflation, fits)
    if comparison.model_fit in comparison.plausible_fits:
        return comparison
    fits += [fit_delay(record, law, inflation) for law in richer_laws(record, elastic)]
    return _LawComparison(record, inflation, fits)


def _judge_delay(track: TrackEvidence) -> Diagnosed:
    """Return the delay of a track's force by all laws, and what it does to the values."""
    # The spread of the values over the laws that describe the record as well.
    laws = _compare_laws(track)
    names = [parameter.name for parameter in track.model.parameters]
    spread = laws.spread(np.array([fit.values - laws.model_fit.values for fit in laws.plausible_fits]))
    table = _delay_table(laws, names)
    is_estimated = track.ending is not None and "timing" in track.ending.included
    if laws.model_fit not in laws.plausible_fits:
        return _another_law(laws, table, dict(zip(names, spread.tolist(), strict=True)), is_estimated)
    if is_estimated:
        terms = {name: share for name, share in zip(names, spread.tolist(), strict=True) if share > 0}
        flag = Flag("self-timed", f"the delay of the force, by law: {_by_law(laws)}", effects=terms)
        return Diagnosed((flag,), terms, table=table, known=_DETERMINED_FACTS)
    # A delay that the estimator does not know is a bias of its values.
    biases = _biases_without_delay(laws, names, spread)
    correction = _corrected_values(track, biases)
    text = f"the motion determines the delay of the force, by law: {_by_law(laws)}{correction}"
    effects = {name: abs(bias.shift) for name, bias in biases.items()}
    flag = Flag("self-timed", text, effects=effects)
    return Diagnosed((flag,), biases=biases, table=table, known=_DETERMINED_FACTS)


def _delay_table(laws: _LawComparison, names: Sequence[str]) -> dict[str, Any]:
    """Return the delay [s] by the model's own law, its standard deviation with the spread of all, and each law's."""
    fit = laws.model_fit
    between = float(laws.spread(np.array([other.delay - fit.delay for other in laws.plausible_fits])))
    by_law: dict[str, Any] = {}
    for other in laws.fits:
        row = {"delay": other.delay, "std": other.std, "bic": other.bic - laws.best_bic}
        row["admitted"] = other in laws.plausible_fits
        by_law[other.law] = row | dict(zip(names, other.values.tolist(), strict=True))
    return {"delay": fit.delay, "delay_std": float(np.hypot(fit.std, between)), "law": fit.law, "laws": by_law}


def _by_law(laws: _LawComparison) -> str:
    """Return each plausible law with its delay in words."""
    return ", ".join(f"{fit.law} {1e3 * fit.delay:.3g} +- {1e3 * fit.std:.2g} ms" for fit in laws.plausible_fits)


def _another_law(laws: _LawComparison, table: dict[str, Any], terms: dict[str, float], is_estimated: bool) -> Diagnosed:
    """Return the doubt about a track whose law does not describe the record, with the delay by the best law.

    Each law but the material's own takes a part of the delay for itself, so that the uncertainty by one law says
    little: that of the delay has the spread of all within 30 of the best BIC, of a rectangular distribution. `terms`
    are the effects on the values, by parameter; `is_estimated` states that the track has the delay as an unknown.
    """
    best = min(laws.fits, key=lambda fit: fit.bic)
    near = [fit for fit in laws.fits if fit.bic - laws.best_bic < _MAX_BIC_OF_SPREAD]
    half_width = max(abs(fit.delay - best.delay) for fit in near)
    delay_std = float(np.hypot(best.std, half_width / np.sqrt(3.0)))
    table |= {"delay": best.delay, "delay_std": delay_std, "law": best.law}

    other_texts = [f"{fit.law} {1e3 * fit.delay:.3g}" for fit in near if fit.bic > laws.best_bic]
    nearly = f" (nearly as well: {', '.join(other_texts)} ms)" if other_texts else ""
    model_fit = laws.model_fit
    text = (
        f"the record is not {model_fit.law}: by {best.law} the delay is {1e3 * best.delay:.3g} +- "
        f"{1e3 * delay_std:.2g} ms{nearly}; as {model_fit.law} it would be {1e3 * model_fit.delay:.3g} +- "
        f"{1e3 * model_fit.std:.2g} ms"
    )
    # A track that estimates the delay has no other statement about it.
    determined_facts = _DETERMINED_FACTS if is_estimated else frozenset[str]()
    flag = Flag("delay-by-law", text, effects=terms)
    return Diagnosed((flag,), terms, table=table, known=determined_facts)


def _biases_without_delay(laws: _LawComparison, names: Sequence[str], spread: Floats) -> dict[str, Bias]:
    """Return the bias of each value (k,) that was estimated as if the force had no delay."""
    undelayed = fit_with_delay(laws.record.with_inertia(0.0), kelvin_voigt(), 0.0, laws.inflation)
    shifts = undelayed.values - laws.model_fit.values
    std = np.hypot(laws.model_fit.values_std, spread)
    # The scatter that the estimator states already is not counted twice.
    remainder = np.sqrt(np.maximum(std**2 - undelayed.values_std**2, 0.0))
    return {
        name: Bias(float(shift), float(bias_std), shared=True)
        for name, shift, bias_std in zip(names, shifts.tolist(), remainder.tolist(), strict=True)
    }


def _corrected_values(track: TrackEvidence, biases: Mapping[str, Bias]) -> str:
    """Return the corrected values of a track in words; empty where no bias is worth it."""
    texts: list[str] = []
    for bias, parameter, value, combined in zip(
        biases.values(), track.model.parameters, track.values.tolist(), track.combined.tolist(), strict=True
    ):
        if abs(bias.shift) > _MIN_CORRECTION * abs(value):
            std = np.hypot(combined, bias.std or 0.0)
            texts.append(f"{parameter.name} {value_with_unit(value - bias.shift, std, parameter.unit)}")
    return f"; corrected: {', '.join(texts)}" if texts else ""

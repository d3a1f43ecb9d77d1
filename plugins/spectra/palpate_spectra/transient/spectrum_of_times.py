"""The spectrum of times with its uncertainty: H over tau, and the strength of each decade; flags of a curve."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from palpate import Flag, Floats

from palpate_spectra.first_touch import excess_distance
from palpate_spectra.transient.relaxation_modulus import ModulusCurve

# Choices.
_REJECTION_LEVEL = 1e-3  # of the p of a linear material
_MAX_SURFACE_EXCESS = 2e-5  # [m] of a fitted skin beyond the tolerance of the first touch
_MAX_RAMP_CORRECTION = 0.05  # of the value, above which a ramp's correction is reported

_STATE_SKIN = "where the skin is known, stating it mends what follows from its height: --surface"
_TRACK_FLAGS = {"surface-mismatch", "diverged", "implausible"}  # of a track's surface and material, not used here


@dataclass(frozen=True)
class Decade:
    """The part of a material that relaxes, or is retarded, with times of one decade."""

    low: float  # [s]
    high: float  # [s]
    strength: float  # [Pa], of a creep [1/Pa]
    std: float


def density(curve: ModulusCurve) -> tuple[Floats, Floats, Floats]:
    """Return times (k,) [s], H (k,) [Pa], of a creep L [1/Pa], per unit of ln(tau), and its standard uncertainty (k,).

    The uncertainty is that of noise and smoothing: it covers the truth at its level on average over the spectrum, not
    at every time (Wahba 1983).
    """
    fit, estimate = curve.fit, curve.fit.estimate
    log_step = math.log(fit.times[1] / fit.times[0])
    std = np.sqrt(np.diag(estimate.covariance)[fit.free :])
    return fit.times, estimate.values[fit.free :] / log_step, std / log_step


def decades(curve: ModulusCurve) -> list[Decade]:
    """Return the strengths of the decades of time, which are better determined than H itself."""
    times, estimate = curve.fit.times, curve.fit.estimate
    free = curve.fit.free  # coefficients before those of the spectrum
    times_per_decade = round(math.log(10) / math.log(times[1] / times[0]))
    strengths = []
    for first in range(0, len(times), times_per_decade):
        members = np.arange(first, min(first + times_per_decade, len(times)))
        # The strength is the sum of the decade's coefficients.
        selection = np.zeros(len(estimate.values))
        selection[free + members] = 1.0
        variance = max(float(selection @ estimate.covariance @ selection), 0.0)
        strengths.append(
            Decade(
                low=float(times[members[0]]),
                high=float(times[members[-1]]),
                strength=float(selection @ estimate.values),
                std=math.sqrt(variance),
            )
        )
    return strengths


def p_value(curve: ModulusCurve) -> float:
    """Return the probability of so large a chi^2 if one linear material with this tip made the whole press."""
    from scipy.stats import chi2

    return float(chi2.sf(curve.relaxation_fit.chi2, curve.relaxation_fit.freedom))


def flags_of(curve: ModulusCurve) -> Iterator[Flag]:
    """Yield the flags of the record, then those of the curve."""
    press = curve.press
    yield from (flag for flag in press.flags if flag.code not in _TRACK_FLAGS)
    yield from _material_flags(curve)
    if press.rig["timing"] is None:
        has_slope = len(curve.time) > 1
        relative_slope = np.gradient(curve.value, curve.time) / curve.value if has_slope else np.zeros(1)  # [1/s]
        percent_per_ms = 0.1 * float(np.max(np.abs(relative_slope)))  # 100 %, over 1000 ms
        yield Flag(
            "timing-undeclared", f"1 ms between force and motion changes the curve by up to {percent_per_ms:.2g} %"
        )
    if press.drift is None:
        yield Flag("drift-unknown", "no free air after the hold: a drift of the force is taken as the material's")
    largest_correction = float(np.max(np.abs(curve.correction - 1.0)))
    if largest_correction > _MAX_RAMP_CORRECTION:
        yield Flag(
            "ramp-long",
            f"the first points are corrected by up to {100 * largest_correction:.2g} % for the ramp's duration",
        )


def _material_flags(curve: ModulusCurve) -> Iterator[Flag]:
    """Yield the flags of a press that no linear material explains, or only with a skin away from the first touch."""
    advice = f"; {_STATE_SKIN}" if curve.surface_std > 0 else ""
    p = p_value(curve)
    if p < _REJECTION_LEVEL:
        fit = curve.relaxation_fit
        yield Flag(
            "not-linear-viscoelastic",
            f"ramp and hold together leave chi^2 {fit.chi2:.3g} with {fit.freedom:.3g} degrees of freedom (p = "
            f"{p:.1e}){advice}",
        )
    excess = excess_distance(curve.press.first_touch, curve.rig.surface)
    if excess > _MAX_SURFACE_EXCESS:
        yield Flag(
            "surface-mismatch",
            f"ramp and hold put the skin {1e3 * excess:.2g} mm farther from where the tip touched than the touch allows"
            f"{advice}",
        )

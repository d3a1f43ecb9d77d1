"""What a spectrum of times determines, and how well: H over tau, and the strength of each decade."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from palpate import Flag, Floats

from palpate_spectra.recorded_oscillation import beyond
from palpate_spectra.transient.relaxation_modulus import ModulusCurve

_UNLIKELY = 1e-3
_STATE_SKIN = "where the skin is known, stating it mends what follows from its height: --surface"
_AWAY = 2e-5  # [m]
_RAMP = 0.05  # of the value, above which a ramp's correction is reported
_OF_ITS_TRACK = {"surface-mismatch", "diverged", "implausible"}  # whose surface and material are not used here


@dataclass(frozen=True)
class Decade:
    """What fades, or is delayed, with times of one decade."""

    low: float  # [s]
    high: float  # [s]
    strength: float  # [Pa], of a creep [1/Pa]
    std: float


def density(curve: ModulusCurve) -> tuple[Floats, Floats, Floats]:
    """Times (k,) [s], H (k,) [Pa], of a creep L [1/Pa], per unit of ln(tau), and its standard uncertainty (k,).

    The uncertainty is that of noise and smoothing: it covers the truth at its level on average over the spectrum, not
    at every time (Wahba 1983).
    """
    free, times = curve.solved.free, curve.solved.times
    step = math.log(times[1] / times[0])
    std = np.sqrt(np.diag(curve.solved.weighing.covariance)[free:])
    return times, curve.solved.weighing.values[free:] / step, std / step


def decades(curve: ModulusCurve) -> list[Decade]:
    """Strengths of the decades of time, which are better known than H itself."""
    free, times, found = curve.solved.free, curve.solved.times, curve.solved.weighing
    per = round(math.log(10) / math.log(times[1] / times[0]))
    found_decades = []
    for first in range(0, len(times), per):
        here = np.arange(first, min(first + per, len(times)))
        row = np.zeros(len(found.values))
        row[free + here] = 1.0
        std = math.sqrt(max(float(row @ found.covariance @ row), 0.0))
        found_decades.append(Decade(float(times[here[0]]), float(times[here[-1]]), float(row @ found.values), std))
    return found_decades


def p_value(curve: ModulusCurve) -> float:
    """Of so large a chi^2 if one linear material with this tip made the whole press."""
    from scipy.stats import chi2

    return float(chi2.sf(curve.tested.chi2, curve.tested.freedom))


def flags_of(curve: ModulusCurve) -> Iterator[Flag]:
    """Flags of the record, then of the curve."""
    yield from (flag for flag in curve.pressed.flags if flag.code not in _OF_ITS_TRACK)
    skin = f"; {_STATE_SKIN}" if curve.surface_std > 0 else ""
    if (p := p_value(curve)) < _UNLIKELY:
        found = curve.tested
        yield Flag(
            "not-linear-viscoelastic",
            f"ramp and hold together leave chi^2 {found.chi2:.3g} with {found.freedom:.3g} degrees of freedom (p = "
            f"{p:.1e}){skin}",
        )
    if (away := beyond(curve.pressed.seen, curve.rig.surface)) > _AWAY:
        yield Flag(
            "surface-mismatch",
            f"ramp and hold put the skin {1e3 * away:.2g} mm farther from where the tip touched than the touch allows"
            f"{skin}",
        )
    if curve.pressed.rig["timing"] is None:
        slope = (
            float(np.max(np.abs(np.gradient(curve.value, curve.time) / curve.value))) if len(curve.time) > 1 else 0.0
        )
        yield Flag("timing-undeclared", f"1 ms between force and motion changes the curve by up to {0.1 * slope:.2g} %")
    if curve.pressed.drift is None:
        yield Flag("drift-unknown", "no free air after the hold: a drift of the force is taken as the material's")
    worst = float(np.max(np.abs(curve.correction - 1.0)))
    if worst > _RAMP:
        yield Flag("ramp-long", f"the first points are corrected by up to {100 * worst:.2g} % for the ramp's duration")

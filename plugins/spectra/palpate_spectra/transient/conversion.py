"""E(t) from a spectrum of retardation times: the relaxation of the material whose creep the spectrum describes."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats

# Choices.
_MIN_STRENGTH_SHARE = 1e-9  # of the largest compliance; smaller parts do not count
_POLE_CLEARANCE = 1e-12  # relative distance from a pole at which the search for a zero begins
_ROOT_RTOL, _ROOT_XTOL_SHARE = 1e-12, 1e-15  # of a zero, and of the upper end of its interval
_MIN_COMPLIANCE = 1e-300  # [1/Pa] keeps a division by a compliance finite


def relaxation_of_creep(instant: float, fluidity: float, strengths: Floats, times: Floats, instants: Floats) -> Floats:
    """Return the relaxation modulus E(t) (m,) [Pa] at instants (m,) [s], by its creep compliance.

    J(t) = J + f t + sum of J_k (1 - exp(-t/tau_k)): `instant` is J [1/Pa], `fluidity` f [1/(Pa s)], `strengths` are J_k
    (k,) [1/Pa], `times` tau_k (k,) [s].

    s J^(s) = J + f/s + sum of J_k/(1 + s tau_k) is 1/(s E^(s)), so that E(t) = E + sum of E_k exp(-x_k t): its rates
    x_k are the zeros of s J^(s) at s = -x, which lie between its poles, and E_k = 1/(x_k d/ds s J^(s)) there (Park and
    Schapery 1999). E is 1/(J + sum of J_k), and 0 where the material flows. Without an instantaneous J the fastest part
    is a damper, which E(t) after a step does not show.
    """
    min_strength = _MIN_STRENGTH_SHARE * max(float(strengths.max(initial=0.0)), instant)
    is_present = strengths > min_strength
    strengths, times = strengths[is_present], times[is_present]
    order = np.argsort(-times)
    strengths, poles = strengths[order], 1.0 / times[order]  # [1/s], rising
    equilibrium_modulus = 0.0 if fluidity > 0 else 1.0 / (instant + float(strengths.sum()))
    modulus = np.full(len(instants), equilibrium_modulus)
    for rate in _relaxation_rates(instant, fluidity, strengths, poles):
        slope = fluidity / rate**2 + float(np.sum(strengths / poles / (1.0 - rate / poles) ** 2))
        modulus = modulus + np.exp(-rate * instants) / (rate * slope)
    return np.asarray(modulus)


def _relaxation_rates(instant: float, fluidity: float, strengths: Floats, poles: Floats) -> list[float]:
    """Return the rates x [1/s] at which J - f/x + sum of J_k/(1 - x/p_k), s J^(s) at s = -x, is 0.

    It rises from -infinity above each pole p_k [1/s], and above 0 where the material flows (f > 0), to +infinity below
    the next pole, so that each of these intervals has one zero. Beyond the last pole it rises to J, and has a
    zero only where J > 0.
    """
    from scipy.optimize import brentq

    solve: Any = brentq  # its annotations want numpy's floats

    def carson_compliance(x: float) -> float:
        """Return s J^(s) [1/Pa] at s = -x."""
        return instant - fluidity / x + float(np.sum(strengths / (1.0 - x / poles)))

    edges = [*([0.0] if fluidity > 0 else []), *poles.tolist()]
    rates = []
    for lower, upper in zip(edges, [*edges[1:], np.inf], strict=True):
        if lower:
            low = lower * (1 + _POLE_CLEARANCE)
        else:
            slowest = poles[0] if len(poles) else fluidity / max(instant, _MIN_COMPLIANCE)
            low = _POLE_CLEARANCE * slowest
        if np.isfinite(upper):
            high = upper * (1 - _POLE_CLEARANCE)
        elif instant > 0:
            # Far above the last pole the function is about J - (f + sum of J_k p_k)/x.
            high = 2.0 * (fluidity + float(np.sum(strengths * poles))) / instant + 2.0 * lower
            while carson_compliance(high) < 0:
                high *= 2.0
        else:
            continue
        if carson_compliance(low) < 0 < carson_compliance(high):
            rate: Any = solve(carson_compliance, low, high, xtol=_ROOT_XTOL_SHARE * high, rtol=_ROOT_RTOL)
            rates.append(float(rate))
    return rates

"""E(t) from a spectrum of retardation times: the material that creeps like this, held at a depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats

_SHARE = 1e-9  # of the largest compliance; smaller parts do not count


def relaxation_of_creep(instant: float, fluidity: float, strengths: Floats, times: Floats, at: Floats) -> Floats:
    """E(t) (m,) [Pa] at times (m,) [s] of J(t) = J + f t + sum of J_k (1 - exp(-t/tau_k)).

    s J^(s) = J + f/s + sum of J_k/(1 + s tau_k) is 1/(s E^(s)), so that E(t) fades with the zeros of it, which lie
    between its poles, and has 1/(s d/ds s J^(s)) there as strengths (Park and Schapery 1999); at rest it is
    1/(J + sum of J_k), and nothing where the material flows. Without an instantaneous J the fastest part is a damper,
    which E(t) after a step does not show.
    """
    kept = strengths > _SHARE * max(float(strengths.max(initial=0.0)), instant)
    strengths, times = strengths[kept], times[kept]
    order = np.argsort(-times)
    strengths, poles = strengths[order], 1.0 / times[order]  # [1/s], rising
    lasting = 0.0 if fluidity > 0 else 1.0 / (instant + float(strengths.sum()))
    found = np.full(len(at), lasting)
    for zero in _zeros(instant, fluidity, strengths, poles):
        slope = fluidity / zero**2 + float(np.sum(strengths / poles / (1.0 - zero / poles) ** 2))
        found = found + np.exp(-zero * at) / (zero * slope)
    return np.asarray(found)


def _zeros(instant: float, fluidity: float, strengths: Floats, poles: Floats) -> list[float]:
    """Rates x = -s [1/s] at which s J^(s) is 0: one above each pole, and one above 0 where the material flows."""
    from scipy.optimize import brentq

    solve: Any = brentq  # its annotations want numpy's floats

    def carson(x: float) -> float:
        return instant - fluidity / x + float(np.sum(strengths / (1.0 - x / poles)))

    edges = [*([0.0] if fluidity > 0 else []), *poles.tolist()]
    zeros = []
    for low, high in zip(edges, [*edges[1:], np.inf], strict=True):
        begin = low * (1 + 1e-12) if low else 1e-12 * (poles[0] if len(poles) else fluidity / max(instant, 1e-300))
        end = high * (1 - 1e-12)
        if not np.isfinite(high):
            if instant <= 0:
                continue
            end = 2.0 * (fluidity + float(np.sum(strengths * poles))) / instant + 2.0 * low
            while carson(end) < 0:
                end *= 2.0
        if carson(begin) < 0 < carson(end):
            zero: Any = solve(carson, begin, end, xtol=1e-15 * end, rtol=1e-12)
            zeros.append(float(zero))
    return zeros

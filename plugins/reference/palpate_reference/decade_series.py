"""A generalised Maxwell law with one arm for each decade of the tables, as master curves are described by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.numerics.material_laws import Complexes, LinearLaw, arm_moduli

from palpate_reference.fit_problem import FitProblem, predictions

DECADES = "generalised-maxwell-decades"
_MIN_DECADES = 3  # a choice: fewer arms are a law of their own (generalised-maxwell-2)
_MIN_STRENGTH = 1e-6  # of the strongest arm, a choice: a weaker one shows in no table


def decade_series(problem: FitProblem) -> LinearLaw | None:
    """Return the law whose relaxation times are the powers of ten between the extreme times of the tables.

    Arms that non-negative least squares of relative errors leave at zero are left out; it gives the start of the fit,
    too. None for creep, which is not linear in the moduli, and for tables of less than three decades. Sources: Emri and
    Tschoegl 1993 (one arm a decade), Lawson and Hanson 1974.
    """
    from scipy.optimize import nnls

    if any(table.kind == "creep" for table in problem.tables):
        return None
    times = _decades(problem)
    if len(times) < _MIN_DECADES:
        return None
    design = _unit_predictions(problem, times)
    (lasting, *strengths), _ = nnls(design, np.ones(len(design)))

    # The arms that count, at least for the start of a fit, which is by logarithms.
    threshold = _MIN_STRENGTH * max(lasting, *strengths)
    arms = [(time, float(strength)) for time, strength in zip(times, strengths, strict=True) if strength > threshold]
    if not arms:
        return None
    start = [max(float(lasting), float(threshold)), *(strength for _, strength in arms)]
    return _maxwell_law([time for time, _ in arms], start)


def _decades(problem: FitProblem) -> list[float]:
    """Return the powers of ten [s] between the shortest and the longest time of the tables; 1/omega of a frequency."""
    times = [1.0 / (2.0 * math.pi * table.x) if table.kind == "oscillation" else table.x for table in problem.tables]
    shortest, longest = (bound(np.concatenate(times)) for bound in (np.min, np.max))
    exponents = range(math.ceil(math.log10(shortest)), math.floor(math.log10(longest)) + 1)
    return [10.0**exponent for exponent in exponents]


def _unit_predictions(problem: FitProblem, times: Sequence[float]) -> Floats:
    """Return predictions over readings (n, 1 + arms) for a modulus of 1 Pa alone: of the spring, then of each arm.

    The prediction of the whole law is linear in these.
    """
    law = _maxwell_law(times)
    unit_moduli = np.eye(len(times) + 1).tolist()
    rows = []
    for table in problem.tables:
        columns = [(predictions(law, table, moduli, problem.poisson) / table.y).ravel() for moduli in unit_moduli]
        rows.append(np.column_stack(columns))
    return np.vstack(rows)


def _maxwell_law(times: Sequence[float], start: Sequence[float] = ()) -> LinearLaw:
    """Return the law of a spring E and arms E_k with these relaxation times [s], and moduli [Pa] to start from."""
    names = (("elasticity", "Pa"), *((f"arm_elasticity_{k}", "Pa") for k in range(1, len(times) + 1)))
    time_texts = ", ".join(f"{time:.0e}" for time in times)
    return LinearLaw(
        DECADES,
        f"E* = E + sum of E_k s tau_k/(1 + s tau_k), tau_k = {time_texts} s",
        names,
        partial(_modulus, tuple(times)),
        lambda level, all_times: [list(start)],
        times=tuple(times),
    )


def _modulus(times: Sequence[float], s: Complexes, moduli: Sequence[Any], _: float) -> Any:
    """Return E + sum of E_k s tau_k/(1 + s tau_k) at s = i omega, for E and E_k [Pa]."""
    return moduli[0] + arm_moduli(s, moduli[1:], times)

"""A generalised Maxwell law with one arm for each decade of the tables: what a master curve is made into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from palpate_kit.numerics.material_laws import Complexes, LinearLaw, arm_moduli

from palpate_reference.table_fit import FitProblem, predictions

DECADES = "generalised-maxwell-decades"
_FEW = 3  # decades; with fewer the arms are not a series
_NONE = 1e-6  # share of the strongest arm, below which an arm does not count


def decade_series(problem: FitProblem) -> LinearLaw | None:
    """The law whose relaxation times are the powers of ten between the shortest and the longest time of the tables.

    Arms that non-negative least squares of relative errors leave at zero are left out; it gives the start of the fit,
    too. None for creep, which is not linear in the moduli, and for tables of less than three decades. Sources: Emri and
    Tschoegl 1993 (one arm a decade), Lawson and Hanson 1974.
    """
    from scipy.optimize import nnls

    if any(table.kind == "creep" for table in problem.tables):
        return None
    of = [1.0 / (2.0 * math.pi * table.x) if table.kind == "oscillation" else table.x for table in problem.tables]
    low, high = (bound(np.concatenate(of)) for bound in (np.min, np.max))
    times = [10.0**k for k in range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)]
    if len(times) < _FEW:
        return None
    whole = _law(times)
    each = np.eye(len(times) + 1)
    design = np.vstack([
        np.column_stack([(predictions(whole, table, one, problem.poisson) / table.y).ravel() for one in each.tolist()])
        for table in problem.tables
    ])  # fmt: skip
    strengths, _ = nnls(design, np.ones(len(design)))
    strong = strengths[1:] > _NONE * strengths.max()
    if not strong.any():
        return None
    lasting = max(float(strengths[0]), _NONE * float(strengths.max()))
    start = [lasting, *strengths[1:][strong].tolist()]
    return _law([tau for tau, one in zip(times, strong, strict=True) if one], start)


def _law(times: Sequence[float], start: Sequence[float] = ()) -> LinearLaw:
    names = (("elasticity", "Pa"), *((f"arm_elasticity_{k}", "Pa") for k in range(1, len(times) + 1)))
    taus = ", ".join(f"{tau:.0e}" for tau in times)
    return LinearLaw(
        DECADES, f"E* = E + sum of E_k s tau_k/(1 + s tau_k), tau_k = {taus} s", names, partial(_modulus, tuple(times)),
        lambda level, of: [list(start)], times=tuple(times),
    )  # fmt: skip


def _modulus(times: Sequence[float], s: Complexes, p: Sequence[Any], _: float) -> Any:
    return p[0] + arm_moduli(s, p[1:], times)

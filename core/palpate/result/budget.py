"""The budget of an estimate: what timing, mass and tare may have shifted it by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.alignment import GRAVITY, AlignmentReport, AlignmentSettings
from palpate.contact import ContactModel
from palpate.design import force_slopes
from palpate.result.record import Tail, acceleration
from palpate.result.response import answer

Floats = NDArray[np.float64]


def systematic_terms(
    model: ContactModel,
    last: Tail,
    shifts: Floats,
    timing: float | None,
    settings: AlignmentSettings,
    report: AlignmentReport,
) -> dict[str, dict[str, float]]:
    """Standard uncertainty [SI] of each parameter from each cause that is known, by parameter name.

    Timing: |dtheta/dtau| u(tau), by `shifts` (k,) of `delay_shifts`. Mass and tare: a small error f(t) of the force
    shifts the least-squares estimate with unknown surface by (J^T J)^-1 J^T f, J the model's derivatives along the last
    samples; f = -u(m) z'' (and the weight, where it was removed) and f = u(tare). Compliance: a robot of stiffness k
    gives way by F/k, so that the depth is F/k less than it seems, f = -(dF/dd F + dF/dd' F')/k; it is not corrected,
    and all of the shift counts.
    """
    values = last.values.mean(axis=0)
    terms: dict[str, dict[str, float]] = {parameter.name: {} for parameter in model.parameters}
    for parameter, shift in zip(model.parameters, shifts, strict=True):
        if shift and timing is not None:
            terms[parameter.name]["timing"] = float(abs(shift)) * timing
    mass, tare = settings.tip_mass_uncertainty, report.tare.offset_std if report.tare else None
    if (
        model.memory
        or (mass is None and tare is None and settings.series_stiffness is None)
        or not np.isfinite(values).all()
    ):
        return terms
    jacobian, slope, given_way = _along(model, last, values)
    if mass is not None:
        weight = GRAVITY if settings.weight == "removed" else 0.0
        _note(terms, "mass", answer(jacobian, mass * (weight - slope)))
    if tare is not None:
        _note(terms, "tare", answer(jacobian, np.full(len(jacobian), tare)))
    if settings.series_stiffness is not None:
        _note(terms, "compliance", answer(jacobian, -given_way / settings.series_stiffness))
    return terms


def _note(terms: dict[str, dict[str, float]], cause: str, shares: Floats | None) -> None:
    if shares is not None:
        for table, share in zip(terms.values(), shares, strict=False):
            table[cause] = abs(float(share))


def _along(model: ContactModel, last: Tail, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Derivatives of the force by parameters and surface (n, k + 1), z'' (n,) [m/s^2], dF/dd F + dF/dd' F' (n,)."""
    slope = acceleration(last.time, last.velocity)
    depth, rate = float(last.surface.mean()) - last.position, -last.velocity
    usable = np.isfinite(depth) & np.isfinite(rate) & np.isfinite(slope) & (depth > 0)
    if not usable.any():
        return np.zeros((0, len(values) + 1)), np.zeros(0), np.zeros(0)
    force, by_parameter, by_depth, by_rate = force_slopes(model, depth[usable], rate[usable], values.tolist())
    change = by_depth * rate[usable] - by_rate * slope[usable]
    return np.column_stack([by_parameter, by_depth]), slope[usable], by_depth * force + by_rate * change

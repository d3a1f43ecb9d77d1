"""The budget of an estimate after the GUM: every source, its standard uncertainty, and what that does to each value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from palpate import ContactModel, Diagnosed, Flag, Floats, Term, TrackEnd, TrackEvidence
from palpate_kit.budget.force_sensitivity import along
from palpate_kit.budget.systematic_terms import systematic_terms
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_uncertainty.delay.timing_shift import delay_shifts, is_viscous
from palpate_uncertainty.inclined_skin import AcrossForce

_MIN_SHARE = 0.01  # of a parameter, a choice: a smaller shift by compliance has no sentence


def budgets(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the effects on each value of every source that is declared or has a default, and the flags on it."""
    return {track.name: _budget(track, track.ending) for track in tracks if track.ending is not None}


def _budget(track: TrackEvidence, end: TrackEnd) -> Diagnosed:
    """Return the budget of one track, from the samples, settings, estimates and declared uncertainties at its end."""
    model, values = track.model, track.values
    settings, report = end.settings, end.report
    if end.is_sweep and report.turned is not None:  # on a sweep the motion along the skin is intended
        report = replace(report, turned=replace(report.turned, slope=0.0))
    # Every source as a term: what its standard uncertainty does to each value.
    sensitivity = along(model, end.tail, end.last, values, end.held)
    shifts = delay_shifts(model, sensitivity, values)
    sources = sources_of(model, end.uncertainties)
    across = AcrossForce.of(track, end)
    if across is not None and across.tells_friction:  # the bias by friction is determined, in place of its default
        sources = tuple(source for source in sources if source.name != "stick" or source.declared)
    terms = systematic_terms(
        sensitivity,
        shifts,
        timing=settings.timing_uncertainty,
        settings=settings,
        report=report,
        sources=sources,
        included=end.included,
    )

    # The share of each value by which the robot's compliance shifts it; zeros (k,) without such a term.
    compliance = sum(np.abs(term.shifts) for term in terms if term.cause == "compliance") + np.zeros(len(values))
    shares = compliance / np.where(values != 0, np.abs(values), np.inf)
    names = [parameter.name for parameter in model.parameters]
    flags = compliance_flags(dict(zip(names, shares.tolist(), strict=True)), settings.series_stiffness)
    return Diagnosed(tuple(flags), sources=tuple(terms), delays=dict(delays(model, values, shifts, terms)))


def delays(model: ContactModel, values: Floats, shifts: Floats, terms: Sequence[Term]) -> Iterator[tuple[str, float]]:
    """Yield the delay [s] that each viscosity looks like; of one that is not a parameter where timing is declared."""
    for parameter, value, shift in zip(model.parameters, values.tolist(), shifts.tolist(), strict=True):
        if shift and is_viscous(parameter):
            yield parameter.name, value / abs(shift)
    names = [parameter.name for parameter in model.parameters]
    late = next((term for term in terms if term.cause == "timing" and term.std), None)
    for material in model.material(values.tolist()):
        if late is not None and material.name == "viscosity" and material.name not in names:
            per_second = abs(float(np.array(material.gradient) @ late.shifts) / late.std)
            yield from [(material.name, material.value / per_second)] if per_second else ()


def compliance_flags(shares: Mapping[str, float], stiffness: float | None) -> Iterator[Flag]:
    """Yield the flag of parameters that a robot's compliance shifts by over 1 %; `shares` of their values by name."""
    strong = [f"{name} by {100 * share:.2g} %" for name, share in shares.items() if share > _MIN_SHARE]
    if stiffness is not None and strong:
        yield Flag(
            "series-compliance",
            f"robot and sensor have a stiffness of {1e-3 * stiffness:.3g} N/mm, which shifts "
            f"{', '.join(strong)}; it is not corrected",
        )

"""Terms of a budget after the GUM: declared and default uncertainties of a record, with their effect on each value."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence

import numpy as np
from palpate import ContactModel, Floats, Term
from palpate_engine import GRAVITY, AlignmentReport, AlignmentSettings

from palpate_kit.budget.force_sensitivity import Along, ForceSensitivity
from palpate_kit.budget.uncertainty_sources import UncertaintySource

_WAVE_COUNT = 4  # cosines over the depth, for the error of a formula: a choice
_COVERAGE = 2.0  # standard uncertainties in the largest error of a formula: a choice, 95 %
_MASS_SHARE = 0.05  # of a tip's mass, its uncertainty if none is declared: a choice
# Power of the cosine of an inclination t: a sphere feels (d cos t)^1.5 along the normal, and of that cos t.
_FORCE_POWER = 2.5


def systematic_terms(
    sensitivity: Along | None,
    shifts: Floats,
    timing: float | None,
    settings: AlignmentSettings,
    report: AlignmentReport | None,
    sources: Sequence[UncertaintySource] = (),
    included: Container[str] = (),
) -> list[Term]:
    """Return the terms of the systematic uncertainty: the shifts (k,) of the parameters by each source.

    A source is declared, or has a default standard uncertainty u. `sensitivity` has the force along the last samples
    with its derivatives by parameters and surface; without one only timing has a term. Causes that an estimator has
    `included` in its own uncertainty are left out, and without a `report` of the alignment those that only it states:
    tare, and directions of a tool that turns. `timing` is the standard uncertainty of the delay [s].

    Timing: dtheta/dtau u(tau), by `shifts` (k,) of `delay_shifts`. All others: a small error f(t) of the force shifts
    the least-squares estimate with unknown surface by (J^T J)^-1 J^T f, J the model's derivatives along the last
    samples. Mass: f = -u(m) z'' (and the weight, where it was removed); tare: f = u; force_scale: f = u F; a number of
    the model: f = -dF/dp u, of an inclination t, which has no derivative at 0, f = F(t) - F(t + u); position_scale: f =
    -(dF/dd d + dF/dd' d') u. Compliance: a robot of stiffness k gives way by F/k, so that the depth is F/k less than it
    seems, f = -(dF/dd F + dF/dd' F')/k; it is not corrected, and all of the shift counts. A beam, what it yields by F/k
    being taken off the depth: f = (dF/dd F + dF/dd' F') u/k^2.
    """
    terms = []
    if timing is not None and shifts.any() and "timing" not in included:
        terms.append(Term("timing", timing, "s", shifts * timing))
    if sensitivity is None:
        return terms
    terms += [term for term in _reading_terms(sensitivity, settings, report) if term.cause not in included]
    return [*terms, *source_terms(sensitivity, [source for source in sources if source.name not in included])]


def source_terms(sensitivity: ForceSensitivity, sources: Sequence[UncertaintySource]) -> Iterator[Term]:
    """Yield the terms of the model's numbers and of the scales of force and height."""
    for source in sources:
        change = _error_per_unit(sensitivity, source)
        if change is not None:
            yield from _term(
                sensitivity,
                cause=source.name,
                std=source.std,
                unit=source.unit,
                error=change * source.std,
                declared=source.declared,
            )


def _reading_terms(sensitivity: Along, settings: AlignmentSettings, report: AlignmentReport | None) -> list[Term]:
    """Return the terms of mass, directions, curvature, formula, tare, compliance and beam; see `systematic_terms`.

    `sensitivity` has force, derivatives and acceleration along samples, `report` the tare and the directions that the
    alignment has found.
    """
    terms: list[Term] = []
    turned = report.turned if report is not None else None
    if settings.tip_mass is not None:
        declared_mass_std = settings.tip_mass_uncertainty
        std = declared_mass_std if declared_mass_std is not None else _MASS_SHARE * settings.tip_mass
        weight = weight_per_mass(settings, turned.along if turned else 0.0, turned.weight if turned else 0.0)
        terms += _term(
            sensitivity,
            cause="mass",
            std=std,
            unit="kg",
            error=std * (weight - sensitivity.acceleration),
            declared=declared_mass_std is not None,
        )
    if report is not None:
        terms += _direction_terms(sensitivity, settings, report)
        terms += _curvature_terms(sensitivity, settings, report)
    terms += _law_terms(sensitivity)
    tare = report.tare.offset_std if report is not None and report.tare else None
    if tare is not None:
        terms += _term(sensitivity, "tare", float(tare), "N", np.full(len(sensitivity.force), tare))
    if settings.series_stiffness is not None and sensitivity.given_way is not None:
        stiffness = settings.series_stiffness
        terms += _term(sensitivity, "compliance", 1.0 / stiffness, "m/N", -sensitivity.given_way / stiffness)
    if settings.beam is not None and settings.beam_uncertainty is not None:
        std = settings.beam_uncertainty
        terms += _term(sensitivity, "beam", std, "N/m", sensitivity.by_beam(settings.beam) * std)
    return terms


def weight_per_mass(settings: AlignmentSettings, along: float, weight: float) -> float:
    """Return the error of the force per error of the mass [N/kg] by the weight, where that is subtracted.

    Of a tool that turns: by its `weight` [N] along the normal, or by how much more `along` it there is than in the air
    that gave the tare.
    """
    if settings.weight == "removed":
        return GRAVITY
    if settings.weight == "tared" or not settings.tip_mass:
        return 0.0
    return -(along if settings.tare == "free-air" else weight) / settings.tip_mass


def _direction_terms(sensitivity: Along, settings: AlignmentSettings, report: AlignmentReport) -> Iterator[Term]:
    """Yield the terms of the sensor's mounting and of the skin's normal, each known to an angle u.

    A mounting that is off turns the weight's change W since the tare and the share s of the force F across the normal:
    f = u (W + s F). A normal that is off does the latter, is an inclination, and of a motion at an angle b to it depth
    and rate are off by u tan(b) of themselves: f = u s F + (1 - cos(u)^2.5) F + u tan(b) (dF/dd d + dF/dd' d'). In the
    code s is `share`, W `turn`, tan(b) `slope`.
    """
    share = report.sideways.size if report.sideways is not None else 0.0
    turn, slope = (0.0, 0.0) if report.turned is None else (report.turned.turn, report.turned.slope)
    for name, (angle, declared) in settings.orientation_uncertainties.items():
        error: Floats = angle * share * sensitivity.force
        if name == "mounting":
            error = error + angle * turn
        else:
            tilt_error = (1.0 - math.cos(angle) ** _FORCE_POWER) * sensitivity.force
            error = error + (tilt_error + angle * slope * sensitivity.by_height_scale())
        yield from _term(sensitivity, cause=name, std=angle, unit="rad", error=error, declared=declared)


def _curvature_terms(sensitivity: Along, settings: AlignmentSettings, report: AlignmentReport) -> Iterator[Term]:
    """Yield the term of the skin's curvature k, by its surface.

    `sensitivity` has force, depth and acceleration (n,) along samples, `report` the curvature [1/m]. Where the track's
    forces were divided by the share s(k) of a curved skin: f = (s(k + u)/s(k) - 1) F, and the inertia that was divided
    with them, (1/s - 1) m z''. Where the model has the skin as flat all of the shift counts.
    """
    turned = report.turned
    if turned is None or not turned.curvature:
        return
    # The share at the curvature, and at the curvature and its uncertainty, of both principal directions alike.
    pairs = np.array([[turned.curvature] * 2, [turned.curvature + turned.curvature_std] * 2])
    shares = sensitivity.model.curved_share(pairs, np.full(2, float(sensitivity.depth.mean())))
    if shares is not None and np.isfinite(shares).all():
        inertia = (1.0 / shares[0] - 1.0) * (settings.tip_mass or 0.0) * sensitivity.acceleration
        error = (shares[1] / shares[0] - 1.0) * sensitivity.force + inertia
        yield from _term(sensitivity, "curvature", turned.curvature_std, "1/m", error)
    elif share := _flat_skin_error(sensitivity.model, turned.curvature):
        yield from _term(sensitivity, "curvature", abs(turned.curvature), "1/m", share * sensitivity.force)


def _law_terms(sensitivity: Along) -> Iterator[Term]:
    """Yield the term of a formula that approximates a solution to a share e of the force F at most.

    The error at each depth is not known, only that it changes slowly. It is a sum of independent waves over
    s = sqrt(depth/deepest depth),

        f_n = e/2 F w_n / sqrt(4),    w_0 = 1, w_n = sqrt(2) cos(n pi s) for n = 1, 2, 3.

    Each w_n has the mean square 1 over s, so that the four f_n together have that of e/2 F. The effect on each
    parameter is the root of the sum of the squares of its shifts by the f_n. No term where parameters and surface are
    indistinct: then no wave has a shift.
    """
    if not (law_error := sensitivity.model.law_error):
        return
    standard_error = law_error / _COVERAGE
    s = np.sqrt(np.clip(sensitivity.depth / sensitivity.depth.max(), 0.0, 1.0))
    shifts_of_waves = []
    for n in range(_WAVE_COUNT):
        amplitude = math.sqrt(2.0) if n else 1.0
        wave = amplitude * np.cos(n * math.pi * s)
        shifts = sensitivity.shifts(standard_error * wave * sensitivity.force / math.sqrt(_WAVE_COUNT))
        if shifts is None:
            return
        shifts_of_waves.append(shifts)
    yield Term("law", standard_error, "1", np.sqrt(np.sum(np.square(shifts_of_waves), axis=0)))


def _flat_skin_error(model: ContactModel, curvature: float) -> float:
    """Return the relative error of the force of a sphere if the model takes a skin of mean curvature k [1/m] as flat.

    A sphere of radius R on the skin is one of 1/R_eff = 1/R + k on a flat one, and its force goes with the root of
    R_eff. 0 for a model that states the skin's radii, and for another tip.
    """
    radius = getattr(getattr(model, "indenter", None), "radius", None)
    skin = getattr(model, "skin", None)
    if radius is None or not curvature or skin is not None or 1.0 + radius * curvature <= 0:
        return 0.0
    return float((1.0 + radius * curvature) ** -0.5 - 1.0)


def _error_per_unit(sensitivity: ForceSensitivity, source: UncertaintySource) -> Floats | None:
    """Return the error (n,) of the force per unit of a source; None where it cannot be determined."""
    if source.path:
        step = source.std if source.name == "inclination" else 0.0
        return -sensitivity.by_number(source.path, source.value, step)
    if source.name == "force_scale":
        return sensitivity.force
    return None if sensitivity.stretched is None else -sensitivity.stretched


def _term(
    sensitivity: ForceSensitivity, cause: str, std: float, unit: str, error: Floats, declared: bool = True
) -> list[Term]:
    """Return the term of an error (n,) of the force [N]; nothing where parameters and surface are indistinct."""
    shifts = sensitivity.shifts(error)
    return [] if shifts is None else [Term(cause, std, unit, shifts, declared)]


def per_newton(sensitivity: Along | None) -> Floats | None:
    """Return the shift (k,) of each parameter per newton of a constant force [unit/N]; None where it cannot be
    determined."""
    return sensitivity.shifts(np.ones(len(sensitivity.force))) if sensitivity is not None else None

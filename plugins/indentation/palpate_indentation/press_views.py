"""Tables and sentences on a press, for people."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from palpate_engine import display_unit
from palpate_kit.figures import force_unit
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

from palpate_indentation.press_analysis import Indentation
from palpate_indentation.press_flags import contributions
from palpate_indentation.press_table import bic_above_best, second_best, table

_SHOWN_SHARE = 0.05  # of the combined uncertainty, a choice: a smaller contribution is in indentation.json only
_MIN_BIC_DIFFERENCE = 10.0  # very strong evidence (Kass and Raftery 1995), by which laws of a sphere are distinguished
_MIN_DEPTH_IN_MM, _MIN_DEPTH_IN_UM = 1e-4, 1e-7  # [m], choices: shallower presses are shown in um, and in nm


@dataclass(frozen=True)
class _Units:
    """Display units of one press, and factors from SI to them."""

    modulus: str
    per_modulus: float
    length: str
    per_length: float


def views(analysis: Indentation, model: str) -> list[str | Table]:
    """Return tables and sentences on a press by the model of this name."""
    unit, per_unit = display_unit(analysis.law.unit)
    units = _Units(unit, per_unit, *_length_unit(analysis.depth))
    shown = [
        *_summary(analysis, model, units),
        _contact_table(analysis, units),
        _window_table(analysis, units),
        *_sphere_views(analysis, units),
        *_adhesion_views(analysis, units),
    ]
    return shown + [f"{flag.code}: {flag.message}" for flag in analysis.flags]


def _summary(analysis: Indentation, model: str, units: _Units) -> Iterator[str]:
    """Yield sentences on the modulus with its uncertainty, adhesion on the way in, viscosity and baseline."""
    fit, factor = analysis.fit, units.per_modulus
    shares = zip(analysis.budget, contributions(analysis.law, analysis.budget), strict=True)
    large_shares = [(row.source, share) for row, share in shares if share > _SHOWN_SHARE * analysis.combined]
    parts = ", ".join(f"{source} {factor * share:.3g}" for source, share in large_shares)
    yield (
        f"{model}: {analysis.law.name} {value_with_uncertainty(factor * fit.modulus, factor * analysis.combined)} "
        f"{units.modulus} ({parts} {units.modulus}); {units.per_length * analysis.depth:.3g} {units.length} deep; "
        f"residual {_force(fit.rms)}, noise {_force(analysis.press.noise)}"
    )
    adhesion = table(analysis)["adhesion_on_the_way_in"]
    if adhesion is not None:
        work = value_with_uncertainty(1e3 * adhesion["adhesion_work"], 1e3 * adhesion["adhesion_work_std"])
        plain_modulus = f"{factor * adhesion['value_without']:.4g} {units.modulus}"
        yield f"the way in sticks: by {adhesion['theory']}, work of adhesion {work} mJ/m^2; without it {plain_modulus}"
    viscosity = analysis.viscosity
    if viscosity is not None:
        unit, per_unit = display_unit(viscosity.unit)
        value = value_with_uncertainty(per_unit * viscosity.value, per_unit * viscosity.std)
        yield f"viscosity taken off: {value} {unit} ({viscosity.words})"
    yield from _baseline_view(analysis)


def _baseline_view(analysis: Indentation) -> Iterator[str]:
    """Yield a sentence on the tilt of the baseline, if one was fitted; also on one that was held at zero."""
    undetermined = analysis.baseline_fit.undetermined
    tilted_fit = undetermined or analysis.fit
    if tilted_fit.tilt_std > 0:
        travel = float(analysis.branch.height.max() - analysis.branch.height.min())
        tilt = f"{_force(tilted_fit.tilt * travel)} +- {_force(tilted_fit.tilt_std * travel)}"
        verb = "tilted" if undetermined is None else "level; least squares would have it tilted"
        yield f"baseline: {verb} by {tilt} over the way"


def _contact_table(analysis: Indentation, units: _Units) -> Table:
    """Return the contact points by all methods, relative to that of the fit."""
    surface, factor = analysis.fit.surface, units.per_length
    rows = [
        (
            name,
            f"{factor * (point.surface - surface):+.4g}",
            f"{factor * (point.usual - surface):+.4g}",
            f"{factor * point.odd:+.3g}",
            f"{factor * point.std:.2g}",
        )
        for name, point in analysis.points.items()
    ]
    headings = ("by", f"above the fit [{units.length}]", "if the fit were true", "difference", "std")
    return Table.of("contact point", headings, rows, ("by",))


def _window_table(analysis: Indentation, units: _Units) -> Table:
    """Return the modulus within windows of depth."""
    profile = analysis.tangent
    rows = [
        (
            f"{units.per_length * begin:.3g} to {units.per_length * end:.3g}",
            f"{units.per_modulus * modulus:.4g}",
            f"{units.per_modulus * std:.2g}",
        )
        for begin, end, modulus, std in zip(profile.begin, profile.end, profile.modulus, profile.std, strict=True)
    ]
    headings = (f"depth [{units.length}]", f"E [{units.modulus}]", "std")
    return Table.of(f"{analysis.law.name} within windows of depth", headings, rows)


def _sphere_views(analysis: Indentation, units: _Units) -> Iterator[str | Table]:
    """Yield the laws of a sphere side by side, and a sentence if the press does not distinguish them."""
    if not analysis.spheres:
        return
    rows = [
        (
            f"{sphere.tip} (chosen)" if sphere.chosen else sphere.tip,
            f"{units.per_modulus * sphere.fit.modulus:.5g}",
            f"{units.per_modulus * sphere.fit.modulus_std:.2g}",
            _force(sphere.fit.rms),
            f"{bic_above_best(sphere, analysis):.3g}",
        )
        for sphere in analysis.spheres
    ]
    headings = ("law of the sphere", f"E [{units.modulus}]", "std", "residual", "BIC above best")
    yield Table.of("shape and large strain", headings, rows, ("law of the sphere",))
    second_bic = second_best(analysis)
    if second_bic is not None and second_bic < _MIN_BIC_DIFFERENCE:
        yield "shape and large strain: the press does not distinguish these laws"


def _adhesion_views(analysis: Indentation, units: _Units) -> Iterator[str | Table]:
    """Yield the pull on the way out, if there is one, and the theories that are fitted to it."""
    if analysis.pull is None:
        return
    yield f"pull-off: {_force(analysis.pull.force)} +- {_force(analysis.pull.std)}"
    if not analysis.theories:
        yield "adhesion: modulus and work of adhesion are determined for spheres only"
        return
    rows = [
        (
            name,
            f"{units.per_modulus * theory['value']:.4g}",
            f"{units.per_modulus * theory['std']:.2g}",
            f"{1e3 * theory['adhesion_work']:.4g}",
            f"{1e3 * theory['adhesion_work_std']:.2g}",
            _force(theory["rms"]),
            f"{theory['tabor']:.3g}",
        )
        for name, theory in table(analysis)["adhesion"].items()
    ]
    headings = ("theory", f"E [{units.modulus}]", "std", "w [mJ/m^2]", "std", "residual", "Tabor's parameter")
    yield Table.of("adhesion on the way out", headings, rows, ("theory",))
    yield "Tabor's parameter above 5 speaks for jkr, below 0.1 for dmt, between for neither"


def _length_unit(depth: float) -> tuple[str, float]:
    """Return the unit of a depth [m], and the factor from metres to it."""
    if depth > _MIN_DEPTH_IN_MM:
        return "mm", 1e3
    return ("um", 1e6) if depth > _MIN_DEPTH_IN_UM else ("nm", 1e9)


def _force(force: float) -> str:
    """Return a force [N] in the unit that shows its digits."""
    unit, factor = force_unit(abs(force))
    return f"{factor * force:.3g} {unit}"

"""A press as plain data, as in ``indentation.json``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from palpate import Floats
from palpate_engine import finite_tree, registry as registries

from palpate_indentation.adhesion import Theory, tabor
from palpate_indentation.modulus_over_depth import ModulusProfile
from palpate_indentation.press_analysis import Indentation
from palpate_indentation.sphere_laws import SphereLawFit
from palpate_indentation.viscosity import PressViscosity


def table(found: Indentation) -> dict[str, Any]:
    """As in ``indentation.json`` [SI]."""
    fit = found.fit
    document: dict[str, Any] = {
        "parameter": found.law.name,
        "unit": found.law.unit,
        "value": fit.modulus,
        "std": fit.modulus_std,
        "combined": found.combined,
        "surface": {"value": fit.surface, "std": fit.surface_std},
        "baseline": {"offset": fit.offset, "tilt": fit.tilt, "tilt_std": fit.tilt_std, "by_tilt": found.fitted.by_tilt},
        "viscosity": None if found.viscosity is None else _viscosity(found.viscosity),
        "budget": [asdict(row) for row in found.budget],
        "rms": fit.rms,
        "noise": found.press.noise,
        "correlation_time": fit.correlation_time,
        "depth": found.depth,
        "rise_over_depth": {"value": found.rise[0], "std": found.rise[1]},
        "contact_points": {
            name: {"surface": p.surface, "std": p.std, "by_the_fit": p.usual} for name, p in found.points.items()
        },
        "spheres": {one.tip: _alternative(one, found) for one in found.spheres},
        "adhesion_on_the_way_in": None if found.without is None else _way_in(found),
        "pull_off": None if found.pull is None else {"force": found.pull.force, "std": found.pull.std},
        "adhesion": {one.name: _theory(one, found) for one in found.theories},
        "secant": _profile(found.secant),
        "tangent": _profile(found.tangent),
        "flags": [flag.table() for flag in registries.load().judged(found.flags)],
    }
    plain: dict[str, Any] = finite_tree(document)
    return plain


def _viscosity(one: PressViscosity) -> dict[str, Any]:
    return {"value": one.value, "std": one.std, "unit": one.unit, "source": one.source, "words": one.words}


def bic_above_best(one: SphereLawFit, found: Indentation) -> float:
    """By the samples that count at the best: all laws have the same number of unknowns."""
    best = min(found.spheres, key=lambda other: other.log_squares)
    return best.fit.effective * (one.log_squares - best.log_squares)


def second_best(found: Indentation) -> float | None:
    """BIC of the second-best law of a sphere above that of the best; None without two."""
    others = sorted(bic_above_best(one, found) for one in found.spheres)
    return others[1] if len(others) > 1 else None


def _alternative(one: SphereLawFit, found: Indentation) -> dict[str, Any]:
    return {
        "value": one.fit.modulus,
        "std": one.fit.modulus_std,
        "surface": one.fit.surface,
        "rms": one.fit.rms,
        "bic_above_best": bic_above_best(one, found),
        "chosen": one.chosen,
    }


def _way_in(found: Indentation) -> dict[str, Any]:
    """Return the theory that the value is by, its work of adhesion, and the value by the pipeline's own law."""
    fit, without = found.fit, found.without
    assert without is not None
    work = {"adhesion_work": fit.work, "adhesion_work_std": fit.work_std}
    theory = registries.load().name_of(type(found.law.model))
    return {"theory": theory, **work, "value_without": without.modulus, "std_without": without.modulus_std}


def _theory(one: Theory, found: Indentation) -> dict[str, Any]:
    assert found.radius is not None
    poisson = float(getattr(found.law.model, "poisson", 0.5))
    return {
        "value": one.modulus,
        "std": one.modulus_std,
        "adhesion_work": one.work,
        "adhesion_work_std": one.work_std,
        "surface": one.surface,
        "rms": one.rms,
        "tabor": tabor(found.radius, one.work, one.modulus, poisson),
    }


def _profile(profile: ModulusProfile) -> dict[str, Floats]:
    return {
        "begin": profile.begin,
        "end": profile.end,
        "value": profile.modulus,
        "noise": profile.noise,
        "contact_point": profile.contact,
        "combined": profile.std,
    }

"""A press as plain data, as in ``indentation.json``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from palpate import Floats
from palpate_engine import finite_tree, registry as registries

from palpate_indentation.adhesion import tabor
from palpate_indentation.modulus_over_depth import ModulusProfile
from palpate_indentation.press_analysis import Indentation
from palpate_indentation.retract_theories import Theory
from palpate_indentation.sphere_laws import SphereLawFit, poisson_ratio
from palpate_indentation.viscosity import PressViscosity


def table(analysis: Indentation) -> dict[str, Any]:
    """Return the analysis as in ``indentation.json`` [SI], with None for numbers that are not finite."""
    fit = analysis.fit
    document: dict[str, Any] = {
        "parameter": analysis.law.name,
        "unit": analysis.law.unit,
        "value": fit.modulus,
        "std": fit.modulus_std,
        "combined": analysis.combined,
        "surface": {"value": fit.surface, "std": fit.surface_std},
        "baseline": {
            "offset": fit.offset,
            "tilt": fit.tilt,
            "tilt_std": fit.tilt_std,
            "by_tilt": analysis.baseline_fit.by_tilt,
        },
        "viscosity": None if analysis.viscosity is None else _viscosity(analysis.viscosity),
        "budget": [asdict(row) for row in analysis.budget],
        "rms": fit.rms,
        "noise": analysis.press.noise,
        "correlation_time": fit.correlation_time,
        "depth": analysis.depth,
        "rise_over_depth": {"value": analysis.rise[0], "std": analysis.rise[1]},
        "contact_points": {
            name: {"surface": point.surface, "std": point.std, "by_the_fit": point.usual}
            for name, point in analysis.points.items()
        },
        "spheres": {sphere.tip: _sphere(sphere, analysis) for sphere in analysis.spheres},
        "adhesion_on_the_way_in": None if analysis.without_adhesion is None else _way_in(analysis),
        "pull_off": None if analysis.pull is None else {"force": analysis.pull.force, "std": analysis.pull.std},
        "adhesion": {theory.name: _theory(theory, analysis) for theory in analysis.theories},
        "secant": _profile(analysis.secant),
        "tangent": _profile(analysis.tangent),
        "flags": [flag.table() for flag in registries.load().judged(analysis.flags)],
    }
    plain: dict[str, Any] = finite_tree(document)
    return plain


def _viscosity(viscosity: PressViscosity) -> dict[str, Any]:
    return {
        "value": viscosity.value,
        "std": viscosity.std,
        "unit": viscosity.unit,
        "source": viscosity.source,
        "words": viscosity.words,
    }


def bic_above_best(sphere: SphereLawFit, analysis: Indentation) -> float:
    """Return n log(S/S_best), with the sums of squares and the n independent samples at the best law of a sphere.

    All laws have the same number of unknowns.
    """
    best = min(analysis.spheres, key=lambda other: other.log_squares)
    return best.fit.effective * (sphere.log_squares - best.log_squares)


def second_best(analysis: Indentation) -> float | None:
    """Return the BIC of the second-best law of a sphere above that of the best; None without two."""
    differences = sorted(bic_above_best(sphere, analysis) for sphere in analysis.spheres)
    return differences[1] if len(differences) > 1 else None


def _sphere(sphere: SphereLawFit, analysis: Indentation) -> dict[str, Any]:
    return {
        "value": sphere.fit.modulus,
        "std": sphere.fit.modulus_std,
        "surface": sphere.fit.surface,
        "rms": sphere.fit.rms,
        "bic_above_best": bic_above_best(sphere, analysis),
        "chosen": sphere.chosen,
    }


def _way_in(analysis: Indentation) -> dict[str, Any]:
    """Return the theory that is the law, its work of adhesion, and the modulus by the pipeline's own law."""
    fit, without = analysis.fit, analysis.without_adhesion
    assert without is not None
    work = {"adhesion_work": fit.work, "adhesion_work_std": fit.work_std}
    theory = registries.load().name_of(type(analysis.law.model))
    return {"theory": theory, **work, "value_without": without.modulus, "std_without": without.modulus_std}


def _theory(theory: Theory, analysis: Indentation) -> dict[str, Any]:
    assert analysis.radius is not None
    poisson = poisson_ratio(analysis.law.model)
    return {
        "value": theory.modulus,
        "std": theory.modulus_std,
        "adhesion_work": theory.work,
        "adhesion_work_std": theory.work_std,
        "surface": theory.surface,
        "rms": theory.rms,
        "tabor": tabor(analysis.radius, theory.work, theory.modulus, poisson),
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

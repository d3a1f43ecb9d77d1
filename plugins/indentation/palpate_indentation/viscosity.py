"""The viscosity that a press is evaluated with: stated, of the run, of the press itself, or bounded by it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from palpate import Floats
from palpate_engine import PIPELINE, verdict_rank
from palpate_kit.runs.result_file import usable_value
from palpate_kit.runs.run_folder import RunFolder

from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch, Press

_MIN_RATE_SCATTER = 0.2  # of the mean rate in contact (0231): a speed that scatters by more changes within the press
_MIN_OUT_FORCE = 0.1  # of the largest force, a choice: below, a way out may show adhesion, or a tip that has lifted off
_MIN_OUT_SAMPLES = 40  # on the way out, a choice: as many as a way in needs
_AIR_SHARE = 20  # of a way out, a choice: its last twentieth is air
_MIN_BIC_DIFFERENCE = 10.0  # very strong evidence (Kass and Raftery 1995) against one law for both ways
_ADDED_UNKNOWNS = 3.0  # of two ways that are fitted separately: modulus, surface and baseline
_MIN_SIGMAS = 2.0  # standard uncertainties that a viscosity of the press has to exceed (0231)


@dataclass(frozen=True)
class PressViscosity:
    """A value of the viscous parameter, and how well it is known."""

    value: float  # [SI]
    std: float
    unit: str
    source: Literal["stated", "run", "press", "bound"]
    words: str  # the source as a phrase, for people


def viscosity_of_run(place: Path, model: str, parameter: str) -> PressViscosity | None:
    """Return the viscosity in the ``result.json`` of a run folder, or of the one that a file is in.

    Of the tracks of the model the one with the best verdict, and among these the smallest uncertainty; None where no
    track has the parameter with an uncertainty.
    """
    folder = RunFolder(place if place.is_dir() else place.parent)
    if not folder.finished or (place.suffix == ".toml" and place.name != PIPELINE):
        return None
    candidates = sorted(_track_values(folder.result["tracks"], model, parameter), key=lambda candidate: candidate[:2])
    if not candidates:
        return None
    _, std, track, value = candidates[0]
    return PressViscosity(float(value["value"]), std, str(value["unit"]), "run", f"result.json, {track}")


def _track_values(
    tracks: Mapping[str, Any], model: str, parameter: str
) -> Iterator[tuple[int, float, str, Mapping[str, Any]]]:
    """Yield rank of the verdict, combined uncertainty, track and value of each usable value of a parameter."""
    for name, track in tracks.items():
        value = usable_value(track, parameter) if track["model"] == model else None
        if value is not None and value["combined"] is not None:
            yield verdict_rank(track["verdict"]), float(value["combined"]), name, value


def viscosity_of_press(law: ElasticLaw, press: Press, branch: Branch, *, tilt: bool) -> PressViscosity:
    """Return the viscosity that a press shows, or how large it may be.

    It shows in the way in against the way out, where one law explains both, or in a speed that changes on the way in.
    Otherwise it is unknown between none and that of least squares, by both ways where there are two.
    """
    assert law.viscosity_index is not None
    unit, noise = law.model.parameters[law.viscosity_index].unit, press.noise
    has_two_ways = press.retract is not None and branch is not press.retract
    way_out = _in_contact(press.retract) if press.retract is not None and has_two_ways else None

    # Both ways by one law, beyond two standard uncertainties.
    both_ways: CurveFit | None = None
    if way_out is not None and len(way_out) >= _MIN_OUT_SAMPLES:
        both_ways = fit_curve(law, branch.joined_with(way_out), noise, tilt=tilt, viscous=True)
        if _shows_viscosity(both_ways) and _is_one_law(law, branch, way_out, both_ways, noise, tilt=tilt):
            return _press_viscosity(both_ways, unit, "the way in against the way out")

    # A speed that scatters by over 20 % in contact.
    one_way = fit_curve(law, branch, noise, tilt=tilt, viscous=True)
    if _is_uneven(branch.rate[branch.height < one_way.surface]) and _shows_viscosity(one_way):
        return _press_viscosity(one_way, unit, "the speed that changes on the way in")

    # A bound: the estimate and its uncertainty, added in squares.
    widest = one_way if both_ways is None else both_ways
    std = float(np.hypot(widest.viscosity, widest.viscosity_std))
    evidence = "by the way out" if both_ways else "by the way in"
    return PressViscosity(0.0, std, unit, "bound", f"unknown: {evidence}")


def _press_viscosity(fit: CurveFit, unit: str, words: str) -> PressViscosity:
    return PressViscosity(fit.viscosity, fit.viscosity_std, unit, "press", words)


def _shows_viscosity(fit: CurveFit) -> bool:
    """Return True if a fit is sound, and has a viscosity beyond doubt."""
    is_finite = bool(np.isfinite([fit.modulus, fit.viscosity, fit.viscosity_std]).all())
    return is_finite and fit.modulus > 0 and fit.viscosity > _MIN_SIGMAS * fit.viscosity_std


def _is_uneven(rate: Floats) -> bool:
    """Return True for rates (n,) [m/s] that change by more than a share of their mean."""
    return len(rate) > 1 and float(rate.std()) > _MIN_RATE_SCATTER * abs(float(rate.mean()))


def _in_contact(retract: Branch) -> Branch:
    """Return the first part of a way out, until the force has fallen to a tenth."""
    air_force = float(np.median(retract.force[-max(len(retract) // _AIR_SHARE, 1) :]))
    limit = _MIN_OUT_FORCE * float(retract.force.max() - air_force)
    low_rows = np.flatnonzero(retract.force - air_force < limit)
    return retract.select(slice(0, int(low_rows[0]) if len(low_rows) else len(retract)))


def _is_one_law(
    law: ElasticLaw, way_in: Branch, way_out: Branch, both_ways: CurveFit, noise: float, *, tilt: bool
) -> bool:
    """Return True if one law with its viscosity explains both ways no worse than two laws, and the way in no worse.

    By BIC: two laws are the fit of each way with the same viscosity; for the way in, the law without viscosity. All
    readings count, correlated or not, since correlated residuals here are not noise.
    """
    viscous_law = law.with_viscosity(law.held[law.viscosity_index or 0] + both_ways.viscosity)
    in_squares = _squares(fit_curve(viscous_law, way_in, noise, tilt=tilt))
    in_squares_without = _squares(fit_curve(law, way_in, noise, tilt=tilt))
    out_squares = _squares(fit_curve(viscous_law, way_out, noise, tilt=False))

    count = len(way_in) + len(way_out)
    log_rise_both = np.log(_squares(both_ways) / (in_squares + out_squares))
    log_rise_in = np.log(in_squares / in_squares_without)
    # Very strong evidence is 10 of BIC; two laws have a modulus, a surface and a baseline more.
    explains_both = count * log_rise_both <= _MIN_BIC_DIFFERENCE + _ADDED_UNKNOWNS * np.log(count)
    explains_way_in = len(way_in) * log_rise_in <= _MIN_BIC_DIFFERENCE
    return bool(explains_both and explains_way_in)


def _squares(fit: CurveFit) -> float:
    """Return the sum of squared residuals [N^2]."""
    return float(fit.residual @ fit.residual)

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

_UNEVEN = 0.2  # of the mean rate in contact: a speed that scatters by more changes within the press
_HIGH = 0.1  # of the largest force: on the way out, less may be adhesion, or a tip that the material no longer follows
_FEWEST = 40  # samples on the way out
_DECISIVE = 10.0  # of BIC, by which both ways apart explain the press better than one law
_UNKNOWNS = 3.0  # that the two ways have more when they are fitted apart: modulus, surface, baseline
_SURE = 2.0  # standard uncertainties


@dataclass(frozen=True)
class PressViscosity:
    """A value of the viscous parameter, and how well it is known."""

    value: float  # [SI]
    std: float
    unit: str
    source: Literal["stated", "run", "press", "bound"]
    words: str  # where it comes from


def viscosity_of_run(place: Path, model: str, parameter: str) -> PressViscosity | None:
    """Return the viscosity in the ``result.json`` of a run folder, or of the one that a file is in.

    Of the tracks of the model the one with the best verdict, and among these the smallest uncertainty; None where no
    track has the parameter with an uncertainty.
    """
    folder = RunFolder(place if place.is_dir() else place.parent)
    if not folder.finished or (place.suffix == ".toml" and place.name != PIPELINE):
        return None
    found = sorted(_values(folder.result["tracks"], model, parameter), key=lambda one: one[:2])
    if not found:
        return None
    _, std, track, value = found[0]
    return PressViscosity(float(value["value"]), std, str(value["unit"]), "run", f"result.json, {track}")


def _values(
    tracks: Mapping[str, Any], model: str, parameter: str
) -> Iterator[tuple[int, float, str, Mapping[str, Any]]]:
    for name, track in tracks.items():
        value = usable_value(track, parameter) if track["model"] == model else None
        if value is not None and value["combined"] is not None:
            yield verdict_rank(track["verdict"]), float(value["combined"]), name, value


def viscosity_of_press(law: ElasticLaw, press: Press, branch: Branch, *, tilt: bool) -> PressViscosity:
    """Return the viscosity that a press shows, or how large it may be.

    It shows in the way in against the way out, where one law explains both, or in a speed that changes on the way in.
    Otherwise it is unknown between none and what least squares would choose, by both ways where there are two.
    """
    assert law.viscous is not None
    unit, noise = law.model.parameters[law.viscous].unit, press.noise
    out = None if press.retract is None or branch is press.retract else _in_contact(press.retract)
    both: CurveFit | None = None
    if out is not None and len(out) >= _FEWEST:
        both = fit_curve(law, branch.joined(out), noise, tilt=tilt, viscous=True)
        if _is_told(both) and _is_one_law(law, branch, out, both, noise, tilt=tilt):
            return _told(both, unit, "the way in against the way out")
    alone = fit_curve(law, branch, noise, tilt=tilt, viscous=True)
    if _is_uneven(branch.rate[branch.height < alone.surface]) and _is_told(alone):
        return _told(alone, unit, "the speed that changes on the way in")
    most = alone if both is None else both
    std = float(np.hypot(most.viscosity, most.viscosity_std))
    return PressViscosity(0.0, std, unit, "bound", "unknown: " + ("by the way out" if both else "by the way in"))


def _told(fit: CurveFit, unit: str, words: str) -> PressViscosity:
    return PressViscosity(fit.viscosity, fit.viscosity_std, unit, "press", words)


def _is_told(fit: CurveFit) -> bool:
    """Return True if a fit is sound, and has a viscosity beyond doubt."""
    sound = bool(np.isfinite([fit.modulus, fit.viscosity, fit.viscosity_std]).all()) and fit.modulus > 0
    return sound and fit.viscosity > _SURE * fit.viscosity_std


def _is_uneven(rate: Floats) -> bool:
    return len(rate) > 1 and float(rate.std()) > _UNEVEN * abs(float(rate.mean()))


def _in_contact(retract: Branch) -> Branch:
    """Return the beginning of a way out, until the force has fallen to a tenth."""
    air = float(np.median(retract.force[-max(len(retract) // 20, 1) :]))
    low = np.flatnonzero(retract.force - air < _HIGH * float(retract.force.max() - air))
    return retract.part(slice(0, int(low[0]) if len(low) else len(retract)))


def _is_one_law(law: ElasticLaw, way_in: Branch, out: Branch, both: CurveFit, noise: float, *, tilt: bool) -> bool:
    """Whether one law explains the press: no worse than each way by itself, and the way in no worse than without.

    All readings count, correlated or not: where they are, something else is going on than noise.
    """
    known = law.with_viscosity(law.held[law.viscous or 0] + both.viscosity)
    with_it, without = (fit_curve(one, way_in, noise, tilt=tilt) for one in (known, law))
    apart = _squares(with_it) + _squares(fit_curve(known, out, noise, tilt=False))
    worse, more = np.log(_squares(both) / apart), np.log(_squares(with_it) / _squares(without))
    count = len(way_in) + len(out)
    return bool(count * worse <= _DECISIVE + _UNKNOWNS * np.log(count) and len(way_in) * more <= _DECISIVE)


def _squares(fit: CurveFit) -> float:
    return float(fit.residual @ fit.residual)

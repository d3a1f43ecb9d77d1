"""The units of a CSV file's columns, where its header does not state them."""

from __future__ import annotations

import numpy as np
from palpate_kit.logs.readings import si_unit
from palpate_kit.logs.role_guess import RoleGuess
from palpate_kit.logs.suggestion import force_unit, length_unit

DIMENSIONS = {"N": "force", "m": "position", "m/s": "velocity"}  # roles, by the SI unit of a column
_LIKE = 0.25  # by which a velocity may miss the slope of the position, of their units' ratio


def units_of(found: RoleGuess, clocked: bool) -> tuple[dict[str, str], list[str]]:
    """Units from the header, else the likeliest; and which of them are guesses; `clocked`: its time is known."""
    units = {
        r: p.series.unit
        for r, p in found.picks.items()
        if p.series.unit and DIMENSIONS.get(si_unit(p.series.unit)[0]) == r
    }
    doubts = []
    spans = {r: float(np.subtract(*np.nanpercentile(p.series.values, (99.8, 0.2)))) for r, p in found.picks.items()}
    if "position" not in units:
        units["position"] = length_unit(spans["position"])
        doubts.append(f"unit of the position: {units['position']} is a guess from its range: {spans['position']:.3g}")
    way = spans["position"] * si_unit(units["position"])[1]
    if "force" not in units:
        units["force"], elasticity = force_unit(spans["force"], way)
        doubts.append(
            f"unit of the force: {units['force']} is a guess: a tip of 5 mm would then measure some "
            f"{elasticity / 1e3:.3g} kPa"
        )
    if "velocity" in found.picks and "velocity" not in units:
        units["velocity"], doubt = _speed_unit(found, units["position"], clocked)
        doubts.append(doubt)
    return units, doubts


def _speed_unit(found: RoleGuess, length: str, clocked: bool) -> tuple[str, str]:
    """The unit in which a velocity is the slope of the position."""
    if not clocked or not found.gain:
        return f"{length}/s", f"unit of the velocity: {length}/s is a guess, like that of the position"
    ratios = {unit: abs(found.gain) * si_unit(unit)[1] / si_unit(length)[1] for unit in ("m/s", "mm/s", "um/s", "cm/s")}
    unit = min(ratios, key=lambda u: abs(np.log(ratios[u])))
    fits = abs(ratios[unit] - 1.0) < _LIKE
    by = (
        "with which it is the slope of the position"
        if fits
        else f"though it is {ratios[unit]:.2f} times the position's slope"
    )
    return unit, f"unit of the velocity: {unit} is a guess, {by}"

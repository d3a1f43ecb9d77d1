"""The units of a CSV file's columns, where its header does not state them."""

from __future__ import annotations

import re

import numpy as np
from palpate import Floats, Indenter
from palpate_kit.logs.role_evidence import span_of
from palpate_kit.logs.role_guess import Pick, RoleGuess
from palpate_kit.logs.suggestion import force_unit, length_unit
from palpate_records.messages.readings import si_unit
from palpate_records.tables.cells import number_or_nan
from palpate_records.tables.csv_names import is_unit, plain_unit, stated_role, weight_of
from palpate_records.tables.csv_sheet import Sheet

DIMENSIONS = {"N": "force", "m": "position", "m/s": "velocity"}  # roles, by the SI unit of a column
_SCALED = {"force": "N", "position": "mm", "velocity": "mm/s"}  # what volts and counts are scaled to
_COUNTS_PER_FORCE = re.compile(r"counts? ?(?:per|/) ?(?:unit )?(?:force|n|newton)|cpf")
_MIN_COUNTS = 1000.0  # a force or height in whole units goes less far; the coarsest converter, of 10 bits, has 1024
_FORCE_UNIT = re.compile(r"(?:force unit|unit of force|unit force)s?")
_LIKE = 0.25  # by which a velocity may miss the slope of the position, of their units' ratio


def units_of(
    found: RoleGuess, sheet: Sheet, clocked: bool, tip: Indenter | None = None
) -> tuple[dict[str, str], dict[str, str]]:
    """Units by role from the header, else the likeliest under a tip; and what is said of those.

    `clocked`: its time is known.
    """
    picks = found.picks
    columns = {role: int(pick.series.key[1]) for role, pick in picks.items()}
    units = {r: u for r, k in columns.items() if (u := sheet.unit(k)) and DIMENSIONS.get(si_unit(u)[0]) == r}
    guesses: dict[str, str] = {}
    spans = {r: span_of(p.series.values) for r, p in picks.items()}
    for role, pick in picks.items():
        if role not in units and needs_scale(sheet, pick, role):
            units[role] = _SCALED[role]
    weight = weight_of(sheet.written_unit(columns["force"]))
    if weight and "force" not in units:
        units["force"] = weight
        written = sheet.written_unit(columns["force"])
        guesses["force"] = f"unit of the force: {weight} is a guess: a load in {written} is taken for its weight"
    if "position" not in units:
        units["position"] = length_unit(spans["position"], tip)
        guesses["position"] = (
            f"unit of the position: {units['position']} is a guess from its range: {spans['position']:.3g}"
        )
    way = spans["position"] * si_unit(units["position"])[1] * sheet.scale(columns["position"])
    if "force" not in units:
        units["force"], elasticity = force_unit(spans["force"], way, tip)
        by = "the tip" if tip is not None else "a tip of 5 mm"
        guesses["force"] = (
            f"unit of the force: {units['force']} is a guess: {by} would then measure some {elasticity / 1e3:.3g} kPa"
        )
    if "velocity" in picks and "velocity" not in units:
        units["velocity"], guesses["velocity"] = _speed_unit(found, units["position"], clocked)
    return units, guesses


def counts_of_header(sheet: Sheet, values: Floats) -> dict[str, str]:
    """Return the units of forces that a file has in counts, by column, as "1e-06 N"; by a line as Counts per Force."""
    stated = {fact.name.strip().lower(): fact.value for fact in sheet.facts}
    counts = next((number_or_nan(stated[name]) for name in stated if _COUNTS_PER_FORCE.fullmatch(name)), float("nan"))
    unit = next((plain_unit(stated[name]) for name in stated if _FORCE_UNIT.fullmatch(name)), "N")
    if not counts > 0.0 or not is_unit(unit):
        return {}
    forces = [k for k, name in enumerate(sheet.names) if stated_role(name) == "force"]
    whole = [k for k in forces if not (values[np.isfinite(values[:, k]), k] % 1.0).any()]
    return {sheet.names[k]: f"{1.0 / counts:.10g} {unit}" for k in whole}


def needs_scale(sheet: Sheet, pick: Pick, role: str) -> bool:
    """Return True if only a person knows how much one of a column is: a reading, or a unit or name of another kind."""
    k = int(pick.series.key[1])
    if sheet.needs_scale(k):
        return True
    if (unit := sheet.unit(k)) is not None:
        return DIMENSIONS.get(si_unit(unit)[0]) != role
    if weight_of(sheet.written_unit(k)) is not None:
        return False
    named = stated_role(sheet.names[k]) if sheet.header else None
    return named not in (None, role) or are_counts(pick.series.values)


def are_counts(values: Floats) -> bool:
    """Return True for whole numbers (n,) of a range that a converter, an encoder or the steps of a motor have."""
    finite = values[np.isfinite(values)]
    return not (finite % 1.0).any() and float(np.ptp(finite)) > _MIN_COUNTS


def _speed_unit(found: RoleGuess, length: str, clocked: bool) -> tuple[str, str]:
    """Return the unit in which a velocity is the slope of the position."""
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

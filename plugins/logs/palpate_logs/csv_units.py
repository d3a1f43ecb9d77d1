"""The units of a CSV file's columns, where its header does not state them."""

from __future__ import annotations

import re
from collections.abc import Mapping

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
_SCALED_UNITS = {"force": "N", "position": "mm", "velocity": "mm/s"}  # that the scale of volts and counts leads to
_COUNTS_PER_FORCE = re.compile(r"counts? ?(?:per|/) ?(?:unit )?(?:force|n|newton)|cpf")
_FORCE_UNIT = re.compile(r"(?:force unit|unit of force|unit force)s?")
_MIN_COUNT_RANGE = 1000.0  # a force or height in whole units goes less far; a converter of 10 bits has 1024 (0610)
_SPEED_UNITS = ("m/s", "mm/s", "um/s", "cm/s")
_SLOPE_TOLERANCE = 0.25  # relative, of a velocity to the slope of its position; a choice, units are ten times apart


def units_of(
    guess: RoleGuess, sheet: Sheet, *, has_time: bool, tip: Indenter | None = None
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the unit of each role, and for each unit that is a guess a sentence on that.

    A unit is that which the header or a person states; of volts and counts that which a scale leads to; of a load in
    a unit of mass that of its weight; else the likeliest by the range of the numbers, under a tip.
    """
    picks = guess.picks
    columns = {role: int(pick.series.key[1]) for role, pick in picks.items()}  # indices; a key is topic and column
    spans = {role: span_of(pick.series.values) for role, pick in picks.items()}
    units = _stated_units(sheet, columns)
    unit_guesses: dict[str, str] = {}
    for role, pick in picks.items():
        if role not in units and needs_scale(sheet, pick, role):
            units[role] = _SCALED_UNITS[role]
    # A load in grams is a weight.
    written_unit = sheet.written_unit(columns["force"])
    weight_unit = weight_of(written_unit)
    if weight_unit and "force" not in units:
        units["force"] = weight_unit
        unit_guesses["force"] = (
            f"unit of the force: {weight_unit} is a guess: a load in {written_unit} is taken for its weight"
        )
    # The position first: the force of a press depends on its depth.
    if "position" not in units:
        units["position"] = length_unit(spans["position"], tip)
        unit_guesses["position"] = (
            f"unit of the position: {units['position']} is a guess from its range: {spans['position']:.3g}"
        )
    if "force" not in units:
        travel = spans["position"] * si_unit(units["position"])[1] * sheet.scale(columns["position"])  # [m]
        units["force"], unit_guesses["force"] = _guess_force_unit(spans["force"], travel, tip)
    if "velocity" in picks and "velocity" not in units:
        units["velocity"], unit_guesses["velocity"] = _guess_speed_unit(guess, units["position"], has_time)
    return units, unit_guesses


def _guess_force_unit(span: float, travel: float, tip: Indenter | None) -> tuple[str, str]:
    """Return the likeliest unit of a force by its range as recorded and that of the position [m], and a sentence."""
    unit, elasticity = force_unit(span, travel, tip)
    tip_name = "the tip" if tip is not None else "a tip of 5 mm"
    return unit, f"unit of the force: {unit} is a guess: {tip_name} would then measure some {elasticity / 1e3:.3g} kPa"


def _stated_units(sheet: Sheet, columns: Mapping[str, int]) -> dict[str, str]:
    """Return the units of columns, by role, which the header or a person states, if they are of the role's kind."""
    units: dict[str, str] = {}
    for role, column in columns.items():
        unit = sheet.unit(column)
        if unit and DIMENSIONS.get(si_unit(unit)[0]) == role:
            units[role] = unit
    return units


def counts_of_header(sheet: Sheet, values: Floats) -> dict[str, str]:
    """Return the force of one count, as "1e-06 N", for each column of forces in counts, by name.

    A line above the names states it, such as "Counts per Force: 1000000". `values` (n, columns) are the numbers of the
    sheet; forces that are not whole numbers are in the unit already.
    """
    facts = {fact.name.strip().lower(): fact.value for fact in sheet.facts}
    counts_per_force = next((number_or_nan(facts[name]) for name in facts if _COUNTS_PER_FORCE.fullmatch(name)), 0.0)
    unit = next((plain_unit(facts[name]) for name in facts if _FORCE_UNIT.fullmatch(name)), "N")
    if not counts_per_force > 0.0 or not is_unit(unit):
        return {}
    units: dict[str, str] = {}
    for column, name in enumerate(sheet.names):
        numbers = values[np.isfinite(values[:, column]), column]
        if stated_role(name) == "force" and not (numbers % 1.0).any():
            units[name] = f"{1.0 / counts_per_force:.10g} {unit}"
    return units


def needs_scale(sheet: Sheet, pick: Pick, role: str) -> bool:
    """Return True if only a person knows how much one number of a role's column is.

    The column is in volts or counts, or its unit or name is that of another quantity.
    """
    column = int(pick.series.key[1])
    if sheet.needs_scale(column):
        return True
    unit = sheet.unit(column)
    if unit is not None:
        return DIMENSIONS.get(si_unit(unit)[0]) != role
    if weight_of(sheet.written_unit(column)) is not None:
        return False
    name_role = stated_role(sheet.names[column]) if sheet.header else None
    return name_role not in (None, role) or are_counts(pick.series.values)


def are_counts(values: Floats) -> bool:
    """Return True for whole numbers (n,) of a range that a converter, an encoder or the steps of a motor have."""
    finite = values[np.isfinite(values)]
    return not (finite % 1.0).any() and float(np.ptp(finite)) > _MIN_COUNT_RANGE


def _guess_speed_unit(guess: RoleGuess, length: str, has_time: bool) -> tuple[str, str]:
    """Return the unit in which the velocity is nearest to the slope of the position, and a sentence on that guess.

    `length` is the unit of the position; without a time or a slope, the unit is that length per second.
    """
    if not has_time or not guess.gain:
        return f"{length}/s", f"unit of the velocity: {length}/s is a guess, like that of the position"
    ratios = {unit: abs(guess.gain) * si_unit(unit)[1] / si_unit(length)[1] for unit in _SPEED_UNITS}
    unit = min(ratios, key=lambda candidate: abs(np.log(ratios[candidate])))
    reason = f"though it is {ratios[unit]:.2f} times the position's slope"
    if abs(ratios[unit] - 1.0) < _SLOPE_TOLERANCE:
        reason = "with which it is the slope of the position"
    return unit, f"unit of the velocity: {unit} is a guess, {reason}"
